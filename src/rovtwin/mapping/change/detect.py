"""Which cells changed by more than noise, misplacement and the light can explain.

    d = B(x + u) - A, less its trend;    D = mean of d over the least thing that is looked for
    T = D' Sigma^-1 D / K

Channels are logarithms, so that a gain of light is an offset, which the trend takes away. Looked at are their mean,
slope and bend over the spectrum (Legendre polynomials): brightness, colour, and the rest, which err in different ways,
and together where a displacement is left beside an edge: see `variance` for Sigma. What of their correlation is not in
it is found without what stands out. How large T becomes where nothing changed is read off its local maxima, see
`tail`, so that effects which nobody stated (shadows, a rough floor seen from another side) make the test more careful
and not wrong.

Reference: change vectors as in Nielsen (2007), IEEE Trans. Image Processing 16(2).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import chi2

from rovtwin.mapping.change.channels import Channels, box_means, without_trend
from rovtwin.mapping.change.displacement import Displacement, pulled_back
from rovtwin.mapping.change.tail import Unchanged, places, unchanged
from rovtwin.mapping.change.variance import about, covariance

TREND = 4.0  # times the least thing: over which light, range and grain are taken to be alike
NAMED = 0.25  # share of the least thing's area that its named cells must have: a thing of that size is no single spot
_ROUNDS = 8


@dataclass(frozen=True)
class Test:
    """Cells of the first mosaic, held against the second.

    Attributes:
        difference: Change of the logarithm, mean over the least thing, less its trend; by channel.
        sd: Standard deviation of its mean over channels.
        statistic: T, 1 in the middle of unchanged cells.
        chance: Probability that a place has such a T or more where nothing changed.
        changed: Cells that are named.
        parts: a [1], b, e and c of brightness: c below 1 says that displacements are better than stated.
        scale: What makes a statistic of a difference.
        trend: What was taken off the difference, by channel.
        unchanged: T of places where nothing changed.
    """

    difference: Float[np.ndarray, "row column channel"]
    sd: Float[np.ndarray, "row column"]
    statistic: Float[np.ndarray, "row column"]
    chance: Float[np.ndarray, "row column"]
    changed: Bool[np.ndarray, "row column"]
    parts: tuple[float, ...]
    scale: "Scale"
    trend: Float[np.ndarray, "row column channel"]
    unchanged: Unchanged


@dataclass(frozen=True)
class Scale:
    """What makes a statistic of a difference.

    Attributes:
        shapes: Weights of channels for brightness, colour and the rest.
        inverse: Of the covariance of the three at each cell.
    """

    shapes: Float[np.ndarray, "channel shape"]
    inverse: Float[np.ndarray, "row column shape shape"]

    def statistic(
        self, mean: Float[np.ndarray, "row column shape"], place: tuple[slice, ...] = (slice(None), slice(None))
    ) -> Float[np.ndarray, "row column"]:
        """T of mean differences by shape in a part of the cells; no number where one has none."""
        return np.einsum("rci,rcij,rcj->rc", mean, self.inverse[place], mean) / mean.shape[2]


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
        false_share: Of the places that are named, that may be false.
    """
    box, wide = max(round(least / cell), 1), max(round(TREND * least / cell), 3)
    there = pulled_back(np.concatenate([second.value, second.noise**2], axis=2), moved.shift)
    count = first.value.shape[2]
    raw, noise = there[:, :, :count] - first.value, first.noise**2 + there[:, :, count:]
    d, shapes = without_trend(raw, wide), _shapes(count)
    D = box_means(d, box)
    together = np.einsum("rck,ki,kj->rcij", noise, shapes, shapes)
    Sigma, parts = covariance(d @ shapes, first.value @ shapes, together, moved.sd, box, wide)
    scale, sd = _scale(D @ shapes, Sigma, shapes, box)
    statistic = scale.statistic(D @ shapes)
    rest = unchanged(places(statistic, box, NAMED), false_share)
    changed = np.nan_to_num(statistic, nan=-1.0) >= rest.limit
    return Test(D, sd, statistic, rest.chance(statistic), changed, parts, scale, raw - d, rest)


def _shapes(count: int) -> Float[np.ndarray, "channel shape"]:
    """Weights of channels: their mean, and what is left of slope and bend without what comes before."""
    x = np.linspace(-1.0, 1.0, count) if count > 1 else np.zeros(1)
    basis, _ = np.linalg.qr(np.stack([x**k for k in range(min(3, count))], axis=1))
    return basis * np.sign(basis[-1]) / np.sqrt(count)


def _scale(
    D: Float[np.ndarray, "row column shape"],
    Sigma: Float[np.ndarray, "row column shape shape"],
    shapes: Float[np.ndarray, "channel shape"],
    box: int,
) -> tuple[Scale, Float[np.ndarray, "row column"]]:
    """Sigma as large as differences about each cell are, with what is left of their correlation; sd of brightness."""
    seen = np.isfinite(D).all(axis=2) & np.isfinite(Sigma).all(axis=(2, 3))
    whiten, count = np.full(Sigma.shape, np.nan), shapes.shape[1]
    whiten[seen] = np.linalg.inv(np.linalg.cholesky(Sigma[seen]))
    w = np.einsum("rcij,rcj->rci", whiten, D)
    g = about(np.sum(w**2, axis=2), count, box)
    S = _correlation(w[seen] / np.sqrt(g[seen])[:, None])
    inverse = np.einsum("rcki,kl,rclj->rcij", whiten, np.linalg.inv(S), whiten) / g[:, :, None, None]
    return Scale(shapes, inverse), np.where(seen, np.sqrt(Sigma[:, :, 0, 0] * g), np.nan)


def _correlation(some: Float[np.ndarray, "n shape"]) -> Float[np.ndarray, "shape shape"]:
    """Covariance of what does not stand out, so large that its squares have the median of chi squared."""
    count = some.shape[1]
    if len(some) < 10 * count:
        return np.full((count, count), np.nan)
    S = np.diag((np.median(np.abs(some), axis=0) / 0.6745) ** 2) + 1e-12 * np.eye(count)
    for _ in range(_ROUNDS):
        squares = _squares(some, S)
        keep = some[squares < np.quantile(squares, 0.9)]
        S = keep.T @ keep / len(keep) + 1e-12 * np.eye(count)
        S *= np.median(_squares(some, S)) / chi2.ppf(0.5, count)
    return S


def _squares(z: Float[np.ndarray, "n channel"], S: Float[np.ndarray, "channel channel"]) -> Float[np.ndarray, " n"]:
    return np.einsum("ni,ij,nj->n", z, np.linalg.inv(S), z)
