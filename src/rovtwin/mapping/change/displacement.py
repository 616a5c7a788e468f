"""How far one mosaic lies from another, place by place, from their own pictures.

Patches of one are looked for in the other, see `patches`. A Gaussian process joins them to a field, with a standard
deviation where there is nothing to see:

    u(x) = common + v(x),    cov(v(x), v(y)) = s^2 exp(-|x - y| / L) (1 - w + w/2 [a(x) = a(y)] + w/2 [b(x) = b(y)])

a and b are the lines of either survey that saw a place: poses of two lines beside each other err by different amounts,
so the field jumps where a mosaic passes from one line to the next, and patches end there. L and s are the likeliest of
some; s is what the mosaics state as their errors within themselves at most, or less where the patches agree better with
each other than that. The covariances of patches are enlarged where they agree less, and a patch that disagrees alone is
dropped.

Reference: Rasmussen and Williams (2006), Gaussian Processes, ch. 2 and 5.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_factor, cho_solve
from scipy.ndimage import binary_dilation, distance_transform_edt, map_coordinates

from rovtwin.mapping.change.channels import box_mean
from rovtwin.mapping.change.patches import Lines, Matches, common_shift, matched

_LENGTHS = (0.6, 1.2, 2.5, 5.0)  # L: over which errors within a mosaic may keep alike [m]
_SHARES = (1.0, 0.5, 0.25)  # s: of what mosaics state
_OWN = 0.75  # w: share of errors within a mosaic that each line has by itself; four pairs of flights like 0.5 to 0.75
_FINE = 0.02  # cells that are searched are not smaller [m]
_MOST = 1500  # patches in the field
_DROPPED = 4.0  # standard deviations beyond which a patch is no match
_ROUNDS = 30
_COMMON = 1.0  # sd of the common displacement before anything is seen [m]


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
    if lines is None:
        lines = np.where(np.isfinite(first), 0.0, np.nan), np.where(np.isfinite(second), 0.0, np.nan)
    step = max(int(_FINE / cell), 1)
    if step > 1:  # the search takes the fourth power of the number of cells a metre, and gains little by it
        a, b = (box_mean(image, step)[0][step // 2 :: step, step // 2 :: step] for image in (first, second))
        some = lines[0][step // 2 :: step, step // 2 :: step], lines[1][step // 2 :: step, step // 2 :: step]
        coarse = displacement(a, b, step * cell, reach, within, some)
        return None if coarse is None else _finer(coarse, first.shape, step)
    common = common_shift(first, second, max(int(np.ceil(reach / cell)), 1))
    nearby = max(int(np.ceil(4.0 * within / cell)), 3)
    found = matched(first, second, lines, common, nearby, cell)
    if len(found.score) < 3:
        return None
    return _field(found, lines, cell, within)


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


def _field(found: Matches, lines: Lines, cell: float, within: float) -> Displacement:
    """Gaussian process through the patches."""
    if len(found.score) > _MOST:
        found = found.some(np.sort(np.argsort(-found.score)[:_MOST]))
    first = _settled(found, _Prior(cell, within, _LENGTHS[0]))  # bends most easily: what it drops, all would
    last = _settled(first.found, _likeliest(first.found, cell, within))
    shift, sd = _spread_out(last, lines)
    return Displacement(shift, sd, last.found, len(found.score) - len(last.found.score), last.scale)


def _settled(found: Matches, prior: "_Prior") -> "_Field":
    """The field, when the others predict each patch as well as the widths say, or it is dropped."""
    scale, least = 1.0, 0.1 * prior.within
    for _ in range(_ROUNDS):
        K = prior.between(found.place, found.lines, found)
        solved = [_Solved.of(K, found.variance[:, k] * scale**2, found.shift[:, k]) for k in (0, 1)]
        field = _Field(found, solved, prior, scale)
        worst = np.max(np.abs([one.left_out for one in solved]), axis=0)
        fits = float(np.median(np.abs([one.left_out for one in solved]))) / 0.6745
        if fits > 1.05:
            scale *= fits
        elif fits < 0.95 and prior.within > least:
            prior = replace(prior, within=prior.within * max(fits, 0.5))
        elif (out := worst > _DROPPED).any() and (~out).sum() >= 3:
            found = found.some(np.flatnonzero(~out))
        else:
            return field
    return field


def _likeliest(found: Matches, cell: float, within: float) -> "_Prior":
    """The prior that makes the patches likeliest."""
    priors = [_Prior(cell, within * share, length) for length in _LENGTHS for share in _SHARES]

    def likelihood(prior: _Prior) -> float:
        K = prior.between(found.place, found.lines, found)
        return sum(_Solved.of(K, found.variance[:, k], found.shift[:, k]).likelihood for k in (0, 1))

    return max(priors, key=likelihood)


@dataclass(frozen=True)
class _Prior:
    """What is known of displacements before patches are seen: s [m] and L [m], for cells of a size [m]."""

    cell: float
    within: float
    length: float

    @property
    def variance(self) -> float:
        """Of a displacement [cells2]."""
        return (_COMMON**2 + self.within**2) / self.cell**2

    def between(self, place: np.ndarray, lines: np.ndarray, found: Matches) -> Float[np.ndarray, "n m"]:
        """Covariance of displacements at places, seen by these lines, and of those of patches [cells2]."""
        apart = np.linalg.norm(place[:, None] - found.place[None], axis=2) * self.cell
        alike = 1.0 - _OWN + _OWN * (lines[:, None] == found.lines[None]).mean(axis=2)
        return (_COMMON**2 + self.within**2 * alike * np.exp(-apart / self.length)) / self.cell**2


@dataclass(frozen=True)
class _Solved:
    """One component.

    Attributes:
        weights: Of the patches.
        factor: Of their covariance.
        left_out: Each patch against all others [standard deviations].
        likelihood: Logarithm of it, but for a constant.
    """

    weights: Float[np.ndarray, " n"]
    factor: tuple[np.ndarray, bool]
    left_out: Float[np.ndarray, " n"]
    likelihood: float

    @classmethod
    def of(cls, K: np.ndarray, variance: np.ndarray, shift: np.ndarray) -> "_Solved":
        factor = cho_factor(K + np.diag(variance + 1e-6))
        weights = cho_solve(factor, shift)
        inverse = cho_solve(factor, np.eye(len(K)))
        # Rasmussen and Williams (2006), eq. 5.12: what the others predict, without solving anew for each.
        left_out = weights / np.sqrt(np.diagonal(inverse))
        likelihood = -0.5 * float(shift @ weights) - float(np.log(np.diagonal(factor[0])).sum())
        return cls(weights, factor, left_out, likelihood)


@dataclass(frozen=True)
class _Field:
    """Displacements at any place, by any lines."""

    found: Matches
    solved: list[_Solved]
    prior: _Prior
    scale: float

    def at(self, place: np.ndarray, lines: np.ndarray) -> Float[np.ndarray, "n 3"]:
        """Rows, columns, and standard deviation of each [cells]."""
        K = self.prior.between(place, lines, self.found)
        left = [self.prior.variance - np.einsum("ij,ji->i", K, cho_solve(one.factor, K.T)) for one in self.solved]
        sd = np.sqrt(np.maximum(np.mean(left, axis=0), 0.0))
        return np.column_stack([K @ self.solved[0].weights, K @ self.solved[1].weights, sd])


def _spread_out(
    field: _Field, lines: Lines
) -> tuple[Float[np.ndarray, "row column 2"], Float[np.ndarray, "row column"]]:
    """The field at every cell, bilinear between knots of a tenth of a metre of the cell's own lines."""
    step, shape = max(round(0.1 / field.prior.cell), 1), lines[0].shape
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
