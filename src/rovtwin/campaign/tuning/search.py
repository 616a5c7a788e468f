"""The search: CMA-ES over a box, with an end in sight.

Reference: Hansen (2016), The CMA Evolution Strategy: A Tutorial, arXiv:1604.00772; Nomura and Shibata (2024), cmaes: a
simple yet practical Python library for CMA-ES, arXiv:2402.01373.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError

WIDTH = 0.35  # of the first generation, in logarithms: 68 % within a factor of 1.4
STALE, NEWS = 6, 2e-3  # the search ends when so many generations in a row bring less than this share


@dataclass
class Search:
    """What was tried.

    Attributes:
        points: In order.
        costs: Of each.
        generations: Number of the generation of each.
        mean: Middle of the last generation.
        ended: Why it ended.
    """

    points: list[np.ndarray] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)
    generations: list[int] = field(default_factory=list)
    mean: Float[np.ndarray, " d"] = field(default_factory=lambda: np.zeros(0))
    ended: str = ""

    @property
    def best(self) -> Float[np.ndarray, " d"]:
        """The cheapest point."""
        return self.points[int(np.argmin(self.costs))]


def population(dimensions: int) -> int:
    """Points of a generation: Hansen (2016), table 1; a single parameter is searched as two."""
    return 4 + int(3.0 * np.log(max(dimensions, 2)))


def search(
    cost: Callable[[list[np.ndarray]], list[float]],
    start: Float[np.ndarray, " d"],
    bounds: Float[np.ndarray, "d 2"],
    *,
    seed: int,
    evaluations: int,
    out_of_time: Callable[[int], bool] = lambda _: False,
    width: float = WIDTH,
) -> Search:
    """Minimise a cost over a box.

    Args:
        cost: Of a generation's points.
        start: Middle of the first generation.
        bounds: Least and largest.
        seed: Of its random numbers: the same seed and costs give the same points.
        evaluations: Most points to be tried, in whole generations; the first is tried in any case.
        out_of_time: Told how many points come next; True ends the search.
        width: Standard deviation of the first generation.

    Raises:
        ConfigError: `evaluations` is not positive.
    """
    if evaluations < 1:
        raise ConfigError(f"--evaluations: found {evaluations}, expected at least 1")
    from cmaes import CMA  # loads slowly, and only a search needs it

    # Where the box has an edge at the start, half of a generation would fall outside.
    inner = np.clip(start, bounds[:, 0] + 1e-6, bounds[:, 1] - 1e-6)
    if len(start) == 1:
        # Its random walk of one dimension is not supported: a second coordinate that changes nothing is.
        inner, bounds = np.append(inner, 0.0), np.vstack([bounds, [-1.0, 1.0]])
    optimiser = CMA(mean=inner, sigma=width, bounds=bounds, seed=seed % 2**32, population_size=population(len(start)))
    found, size, d = Search(mean=start.copy()), population(len(start)), len(start)
    while True:
        if len(found.points) and len(found.points) + size > evaluations:
            found.ended = f"all {evaluations} evaluations were used"
        elif out_of_time(size):
            found.ended = "its time was up"
        elif _stale(found, size):
            found.ended = f"{STALE} generations brought less than {100 * NEWS:g} %"
        if found.ended:
            return found
        asked = [optimiser.ask() for _ in range(size)]
        costs = cost([x[:d] for x in asked])
        optimiser.tell(list(zip(asked, costs, strict=True)))
        found.generations += [found.generations[-1] + 1 if found.generations else 0] * size
        found.points += [x[:d] for x in asked]
        found.costs += [float(c) for c in costs]
        found.mean = optimiser.mean[:d].copy()


def _stale(found: Search, size: int) -> bool:
    """By the medians of the generations: the best of a generation may be nothing but lucky."""
    medians = np.median(np.reshape(found.costs, (-1, size)), axis=1)
    if len(medians) <= STALE:
        return False
    before, now = medians[:-STALE].min(), medians[-STALE:].min()
    return bool(before - now < NEWS * abs(before))
