"""From a scenario to blocks: the only place where vehicle, world, sensors and autopilot meet."""

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

from rovtwin.core.block import Block, Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Mission
from rovtwin.core.frames import quaternion_from_euler
from rovtwin.core.numerics import jax, jnp
from rovtwin.core.sensors import SENSORS, SensorKind
from rovtwin.core.types import PRNGKey
from rovtwin.gnc.guidance.mission import mission as mission_of
from rovtwin.gnc.navigation.accuracy_bound import position_bound
from rovtwin.gnc.scales import VehicleScales
from rovtwin.runs.compose.acoustic import as_white
from rovtwin.runs.compose.autopilot import autopilot_of
from rovtwin.runs.compose.battery import battery_of
from rovtwin.runs.compose.experiment import experiment_of, hand_of
from rovtwin.runs.compose.faults import faults_of, listed
from rovtwin.runs.compose.fit_experiment import fitted_test
from rovtwin.runs.compose.fitting import fitted
from rovtwin.runs.compose.inside import require_inside
from rovtwin.runs.compose.own_blocks import forces_of, require_own_sensors
from rovtwin.runs.compose.sensors import OnBoard, on_board, sensors_of, together
from rovtwin.runs.compose.tethers import tethers_of
from rovtwin.runs.compose.topside import topside_of
from rovtwin.runs.compose.world import mismatch_of, plant_of, world_of
from rovtwin.runs.loop import Loop
from rovtwin.runs.vehicle_defaults import vehicle_of
from rovtwin.scenario.schema import Scenario, WorldSection
from rovtwin.simulation.sensors.sensor import Sensor
from rovtwin.simulation.twin import Twin
from rovtwin.vehicle import Model, Vehicle, summary
from rovtwin.vehicle.analysis.stability import afloat

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Simulation:
    """A scenario, ready to run.

    Attributes:
        loop: Autopilot and twin.
        key: Seeds all randomness of the run.
        start: Where it begins.
        model: The autopilot's; the plant is `loop.twin.model`.
        thruster_names, sensor_names, battery_names: For the log; batteries only if they are simulated.
        vehicle: Its description.
        faults: What breaks and when, for the report.
        scenario: What it was made from, with what it left out (`fitting`) and the test as the vehicle flies it
            (`fit_experiment`).
    """

    loop: Loop
    key: PRNGKey
    start: Start
    model: Model
    thruster_names: list[str]
    sensor_names: list[str]
    battery_names: list[str]
    vehicle: Vehicle
    faults: list[dict[str, Any]]
    scenario: Scenario

    @cached_property
    def vehicle_table(self) -> dict[str, Any]:
        """Parameters of the vehicle and what follows from them, for the report; longer to compute than to compose."""
        return summary(self.vehicle)

    @cached_property
    def mismatch(self) -> dict[str, float] | None:
        """How the true vehicle of a simulated run differs from the model, by factors; None where it does not."""
        return mismatch_of(self.scenario.world, self.vehicle, self.model, self.loop.twin.model)

    @property
    def sensor_kinds(self) -> dict[str, SensorKind]:
        """What each sensor reads, by name."""
        return {name: sensor.row for name, sensor in self.loop.twin.sensors.items()}

    @cached_property
    def on_board(self) -> OnBoard:
        """Which sensors it has, and which part carries each."""
        return on_board(self.scenario, self.vehicle)

    @property
    def paid_out(self) -> float:
        """Length of all tethers at the start [m], 0 without one."""
        return sum(float(tether.paid_out_at(self.start)) for tether in self.loop.twin.tethers.values())

    @cached_property
    def white_sensors(self) -> dict[str, Sensor]:
        """The sensors with white noise in place of errors that last: what those get who know no other."""
        walk = VehicleScales.of(self.model).force_walk
        return {name: as_white(one, self.model, walk) for name, one in self.loop.twin.sensors.items()}

    @property
    def position_noise(self) -> float:
        """Standard deviation of one position, each axis [m]; the usual one where the scenario has none or no noise."""
        found = together(self.white_sensors, "position")
        return (found[0] if found else 0.0) or SENSORS["position"].std

    def bound(self, speed: float) -> list[float]:
        """Steady-state sigma of the position in surge and sway of the best filter with these sensors [m].

        Args:
            speed: At which the model is linearised [m/s].
        """
        walk = VehicleScales.of(self.model).force_walk
        position, dvl, accelerometer = (
            together(self.white_sensors, kind) for kind in ("position", "dvl", "accelerometer")
        )
        assert position is not None and accelerometer is not None
        waves = self.scenario.world.waves
        result = position_bound(
            self.model,
            speed,
            *position,
            getattr(waves, "drift", 0.0) or walk,
            dvl_sigma=dvl[0] if dvl else None,
            dvl_rate=dvl[1] if dvl else None,
            accelerometer_sigma=accelerometer[0],
            accelerometer_rate=accelerometer[1],
        )
        return [float(value) for value in result]


def compose(
    scenario: Scenario,
    truth: Model | None = None,
    vehicle: Vehicle | None = None,
    own: Mapping[str, Block] | None = None,
) -> Simulation:
    """Blocks of a scenario.

    Args:
        scenario: What to fly.
        truth: The vehicle as it truly is, before what the world does to it (`thruster_health`, `net_buoyancy`); None:
            as the world's `water` and `mismatch` make it.
        vehicle: In place of the scenario's.
        own: Blocks that were handed over in Python, by key of the scenario's autopilot.

    Raises:
        ConfigError: The vehicle cannot be used, or does not fit the scenario.
    """
    vehicle = vehicle or vehicle_of(scenario)
    model = vehicle.model()
    _say_doubts(vehicle.where, tuple(vehicle.doubts))
    scenario = fitted(fitted_test(scenario, vehicle), model)
    if not vehicle.thruster_names:
        raise ConfigError(f"{vehicle.name}: has no thrusters, so that it cannot fly. Choose a vehicle or add thrusters")
    key_plant, key_run = keys_of(scenario.seed)
    sensors = sensors_of(scenario, vehicle)
    plant = plant_of(scenario.world, vehicle, model, key_plant, truth)
    require_inside(scenario, model)
    start = start_of(scenario, plant)
    tethers = tethers_of(scenario.world, vehicle, start)
    physics_dt = scenario.control_dt / scenario.substeps
    forces = forces_of(scenario.world.forces, plant, start, physics_dt, f"{scenario.name}: world.forces")
    loop = Loop(
        autopilot=experiment_of(scenario, model, vehicle, sensors)
        if scenario.test
        else autopilot_of(scenario, model, sensors, way_points(scenario, model), list(vehicle.thruster_names), own),
        twin=Twin(
            plant,
            world_of(scenario.world, forces),
            sensors,
            scenario.substeps,
            faults_of(scenario, list(vehicle.thruster_names), list(tethers)),
            battery_of(scenario, vehicle),
            tethers=tethers,
            hand=hand_of(scenario) if scenario.test else None,
        ),
        topside=topside_of(scenario),
    )
    require_own_sensors(scenario, loop.twin, start, physics_dt)
    return Simulation(
        loop=loop,
        key=key_run,
        start=start,
        model=model,
        thruster_names=[_field_name(name) for name in vehicle.thruster_names],
        sensor_names=list(sensors),
        battery_names=[_field_name(s.name) for s in vehicle.power_sources] if scenario.battery else [],
        vehicle=vehicle,
        faults=listed(scenario, list(vehicle.thruster_names)),
        scenario=scenario,
    )


keys_of = jax.jit(lambda seed: tuple(jax.random.split(jax.random.key(seed))))
"""Keys of a seed: what draws the plant, and what seeds the run."""


@cache
def _say_doubts(where: str, doubts: tuple[str, ...]) -> None:
    """A line on standard error, once for each vehicle, where its parameters are not to be relied on."""
    if doubts:
        logger.warning("%s: what was identified is not to be relied on: %s", where, "; ".join(doubts))


def water_density(scenario: Scenario) -> float:
    """Density of the water that the vehicle is in [kg/m3]: the scenario's, else what the vehicle is written for."""
    water = scenario.world.water
    return vehicle_of(scenario).assembly.density if water is None else water.kg_per_m3


def _field_name(name: str) -> str:
    """A thruster's name as a field of a log channel, which has no dots."""
    return name.replace(".", "_")


def start_of(scenario: Scenario, plant: Model) -> Start:
    """Where the run begins, at rest."""
    place = below_surface(scenario.start.position, scenario.world, plant)
    level = Start.at(place, scenario.heading)
    if not any(scenario.start.attitude_deg):
        return level
    roll, pitch = (math.radians(angle) for angle in scenario.start.attitude_deg)
    return Start(level.position, quaternion_from_euler(jnp.asarray([roll, pitch, scenario.heading])), level.velocity)


def below_surface(position: list[float], world: WorldSection, model: Model) -> list[float]:
    """A place [m], or the one below it where the vehicle floats: depth 0 means at the surface, not half in air."""
    if not world.surface:
        return position
    return [*position[:2], max(position[2], afloat(model))]


def way_points(scenario: Scenario, model: Model, pad_to: int = 16) -> Mission:
    """The mission's arrays, padded to a multiple of so many rows; way-points on the map become places in n."""
    places = [w.placed(scenario.origin) for w in scenario.waypoints]
    if scenario.world.surface:
        least = afloat(model)  # a search, the same for all: a console checks hundreds of them while it flies
        places = [[*place[:2], max(place[2], least)] for place in places]
    return mission_of(
        [
            {
                "x": place[0],
                "y": place[1],
                "depth": place[2],
                "speed": w.speed,
                "acceptance": w.acceptance,
                "hold_time": w.hold_time,
                "heading": None if w.heading_deg is None else math.radians(w.heading_deg),
                "altitude": w.altitude,
            }
            for w, place in zip(scenario.waypoints, places, strict=True)
        ],
        pad_to=pad_to,
        where=scenario.mission.name if scenario.mission else "mission",
    )
