"""What a flight takes of force: more telling than its path, which an autopilot holds whatever the drag.

Along each axis the thrusters' work over the integral of the cube of the speed, sum(tau nu) / sum(|nu|^3): what a
quadratic drag coefficient would be, were there no other drag, and nothing accelerated for good. Both are the
autopilot's: the wrench that it asks for and the speed that it estimates. A vehicle with weaker thrusters needs more,
too. Only ratios to the prediction count.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import stdtr, stdtrit

from rovtwin.runs.scoring.scores import Flown
from rovtwin.vehicle.constants import AXES

ALARM = 0.01  # chance that a true model is called untrue, all axes together
SPREAD = 0.3  # of the logarithm over drawn flights, from which on an axis tells nothing


def effort(nu: Float[np.ndarray, "n 6"], tau: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "6"]:
    """Of each axis [N s2/m2, N m s2/rad2]; of estimates and wrenches."""
    return np.sum(tau * nu, axis=0) / np.maximum(np.sum(np.abs(nu) ** 3, axis=0), 1e-12)


def effort_of_flown(flown: Flown, began: float, lasting: float) -> Float[np.ndarray, "6"]:
    """Of a flight of the twin from a time on, for so long [s]; shape (6,)."""
    assert flown.tau is not None  # every mission has it
    during = (flown.t >= began - 1e-6) & (flown.t <= began + lasting + 1e-6)
    return effort(flown.nu_hat[during], flown.tau[during])


@dataclass(frozen=True)
class Foreseen:
    """The effort along one axis, as drawn flights have it: its logarithm is taken as normal.

    Attributes:
        axis: Its name.
        mean, std: Of the logarithm over the drawn flights.
        draws: How many.
    """

    axis: str
    mean: float
    std: float
    draws: int

    @property
    def middle(self) -> float:
        """The median effort [N s2/m2, N m s2/rad2]."""
        return float(np.exp(self.mean))

    def ratio(self, chance: float = 0.95) -> tuple[float, float]:
        """Prediction interval of one more flight's effort over the median, by Student's t."""
        half = float(stdtrit(self.draws - 1, 0.5 + 0.5 * chance)) * self._error
        return float(np.exp(-half)), float(np.exp(half))

    @property
    def _error(self) -> float:
        return self.std * float(np.sqrt(1.0 + 1.0 / self.draws))

    def chance(self, flown: float) -> float:
        """Of an effort as far off as this one or farther, if the model is true."""
        if flown <= 0.0:
            return 0.0
        return float(2.0 * stdtr(self.draws - 1, -abs(np.log(flown) - self.mean) / self._error))


def foreseen(efforts: Sequence[np.ndarray]) -> list[Foreseen]:
    """Axes whose effort drawn flights agree about, from theirs, shape (6,) each."""
    every, found = np.stack(efforts), []
    for i, axis in enumerate(AXES):
        if every[:, i].min() <= 0.0:
            continue
        logs = np.log(every[:, i])
        std = float(np.std(logs, ddof=1))
        if 0.0 < std < SPREAD:
            found.append(Foreseen(axis, float(np.mean(logs)), std, len(logs)))
    return found


def agrees(one: Foreseen, flown: float, axes: int) -> bool:
    """Whether the model may be true by this axis, one of so many."""
    return one.chance(flown) > ALARM / axes
