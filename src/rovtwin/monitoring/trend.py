"""Quantities over runs: a baseline of the first ones, what has changed against it, and what drifts.

Runs differ by more than each of them states, for a model is never all of it: the baseline's scatter beyond the stated
deviations (DerSimonian and Laird 1986) is part of what a change is measured against. Few runs hardly tell it, so it
starts from what models of vehicles usually leave, as if two runs more had shown it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import t as student

from rovtwin.monitoring.change import CARED_FOR, FALSE_ALARMS, Change, changes
from rovtwin.monitoring.quantities import Reading

FEW = 3  # runs, up to which there is no slope to speak of
USUAL_SCATTER, AS_IF = 0.33, 2.0  # scatter at first, of the least change that is reported; runs that it counts as


@dataclass(frozen=True, eq=False)
class Run:
    """A run's name and what it says of each quantity."""

    name: str
    readings: list[Reading]

    @property
    def value(self) -> Float[np.ndarray, " n"]:
        return np.array([reading.value for reading in self.readings])

    @property
    def std(self) -> Float[np.ndarray, " n"]:
        return np.array([reading.std for reading in self.readings])


@dataclass(frozen=True, eq=False)
class Baseline:
    """What runs before say together.

    Attributes:
        value: Weighted mean.
        std: Of a further run's true value about it: of the mean, and the scatter.
        scatter: Between runs beyond what they state.
        freedom: Degrees of freedom with which it is known.
        runs: How many.
        unlearnt: What none of them has learnt.
    """

    value: Float[np.ndarray, " q"]
    std: Float[np.ndarray, " q"]
    scatter: Float[np.ndarray, " q"]
    freedom: float
    runs: int
    unlearnt: Bool[np.ndarray, " q"]


@dataclass(frozen=True)
class Drift:
    """A quantity that goes one way from run to run: change a run and its standard deviation."""

    reading: Reading
    slope: float
    std: float

    def __str__(self) -> str:
        """As in `surge drag +1.2 ± 0.2 %`."""
        return str(self.reading.with_values(self.slope, self.std))


def baseline(runs: Sequence[Run]) -> Baseline:
    """Random-effects mean of some runs; NaN of what not all of them have learnt."""
    value, std, n = np.stack([run.value for run in runs]), np.stack([run.std for run in runs]), len(runs)
    w = std**-2.0
    mean = np.sum(w * value, axis=0) / w.sum(axis=0)
    usual = np.array([USUAL_SCATTER * CARED_FOR[reading.quantity.unit] for reading in runs[0].readings])
    found = np.zeros(len(usual))
    if n > 1:
        q = np.sum(w * (value - mean) ** 2, axis=0)
        room = w.sum(axis=0) - np.sum(w**2, axis=0) / w.sum(axis=0)
        found = np.maximum(q - (n - 1), 0.0) / room
    scatter = np.sqrt(((n - 1) * found + AS_IF * usual**2) / (n - 1 + AS_IF))
    w = 1.0 / (std**2 + scatter**2)
    mean = np.sum(w * value, axis=0) / w.sum(axis=0)
    learnt = np.array([[reading.learnt for reading in run.readings] for run in runs])
    wide = np.where(learnt.all(axis=0), np.sqrt(1.0 / w.sum(axis=0) + scatter**2), np.nan)
    return Baseline(mean, wide, scatter, n - 1.0 + AS_IF, n, np.asarray(~learnt.any(axis=0)))


def changed_since(run: Run, before: Baseline) -> list[Change]:
    """What of a run is not as in the runs before."""
    return changes(run.readings, before.value, before.std, before.freedom)


def first_learnt(run: Run, before: Baseline) -> list[Change]:
    """What a run tells and none of the runs before, and is not as described: whether it has changed nobody knows."""
    described = np.zeros(len(run.readings))
    return changes(run.readings, described, np.where(before.unlearnt, 0.0, np.nan))


def drifts(runs: Sequence[Run]) -> list[Drift]:
    """Quantities with a slope over the runs, by weighted least squares, that chance does not explain."""
    if len(runs) <= FEW:
        return []
    value, std = np.stack([run.value for run in runs]), np.stack([run.std for run in runs])
    learnt = [i for i in range(value.shape[1]) if all(run.readings[i].learnt for run in runs)]
    at, found = np.arange(len(runs), dtype=float), []
    for i in learnt:
        w = std[:, i] ** -2.0
        middle = np.sum(w * at) / w.sum()
        spread = np.sum(w * (at - middle) ** 2)
        slope = np.sum(w * (at - middle) * value[:, i]) / spread
        rest = value[:, i] - np.sum(w * value[:, i]) / w.sum() - slope * (at - middle)
        wider = max(1.0, np.sum(w * rest**2) / (len(runs) - 2))
        deviation = np.sqrt(wider / spread)
        sure = student.isf(0.5 * FALSE_ALARMS / len(learnt), len(runs) - 2)
        if (
            abs(slope) > sure * deviation
            and abs(slope) * (len(runs) - 1) > CARED_FOR[runs[-1].readings[i].quantity.unit]
        ):
            found.append(Drift(runs[-1].readings[i], float(slope), float(deviation)))
    return found
