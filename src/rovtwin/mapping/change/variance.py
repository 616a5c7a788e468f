"""How much the mean difference over the least thing varies where nothing changed: a covariance of shapes at each cell.

    Sigma = g (a + (b V_d + e (V_A + V_B)) / n + c sd_u^2 sum grad A_mean grad A_mean')

V_d is the covariance of differences from cell to cell about each place: grain that falls between cells, blur. V_A and
V_B are the imager's noise. The last term is what is left of displacement: beside an edge it changes brightness and
colour together, in the direction in which the two materials differ, which a real change there seldom has. What remains
of light and trend (a), how much of the grain survives the mean (b), and how far stated noise (e) and displacement
errors (c) hold are read from the cells themselves: all >= 0 are fitted to the spread among cells that are alike in
these terms, by medians, which the few that changed do not move. g is what differences about each cell have beside this:
registration, light and seams are not as good everywhere as in the middle.

Reference: for g, the threshold of radar by the clutter about each cell, of an order of it, Rohling (1983), IEEE Trans.
Aerospace and Electronic Systems 19(4).
"""

from itertools import combinations_with_replacement

import numpy as np
from jaxtyping import Float
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import map_coordinates
from scipy.optimize import nnls
from scipy.stats import chi2

from rovtwin.mapping.change.channels import box_mean, box_means

_ALIKE = (12, 5)  # classes of cells by misplacement, and in each by grain
_CLASS = 20  # cells of a class, at the least, for a spread to be read off them
FEWEST = _ALIKE[0] * _ALIKE[1] * (_CLASS + 1)  # cells with which all classes have so many
_ABOUT = 10  # times the least thing: over which g is read
_STATED = 10.0  # boxes of the least thing that g = 1 counts for beside those that are there

Image = Float[np.ndarray, "row column"]
Shapes = Float[np.ndarray, "row column shape"]


def covariance(
    d: Shapes, image: Shapes, noise: Float[np.ndarray, "row column shape shape"], sd: Image, box: int, wide: int
) -> tuple[Float[np.ndarray, "row column shape shape"], tuple[float, ...]]:
    """Sigma, and a, b, e, c of the first shape.

    Args:
        d: Difference of each cell by shape.
        image: Of the first mosaic.
        noise: Covariance of the difference by the imager's noise.
        sd: Standard deviation of the displacement [cells].
        box: Cells of the least thing.
        wide: Cells over which grain is alike.
    """
    count = d.shape[2]
    mean, cells = box_means(d, box), np.maximum(box_mean(d[:, :, 0], box)[1], 1.0)
    steep = np.gradient(box_means(image, box), axis=(0, 1))
    capped = np.stack([_capped(_grain(d, mean, k, k, box), wide) for k in range(count)], axis=2)
    own = np.stack([_grain(d, mean, k, k, box) for k in range(count)], axis=2)
    cap = np.sqrt(capped / np.maximum(own, 1e-300))

    def terms(i: int, j: int) -> list[Image]:
        grain = _grain(d, mean, i, j, box) * cap[:, :, i] * cap[:, :, j]
        counted = box_mean(noise[:, :, i, j], box)[0]
        return [grain / cells, counted / cells, sum(g[:, :, i] * g[:, :, j] for g in steep) * sd**2]

    factors = np.stack([_factors(mean[:, :, k], terms(k, k)) for k in range(count)])
    found = np.full((*d.shape, count), np.nan)
    for i, j in combinations_with_replacement(range(count), 2):
        both = np.sqrt(factors[i] * factors[j])  # of a sum of positive semi-definite matrices, scaled row and column
        value = both[0] * (i == j) + sum(f * term for f, term in zip(both[1:], terms(i, j), strict=True))
        found[:, :, i, j] = found[:, :, j, i] = np.maximum(value, 1e-12) if i == j else value
    return found, tuple(float(value) for value in factors[0])


def about(squares: Image, count: int, box: int) -> Image:
    """g: the median of squares D' Sigma^-1 D about each cell over that of chi squared with so many degrees."""
    step = max(box // 2, 1)
    half = round(_ABOUT * box / step) // 2
    some = np.pad(squares[::step, ::step], half, constant_values=np.nan)
    found = np.empty([n - 2 * half for n in some.shape])
    for row in range(len(found)):
        windows = sliding_window_view(some[row : row + 2 * half + 1], (2 * half + 1, 2 * half + 1))[0]
        ordered = np.sort(windows.reshape(len(windows), -1), axis=1)  # those without a number come last
        known = np.isfinite(ordered).sum(axis=1)
        middle = np.take_along_axis(ordered, (known // 2)[:, None], axis=1)[:, 0]
        boxes = known * (step / box) ** 2
        sum_of = np.where(known > 0, boxes * middle / chi2.ppf(0.5, count), 0.0)
        found[row] = (sum_of + _STATED) / (boxes + _STATED)
    rows, columns = np.meshgrid(*(np.arange(n) / step for n in squares.shape), indexing="ij")
    return map_coordinates(found, [rows, columns], order=1, mode="nearest")


def _grain(d: Shapes, mean: Shapes, i: int, j: int, box: int) -> Image:
    return box_mean((d[:, :, i] - mean[:, :, i]) * (d[:, :, j] - mean[:, :, j]), box)[0]


def _capped(variance: Image, wide: int) -> Image:
    """The larger of a variance here and that about here: an edge of what changed is no grain of the floor."""
    about_here = box_mean(variance, wide, 0.05)[0]
    return np.clip(variance, about_here, 4.0 * about_here)


def _factors(D: Image, terms: list[Image]) -> Float[np.ndarray, " part"]:
    """Of 1 and of terms of the variance."""
    seen = np.isfinite(D) & np.all([np.isfinite(term) for term in terms], axis=0)
    d, some = D[seen], np.stack([np.ones(seen.sum()), *(term[seen] for term in terms)], axis=1)
    rows, spread = [], []
    for by_last in np.array_split(np.argsort(some[:, -1]), _ALIKE[0]):
        for cells in np.array_split(by_last[np.argsort(some[by_last, -2])], _ALIKE[1]):
            if len(cells) > _CLASS:
                rows.append(np.median(some[cells], axis=0))
                spread.append((np.median(np.abs(d[cells])) / 0.6745) ** 2)
    if len(rows) < len(terms) + 1:
        return np.full(len(terms) + 1, np.nan)
    X, y = np.array(rows), np.array(spread) + 1e-12
    scale = X.max(axis=0) + 1e-300  # the terms' sizes differ by orders of magnitude
    return nnls(X / scale / y[:, None], np.ones(len(y)))[0] / scale  # each class's spread counts as a share of itself
