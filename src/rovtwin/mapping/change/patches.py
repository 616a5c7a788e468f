"""Patches of one mosaic found again in another, by normalised cross-correlation, at the top refined by a paraboloid.

Reference: Lewis (1995), Fast normalized cross-correlation.
"""

import itertools
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float

from rovtwin.mapping.alignment.matching import correlations, cut, shift_of
from rovtwin.mapping.change.channels import box_mean

PATCH, SPACING = 0.4, 0.25  # [m]
_LEAST_SCORE, _LEAST_SEEN = 0.5, 0.7
_COARSE = 4  # cells that the first, wide search takes together

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

    def some(self, which: np.ndarray) -> "Matches":
        """Some of them."""
        return Matches(*(getattr(self, one.name)[which] for one in fields(self)))


def common_shift(first: np.ndarray, second: np.ndarray, reach: int) -> tuple[int, int]:
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


def matched(
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
