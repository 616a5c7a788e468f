"""Tests flown by the twin without noise, each its own, side by side: what a planner looks at before a real test."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float, Shaped

from rovtwin.core.arrays.rotations import tilt_of
from rovtwin.core.block import Start
from rovtwin.core.flow import ABORTED
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.types import Index, PRNGKey
from rovtwin.gnc.experiment import Experiment
from rovtwin.identification.logs.record import Record
from rovtwin.planning.records import records_of
from rovtwin.runs.compose.composition import Simulation, compose
from rovtwin.runs.compose.experiment import experiment_of, hand_of
from rovtwin.runs.loop import Loop, LoopMemory, stack
from rovtwin.runs.run import ticks_in
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.events.attitude_restraint import AttitudeRestraint
from rovtwin.vehicle import Model

CHUNK = 10.0  # simulated time between looks from outside [s]


@dataclass(frozen=True, eq=False)
class Rehearsed:
    """A test as the twin flies it.

    Attributes:
        scenario: The test.
        t: [s].
        position, attitude, nu: Truth.
        command: Of the thrusters, -1 to 1.
        records: As a log would give them, but without noise; the sensors' noise is declared in them.
        aborted_at: When the vehicle left its limits [s]; there are no records then. None: it did not.
    """

    scenario: Scenario
    t: Float[np.ndarray, " n"]
    position: Float[np.ndarray, "n 3"]
    attitude: Float[np.ndarray, "n 4"]
    nu: Float[np.ndarray, "n 6"]
    command: Float[np.ndarray, "n thrusters"]
    records: list[Record]
    aborted_at: float | None

    @property
    def aborted(self) -> bool:
        """Whether the vehicle left its limits."""
        return self.aborted_at is not None

    @property
    def tilt(self) -> Float[np.ndarray, " n"]:
        """From upright, as the attitude limit has it [rad]."""
        return np.linalg.norm(tilt_of(self.attitude), axis=1)


def rehearse(scenarios: Sequence[Scenario], plants: Sequence[Model] | None = None) -> list[Rehearsed]:
    """Fly tests that differ in nothing but their manoeuvres.

    Args:
        scenarios: The tests.
        plants: The vehicle that each is truly flown by; None: as the scenario has it.

    Raises:
        ConfigError: A test cannot be composed.
    """
    run, dt = compose(scenarios[0]), scenarios[0].control_dt
    loop = eqx.tree_at(lambda one: one.twin.sensors, run.loop, _exact(run.loop.twin.sensors))
    experiments = [experiment_of(one, run.model, run.vehicle, run.loop.twin.sensors) for one in scenarios]
    counts = [int(experiment.timeline.count) for experiment in experiments]
    truths = [run.loop.twin.model] * len(scenarios) if plants is None else list(plants)
    tests = (_stacked(experiments), _hands(scenarios), stack(truths))
    memories = _begin(loop, tests, run.key, run.start, control_dt=dt)
    ticks, kept = ticks_in(CHUNK, dt), []
    for k in range(0, max(counts), ticks):
        memories, given = _advance(loop, tests, memories, jnp.asarray(k), ticks=ticks, control_dt=dt)
        kept.append(jax.device_get(given))
    whole = jax.tree.map(lambda *leaves: np.concatenate(leaves, axis=1), *kept)
    return [
        _rehearsed(run, one, jax.tree.map(lambda leaf, i=i, n=n: leaf[i, :n], whole))
        for i, (one, n) in enumerate(zip(scenarios, counts, strict=True))
    ]


def _exact(sensors: dict[str, Any]) -> dict[str, Any]:
    """The same sensors without anything that is drawn, nor bias: one draw must not decide on a plan."""
    fields = ("noise", "bias", "bias_walk", "dropout", "outlier", "errors")
    return {
        name: eqx.tree_at(
            lambda s: [getattr(s, f) for f in fields],
            sensor,
            [*(jnp.zeros_like(getattr(sensor, f)) for f in fields[:-1]), None],
            is_leaf=lambda leaf: leaf is None,
        )
        for name, sensor in sensors.items()
    }


def _stacked(experiments: list[Experiment]) -> Experiment:
    """With time-lines as long as the longest."""
    longest = max(len(experiment.timeline.row) for experiment in experiments)
    rows = max(len(experiment.timeline.on) for experiment in experiments)

    def padded(leaf: Shaped[Array, "..."], size: int) -> Shaped[Array, "..."]:
        return jnp.pad(leaf, [(0, size - leaf.shape[0])] + [(0, 0)] * (leaf.ndim - 1))

    def even(experiment: Experiment) -> Experiment:
        line = experiment.timeline
        ticks = [padded(leaf, longest) for leaf in (line.share, line.row)]
        others = [padded(leaf, rows) for leaf in (line.hold, line.keep, line.on, line.manoeuvre, line.phase)]
        names = ("share", "row", "hold", "keep", "on", "manoeuvre", "phase")
        return eqx.tree_at(lambda t: [getattr(t.timeline, n) for n in names], experiment, ticks + others)

    return stack([even(experiment) for experiment in experiments])


def _hands(scenarios: Sequence[Scenario]) -> AttitudeRestraint:
    """One for each test; that of a test without a release never touches."""
    hands = [hand_of(one) for one in scenarios]
    most = max(1, *(len(hand.spans) for hand in hands if hand), 1)

    def even(hand: AttitudeRestraint | None) -> AttitudeRestraint:
        spans, turns = np.full((most, 2), -1.0), np.tile(np.eye(3), (most, 1, 1))
        if hand is not None:
            spans[: len(hand.spans)], turns[: len(hand.spans)] = hand.spans, hand.R_nb
        return AttitudeRestraint(as_array(spans), as_array(turns))

    return stack([even(hand) for hand in hands])


def _with_test(loop: Loop, test: tuple[Experiment, AttitudeRestraint, Model]) -> Loop:
    experiment, hand, truth = test
    twin = eqx.tree_at(lambda twin: (twin.hand, twin.model), loop.twin, (hand, truth), is_leaf=lambda x: x is None)
    return Loop(experiment, twin)


@partial(jax.jit, static_argnames="control_dt")
def _begin(loop: Loop, tests: Any, key: PRNGKey, start: Start, control_dt: float) -> LoopMemory:
    return jax.vmap(lambda test: _with_test(loop, test).init(key, start, control_dt))(tests)


@partial(jax.jit, static_argnames=("ticks", "control_dt"), donate_argnames="memories")
def _advance(
    loop: Loop, tests: Any, memories: LoopMemory, k: Index, ticks: int, control_dt: float
) -> tuple[LoopMemory, Any]:
    def fly_one(test: Any, memory: LoopMemory) -> tuple[LoopMemory, Any]:
        own = _with_test(loop, test)

        def one(carry: LoopMemory, i: Index) -> tuple[LoopMemory, Any]:
            after, record = own.tick(carry, i, control_dt)
            state, setpoint = record.state, record.autopilot.setpoint
            seen = (record.autopilot.command.u, record.measurements, setpoint.phase, setpoint.reason)
            return after, (seen, (state.position, state.attitude, state.nu))

        return jax.lax.scan(one, memory, k + jnp.arange(ticks))

    return jax.vmap(fly_one)(tests, memories)


def _rehearsed(run: Simulation, scenario: Scenario, given: Any) -> Rehearsed:
    seen, (position, attitude, nu) = given
    t = np.arange(len(position)) * scenario.control_dt
    left = np.flatnonzero(seen[2] == ABORTED)
    aborted_at = float(t[left[0]]) if len(left) else None
    records = records_of(run, scenario, seen) if aborted_at is None else []
    return Rehearsed(scenario, t, position, attitude, nu, seen[0], records, aborted_at)
