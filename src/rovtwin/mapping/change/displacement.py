"""How far one mosaic lies from another, place by place, from their own pictures.

Patches of one are looked for in the other (normalised cross-correlation, at the top refined by a parabola). Each gives
a displacement with a covariance by its texture; a Gaussian process joins them to a field, with a standard deviation
where there is nothing to see:

    u(x) = common + v(x),    cov(v(x), v(y)) = s^2 exp(-|x - y| / L)

s is what the mosaics state as their errors within themselves, or less where the patches agree better with each other
than that. The covariances of patches are enlarged where they agree less, and a patch that disagrees alone is dropped.

Reference: Lewis (1995), Fast normalized cross-correlation; Rasmussen and Williams (2006), Gaussian Processes, ch. 2.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_factor, cho_solve
from scipy.ndimage import map_coordinates

from rovtwin.mapping.alignment.matching import correlations, cut, shift_of
from rovtwin.mapping.change.channels import box_mean

PATCH, SPACING = 0.4, 0.25  # [m]
LENGTH = 0.6  # over which errors within a mosaic keep alike [m]
_LEAST_SCORE, _LEAST_SEEN = 0.5, 0.7
_FINE = 0.02  # cells that are searched are not smaller [m]
_COARSE = 4  # cells that the first, wide search takes together
_MOST = 1500  # patches in the field
_DROPPED = 4.0  # standard deviations beyond which a patch is no match
_ROUNDS = 30
_COMMON = 1.0  # sd of the common displacement before anything is seen [m]


@dataclass(frozen=True)
class Matches:
    """Patches of the first mosaic found in the second.

    Attributes:
        place: Row and column of their middles.
        shift: Rows and columns from there to the same thing in the second mosaic.
        variance: Of each component by texture and noise [cells2].
        score: Normalised cross-correlation.
    """

    place: Float[np.ndarray, "n 2"]
    shift: Float[np.ndarray, "n 2"]
    variance: Float[np.ndarray, "n 2"]
    score: Float[np.ndarray, " n"]


@dataclass(frozen=True)
class Displacement:
    """From the first mosaic to the second.

    Attributes:
        shift: Rows and columns at each cell.
        sd: Standard deviation of each component [cells].
        matches: Patches that were used.
        dropped: How many disagreed with the others.
        scale: Factor by which patches' standard deviations were enlarged.
    """

    shift: Float[np.ndarray, "row column 2"]
    sd: Float[np.ndarray, "row column"]
    matches: Matches
    dropped: int
    scale: float


def displacement(
    first: Float[np.ndarray, "row column"],
    second: Float[np.ndarray, "row column"],
    cell: float,
    reach: float,
    within: float,
) -> Displacement | None:
    """Field of displacements between two images of one place; None where fewer than three patches are found again.

    Args:
        first: Image without trend, no number where nothing was seen.
        second: The other on the same grid.
        cell: Size of a cell [m].
        reach: Farthest that the second can lie from the first [m].
        within: Standard deviation of their difference within the mosaics, each component [m].
    """
    step = max(int(_FINE / cell), 1)
    if step > 1:  # the search takes the fourth power of the number of cells a metre, and gains little by it
        a, b = (box_mean(image, step)[0][step // 2 :: step, step // 2 :: step] for image in (first, second))
        coarse = displacement(a, b, step * cell, reach, within)
        return None if coarse is None else _finer(coarse, first.shape, step)
    common = _common(first, second, max(int(np.ceil(reach / cell)), 1))
    nearby = max(int(np.ceil(4.0 * within / cell)), 3)
    found = _matches(first, second, common, nearby, cell)
    if len(found.score) < 3:
        return None
    return _field(found, first.shape, cell, within / cell)


def _finer(found: Displacement, shape: tuple[int, ...], step: int) -> Displacement:
    """The same in cells that are so many times smaller."""
    at = [(np.arange(n) - step // 2) / step for n in shape[:2]]
    rows, columns = np.meshgrid(*at, indexing="ij")

    def fine(values: np.ndarray) -> np.ndarray:
        return step * map_coordinates(values, [rows, columns], order=1, mode="nearest")

    shift = np.stack([fine(found.shift[:, :, k]) for k in (0, 1)], axis=-1)
    m = found.matches
    matches = Matches(m.place * step + step // 2, m.shift * step, m.variance * step**2, m.score)
    return Displacement(shift, fine(found.sd), matches, found.dropped, found.scale)


def _common(first: np.ndarray, second: np.ndarray, reach: int) -> tuple[int, int]:
    """Displacement of the whole, to some cells: the best of all within reach on images of fewer cells."""
    step = _COARSE if reach > _COARSE else 1
    a, b = (box_mean(image, step)[0][step // 2 :: step, step // 2 :: step] for image in (first, second))
    most = max(reach // step, 1)
    scores = {(i, j): _score(a, b, i, j) for i in range(-most, most + 1) for j in range(-most, most + 1)}
    i, j = max(scores, key=lambda key: scores[key])
    return i * step, j * step


def _shifted(image: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """What lies so many rows and columns farther, at each cell."""
    moved = np.full_like(image, np.nan)
    n, m = image.shape
    to = (slice(max(-rows, 0), n - max(rows, 0)), slice(max(-columns, 0), m - max(columns, 0)))
    at = (slice(max(rows, 0), n - max(-rows, 0)), slice(max(columns, 0), m - max(-columns, 0)))
    if abs(rows) < n and abs(columns) < m:
        moved[to] = image[at]
    return moved


def _score(a: np.ndarray, b: np.ndarray, rows: int, columns: int) -> float:
    """Correlation of two images with one shifted; -1 where they hardly overlap."""
    moved = _shifted(b, rows, columns)
    both = np.isfinite(a) & np.isfinite(moved)
    if both.sum() < max(0.05 * np.isfinite(a).sum(), 9):
        return -1.0
    x, y = a[both] - a[both].mean(), moved[both] - moved[both].mean()
    return float(x @ y / max(np.linalg.norm(x) * np.linalg.norm(y), 1e-30))


def _matches(first: np.ndarray, second: np.ndarray, common: tuple[int, int], nearby: int, cell: float) -> Matches:
    """The best place of each patch within `nearby` cells of the common displacement."""
    half, step = max(round(0.5 * PATCH / cell), 2), max(round(SPACING / cell), 2)
    place, found = [], []
    for row, column in itertools.product(*(range(half, n - half, step) for n in first.shape)):
        there = row + common[0], column + common[1]
        compared = correlations(cut(first, (row, column), half), cut(second, there, half + nearby), _LEAST_SEEN)
        one = shift_of(*compared)
        if one is not None and one.score > _LEAST_SCORE:
            place.append([row, column])
            found.append(one)
    return Matches(
        np.array(place, float).reshape(-1, 2),
        np.array([common + one.shift for one in found]).reshape(-1, 2),
        np.array([np.diagonal(one.covariance) for one in found]).reshape(-1, 2),
        np.array([one.score for one in found]),
    )


def _field(found: Matches, shape: tuple[int, ...], cell: float, within: float) -> Displacement:
    """Gaussian process through the patches: the others predict each as well as the widths say, or it is dropped."""
    if len(found.score) > _MOST:
        found = _taken(found, np.sort(np.argsort(-found.score)[:_MOST]))
    scale, dropped, stated = 1.0, 0, within
    for _ in range(_ROUNDS):
        K = _kernel(found.place, found.place, cell, within)
        solved = [_Solved.of(K, found.variance[:, k] * scale**2, found.shift[:, k]) for k in (0, 1)]
        worst = np.max(np.abs([one.left_out for one in solved]), axis=0)
        fits = float(np.median(np.abs([one.left_out for one in solved]))) / 0.6745
        if fits > 1.05:
            scale *= fits
        elif fits < 0.95 and within > 0.1 * stated:
            within *= max(fits, 0.5)
        elif (out := worst > _DROPPED).any() and (~out).sum() >= 3:
            dropped += int(out.sum())
            found = _taken(found, np.flatnonzero(~out))
        else:
            break
    return _spread_out(found, solved, shape, cell, within, dropped, scale)


def _kernel(a: np.ndarray, b: np.ndarray, cell: float, within: float) -> Float[np.ndarray, "n m"]:
    """Covariance of displacements at places [cells2]."""
    apart = np.linalg.norm(a[:, None] - b[None], axis=2) * cell
    return (_COMMON / cell) ** 2 + within**2 * np.exp(-apart / LENGTH)


def _taken(found: Matches, which: np.ndarray) -> Matches:
    return Matches(found.place[which], found.shift[which], found.variance[which], found.score[which])


@dataclass(frozen=True)
class _Solved:
    """One component: weights of the patches, factor, and each patch against all others [standard deviations]."""

    weights: Float[np.ndarray, " n"]
    factor: tuple[np.ndarray, bool]
    left_out: Float[np.ndarray, " n"]

    @classmethod
    def of(cls, K: np.ndarray, variance: np.ndarray, shift: np.ndarray) -> "_Solved":
        factor = cho_factor(K + np.diag(variance + 1e-6))
        weights = cho_solve(factor, shift)
        inverse = cho_solve(factor, np.eye(len(K)))
        # Rasmussen and Williams (2006), eq. 5.12: what the others predict, without solving anew for each.
        return cls(weights, factor, weights / np.sqrt(np.diagonal(inverse)))


def _spread_out(
    found: Matches,
    solved: list[_Solved],
    shape: tuple[int, ...],
    cell: float,
    within: float,
    dropped: int,
    scale: float,
) -> Displacement:
    """The field at every cell, by bilinear interpolation between knots of a tenth of a metre."""
    step = max(round(0.1 / cell), 1)
    counts = [int(np.ceil(n / step)) + 1 for n in shape[:2]]
    knots = np.stack(np.meshgrid(*(np.arange(n) * step for n in counts), indexing="ij"), axis=-1).reshape(-1, 2)
    K = _kernel(knots.astype(float), found.place, cell, within)
    shift = np.stack([K @ one.weights for one in solved], axis=-1)
    prior = (_COMMON / cell) ** 2 + within**2
    left = [prior - np.einsum("ij,ji->i", K, cho_solve(one.factor, K.T)) for one in solved]
    sd = np.sqrt(np.maximum(np.mean(left, axis=0), 0.0))
    rows, columns = np.meshgrid(*(np.arange(n) / step for n in shape[:2]), indexing="ij")

    def fine(values: np.ndarray) -> np.ndarray:
        return map_coordinates(values.reshape(counts), [rows, columns], order=1, mode="nearest")

    field = np.stack([fine(shift[:, k]) for k in (0, 1)], axis=-1)
    return Displacement(field, fine(sd), found, dropped, scale)


def pulled_back(
    image: Float[np.ndarray, "row column channel"], shift: Float[np.ndarray, "row column 2"]
) -> Float[np.ndarray, "row column channel"]:
    """The second image as it would lie on the first; no number where one of four neighbours has none."""
    rows, columns = np.meshgrid(*(np.arange(n, dtype=float) for n in image.shape[:2]), indexing="ij")
    at = [rows + shift[:, :, 0], columns + shift[:, :, 1]]
    return np.stack(
        [map_coordinates(image[:, :, k], at, order=1, mode="constant", cval=np.nan) for k in range(image.shape[2])],
        axis=-1,
    )
