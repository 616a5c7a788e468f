"""The closed loop: autopilot and twin, compiled together and advanced in chunks of one simulated second."""

from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from rovtwin.core.arrays.batch import batched
from rovtwin.core.arrays.flat import Flat
from rovtwin.core.block import Block, Start
from rovtwin.core.flow import NO_REQUEST, AutopilotInput, AutopilotOutput, Measurements
from rovtwin.core.numerics import jax, jnp
from rovtwin.core.programs.compiled import in_one_piece, jit_once
from rovtwin.core.types import HostArray, Index, PRNGKey, Scalar, Vector3, Vector6
from rovtwin.simulation.battery import BatteryState
from rovtwin.simulation.events.topside import Topside
from rovtwin.simulation.tether.tether import Line
from rovtwin.simulation.twin import Twin, TwinInput
from rovtwin.vehicle.physics.dynamics import State


class LoopMemory(eqx.Module):
    """What the loop remembers between ticks."""

    autopilot: Any
    twin: Any
    state: State
    measurements: Measurements
    water_velocity: Vector3
    external_wrench: Vector6
    surface: Scalar | None

    @property
    def tethers(self) -> dict[str, Line]:
        """Each tether as it is."""
        return {name: tether.line for name, tether in self.twin.tethers.items()}

    @property
    def broken_force(self) -> Index | None:
        """Which force of one's own gave what is no number, see `WorldMemory`."""
        return self.twin.world.broken


class Record(eqx.Module):
    """What one control tick leaves: truth at its instant, readings since the last tick, the autopilot's answer.

    `surface` is the depth of the water's surface above CO, None where the world has none; `battery` None where none is
    simulated; `tethers` by name; `broken_force` as in `WorldMemory`.
    """

    state: State
    water_velocity: Float[HostArray, "*ticks 3"]
    external_wrench: Float[HostArray, "*ticks 6"]
    measurements: Measurements
    autopilot: AutopilotOutput
    surface: Float[HostArray, "*ticks"] | None = None
    battery: BatteryState | None = None
    tethers: dict[str, Line] = eqx.field(default_factory=dict)
    broken_force: Int[HostArray, "*ticks"] | None = None


class Loop(eqx.Module):
    """Autopilot and twin. `tick` runs tick k: the autopilot reads, decides and commands, then the twin moves on."""

    autopilot: Block
    twin: Twin
    topside: Topside | None = None

    def init(self, key: PRNGKey, start: Start, control_dt: float) -> LoopMemory:
        """Memory before tick 0: no reading has come yet."""
        key_autopilot, key_twin = jax.random.split(key)
        twin = self.twin.init(key_twin, start)
        state = State.at(self.twin.model, start)
        _, water = self.twin.world.step(twin.world, state, control_dt / self.twin.substeps)
        return LoopMemory(
            autopilot=self.autopilot.init(key_autopilot, start),
            twin=twin,
            state=state,
            measurements=self.twin.empty(),
            water_velocity=water.velocity,
            external_wrench=water.wrench,
            surface=water.surface,
        )

    def tick(self, memory: LoopMemory, k: Index, control_dt: float) -> tuple[LoopMemory, Record]:
        """One control period; k counts control ticks and is the same for all vehicles of a batch."""
        inputs = AutopilotInput(memory.measurements, jnp.asarray(NO_REQUEST))
        if self.topside:
            host, request, pilot = self.topside.at(k * control_dt, control_dt)
            inputs = AutopilotInput(memory.measurements, request, host, pilot)
        autopilot, decided = self.autopilot.step(memory.autopilot, inputs, control_dt)
        record = Record(
            memory.state,
            memory.water_velocity,
            memory.external_wrench,
            memory.measurements,
            decided,
            memory.surface,
            memory.twin.battery,
            memory.tethers,
            memory.broken_force,
        )
        twin, moved = self.twin.step(memory.twin, TwinInput(decided.command, k), control_dt)
        after = LoopMemory(
            autopilot=autopilot,
            twin=twin,
            state=moved.state,
            measurements=moved.measurements,
            water_velocity=moved.environment.velocity,
            external_wrench=moved.environment.wrench,
            surface=moved.environment.surface,
        )
        return after, record


def _chunk(loop: Loop, memory: LoopMemory, k: Index, ticks: int, control_dt: float) -> tuple[LoopMemory, Record]:
    def one(carry: LoopMemory, i: Index) -> tuple[LoopMemory, Record]:
        return loop.tick(carry, i, control_dt)

    return jax.lax.scan(one, memory, k + jnp.arange(ticks))


def _chunk_batch(
    loops: Loop, memories: LoopMemory, k: Index, ticks: int, control_dt: float
) -> tuple[LoopMemory, Record]:
    return batched(lambda loop, memory: _chunk(loop, memory, k, ticks, control_dt))(loops, memories)


# Every leaf of a Loop is an array, so plain jit serves: called once a simulated second, it costs 0.2 ms; equinox's
# filtered one, which looks at every leaf in Python, 4 ms.
start_loop = jit_once(Loop.init, static_argnames="control_dt")
"""Compiled `Loop.init`: `start_loop(loop, key, start, control_dt=...)`."""

start_batch = jax.jit(
    lambda loops, keys, starts, control_dt: jax.vmap(lambda *one: one[0].init(*one[1:], control_dt))(
        loops, keys, starts
    ),
    static_argnames="control_dt",
)
"""The same for loops, keys and starts with a leading axis."""

advance = jax.jit(_chunk, static_argnames=("ticks", "control_dt"), donate_argnames=("memory",))
"""`advance(loop, memory, k, ticks=, control_dt=)`: `ticks` control ticks from tick k on; memory after them and their
records, leading axis `ticks`. The memory given is used up."""

advance_batch = jax.jit(_chunk_batch, static_argnames=("ticks", "control_dt"), donate_argnames=("memories",))
"""The same for a batch of vehicles: a leading axis on every array of loops and memories; records (n, ticks, ...)."""


def _begin(loop: Loop, key: PRNGKey, start: Start, *, control_dt: float) -> tuple[Flat[Loop], Flat[LoopMemory]]:
    return Flat.of(loop), Flat.of(loop.init(key, start, control_dt))


def _advance_flat(
    loop: Flat[Loop], memory: Flat[LoopMemory], k: Index, *, ticks: int, control_dt: float
) -> tuple[Flat[LoopMemory], Flat[Record]]:
    parameters = loop.tree

    def one(carry: LoopMemory, i: Index) -> tuple[LoopMemory, Flat[Record]]:
        after, record = parameters.tick(carry, i, control_dt)
        return after, Flat.of(record)

    after, records = jax.lax.scan(one, memory.tree, k + jnp.arange(ticks))
    return Flat.of(after), records


_start = jit_once(_begin, static_argnames="control_dt")
_advance = {
    quickly: in_one_piece(_advance_flat, quickly, static_argnames=("ticks", "control_dt"), donate_argnames="memory")
    for quickly in (True, False)
}
# A program that is not optimised flies 4,500 ticks a second in place of 20,000, and is there 25 s of processor time
# earlier (docs/performance.md). Most missions end before it has lost that, and a longer one goes on with the other. The
# tick decides, and not what is compiled already, so that the same scenario gives the same figures.
SHORT = 30_000  # ticks


class HostLoop:
    """A loop that a host program advances chunk by chunk; parameters, memory and records cross as one array each.

    To hand over 200 arrays and take as many takes as long as a third of a simulated second.
    """

    def __init__(self, loop: Loop, key: PRNGKey, start: Start, control_dt: float, ticks: int, short: int = SHORT):
        """A chunk is `ticks` control ticks of `control_dt` seconds; from tick `short` on the program is optimised."""
        self._k, self._ticks, self._control_dt, self._short = 0, ticks, control_dt, short
        self._loop, self._memory = _start(loop, key, start, control_dt=control_dt)

    def advance(self) -> Record:
        """The records of the next chunk, NumPy, leading axis ticks."""
        self._memory, records = _advance[self._k < self._short](
            self._loop, self._memory, np.asarray(self._k), ticks=self._ticks, control_dt=self._control_dt
        )
        self._k += self._ticks
        return Flat(np.asarray(records.vector), records.layout).tree


def stack(trees: list[Any]) -> Any:
    """Trees of one structure as one tree with a leading axis on every array."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *trees)
