"""Runs, as a stream of records: one simulated second at a time, from the compiled loop or tick by tick in real time."""

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.block import Start
from rovtwin.core.flow import ENDS, NO_REQUEST, Command, Measurement, Measurements
from rovtwin.core.numerics import jax, jnp
from rovtwin.core.types import PRNGKey
from rovtwin.links.twin import TwinLink
from rovtwin.runs.loop import SHORT, HostLoop, Loop, Record, start_loop
from rovtwin.runs.realtime import NO_PILOT_COMMAND, HostAutopilot
from rovtwin.simulation.events.topside import Topside
from rovtwin.simulation.twin import TwinInput

CHUNK = 1.0  # simulated time between looks from outside [s]


def chunks(
    loop: Loop, key: PRNGKey, start: Start, control_dt: float, duration: float, short: int = SHORT
) -> Iterator[Record]:
    """Records of a run from the compiled loop, on the host, leading axis of at most one simulated second.

    Ends with the tick at which the mission is finished or aborted, or with `duration`. From tick `short` on the program
    is optimised, see `loop.SHORT`.
    """
    ticks = ticks_in(CHUNK, control_dt)
    total = ticks_in(duration, control_dt) + 1
    host = HostLoop(loop, key, start, control_dt, ticks, short)
    for k in range(0, total, ticks):
        kept, over = until_the_end(host.advance(), total - k)
        yield kept
        if over:
            return


def ticks_in(duration: float, control_dt: float) -> int:
    """Control ticks in a duration [s], at least one."""
    return max(1, round(duration / control_dt))


def until_the_end(record: Record, most: int) -> tuple[Record, bool]:
    """The record up to the tick that ends the mission, at most `most` ticks, and whether it ended."""
    phase = np.asarray(record.autopilot.setpoint.phase)
    ended = np.flatnonzero(np.isin(phase, ENDS))
    length = min(int(ended[0]) + 1 if ended.size else len(phase), most)
    return jax.tree.map(lambda leaf: leaf[:length], record), bool(ended.size) or length == most


def realtime_chunks(
    loop: Loop,
    key: PRNGKey,
    start: Start,
    control_dt: float,
    duration: float,
    clock: Callable[[], float] | None = None,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[Record]:
    """The same run with the same blocks tick by tick through a Link, paced by the wall clock.

    Args:
        loop: Autopilot and twin.
        key: Seeds all randomness.
        start: Where it begins.
        control_dt: Control period [s].
        duration: Longest run [s].
        clock: Time since the start [s]; the default is the wall clock, from when everything is compiled.
        sleep: Waits so many seconds.
    """
    memory = start_loop(loop, key, start, control_dt=control_dt)
    step_twin = jax.jit(lambda twin, memory, command, k: twin.step(memory, TwinInput(command, k), control_dt))
    move = partial(step_twin, loop.twin)  # parameters are arguments: as constants they would be compiled anew each time
    autopilot = HostAutopilot(loop.autopilot, memory.autopilot, memory.measurements, control_dt)
    seen_above = above(loop.topside, control_dt)
    off = jnp.zeros(loop.twin.model.thrusters.count)
    jax.block_until_ready(move(memory.twin, Command(off), 0))

    truth = _Truth(
        memory.state,
        memory.water_velocity,
        memory.external_wrench,
        memory.surface,
        memory.twin.battery,
        memory.tethers,
        memory.broken_force,
    )
    seen_above(0)
    began = time.monotonic()
    now = clock or (lambda: time.monotonic() - began)
    link = TwinLink(truth.following(move), memory.twin, off.shape[0], control_dt, now)
    total, ticks = ticks_in(duration, control_dt) + 1, ticks_in(CHUNK, control_dt)
    rows: list[tuple[Any, np.ndarray, np.ndarray]] = []
    with link:
        for k in range(total):
            readings: list[Measurement] = []
            while link.tick < k:
                sleep(max(0.0, k * control_dt - now()))
                readings = link.read()
            (link_age, operator_age, late), request, pilot = seen_above(k)
            late = max(late, (now() - k * control_dt) / control_dt)
            link.send(autopilot.step(readings, request, (link_age, operator_age, late), pilot))
            # The command is out; from here on there is time.
            rows.append((truth.now, autopilot.taken, autopilot.given))
            if len(rows) == ticks or k == total - 1 or autopilot.phase in ENDS:
                kept, over = until_the_end(_recorded(autopilot, rows), len(rows) + 1)
                rows = []
                yield kept
                if over:
                    return


Above = tuple[tuple[float, float, float], int, Sequence[float]]


def above(topside: Topside | None, control_dt: float) -> Callable[[int], Above]:
    """What the host of a tick knows, the operator's request and the pilot's command, see `HostAutopilot.step`."""
    if topside is None:
        return lambda k: ((0.0, 0.0, 0.0), NO_REQUEST, NO_PILOT_COMMAND)
    look = jax.jit(lambda t: topside.at(t, control_dt))

    def at(k: int) -> Above:
        host, request, pilot = jax.device_get(look(k * control_dt))
        return (float(host.link_age), float(host.operator_age), float(host.lateness)), int(request), pilot

    return at


def _recorded(
    autopilot: HostAutopilot, rows: list[tuple[Any, Float[np.ndarray, " _"], Float[np.ndarray, " _"]]]
) -> Record:
    """The record of several ticks, leading axis ticks, from truth before each and the autopilot's vectors."""
    truths, taken, given = zip(*rows, strict=True)
    truth = jax.tree.map(lambda *leaves: np.stack(leaves), *jax.device_get(truths))
    state, water_velocity, external_wrench, surface, battery, tethers, broken = truth
    measurements, decided = autopilot.unpacked(taken, given)
    return Record(state, water_velocity, external_wrench, measurements, decided, surface, battery, tethers, broken)


class _Truth:
    """Keeps what the twin last was, for the log: a Link itself shows only what a real vehicle would."""

    def __init__(self, *now: Any):
        self.now = now

    def following(self, move: Callable[..., Any]) -> Callable[[Any, Command, int], tuple[Any, Measurements]]:
        def advance_twin(memory: Any, command: Command, k: int) -> tuple[Any, Measurements]:
            memory, moved = move(memory, command, k)
            water = moved.environment
            tethers = {name: tether.line for name, tether in memory.tethers.items()}
            broken = memory.world.broken
            self.now = (moved.state, water.velocity, water.wrench, water.surface, memory.battery, tethers, broken)
            return memory, moved.measurements

        return advance_twin
