"""What a served vehicle is made of, and its tick: compiled once, and kept between processes.

Nothing here knows of scenarios: a program is kept by all that the modules of its code hold.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.flat import Layout
from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Estimate, Measurements
from rovtwin.core.frames import euler_from_quaternion, readings_in_body
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.programs.compiled import in_one_piece, shapes_in_one_piece
from rovtwin.core.types import Index, Matrix3, PRNGKey, Vector6
from rovtwin.gnc.interfaces import ObserverInput
from rovtwin.simulation.twin import Twin, TwinInput
from rovtwin.simulation.vehicle_firmware import Onboard, OnboardInput, OnboardMemory, Order, Sense, Sensed, SenseMemory
from rovtwin.vehicle.physics.dynamics import State


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
        measured = of_drone(memory.measurements, self.drones[0])
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


def of_drone(measurements: Measurements, drone: str) -> Measurements:
    """The readings that a filter of the whole vehicle takes: a drone's own, and the vehicle's."""
    mine = {name.removeprefix(f"{drone}/"): slot for name, slot in measurements.items() if name.startswith(f"{drone}/")}
    return {name: slot for name, slot in measurements.items() if "/" not in name} | mine


def orders(served: Served) -> dict[str, Order]:
    """No order for any drone."""
    return jax.tree.map(jnp.asarray, {name: Order.none() for name in served.drones})


@partial(jax.jit, static_argnames="dt")
def _tick(
    served: Served, memory: ServedMemory, orders: dict[str, Order], k: Index, dt: float
) -> tuple[ServedMemory, ServedOutput]:
    return served.tick(memory, orders, k, dt)


def output_of(served: Served, memory: ServedMemory, orders: dict[str, Order], dt: float) -> ServedOutput:
    """Shapes of what a tick leaves."""
    return shapes_in_one_piece(_tick, served, memory, orders, np.asarray(0), dt=dt)[1]


def advance_of(
    blocks: Layout[Served],
    takes: Layout[dict[str, Order]],
    gives: Layout[tuple[ServedOutput, ServedMemory]],
    dt: float,
) -> Callable[..., Float[Array, " _"]]:
    """A tick from vectors to a vector: blocks, what the last tick gave, orders, and the number of the tick.

    What it gives is followed by the true pose, Euler angles.
    """

    def advance(
        parameters: Float[Array, " _"], before: Float[Array, " _"], taken: Float[Array, " _"], k: Index
    ) -> Float[Array, " _"]:
        _, memory = gives.unflatten(before)
        memory, output = _tick(blocks.unflatten(parameters), memory, takes.unflatten(taken), k, dt=dt)
        pose = jnp.concatenate([output.state.position, euler_from_quaternion(output.state.attitude)])
        return jnp.concatenate([gives.flatten((output, memory)), pose])

    return in_one_piece(advance)
