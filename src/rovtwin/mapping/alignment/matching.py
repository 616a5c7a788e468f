"""Ties found in the pictures themselves: patches of one strip looked for in the other, by normalised cross-correlation.

Strips are gridded by each line's own estimate, so that two of them differ by a shift that is nearly the same all over a
patch. The peak is found to a part of a cell on the paraboloid through its neighbours. How well a shift is known follows
from the correlation r and its curvature H at the peak, with n cells (Cramér and Rao, for white noise in both):

    cov = (1 - r) / (r n) (-H)^-1

A patch whose highest peak is hardly above the next, or flat in one direction, ties nothing.

Reference: Gruen (1985), Adaptive least squares correlation, South African Journal of Photogrammetry 14(3).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.lib.stride_tricks import sliding_window_view

from rovtwin.mapping.alignment.strips import Strip
from rovtwin.mapping.alignment.ties import Ties


@dataclass(frozen=True)
class Matching:
    """How patches are matched.

    Attributes:
        size: Side of a patch [m].
        reach: How far it is looked for, each way [m].
        every: From patch to patch along the overlap [m].
        least: Correlation below which nothing is tied.
        distinct: Share of the highest peak that the next one, farther than `apart` cells away, may reach.
        apart: Cells.
        whole: Share of a patch that both strips must see.
        most: Patches that are tried in all; of more, so many spread evenly: the update takes memory with their square.
        floor: Standard deviation of a tie at its best, in cells: grids, and what floors and pixels are off by.
    """

    size: float = 0.36
    reach: float = 0.30
    every: float = 0.5
    least: float = 0.6
    distinct: float = 0.9
    apart: int = 5
    whole: float = 0.6
    most: int = 2000
    floor: float = 0.35


USUAL = Matching()


def match_strips(strips: Sequence[Strip], how: Matching = USUAL) -> Ties:
    """Ties between all strips that overlap."""
    places = [place for k, one in enumerate(strips) for other in strips[k + 1 :] for place in _of_pair(one, other, how)]
    untried = max(len(places) - how.most, 0)
    if untried:
        places = [places[k] for k in np.linspace(0, len(places) - 1, how.most).astype(int)]
    found = [tie for one, other, middle, shift in places if (tie := _at(one, other, middle, shift, how)) is not None]
    if not found:
        return Ties(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0), untried)
    t, pixel, covariance, quality = (np.array(part) for part in zip(*found, strict=True))
    return Ties(t, pixel, covariance, quality, untried)


_Place = tuple[Strip, Strip, tuple[int, int], np.ndarray]
_Tie = tuple[list[float], list[float], Float[np.ndarray, "2 2"], float]


def _of_pair(one: Strip, other: Strip, how: Matching) -> list[_Place]:
    """Patches along the overlap of two strips, one every so often."""
    shift = np.rint((other.corner - one.corner) / one.cell).astype(int)  # cells: index in one = index in other + shift
    low = np.maximum(0, shift)
    high = np.minimum(np.array(one.bright.shape), shift + np.array(other.bright.shape))
    if (high - low < round(how.size / one.cell)).any():
        return []
    both = np.zeros(one.bright.shape, bool)
    window = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    both[window] = (
        one.seen[window] & other.seen[tuple(slice(a - s, b - s) for a, b, s in zip(low, high, shift, strict=True))]
    )
    return [(one, other, middle, shift) for middle in _middles(both, one.cell, how)]


def _middles(both: np.ndarray, cell: float, how: Matching) -> list[tuple[int, int]]:
    """Cells in the middle of an overlap, so far apart along its longer side, and across it where it is wide."""
    at = np.argwhere(both)
    if not len(at):
        return []
    long = int(np.argmax(np.ptp(at, axis=0)))
    step, half = max(round(how.every / cell), 1), round(0.5 * how.size / cell)
    found = []
    for place in range(int(at[:, long].min()) + half, int(at[:, long].max()) - half + 1, step):
        across = np.sort(at[at[:, long] == place][:, 1 - long])
        if not len(across):
            continue
        width = across[-1] - across[0] + 1
        count = max(int(width // (2 * step)), 1)
        for share in (np.arange(count) + 0.5) / count:
            middle = int(across[min(int(share * len(across)), len(across) - 1)])
            found.append((place, middle) if long == 0 else (middle, place))
    return found


def _at(one: Strip, other: Strip, middle: tuple[int, int], shift: np.ndarray, how: Matching) -> _Tie | None:
    """The tie of a patch about a cell of one, if there is any."""
    half, reach = round(0.5 * how.size / one.cell), round(how.reach / one.cell)
    patch = cut(one.bright, middle, half)
    there = (middle[0] - shift[0], middle[1] - shift[1])
    correlation, cells = correlations(patch, cut(other.bright, there, half + reach), how.whole)
    found = shift_of(correlation, cells)
    if found is None or found.score < how.least:
        return None
    if _next_peak(correlation, found.peak, how.apart) > how.distinct * found.score:
        return None
    covariance = found.covariance + how.floor**2 * np.eye(2)
    if np.sqrt(np.linalg.eigvalsh(covariance)[-1]) > 2.0:  # cells
        return None
    seen = [_when(one, np.array(middle, float), half), _when(other, np.array(there) + found.shift, half)]
    if not np.isfinite(seen).all():
        return None
    return [x[0] for x in seen], [x[1] for x in seen], covariance * one.cell**2, found.score


def correlations(
    patch: Float[np.ndarray, "n n"], search: Float[np.ndarray, "m m"], whole: float
) -> tuple[Float[np.ndarray, "k k"], Float[np.ndarray, "k k"]]:
    """Normalised cross-correlation at each place of a patch in a larger picture, over the cells that both have.

    No number where they have less than a share `whole` in common; and how many cells those are.
    """
    n = len(patch)
    windows = sliding_window_view(search, (n, n))
    mask = np.isfinite(windows) & np.isfinite(patch)
    a, b = np.where(mask, patch, 0.0), np.where(mask, windows, 0.0)
    count = mask.sum(axis=(2, 3)).astype(float)
    with np.errstate(invalid="ignore", divide="ignore"):
        sa, sb = a.sum(axis=(2, 3)), b.sum(axis=(2, 3))
        ab = (a * b).sum(axis=(2, 3)) - sa * sb / count
        aa, bb = (a * a).sum(axis=(2, 3)) - sa**2 / count, (b * b).sum(axis=(2, 3)) - sb**2 / count
        found = ab / np.sqrt(aa * bb)
    return np.where(count >= whole * n * n, found, np.nan), count


@dataclass(frozen=True)
class Shift:
    """Where a patch lies in the picture that it was looked for in.

    Attributes:
        peak: Row and column of the highest correlation.
        shift: Rows and columns from the middle of the picture to the top of the paraboloid through that peak.
        covariance: Of the shift, by Cramér and Rao [cells2].
        score: The highest correlation.
    """

    peak: tuple[int, int]
    shift: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]
    score: float


def shift_of(correlation: Float[np.ndarray, "k k"], cells: Float[np.ndarray, "k k"]) -> Shift | None:
    """The shift at the highest of the `correlations`; None where they have no top inside."""
    if not np.isfinite(correlation).any():
        return None
    row, column = divmod(int(np.nanargmax(correlation)), correlation.shape[1])
    peak = row, column
    best, fine = float(correlation[peak]), _fine(correlation, peak)
    if fine is None or best <= 0.0:
        return None
    offset, curvature = fine
    covariance = (1.0 - best) / (best * cells[peak]) * np.linalg.inv(-curvature)
    return Shift(peak, np.array(peak) - correlation.shape[0] // 2 + offset, covariance, best)


def cut(picture: Float[np.ndarray, "r c"], middle: tuple[int, int], half: int) -> Float[np.ndarray, "n n"]:
    """A square about a cell, no numbers where the picture ends."""
    found = np.full((2 * half + 1, 2 * half + 1), np.nan)
    low = np.array(middle) - half
    begin = np.clip(low, 0, picture.shape)
    end = np.clip(np.array(middle) + half + 1, begin, picture.shape)
    part = picture[begin[0] : end[0], begin[1] : end[1]]
    at = begin - low
    if part.size:
        found[at[0] : at[0] + part.shape[0], at[1] : at[1] + part.shape[1]] = part
    return found


def _next_peak(correlation: Float[np.ndarray, "k k"], peak: tuple[int, int], apart: int) -> float:
    """Largest correlation farther away than so many cells."""
    i, j = np.indices(correlation.shape)
    far = np.maximum(np.abs(i - peak[0]), np.abs(j - peak[1])) > apart
    rest = np.where(far, correlation, np.nan)
    return float(np.nanmax(rest)) if np.isfinite(rest).any() else -1.0


def _fine(
    correlation: Float[np.ndarray, "k k"], peak: tuple[int, int]
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2 2"]] | None:
    """Top of the paraboloid through the nine values about a peak, from it in cells, and its curvature; None: no top."""
    i, j = peak
    if not (0 < i < correlation.shape[0] - 1 and 0 < j < correlation.shape[1] - 1):
        return None
    part = correlation[i - 1 : i + 2, j - 1 : j + 2]
    if not np.isfinite(part).all():
        return None
    u, v = (x.ravel() for x in np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], indexing="ij"))
    A = np.column_stack([np.ones(9), u, v, 0.5 * u * u, u * v, 0.5 * v * v])
    c = np.linalg.lstsq(A, part.ravel(), rcond=None)[0]
    H = np.array([[c[3], c[4]], [c[4], c[5]]])
    if np.linalg.eigvalsh(H)[-1] >= -1e-6:
        return None
    top = -np.linalg.solve(H, c[1:3])
    return (top, H) if np.abs(top).max() <= 1.0 else None


def _when(strip: Strip, at: Float[np.ndarray, "2"], half: int) -> Float[np.ndarray, "2"]:
    """Stamp and pixel that saw a place between cells: planes through those of the cells about it."""
    i, j = np.rint(at).astype(int)
    near = max(half // 3, 2)
    t, pixel = (cut(x, (int(i), int(j)), near) for x in (strip.t, strip.pixel))
    cells, good = np.indices(t.shape) - near, np.isfinite(t)
    u, v = cells[0], cells[1]
    if good.sum() < 6:
        return np.full(2, np.nan)
    A = np.column_stack([np.ones(good.sum()), u[good] + i - at[0], v[good] + j - at[1]])
    found, *_ = np.linalg.lstsq(A, np.column_stack([t[good], pixel[good]]), rcond=None)
    return found[0]
