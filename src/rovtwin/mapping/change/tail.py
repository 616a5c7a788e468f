"""How large the statistic grows where nothing changed, and from where on it is named: by places, not by cells.

The statistic varies over the least thing, so that its cells are not as many tries; what a user counts are places. Each
local maximum is one place, its value that which as many cells about it reach as a thing must have. Most places have not
changed: above their median, values less it are taken to have a generalised Pareto distribution,

    P(value > median + x | value > median) = (1 + xi x / sigma)^(-1 / xi),    xi >= 0,

fitted by likelihood to all places but those that are named, in turns with the naming. Places are named so that a share
of them at most is false.

Reference: local maxima as what is tested, Cheng and Schwartzman (2017), Annals of Statistics 45(2); the naming,
Benjamini and Hochberg (1995), J. R. Statist. Soc. B 57(1); excesses over a threshold, Coles (2001), An Introduction to
Statistical Modeling of Extreme Values, ch. 4.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.ndimage import label, maximum_filter, rank_filter
from scipy.optimize import minimize

_ACROSS = 5  # cells of the least thing that are looked at, a side
_ROUNDS = 20
_FIRST = (0.1, 0.2, 0.35)  # of places, the largest, that are left out at first
_XI = (0.33, 0.25)  # of which size xi is before anything is seen, and the sd of its logarithm: 0.25 to 0.40 in flights
FEWEST = 30  # places, for a tail to be read off them


@dataclass(frozen=True)
class Unchanged:
    """Values of places where nothing changed.

    Attributes:
        middle: Their median; no number where there are too few.
        sigma: Scale of what lies above it.
        xi: Shape of that; 0 is the tail of a Gaussian's squares.
        count: How many places there are.
        limit: Value from which places are named; infinite where none is.
    """

    middle: float
    sigma: float
    xi: float
    count: int
    limit: float

    def chance(self, value: Float[np.ndarray, " *n"]) -> Float[np.ndarray, " *n"]:
        """Probability that a place has such a value or more; half or more below the median, which is all one here."""
        return np.where(np.isnan(value), np.nan, 0.5 * self._beyond(np.maximum(value - self.middle, 0.0)))

    def _beyond(self, x: Float[np.ndarray, " *n"]) -> Float[np.ndarray, " *n"]:
        return np.exp(-np.log1p(self.xi * x / self.sigma) / self.xi)

    def value(self, chance: float) -> float:
        """That a place exceeds with a probability of less than half."""
        return float(self.middle + self.sigma / self.xi * np.expm1(-self.xi * np.log(2.0 * min(chance, 0.5))))


def places(statistic: Float[np.ndarray, "row column"], box: int, named: float) -> Float[np.ndarray, " n"]:
    """The value of each place, increasing.

    Args:
        statistic: Of each cell; no number where not known.
        box: Cells of the least thing, a side.
        named: Share of its area that must reach the value.
    """
    step = max(box // _ACROSS, 1)
    side = max(round(box / step), 1)
    some = np.nan_to_num(statistic[::step, ::step], nan=-1.0)
    reached = rank_filter(some, -max(round(named * side**2), 1), size=side)
    top: Any = label((reached == maximum_filter(reached, size=2 * side + 1)) & (reached >= 0.0), np.ones((3, 3)))
    first = np.unique(top[0], return_index=True)[1][1:]  # cells of one maximum are alike; 0 is none
    return np.sort(reached.ravel()[first])


def unchanged(values: Float[np.ndarray, " n"], false_share: float) -> Unchanged:
    """The tail of places that did not change, and which are named.

    Nobody knows at first how many changed. If more did than are left out, they widen the tail; if far fewer, what is
    left of it is too short to be read, and flat. Either names fewer places, so of several beginnings that which names
    most is taken.

    Args:
        values: Of all places, increasing.
        false_share: Of the named places, that may be false.
    """
    if len(values) < FEWEST:
        return Unchanged(np.nan, np.nan, np.nan, len(values), np.inf)
    found = [_in_turns(values, false_share, round(share * len(values))) for share in _FIRST]
    return max(found, key=lambda one: int((values >= one.limit).sum()))


def _in_turns(values: Float[np.ndarray, " n"], false_share: float, named: int) -> Unchanged:
    """Fitted to all places but so many at first, then to all but the named ones, until these stay the same."""
    n, more, found = len(values), None, Unchanged(np.nan, np.nan, np.nan, len(values), np.inf)
    for _ in range(_ROUNDS):
        rest = values[: n - named]
        middle = float(np.median(rest))
        beyond = float(values[min(n - named, n - 1)]) - middle
        sigma, xi = _pareto(rest[rest > middle] - middle, more, beyond)
        found = Unchanged(middle, sigma, xi, n, np.inf)
        below = np.flatnonzero(found.chance(values[::-1]) * n <= false_share * np.arange(1, n + 1))
        now = int(below[-1]) + 1 if below.size else 0
        found = replace(found, limit=found.value(false_share * now / n) if now else np.inf)
        if now == named and more is not None:
            break
        named, more = now, false_share * now
    return found


def _pareto(x: Float[np.ndarray, " n"], more: float | None, beyond: float) -> tuple[float, float]:
    """Scale and shape of excesses, and of so many more of which only is known that they lie beyond a value.

    None: it is not known how many lie there.
    """

    def misfit(at: np.ndarray) -> float:
        sigma, xi = np.exp(at)
        left = np.log1p(xi * beyond / sigma) / xi  # minus the logarithm of the share beyond
        far = len(x) * np.log(-np.expm1(-left)) if more is None else more * left
        usual = 0.5 * ((at[1] - np.log(_XI[0])) / _XI[1]) ** 2
        return float(len(x) * at[0] + (1.0 / xi + 1.0) * np.log1p(xi * x / sigma).sum() + far + usual)

    start = np.log([max(float(np.mean(x)), 1e-12), _XI[0]])
    best = minimize(misfit, start, method="Nelder-Mead", bounds=[(None, None), (np.log(1e-3), np.log(2.0))])
    return float(np.exp(best.x[0])), float(np.exp(best.x[1]))
