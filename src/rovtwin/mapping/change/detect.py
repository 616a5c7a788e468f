"""Which cells changed by more than noise, misplacement and the light can explain.

    d = B(x + u) - A, less its trend;    D = mean of d over the least thing that is looked for
    var D = a + (b v_d + e (noise_A^2 + noise_B^2)) / n + c |grad A_mean|^2 sd_u^2
    T = z' S^-1 z / K,   z = D / sd D

Channels are logarithms, so that a gain of light is an offset, which the trend takes away. Looked at are their mean,
slope and bend over the spectrum (Legendre polynomials): brightness, colour, and the rest, which err in different ways.
v_d is the variance of d from cell to cell about each place: grain that falls between cells, blur. What remains of
light and trend (a), how much of the grain survives the mean (b), and how far stated noise (e) and displacement errors
(c) hold are read from the cells themselves: all >= 0 are fitted to the spread of D among cells that are alike in these
terms, by medians, which the few that changed do not move. S is the correlation of the three, found without what stands
out. T of unchanged cells is taken to be Fisher's F with K and nu degrees of freedom, nu read off how far their tail
lies beyond the middle, so that effects which nobody stated (shadows, a rough floor seen from another side) make the
test more careful and not wrong; cells that stand far out, and those about them, do not count when it is read. Of all
cells those are named that keep the share of false ones below what was asked for.

Reference: change vectors as in Nielsen (2007), IEEE Trans. Image Processing 16(2); the F of Student's t of many
dimensions, Kotz and Nadarajah (2004), ch. 1; Benjamini and Hochberg (1995), J. R. Statist. Soc. B 57(1).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import binary_dilation, map_coordinates
from scipy.optimize import nnls
from scipy.stats import chi2, f

from rovtwin.mapping.change.channels import Channels, box_mean, box_means, without_trend
from rovtwin.mapping.change.displacement import Displacement, pulled_back

TREND = 4.0  # times the least thing: over which light, range and grain are taken to be alike
_ROUNDS = 8
_ALIKE = (12, 5)  # classes of cells by misplacement, and in each by grain
_CLASS = 20  # cells of a class, at the least, for a spread to be read off them
FEWEST = _ALIKE[0] * _ALIKE[1] * (_CLASS + 1)  # cells with which all classes have so many
_FAR = 1e-3  # chance of a cell that may have changed, when nu is read a second time
_TAIL = 0.9  # of cells, from which nu is read: beyond it may lie what changed
_ABOUT = 10.0  # times the least thing: over which differences are as large as about each cell
_STATED = 10.0  # boxes of the least thing that the stated variance counts for beside them
_NU = np.concatenate([np.arange(2.5, 12.0, 0.5), np.geomspace(12.0, 300.0, 20)])  # of the search


@dataclass(frozen=True)
class Test:
    """Cells of the first mosaic, held against the second.

    Attributes:
        difference: Change of the logarithm, mean over the least thing, less its trend; by channel.
        sd: Standard deviation of its mean over channels.
        statistic: T, 1 in the middle of unchanged cells.
        chance: Probability of such a T where nothing changed.
        changed: Cells that are named.
        parts: a [1], b, e and c of brightness: c below 1 says that displacements are better than stated.
        scale: What makes a statistic of a difference.
        trend: What was taken off the difference, by channel.
        limit: Greatest chance of a cell that is named; -1 where none is.
    """

    difference: Float[np.ndarray, "row column channel"]
    sd: Float[np.ndarray, "row column"]
    statistic: Float[np.ndarray, "row column"]
    chance: Float[np.ndarray, "row column"]
    changed: Bool[np.ndarray, "row column"]
    parts: tuple[float, ...]
    scale: "Scale"
    trend: Float[np.ndarray, "row column channel"]
    limit: float


@dataclass(frozen=True)
class Scale:
    """What makes a statistic of a difference.

    Attributes:
        shapes: Weights of channels for brightness, colour and the rest.
        spread: Standard deviation of each at each cell.
        S: Correlation of the three over their standard deviations, scaled so that T has its median where F has.
        freedom: nu; few say that the tails are far wider than a Gaussian's.
    """

    shapes: Float[np.ndarray, "channel shape"]
    spread: Float[np.ndarray, "row column shape"]
    S: Float[np.ndarray, "shape shape"]
    freedom: float

    def statistic(
        self, mean: Float[np.ndarray, "row column shape"], place: tuple[slice, ...] = (slice(None), slice(None))
    ) -> Float[np.ndarray, "row column"]:
        """T of mean differences by shape in a part of the cells; no number where one has none."""
        z = mean / self.spread[place]
        return np.asarray(np.einsum("...i,ij,...j->...", z, np.linalg.inv(self.S), z) / self.S.shape[0])

    def chance(self, T: Float[np.ndarray, "row column"]) -> Float[np.ndarray, "row column"]:
        """Probability of such a T where nothing changed."""
        return np.asarray(f.sf(T, self.S.shape[0], self.freedom))


def tested(
    first: Channels, second: Channels, moved: Displacement, cell: float, least: float, false_share: float
) -> Test:
    """Test each cell.

    Args:
        first: Of the first mosaic.
        second: Of the second, on the same grid.
        moved: From the first to the second.
        cell: Size of a cell [m].
        least: Size of the smallest thing that is looked for [m].
        false_share: Of the named cells, that may be false.
    """
    box, wide = max(round(least / cell), 1), max(round(TREND * least / cell), 3)
    there = pulled_back(np.concatenate([second.value, second.noise**2], axis=2), moved.shift)
    count = first.value.shape[2]
    raw, noise = there[:, :, :count] - first.value, first.noise**2 + there[:, :, count:]
    d = without_trend(raw, wide)
    D, shapes = box_means(d, box), _shapes(count)
    parts, spread = [], []
    for shape in shapes:
        one, image = d @ shape, first.value @ shape
        mean, cells = box_mean(one, box)
        smooth = box_mean(image, box)[0]
        steep = np.gradient(smooth, axis=0) ** 2 + np.gradient(smooth, axis=1) ** 2
        grain = _capped(box_mean((one - mean) ** 2, box)[0], wide) / np.maximum(cells, 1.0)
        counted = box_mean(noise @ shape**2, box)[0] / np.maximum(cells, 1.0)
        found, variance = _explained(mean, [grain, counted, steep * moved.sd**2])
        parts.append(tuple(float(value) for value in found))
        spread.append(np.sqrt(variance * _about(mean**2 / variance, box)))
    scale = _student(D, np.stack(shapes, axis=1), np.stack(spread, axis=2), box)
    statistic = scale.statistic(D @ scale.shapes)
    chance = scale.chance(statistic)
    limit = _limit(chance, false_share)
    changed = np.nan_to_num(chance, nan=1.0) <= limit
    return Test(D, spread[0], statistic, chance, changed, parts[0], scale, raw - d, limit)


def _shapes(count: int) -> list[Float[np.ndarray, " channel"]]:
    """Weights of channels: their mean, and what is left of slope and bend without what comes before."""
    x = np.linspace(-1.0, 1.0, count) if count > 1 else np.zeros(1)
    basis, _ = np.linalg.qr(np.stack([x**k for k in range(min(3, count))], axis=1))
    return list(basis.T * np.sign(basis[-1])[:, None] / np.sqrt(count))


def _capped(variance: Float[np.ndarray, "row column"], wide: int) -> Float[np.ndarray, "row column"]:
    """The larger of a variance here and that about here: an edge of what changed is no grain of the floor."""
    about = box_mean(variance, wide, 0.05)[0]
    return np.clip(variance, about, 4.0 * about)


def _explained(
    D: Float[np.ndarray, "row column"], terms: list[Float[np.ndarray, "row column"]]
) -> tuple[Float[np.ndarray, " part"], Float[np.ndarray, "row column"]]:
    """Factors of 1 and of terms of the variance, and the variance that they give each cell."""
    seen = np.isfinite(D) & np.all([np.isfinite(term) for term in terms], axis=0)
    d, some = D[seen], np.stack([np.ones(seen.sum()), *(term[seen] for term in terms)], axis=1)
    rows, spread = [], []
    for by_last in np.array_split(np.argsort(some[:, -1]), _ALIKE[0]):
        for cells in np.array_split(by_last[np.argsort(some[by_last, -2])], _ALIKE[1]):
            if len(cells) > _CLASS:
                rows.append(np.median(some[cells], axis=0))
                spread.append((np.median(np.abs(d[cells])) / 0.6745) ** 2)
    if len(rows) < len(terms) + 1:
        return np.ones(len(terms) + 1), np.full(D.shape, np.nan)
    X, y = np.array(rows), np.array(spread) + 1e-12
    scale = X.max(axis=0) + 1e-300  # the terms' sizes differ by orders of magnitude
    found = nnls(X / scale / y[:, None], np.ones(len(y)))[0] / scale  # each class's spread counts as a share of itself
    variance = found[0] + sum(factor * term for factor, term in zip(found[1:], terms, strict=True))
    return found, np.where(seen, np.maximum(variance, 1e-12), np.nan)


def _about(ratio: Float[np.ndarray, "row column"], box: int) -> Float[np.ndarray, "row column"]:
    """By what factor differences about each cell are larger than stated: the median of squares over their variance.

    Radar sets its threshold by the clutter about each cell in this way; of an order of them, the few that changed are
    no more than so many cells.
    """
    step, side = max(box // 2, 1), round(_ABOUT * box / max(box // 2, 1))
    half = side // 2
    some = np.pad(ratio[::step, ::step], half, constant_values=np.nan)
    found = np.empty(tuple(n - 2 * half for n in some.shape))
    for row in range(len(found)):
        windows = sliding_window_view(some[row : row + 2 * half + 1], (2 * half + 1, 2 * half + 1))[0]
        ordered = np.sort(windows.reshape(len(windows), -1), axis=1)  # those without a number come last
        count = np.isfinite(ordered).sum(axis=1)
        middle = np.take_along_axis(ordered, (count // 2)[:, None], axis=1)[:, 0]
        boxes = count * (step / box) ** 2
        found[row] = (np.where(count > 0, boxes * middle / chi2.ppf(0.5, 1), 0.0) + _STATED) / (boxes + _STATED)
    rows, columns = np.meshgrid(*(np.arange(n) / step for n in ratio.shape), indexing="ij")
    return map_coordinates(found, [rows, columns], order=1, mode="nearest")


def _student(
    D: Float[np.ndarray, "row column channel"],
    shapes: Float[np.ndarray, "channel shape"],
    spread: Float[np.ndarray, "row column shape"],
    box: int,
) -> Scale:
    """S and nu of what did not change: without cells that stand far out, and those whose squares reach into theirs."""
    z = D @ shapes / spread
    seen = np.isfinite(z).all(axis=2)
    scale = _fitted(z[seen], shapes, spread)
    if not np.isfinite(scale.freedom):
        return scale
    far = seen & (np.nan_to_num(scale.chance(scale.statistic(D @ shapes)), nan=1.0) < _FAR)
    return _fitted(z[seen & ~np.asarray(binary_dilation(far, iterations=box), bool)], shapes, spread)


def _fitted(
    some: Float[np.ndarray, "n shape"],
    shapes: Float[np.ndarray, "channel shape"],
    spread: Float[np.ndarray, "row column shape"],
) -> Scale:
    count = shapes.shape[1]
    if len(some) < 10 * count:
        return Scale(shapes, spread, np.full((count, count), np.nan), np.nan)
    S = np.diag((np.median(np.abs(some), axis=0) / 0.6745) ** 2) + 1e-12 * np.eye(count)
    for _ in range(_ROUNDS):
        squares = _squares(some, S)
        keep = some[squares < np.quantile(squares, 0.9)]
        S = keep.T @ keep / len(keep) + 1e-12 * np.eye(count)
        S *= np.median(_squares(some, S)) / chi2.ppf(0.5, count)
    squares = _squares(some, S) / count
    middle, tail = np.quantile(squares, [0.5, _TAIL])
    ratios = f.ppf(_TAIL, count, _NU) / f.ppf(0.5, count, _NU)
    freedom = float(_NU[np.argmin(np.abs(np.log(ratios / (tail / middle))))])
    return Scale(shapes, spread, S * middle / f.ppf(0.5, count, freedom), freedom)


def _squares(z: Float[np.ndarray, "n channel"], S: Float[np.ndarray, "channel channel"]) -> Float[np.ndarray, " n"]:
    return np.einsum("ni,ij,nj->n", z, np.linalg.inv(S), z)


def _limit(chance: Float[np.ndarray, "row column"], false_share: float) -> float:
    """Benjamini and Hochberg's: cells of a smaller chance are named; that cells overlap makes it no more generous."""
    some = np.sort(chance[np.isfinite(chance)])
    below = np.flatnonzero(some <= false_share * np.arange(1, len(some) + 1) / max(len(some), 1))
    return float(some[below[-1]]) if below.size else -1.0
