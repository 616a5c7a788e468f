"""How far vehicle files differ: parameter by parameter in standard deviations, and as a whole.

Errors of two files are taken as independent. Where they share a prior or a test they are not, and differ by less.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.identification.diagnostics.stated import Stated, Value

_FLAT = 1e-7  # eigenvalues of the correlation below which a rounded covariance says nothing


@dataclass(frozen=True)
class Difference:
    """Of one parameter from that of the first file.

    Attributes:
        relative: Value over the first less one; NaN where the first is zero or the sign may change.
        deviations: Difference over its standard deviation; NaN where neither file has one.
        both: Whether both files have one, so that neither is taken as exact.
    """

    relative: float
    deviations: float
    both: bool


@dataclass(frozen=True)
class Whole:
    """All parameters that both files have and at least one knows the width of, together.

    Attributes:
        distance: Squared distance in standard deviations, correlations included.
        count: Directions that it is the sum of; also what is expected where nothing but errors differs.
        chance: That errors alone give as much.
    """

    distance: float
    count: int
    chance: float


def difference(first: Value, other: Value) -> Difference:
    """Of two values of a parameter."""
    logarithmic = first.positive and other.positive and first.value > 0 and other.value > 0
    gap = _gap(first, other) if logarithmic or not first.positive else other.value - first.value
    widths = [w for w in (first.std, other.std) if np.isfinite(w) and w > 0]
    deviations = float(gap / np.sqrt(sum(w**2 for w in widths))) if widths else float("nan")
    relative = other.value / first.value - 1.0 if logarithmic else float("nan")
    return Difference(float(relative), deviations, len(widths) == 2)


def as_a_whole(first: Stated, other: Stated) -> Whole | None:
    """Squared Mahalanobis distance of two files; None where no parameter of both has a width."""
    from scipy.stats import chi2

    names = [n for n in first.values if n in other.values and {n} & ({*_known(first)} | {*_known(other)})]
    names = [n for n in names if first.values[n].positive == other.values[n].positive]
    if not names:
        return None
    C = _covariance(first, names) + _covariance(other, names)
    gap = np.array([_gap(first.values[n], other.values[n]) for n in names])
    std = np.sqrt(np.diag(C))
    spread, axes = np.linalg.eigh(C / np.outer(std, std))
    kept = spread > _FLAT
    along = axes[:, kept].T @ (gap / std)
    distance = float(np.sum(along**2 / spread[kept]))
    return Whole(distance, int(kept.sum()), float(chi2.sf(distance, kept.sum())))


def _known(one: Stated) -> list[str]:
    return [p.name for p in one.parameters.free]


def _gap(a: Value, b: Value) -> float:
    return a.parameter.theta(b.value)


def _covariance(one: Stated, names: list[str]) -> Float[np.ndarray, "n n"]:
    """Of the named parameters; zero for what is taken as exact."""
    C = np.zeros((len(names), len(names)))
    known = _known(one)
    rows = [i for i, n in enumerate(names) if n in known]
    if rows and one.covariance is not None:
        columns = [known.index(names[i]) for i in rows]
        C[np.ix_(rows, rows)] = one.covariance[np.ix_(columns, columns)]
    return C
