"""A served vehicle: the twin with what a real one brings along, its own controllers and its own filter."""

from dataclasses import replace
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.block import Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Command, Estimate, Measurements
from rovtwin.core.frames import readings_in_body
from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.core.types import Index, Matrix3, PRNGKey, Vector6
from rovtwin.gnc.interfaces import ObserverInput
from rovtwin.runs.compose.autopilot import navigation_filter
from rovtwin.runs.compose.composition import Simulation, compose, vehicle_of
from rovtwin.runs.compose.sensors import rotated
from rovtwin.scenario.schema import ModelBasedSection, Scenario
from rovtwin.simulation.sensors.sensor import Sensor
from rovtwin.simulation.twin import Twin, TwinInput
from rovtwin.simulation.vehicle_firmware import Onboard, OnboardInput, OnboardMemory, Order, Sense, Sensed, SenseMemory
from rovtwin.vehicle import Model, Vehicle
from rovtwin.vehicle.physics.dynamics import State
from rovtwin.vehicle.physics.thrusters import Thrusters

OF_A_DRONE = ("pressure", "accelerometer", "gyro", "attitude", "battery", "leak")  # each drone has its own
MODEL_BASED = ModelBasedSection(type="model_based")  # whose filter stands for the vehicle's own


class ServedMemory(eqx.Module):
    """Memories of the parts, the readings of the last tick, and what thrusters were sent."""

    twin: Any
    filter: Any
    senses: dict[str, SenseMemory]
    onboards: dict[str, OnboardMemory]
    measurements: Measurements
    command: Command


class ServedOutput(eqx.Module):
    """What one tick leaves.

    Attributes:
        state: Truth at its end.
        measurements: Readings delivered within it, those of imus along the axes of b; a drone's as `port/attitude`.
        estimate: The estimate of the vehicle's own filter, before it.
        command: Of all thrusters during it.
        tau: Wrench that each drone's controller asked for, b at the drone [N, N m], by drone.
    """

    state: State
    measurements: Measurements
    estimate: Estimate
    command: Command
    tau: dict[str, Vector6]


class Served(eqx.Module):
    """Twin, controllers and filter. `tick` runs control period k: drones obey their orders, then the twin moves on.

    Attributes:
        twin: With the sensors of each drone.
        filter: Of the whole vehicle, fed with the first drone's sensors.
        senses: What each drone knows of itself; empty for a vehicle that is one: it has the filter.
        onboards: Each drone's controller.
        rotations: R_bs of the twin's imus that do not point along b, by sensor: a vehicle turns their readings before
            its filter, its controllers and its clients get them. A DVL tells along its own axes.
        places: Which of the twin's thrusters are a drone's, by drone.
    """

    twin: Twin
    filter: Any
    senses: dict[str, Sense]
    onboards: dict[str, Onboard]
    rotations: dict[str, Matrix3]
    places: dict[str, tuple[int, ...]] = eqx.field(static=True)

    @property
    def drones(self) -> tuple[str, ...]:
        return tuple(self.places)

    def init(self, key: PRNGKey, start: Start) -> ServedMemory:
        """Memory before tick 0: no reading has come yet."""
        return ServedMemory(
            twin=self.twin.init(key, start),
            filter=self.filter.init(key, start),
            senses={name: sense.init(key, start) for name, sense in self.senses.items()},
            onboards={name: onboard.init(key, start) for name, onboard in self.onboards.items()},
            measurements=self.twin.empty(),
            command=Command(jnp.zeros(self.twin.model.thrusters.count)),
        )

    def tick(
        self, memory: ServedMemory, orders: dict[str, Order], k: Index, dt: float
    ) -> tuple[ServedMemory, ServedOutput]:
        """One control period; an order for each drone."""
        measured = _of_drone(memory.measurements, self.drones[0])
        filtered, estimate = self.filter.step(memory.filter, ObserverInput(measured, memory.command), dt)
        senses, onboards, tau = {}, {}, {}
        u = jnp.zeros_like(memory.command.u)
        for name, onboard in self.onboards.items():
            sensed = Sensed(estimate.eta, estimate.nu, jnp.ones(6, dtype=bool))
            if name in self.senses:
                senses[name], sensed = self.senses[name].step(memory.senses[name], memory.measurements, dt)
            seen = OnboardInput(orders[name], sensed.eta, sensed.nu, sensed.known)
            onboards[name], asked = onboard.step(memory.onboards[name], seen, dt)
            mine = np.arange(u.shape[0])[:, None] == np.array(self.places[name])
            u = u + jnp.sum(jnp.where(mine, asked.command.u, 0.0), axis=1)  # no scatter: it would not compile as one
            tau[name] = asked.tau
        command = Command(u)
        twin, moved = self.twin.step(memory.twin, TwinInput(command, k), dt)
        published = self._along_b(moved.measurements)
        return (
            ServedMemory(twin, filtered, senses, onboards, published, command),
            ServedOutput(moved.state, published, estimate, command, tau),
        )

    def _along_b(self, measurements: Measurements) -> Measurements:
        """Readings with those of imus along the axes of b."""
        found = dict(measurements)
        for name, rotation in self.rotations.items():
            value = readings_in_body(found[name].value, self.twin.sensors[name].kind, rotation)
            found[name] = replace(found[name], value=value)
        return found


def _of_drone(measurements: Measurements, drone: str) -> Measurements:
    """The readings that a filter of the whole vehicle takes: a drone's own, and the vehicle's."""
    mine = {name.removeprefix(f"{drone}/"): slot for name, slot in measurements.items() if name.startswith(f"{drone}/")}
    return {name: slot for name, slot in measurements.items() if "/" not in name} | mine


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
    first = _of_drone(sensors | straight, next(iter(drones)))  # type: ignore[arg-type]  (sensors by name, as readings)
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


def orders(served: Served) -> dict[str, Order]:
    """No order for any drone."""
    return jax.tree.map(jnp.asarray, {name: Order.none() for name in served.drones})
