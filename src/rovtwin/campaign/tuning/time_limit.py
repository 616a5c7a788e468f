"""Whether a tuning fits into its time: found out as early as the cost of a flight is known."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.runs.compose.composition import Simulation

USUAL = 170.0  # for nine parameters on two cores [s]
SPARE = 1.15  # of what is said to be enough: a machine is not always as quick


@dataclass
class Clock:
    """Wall time of a tuning since it began.

    Attributes:
        budget: For all of it [s].
    """

    budget: float
    began: float = field(default_factory=time.monotonic)

    @property
    def gone(self) -> float:
        """[s]"""
        return time.monotonic() - self.began

    def require_start(self, after: float) -> None:
        """Nothing is compiled that no time is left for.

        Args:
            after: What files and report take [s].

        Raises:
            ConfigError: Composing alone took the budget.
        """
        gone = self.gone
        if gone + after > self.budget:
            raise ConfigError(
                f"--budget-s: found {self.budget:g}, expected about {_tens(USUAL + gone)} or more here: composing "
                f"took {gone:.0f} s, and compiling, flying, judging and files come after it"
            )

    def require(self, after: float, what: str) -> None:
        """Nothing goes on that cannot come to an end.

        Args:
            after: What is still to come at the least [s].
            what: What that is.

        Raises:
            ConfigError: It does not fit; the message says what would.
        """
        gone = self.gone
        if gone + after > self.budget:
            enough = _tens(SPARE * (gone + after))
            raise ConfigError(
                f"--budget-s: found {self.budget:g}, expected about {enough} or more here: {gone:.0f} s are gone, and "
                f"{what} take {after:.0f} s at the least; or take fewer --held-out and --plants"
            )


def _tens(seconds: float) -> int:
    """The next ten seconds [s]."""
    return math.ceil(seconds / 10.0) * 10


def least_seconds(runs: Sequence[Simulation]) -> float:
    """How long the longest of some flights lasts at the least: its legs at their speed, and its holds [s]."""
    return max(_least(run) for run in runs)


def _least(run: Simulation) -> float:
    scenario = run.scenario
    places = np.array([scenario.start.position, *(w.placed(scenario.origin) for w in scenario.waypoints)])
    ways = np.linalg.norm(np.diff(places[:, :2], axis=0), axis=1)
    legs = [max(way - w.acceptance, 0.0) / w.speed for way, w in zip(ways, scenario.waypoints, strict=True)]
    return min(sum(legs) + sum(w.hold_time for w in scenario.waypoints), scenario.duration)
