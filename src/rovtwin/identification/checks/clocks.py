"""Whose clock is wrong: one signal's, several with errors of their own, or that of the commands against all of them.

Two signals of the same motion tell their lag exactly, but not which of them is late; the commands tell that roughly.
Signals that agree with each other and lag behind the commands share one error: that is one of the commands' clock, and
a `time_offset` at a signal would only make it disagree with the others.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool

from rovtwin.identification.checks.findings import Finding
from rovtwin.identification.logs.motion import Motion
from rovtwin.identification.logs.record import Record
from rovtwin.identification.logs.response import Regression, thruster_forces
from rovtwin.vehicle.physics.model import Model

LAGS = np.round(np.arange(-2.0, 2.01, 0.1), 2)
_EXPLAINED = 0.2  # share of an axis' acceleration that thrusters must explain before its lag counts
_ROUGH = 0.35  # [s] by which a lag against the commands may be wrong
_COARSE = 0.04  # [s] between rows, from which a slip by a row can be distinguished from a clock
_ROWS = 6  # rows by which columns may have slipped
_SMALLEST = 0.1  # [s] that is reported
_ALIKE = 0.05  # share by which rows may explain less than a time: they come in steps
_SIMPLER = 0.02  # share that one more wrong clock must explain
_TURNING, _MOVING = ("attitude", "gyro"), ("velocity", "position", "depth")


@dataclass(frozen=True)
class Lag:
    """By how much a signal is late against another [s]; negative: early."""

    first: str
    second: str
    lag: float


def check_clocks(model: Model, record: Record, lags: Callable[[Record], list[Lag]]) -> list[Finding]:
    """Which signals are late, where some disagree in time with others; one finding each.

    Lags against each other are exact. Which signal is right is tried: the way in which the commands explain most of the
    accelerations, of those alike the one that makes the fewest signals wrong.

    Args:
        model: Of the vehicle.
        record: With its clocks as they are.
        lags: Of pairs of signals of a record that see the same motion; only those that are not zero.
    """
    found, tried = lags(record), []
    if any({lag.first, lag.second} == {"attitude", "velocity"} for lag in found):
        # How late the attitude is against what moves is known, and so of all signals against all others.
        every = _lags_within(record, (*_TURNING, *_MOVING), [*found, *_agreed(found)])
        tried = [_judged(model, record, late) for late in _ways(every, None)]
    else:
        for turning in _ways(_lags_within(record, _TURNING, found), behind_commands(model, record, slice(3, 6))):
            aligned = _shifted(record, turning)
            moving = _lags_within(aligned, _MOVING, lags(aligned))
            tried += [_judged(model, record, turning | other) for other in _ways(moving, None)]
    late = max(tried, key=lambda way: way[0])[1]
    wrong = {name: by for name, by in late.items() if abs(by) > _SMALLEST}
    return [_finding(record, name, wrong, len(wrong) == len(late)) for name in wrong]


def _agreed(lags: list[Lag]) -> list[Lag]:
    """Pairs that are not said to disagree."""
    apart = {frozenset((lag.first, lag.second)) for lag in lags}
    same = (("velocity", "position"), ("depth", "velocity"), ("depth", "position"), ("gyro", "attitude"))
    return [Lag(*pair, 0.0) for pair in same if frozenset(pair) not in apart]


def _judged(model: Model, record: Record, late: dict[str, float]) -> tuple[float, dict[str, float]]:
    """A way to put clocks right, and how good it is: what commands explain then, less what it costs in wrong clocks."""
    wrong = sum(abs(by) > _SMALLEST for by in late.values())
    return _explained(model, _shifted(record, late)) - _SIMPLER * wrong, late


def _shifted(record: Record, late: dict[str, float]) -> Record:
    """The record with what is known of its signals' clocks put right."""
    signals = {n: replace(s, t=s.t - late.get(n, 0.0)) for n, s in record.signals.items()}
    return replace(record, signals=signals)


def _lags_within(record: Record, names: tuple[str, ...], lags: list[Lag]) -> dict[str, float]:
    """How late each signal of a group is against the first of them [s]."""
    present = [name for name in names if name in record.signals]
    own = dict.fromkeys(present[:1], 0.0)
    for _ in present:
        for pair in lags:
            if pair.second in own and pair.first in present:
                own.setdefault(pair.first, own[pair.second] + pair.lag)
            elif pair.first in own and pair.second in present:
                own.setdefault(pair.second, own[pair.first] - pair.lag)
    return {name: own.get(name, 0.0) for name in present}


def _ways(own: dict[str, float], common: float | None) -> list[dict[str, float]]:
    """How late each of a group may be against the commands [s]: with any of them right, or all of them wrong alike."""
    bases = [-by for by in own.values()]
    if any(bases) and common is not None and min(abs(base - common) for base in bases) > _ROUGH:
        bases.append(common)
    return [{name: round(by + base, 2) for name, by in own.items()} for base in dict.fromkeys(bases)] or [{}]


def _explained(model: Model, record: Record) -> float:
    """Share of the accelerations that commands explain, in the mean of the axes."""
    motion = Motion.of(record)
    regression = Regression.of(model, motion)
    if regression is None:
        return 0.0
    return float(regression.against(thruster_forces(model, motion)).explainable.mean())


def _finding(record: Record, name: str, wrong: dict[str, float], alone: bool) -> Finding:
    by = wrong[name]
    way = "behind" if by > 0 else "ahead of"
    text = (
        f"{name} is {abs(by):.2f} s {way} the commands{'' if alone else ' and the other signals'}: its clock differs."
    )
    rows = _rows(record, name, by)
    if rows:
        text += f" Its columns are {abs(rows)} samples {'later' if rows > 0 else 'earlier'} than the others."
    fix = f"Write signals.{name}.time_offset: {-by:.2f}, which is added to its times and no other signal's."
    same = [other for other in wrong if other != name and abs(wrong[other] - by) < _SMALLEST]
    if same:
        fix += (
            f" {', '.join(same)}: the same; where they are a file of their own, clock: estimate there does it for all."
        )
    return Finding("error", "clock", name, text, fix)


def _rows(record: Record, name: str, by: float) -> int:
    """By how many rows of a table that it shares with others a signal is late; 0 where that is no whole number."""
    t = record.signals[name].t
    others = [s.t for n, s in record.signals.items() if n != name]
    if not any(len(t) == len(other) and np.allclose(t, other) for other in [*others, record.t_command]):
        return 0
    step = float(np.median(np.diff(t)))
    rows = by / step
    return round(rows) if step > _COARSE and round(rows) and abs(rows - round(rows)) < 0.4 else 0


def behind_commands(model: Model, record: Record, axes: slice = slice(0, 6)) -> float | None:
    """By how much the motion along some axes is late against the commands [s], roughly; None where it does not tell."""
    motion = Motion.of(record)
    regression = Regression.of(model, motion)
    if regression is None:
        return None
    table = np.array([regression.against(thruster_forces(model, motion, lag)).explainable for lag in LAGS])
    explained = (table.max(axis=0) > _EXPLAINED) & np.isin(regression.axes, np.arange(6)[axes])
    if not explained.any():
        return None
    return float(LAGS[int(np.argmax(table[:, explained].mean(axis=1)))])


def all_behind(record: Record, lag: float, shares: tuple[float, float], rows: int) -> Finding:
    """That commands and all signals differ by one lag, which agree among themselves.

    Args:
        record: Whose.
        lag: To add to the commands' times [s].
        shares: Of the accelerations that commands explain then, and as they are.
        rows: By how many rows of a common table the commands may be late, see `slipped_rows`.
    """
    text = (
        f"the motion follows the commands best when these are taken {abs(lag):.1f} s "
        f"{'earlier' if lag < 0 else 'later'} (they explain {shares[0]:.0%} of the accelerations instead of "
        f"{shares[1]:.0%}): the clocks differ, by the same for {_all_of(record)}."
    )
    fix = (
        f"Write commands.time_offset: {lag:.2f}, which is added to the times of the commands, once for the whole log; "
        "no time_offset at a signal. Where the commands are a file of their own: clock: estimate there."
    )
    if rows:
        text += (
            f" Or columns are paired with the wrong rows: the commands are {abs(rows)} "
            f"sample{'s' if abs(rows) > 1 else ''} {'later' if rows > 0 else 'earlier'} than all others."
        )
        fix += " If rows have slipped, move the columns by whole rows: samples are not evenly spaced."
    return Finding("error", "clock", "commands", text, fix)


def _all_of(record: Record) -> str:
    names = list(record.signals)
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def slipped_rows(
    model: Model, motion: Motion, regression: Regression, axes: Bool[np.ndarray, " a"], share: float
) -> int:
    """By how many rows the commands are late in a table that they share with the signals; 0 where time explains more.

    Args:
        model: Of the vehicle.
        motion: Of the record.
        regression: Of its accelerations.
        axes: Those that tell.
        share: Of the accelerations that commands explain, all of them moved by one time.
    """
    record = motion.record
    common = np.mean(
        [np.isclose(record.t_command[:, None], s.t[:50]).any(axis=0).mean() for s in record.signals.values()]
    )
    if common < 0.9 or np.median(np.diff(record.t_command)) < _COARSE:
        return 0
    step = float(np.median(np.diff(record.t_command)))
    score = {}
    for rows in range(-_ROWS, _ROWS + 1):
        # What a row holds was either given then, and held, or is a sample of what changed all the time.
        for earlier in (0.0, 0.5 * step):
            command = np.roll(record.command, -rows, axis=0)
            moved = replace(record, t_command=record.t_command - earlier, command=command)
            force = thruster_forces(model, replace(motion, record=moved, _known={}))
            score[rows, earlier] = float(regression.against(force).explainable[axes].mean())
    best = max(score, key=lambda way: score[way])
    return best[0] if score[best] > share - _ALIKE else 0
