"""Makes a scenario's vehicle one that is served: with what a real one brings along, its controllers and filter."""

from dataclasses import replace

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import as_array, jnp
from rovtwin.live.serving.served import Served, of_drone
from rovtwin.runs.compose.autopilot import navigation_filter
from rovtwin.runs.compose.composition import Simulation, compose, vehicle_of
from rovtwin.runs.compose.sensors import rotated
from rovtwin.scenario.schema import ModelBasedSection, Scenario
from rovtwin.simulation.sensors.sensor import Sensor
from rovtwin.simulation.vehicle_firmware import Onboard, Sense
from rovtwin.vehicle import Model, Vehicle
from rovtwin.vehicle.physics.thrusters import Thrusters

OF_A_DRONE = ("pressure", "accelerometer", "gyro", "attitude", "battery", "leak")  # each drone has its own
MODEL_BASED = ModelBasedSection(type="model_based")  # whose filter stands for the vehicle's own


def require_no_own_autopilot(scenario: Scenario) -> None:
    """Raise ConfigError where a scenario has blocks of one's own in its autopilot, which does not run where one serves.

    A served vehicle is flown by its own electronics, and those by who connects.
    """
    section = scenario.autopilot
    if isinstance(section, ModelBasedSection) and section.own_blocks:
        key, block = next(iter(section.own_blocks.items()))
        raise ConfigError(
            f"{scenario.name}: autopilot.{key}: found {block.label}, a block of your own, which would not run: a "
            "served vehicle has its own electronics, and the autopilot flies at the other end of the link. Serve it "
            "with --set autopilot=model_based, and fly the scenario as it is with rovtwin fly .. --link"
        )


def served_of(scenario: Scenario) -> tuple[Served, Simulation]:
    """The vehicle of a scenario in its world, with the controllers that it brings along.

    Raises:
        ConfigError: The scenario cannot be composed, or its autopilot has blocks of one's own.
    """
    require_no_own_autopilot(scenario)
    vehicle = vehicle_of(scenario).with_pairs_apart()
    scenario = scenario.model_copy(update={"autopilot": MODEL_BASED})
    simulation = compose(scenario, vehicle=vehicle)
    drones = drones_of(vehicle)
    twin = simulation.loop.twin
    sensors = _sensors(simulation, drones)
    rotations = rotated(sensors)
    straight = {name: eqx.tree_at(lambda s: s.rotation, sensors[name], jnp.eye(3)) for name in rotations}
    first = of_drone(sensors | straight, next(iter(drones)))  # type: ignore[arg-type]  (sensors by name, as readings)
    places, onboards = {}, {}
    for name in drones:
        prefix = f"{name}." if name else ""
        places[name] = tuple(i for i, thruster in enumerate(vehicle.thruster_names) if thruster.startswith(prefix))
        onboards[name] = _onboard(simulation.model, places[name], drones[name], len(drones))
    names = ("pressure", "attitude", "gyro")
    senses = {
        d: Sense(tuple(f"{d}/{n}" for n in names), sensors[f"{d}/pressure"].rate / 1000)  # type: ignore[arg-type]  (three names)
        for d in drones
        if d
    }
    served = Served(
        replace(twin, sensors=sensors, hand=None),  # whoever flies a scenario's test begins when he likes
        navigation_filter(MODEL_BASED, simulation.model, first),  # type: ignore[arg-type]  (as above)
        senses,
        onboards,
        rotations,
        places,
    )
    return served, simulation


def drones_of(vehicle: Vehicle) -> dict[str, Float[np.ndarray, "3"]]:
    """Drones that a vehicle is made of and where they are in b [m]; one without a name if it is one."""
    surge = [t for t in vehicle.assembly.thrusters if t.item.name == "surge"]
    places = {t.name.rpartition(".")[0]: t.placement.position for t in surge}
    return {"": np.zeros(3)} if len(places) < 2 or "" in places else places


def _sensors(simulation: Simulation, drones: dict[str, Float[np.ndarray, "3"]]) -> dict[str, Sensor]:
    """Sensors of the whole vehicle, and each drone's own: those that fly, at the same place of each drone."""
    sensors = simulation.loop.twin.sensors
    if len(drones) == 1:
        return sensors
    own = {}
    for name in OF_A_DRONE:
        if name in sensors:
            part = simulation.on_board.part_of(name)
            home = next((place for drone, place in drones.items() if part.startswith(f"{drone}.")), np.zeros(3))
            for drone, place in drones.items():
                lever = sensors[name].lever + as_array(place - home)
                own[f"{drone}/{name}"] = eqx.tree_at(lambda s: s.lever, sensors[name], lever)
    return {name: sensor for name, sensor in sensors.items() if name not in OF_A_DRONE} | own


def _onboard(model: Model, places: tuple[int, ...], origin: Float[np.ndarray, "3"], drones: int) -> Onboard:
    """A drone's controller: its thrusters seen from its origin, its share of the whole's inertia."""
    chosen = _chosen(model.thrusters, places)
    T = np.asarray(chosen.configuration)
    T = np.concatenate([T[:3], T[3:] - np.cross(np.broadcast_to(origin, (T.shape[1], 3)), T[:3].T).T])
    inertia = np.diagonal(np.asarray(model.inertia)) / drones
    return Onboard.of(replace(chosen, configuration=as_array(T)), inertia)


def _chosen(thrusters: Thrusters, places: tuple[int, ...]) -> Thrusters:
    """Some of the thrusters."""
    index = np.asarray(places)
    shared = {"table_command": thrusters.table_command, "configuration": thrusters.configuration[:, index]}
    each = {f: getattr(thrusters, f) for f in thrusters.__dataclass_fields__ if f not in shared}
    rest = {f: None if values is None else values[index] for f, values in each.items()}
    return replace(thrusters, **shared, **rest)
