"""How good a map of classes is: against what lies there, and areas put right by check points.

References: Congalton (1991), A review of assessing the accuracy of classifications of remotely sensed data, Remote
Sensing of Environment 37 (producer's and user's accuracy, kappa); Olofsson et al. (2014), Good practices for estimating
area and assessing accuracy of land change, Remote Sensing of Environment 148 (the stratified estimator).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import norm


@dataclass(frozen=True)
class Confusion:
    """Cells by the map and by the truth.

    Attributes:
        mapped: Names of the map's classes.
        true: Names of what lies there.
        count: Of cells.
    """

    mapped: tuple[str, ...]
    true: tuple[str, ...]
    count: Int[np.ndarray, "mapped true"]

    def _agreed(self, name: str) -> int:
        both = name in self.mapped and name in self.true
        return int(self.count[self.mapped.index(name), self.true.index(name)]) if both else 0

    @property
    def overall(self) -> float:
        """Share of cells that are mapped as what they are."""
        return sum(map(self._agreed, self.mapped)) / max(int(self.count.sum()), 1)

    @property
    def kappa(self) -> float:
        """Agreement beyond that by chance."""
        total = max(float(self.count.sum()), 1.0)
        rows = {name: self.count[k].sum() / total for k, name in enumerate(self.mapped)}
        columns = {name: self.count[:, k].sum() / total for k, name in enumerate(self.true)}
        chance = sum(share * columns.get(name, 0.0) for name, share in rows.items())
        return float((self.overall - chance) / (1.0 - chance)) if chance < 1.0 else 1.0

    def users(self, name: str) -> float | None:
        """Share of the cells mapped as a class that are of it; None where none is mapped so."""
        total = int(self.count[self.mapped.index(name)].sum()) if name in self.mapped else 0
        return self._agreed(name) / total if total else None

    def producers(self, name: str) -> float | None:
        """Share of the cells of a class that are mapped as it; None where none is of it."""
        total = int(self.count[:, self.true.index(name)].sum()) if name in self.true else 0
        return self._agreed(name) / total if total else None


def counted(mapped: list[str], true: list[str], classes: tuple[str, ...]) -> Confusion:
    """Of pairs of names; classes of the map in their order, then what else is true."""
    columns = tuple(dict.fromkeys([name for name in classes if name in true] + sorted(set(true))))
    count = np.zeros((len(classes), len(columns)), int)
    np.add.at(count, ([classes.index(name) for name in mapped], [columns.index(name) for name in true]), 1)
    return Confusion(classes, columns, count)


@dataclass(frozen=True)
class Adjusted:
    """Areas by check points.

    Attributes:
        share: Of the mapped area, by true class.
        sd: Standard error of it.
        overall: Overall accuracy, by area.
        overall_sd: Standard error of it.
        few: Classes of the map with less than two check points, whose area counts as unknown: each true class may have
            all of it or nothing.
        unknown: Their share of the mapped area.
    """

    share: Float[np.ndarray, " true"]
    sd: Float[np.ndarray, " true"]
    overall: float
    overall_sd: float
    few: tuple[str, ...]
    unknown: float

    def interval(self, level: float = 0.95) -> tuple[Float[np.ndarray, " true"], Float[np.ndarray, " true"]]:
        """Of the shares."""
        z = float(norm.ppf(0.5 + 0.5 * level))
        return np.maximum(self.share - z * self.sd, 0.0), np.minimum(self.share + z * self.sd + self.unknown, 1.0)


def adjusted(confusion: Confusion, weight: Float[np.ndarray, " mapped"]) -> Adjusted:
    """Stratified estimate, the map's classes the strata.

    Args:
        confusion: Of check points drawn at random within each class of the map.
        weight: Share of the mapped area of each class of the map.
    """
    n = confusion.count.sum(axis=1)
    enough = n >= 2
    p = confusion.count[enough] / n[enough, None]
    W = weight[enough]
    variance = (W**2 / (n[enough] - 1))[:, None] * p * (1.0 - p)
    right = np.array(
        [
            p[k, confusion.true.index(name)] if name in confusion.true else 0.0
            for k, name in enumerate(np.array(confusion.mapped, object)[enough])
        ]
    )
    few = tuple(name for name, some, w in zip(confusion.mapped, enough, weight, strict=True) if not some and w > 0)
    return Adjusted(
        W @ p, np.sqrt(variance.sum(axis=0)), float(W @ right),
        float(np.sqrt(np.sum(W**2 * right * (1.0 - right) / np.maximum(n[enough] - 1, 1)))),
        few, float(weight[~enough].sum()),
    )  # fmt: skip
