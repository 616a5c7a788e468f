"""How good a map of classes is: against what lies there, and areas put right by check points.

References: Congalton (1991), A review of assessing the accuracy of classifications of remotely sensed data, Remote
Sensing of Environment 37 (producer's and user's accuracy, kappa); Olofsson et al. (2014), Good practices for estimating
area and assessing accuracy of land change, Remote Sensing of Environment 148 (the stratified estimator); Agresti and
Coull (1998), Approximate is better than "exact" for interval estimation of binomial proportions, The American
Statistician 52(2) (shares of which all points agree).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
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


_ADDED = 2  # points to each side, as Agresti and Coull add them for 95 %
FEW = 20  # points in a stratum, below which its intervals are rough


@dataclass(frozen=True)
class Adjusted:
    """Areas by check points.

    Attributes:
        share: Of the mapped area, by true class.
        sd: Standard error of it.
        absent_sd: Of the share of a class that none of the points is of.
        overall: Overall accuracy by area, of the area whose strata have points; None where none has two.
        overall_sd: Standard error of it.
        few: Classes of the map with fewer than two check points, whose area counts as unknown: each true class may have
            all of it or nothing.
        rough: Those with two or more, and fewer than `FEW`.
        unknown: Share of the mapped area of `few`.
    """

    share: Float[np.ndarray, " true"]
    sd: Float[np.ndarray, " true"]
    absent_sd: float
    overall: float | None
    overall_sd: float | None
    few: tuple[str, ...]
    rough: tuple[str, ...]
    unknown: float

    def interval(self, level: float = 0.95) -> tuple[Float[np.ndarray, " true"], Float[np.ndarray, " true"]]:
        """Of the shares."""
        z = float(norm.ppf(0.5 + 0.5 * level))
        return np.maximum(self.share - z * self.sd, 0.0), np.minimum(self.share + z * self.sd + self.unknown, 1.0)

    def most_absent(self, level: float = 0.95) -> float:
        """Upper end of the interval of a class that none of the points is of."""
        return min(float(norm.ppf(0.5 + 0.5 * level)) * self.absent_sd + self.unknown, 1.0)


def adjusted(confusion: Confusion, weight: Float[np.ndarray, " mapped"], never: tuple[str, ...] = ()) -> Adjusted:
    """Stratified estimate, the map's classes the strata.

    Args:
        confusion: Of check points drawn at random within each class of the map.
        weight: Share of the mapped area of each class of the map.
        never: Classes of the map that no point can be of, such as mixtures: they count as mapped wrong.
    """
    n = confusion.count.sum(axis=1)
    enough = n >= 2
    mapped = [name for name, some in zip(confusion.mapped, enough, strict=True) if some]
    W, count, n_of = weight[enough], confusion.count[enough], n[enough]
    agreed = (count == n_of[:, None]).any(axis=1)
    variance = (W**2)[:, None] * _variance(count, n_of, agreed)
    absent = W**2 * _variance(np.zeros((len(W), 1)), n_of, np.ones(len(W), bool))[:, 0]
    right = np.array([count[k, confusion.true.index(x)] if x in confusion.true else 0 for k, x in enumerate(mapped)])
    able = np.array([name not in never for name in mapped], bool)
    of_right = W**2 * _variance(right[:, None], n_of, agreed)[:, 0] * able
    known = float(W.sum())
    in_use = [(name, k) for name, k, w in zip(confusion.mapped, n, weight, strict=True) if w > 0]
    return Adjusted(
        W @ (count / n_of[:, None]), np.sqrt(variance.sum(axis=0)), float(np.sqrt(absent.sum())),
        float(W @ (right / n_of)) / known if known > 0.0 else None,
        float(np.sqrt(of_right.sum())) / known if known > 0.0 else None,
        tuple(name for name, k in in_use if k < 2), tuple(name for name, k in in_use if 2 <= k < FEW),
        float(weight[~enough].sum()),
    )  # fmt: skip


def _variance(
    count: Float[np.ndarray, "stratum true"], n: Int[np.ndarray, " stratum"], agreed: Bool[np.ndarray, " stratum"]
) -> Float[np.ndarray, "stratum true"]:
    """Of shares p of points. Where all agree p (1 - p) is 0, though p may be off: there the second moment about p of
    Agresti and Coull's estimate, with points added to each side.
    """
    p, more = count / n[:, None], n[:, None] + 2 * _ADDED
    q = (count + _ADDED) / more
    return np.where(agreed[:, None], q * (1.0 - q) / more + (p - q) ** 2, p * (1.0 - p) / (n[:, None] - 1))
