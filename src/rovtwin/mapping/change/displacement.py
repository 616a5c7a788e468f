"""How far one mosaic lies from another, place by place, from their own pictures.

Patches of one are looked for in the other (normalised cross-correlation, at the top refined by a parabola). Each gives
a displacement with a covariance by its texture; a Gaussian process joins them to a field, with a standard deviation
where there is nothing to see:

    u(x) = common + v(x),    cov(v(x), v(y)) = s^2 exp(-|x - y| / L) (1 - w + w/2 [a(x) = a(y)] + w/2 [b(x) = b(y)])

a and b are the lines of either survey that saw a place: poses of two lines beside each other err by different amounts,
so the field jumps where a mosaic passes from one line to the next, and patches end there. s is what the mosaics state
as their errors within themselves, or less where the patches agree better with each other than that. The covariances of patches are enlarged where they agree less, and a patch that disagrees alone is dropped.

Reference: Lewis (1995), Fast normalized cross-correlation; Rasmussen and Williams (2006), Gaussian Processes, ch. 2.
"""

import itertools
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_factor, cho_solve
from scipy.ndimage import binary_dilation, distance_transform_edt, map_coordinates

from rovtwin.mapping.alignment.matching import correlations, cut, shift_of
from rovtwin.mapping.change.channels import box_mean

PATCH, SPACING = 0.4, 0.25  # [m]
LENGTH = 0.6  # over which errors within a mosaic keep alike [m]
_OWN = 0.75  # w: share of errors within a mosaic that each line has by itself
_LEAST_SCORE, _LEAST_SEEN = 0.5, 0.7
_FINE = 0.02  # cells that are searched are not smaller [m]
_COARSE = 4  # cells that the first, wide search takes together
_MOST = 1500  # patches in the field
_DROPPED = 4.0  # standard deviations beyond which a patch is no match
_ROUNDS = 30
_COMMON = 1.0  # sd of the common displacement before anything is seen [m]

Lines = tuple[Float[np.ndarray, "row column"], Float[np.ndarray, "row column"]]


@dataclass(frozen=True)
class Matches:
    """Patches of the first mosaic found in the second.

    Attributes:
        place: Row and column of their middles.
        lines: Of the first and of the second survey that saw them.
        shift: Rows and columns from there to the same thing in the second mosaic.
        variance: Of each component by texture and noise [cells2].
        score: Normalised cross-correlation.
    """

    place: Float[np.ndarray, "n 2"]
    lines: Float[np.ndarray, "n 2"]
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
    lines: Lines | None = None,
) -> Displacement | None:
    """Field of displacements between two images of one place; None where fewer than three patches are found again.

    Args:
        first: Image without trend, no number where nothing was seen.
        second: The other on the same grid.
        cell: Size of a cell [m].
        reach: Farthest that the second can lie from the first [m].
        within: Standard deviation of their difference within the mosaics, each component [m].
        lines: Number of the line of each survey that saw each cell, no number where none did; None: not known.
    """
    lines = tuple(np.where(np.isfinite(image), 0.0, np.nan) for image in (first, second)) if lines is None else lines
    step = max(int(_FINE / cell), 1)
    if step > 1:  # the search takes the fourth power of the number of cells a metre, and gains little by it
        a, b = (box_mean(image, step)[0][step // 2 :: step, step // 2 :: step] for image in (first, second))
        some = tuple(one[step // 2 :: step, step // 2 :: step] for one in lines)
        coarse = displacement(a, b, step * cell, reach, within, some)
        return None if coarse is None else _finer(coarse, first.shape, step)
    common = _common(first, second, max(int(np.ceil(reach / cell)), 1))
    nearby = max(int(np.ceil(4.0 * within / cell)), 3)
    found = _matches(first, second, lines, common, nearby, cell)
    if len(found.score) < 3:
        return None
    return _field(found, lines, cell, within / cell)


def _finer(found: Displacement, shape: tuple[int, ...], step: int) -> Displacement:
    """The same in cells that are so many times smaller."""
    at = [(np.arange(n) - step // 2) / step for n in shape[:2]]
    rows, columns = np.meshgrid(*at, indexing="ij")

    def fine(values: np.ndarray) -> np.ndarray:
        return step * map_coordinates(values, [rows, columns], order=1, mode="nearest")

    shift = np.stack([fine(found.shift[:, :, k]) for k in (0, 1)], axis=-1)
    m = found.matches
    matches = replace(m, place=m.place * step + step // 2, shift=m.shift * step, variance=m.variance * step**2)
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


def _matches(
    first: np.ndarray, second: np.ndarray, lines: Lines, common: tuple[int, int], nearby: int, cell: float
) -> Matches:
    """The best place of each patch within `nearby` cells of the common displacement, of one line in either survey."""
    half, step = max(round(0.5 * PATCH / cell), 2), max(round(SPACING / cell), 2)
    place, seen, found = [], [], []
    for row, column in itertools.product(*(range(half, n - half, step) for n in first.shape)):
        here, there = (row, column), (row + common[0], column + common[1])
        a, b = cut(lines[0], here, half), cut(lines[1], there, half + nearby)
        by = a[half, half], b[half + nearby, half + nearby]
        patch = np.where(a == by[0], cut(first, here, half), np.nan)
        search = np.where(b == by[1], cut(second, there, half + nearby), np.nan)
        one = shift_of(*correlations(patch, search, _LEAST_SEEN))
        if one is not None and one.score > _LEAST_SCORE:
            place.append(here)
            seen.append(by)
            found.append(one)
    return Matches(
        np.array(place, float).reshape(-1, 2),
        np.array(seen, float).reshape(-1, 2),
        np.array([common + one.shift for one in found]).reshape(-1, 2),
        np.array([np.diagonal(one.covariance) for one in found]).reshape(-1, 2),
        np.array([one.score for one in found]),
    )


def _field(found: Matches, lines: Lines, cell: float, within: float) -> Displacement:
    """Gaussian process through the patches: the others predict each as well as the widths say, or it is dropped."""
    if len(found.score) > _MOST:
        found = _taken(found, np.sort(np.argsort(-found.score)[:_MOST]))
    scale, dropped, stated = 1.0, 0, within
    for _ in range(_ROUNDS):
        K = _kernel(found.place, found.lines, found, cell, within)
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
    shift, sd = _spread_out(_Field(found, solved, cell, within), lines)
    return Displacement(shift, sd, found, dropped, scale)


def _kernel(
    place: np.ndarray, lines: np.ndarray, found: Matches, cell: float, within: float
) -> Float[np.ndarray, "n m"]:
    """Covariance of displacements at places, seen by these lines, and of those of patches [cells2]."""
    apart = np.linalg.norm(place[:, None] - found.place[None], axis=2) * cell
    alike = 1.0 - _OWN + _OWN * (lines[:, None] == found.lines[None]).mean(axis=2)
    return (_COMMON / cell) ** 2 + within**2 * alike * np.exp(-apart / LENGTH)


def _taken(found: Matches, which: np.ndarray) -> Matches:
    return Matches(*(getattr(found, one.name)[which] for one in fields(found)))


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


@dataclass(frozen=True)
class _Field:
    """Displacements at any place, by any lines."""

    found: Matches
    solved: list[_Solved]
    cell: float
    within: float

    def at(self, place: np.ndarray, lines: np.ndarray) -> Float[np.ndarray, "n 3"]:
        """Rows, columns, and standard deviation of each [cells]."""
        K = _kernel(place, lines, self.found, self.cell, self.within)
        prior = (_COMMON / self.cell) ** 2 + self.within**2
        left = [prior - np.einsum("ij,ji->i", K, cho_solve(one.factor, K.T)) for one in self.solved]
        sd = np.sqrt(np.maximum(np.mean(left, axis=0), 0.0))
        return np.column_stack([K @ self.solved[0].weights, K @ self.solved[1].weights, sd])


def _spread_out(
    field: _Field, lines: Lines
) -> tuple[Float[np.ndarray, "row column 2"], Float[np.ndarray, "row column"]]:
    """The field at every cell, by bilinear interpolation between knots of a tenth of a metre of the cell's own lines."""
    step, shape = max(round(0.1 / field.cell), 1), lines[0].shape
    here = np.stack(np.meshgrid(*(np.arange(n, dtype=float) for n in shape), indexing="ij"), axis=-1)
    full = np.broadcast_to(np.median(field.found.shift, axis=0), here.shape)
    tables: dict[tuple[float, float], np.ndarray] = {}
    for _ in range(2):  # which line of the second survey saw a place is known when its displacement is
        full = np.concatenate([full[:, :, :2], np.full((*shape, 1), np.nan)], axis=2)
        by = np.stack([lines[0], _nearest(lines[1], here + full[:, :, :2])], axis=-1)
        for pair in np.unique(by[np.isfinite(by).all(axis=2)], axis=0):
            cells = (by == pair).all(axis=2)
            key = (pair[0], pair[1])
            if key not in tables:
                tables[key] = _table(field, pair, cells, step)
            at = here[cells].T / step
            full[cells] = np.stack([map_coordinates(one, at, order=1, mode="nearest") for one in tables[key]], axis=1)
    near: Any = distance_transform_edt(np.isnan(full[:, :, 2]), return_distances=False, return_indices=True)
    full = full[tuple(near)]
    return full[:, :, :2], full[:, :, 2]


def _table(field: _Field, pair: np.ndarray, cells: np.ndarray, step: int) -> Float[np.ndarray, "3 row column"]:
    """The field at knots about cells that two lines saw."""
    at = np.argwhere(cells) // step
    knots = np.zeros([int(np.ceil(n / step)) + 2 for n in cells.shape], bool)
    knots[at[:, 0], at[:, 1]] = True
    knots = np.asarray(binary_dilation(knots, np.ones((3, 3)), iterations=3), bool)
    found = np.full((3, *knots.shape), np.nan)
    place = np.argwhere(knots)
    found[:, knots] = field.at(place * float(step), np.broadcast_to(pair, place.shape)).T
    return found


def _nearest(image: np.ndarray, at: Float[np.ndarray, "row column 2"]) -> Float[np.ndarray, "row column"]:
    """Values at places, of the nearest cell; no number beyond the image."""
    row, column = np.moveaxis(np.rint(at).astype(int), -1, 0)
    inside = (row >= 0) & (row < image.shape[0]) & (column >= 0) & (column < image.shape[1])
    found = np.full(inside.shape, np.nan)
    found[inside] = image[row[inside], column[inside]]
    return found


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
