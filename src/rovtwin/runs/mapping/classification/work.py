"""Each cell of a mosaic: angle, mixture, class; and from them areas with what they may be off by."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from rovtwin.core.errors import LogError
from rovtwin.mapping.classes.angle import Angles, angles, limits
from rovtwin.mapping.classes.areas import Sample, deviations, interval
from rovtwin.mapping.classes.unmixing import Shares
from rovtwin.runs.mapping.classification.refusals import MIXED_NAME, OUTSIDE_NAME
from rovtwin.runs.mapping.classification.sources import Prepared

NOT_SEEN, OUTSIDE = 255, 0  # values of cells without a number, and of those not of the library
_AT_ONCE = 8e6  # bytes of values of the rows looked at together
_KNOWN = 0.5  # share of the bands that a cell must know
_SAMPLE = 2000  # cells of which errors of areas are drawn
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Layers:
    """Of each cell, no number where not seen.

    Attributes:
        value: `OUTSIDE` for what is not of the library, 1 .. K the class, K + 1 a mixture, `NOT_SEEN`.
        nearest: Number of the class of the least angle.
        angle: To it [rad].
        margin: How much farther the second is [rad].
        limit: Of the angle [rad].
        share: Of each class; no number for what is not of the library.
        sd: Of shares, by noise.
        brightness: Of the mixture.
        residual: Angle between the cell and the nearest mixture [rad].
    """

    value: Int[np.ndarray, "row column"]
    nearest: Int[np.ndarray, "row column"]
    angle: Float[np.ndarray, "row column"]
    margin: Float[np.ndarray, "row column"]
    limit: Float[np.ndarray, "row column"]
    share: Float[np.ndarray, "row column class"]
    sd: Float[np.ndarray, "row column class"]
    brightness: Float[np.ndarray, "row column"]
    residual: Float[np.ndarray, "row column"]


@dataclass(frozen=True)
class Areas:
    """By class, share of the cells that have a number.

    Attributes:
        counted: Cells whose class it is.
        unmixed: Sum of shares over all but what is not of the library.
        low: Of its 95 % interval.
        high: Of it.
        nearest: Cells not of the library that are nearest to a class.
        mixed: Cells named mixtures.
        outside: Cells not of the library.
    """

    counted: Float[np.ndarray, " class"]
    unmixed: Float[np.ndarray, " class"]
    low: Float[np.ndarray, " class"]
    high: Float[np.ndarray, " class"]
    nearest: Float[np.ndarray, " class"]
    mixed: float
    outside: float


@dataclass(frozen=True)
class Classified:
    """A mosaic's classes.

    Attributes:
        prepared: What it started from.
        layers: Of each cell.
        areas: Of each class.
        means: Mean spectrum of the cells of each class, each divided by its brightness; no number where there is none.
        cells: How many these are.
        missed: Cells that were seen and know too few bands.
    """

    prepared: Prepared
    layers: Layers
    areas: Areas
    means: Float[np.ndarray, "class band"]
    cells: Int[np.ndarray, " class"]
    missed: int

    @property
    def names(self) -> tuple[str, ...]:
        """Of the classes."""
        return self.prepared.classes.names

    @cached_property
    def mapped(self) -> tuple[str, ...]:
        """Of the values 0 .. K + 1 of `layers.value`."""
        return OUTSIDE_NAME, *self.names, MIXED_NAME

    @cached_property
    def weights(self) -> Float[np.ndarray, " mapped"]:
        """Share of the cells with a number, by value."""
        return np.array([self.areas.outside, *self.areas.counted, self.areas.mixed])

    @property
    def total_m2(self) -> float:
        """Area of the cells with a number [m2]."""
        return float(np.count_nonzero(self.layers.value != NOT_SEEN)) * self.prepared.ground.cell_m2


class _Sums:
    """Spectra by class, and cells that are picked for the draws."""

    def __init__(self, prepared: Prepared, picked: Bool[np.ndarray, " cell"]) -> None:
        count, bands = prepared.classes.spectra.shape
        self.total, self.number = np.zeros((count, bands)), np.zeros((count, bands))
        self.cells, self.picked = np.zeros(count, int), picked
        self.parts: list[tuple[np.ndarray, ...]] = []

    def add(self, first: int, x: np.ndarray, known: np.ndarray, value: np.ndarray, shares: Shares, scale: np.ndarray):
        for k in range(len(self.total)):
            cells = (value == k + 1) & np.isfinite(shares.brightness)
            self.total[k] += (x[cells] / shares.brightness[cells, None]).sum(axis=0, dtype=float)
            self.number[k] += known[cells].sum(axis=0)
            self.cells[k] += np.count_nonzero(cells)
        use = self.picked[first : first + len(x)] & (value != NOT_SEEN) & (value != OUTSIDE)
        use &= np.isfinite(shares.brightness) & np.isfinite(shares.value).all(axis=1)
        self.parts.append((shares.value[use], shares.brightness[use], scale[use]))

    def sample(self) -> Sample:
        return Sample(*(np.concatenate(part) for part in zip(*self.parts, strict=True)))

    def means(self) -> Float[np.ndarray, "class band"]:
        return np.where(self.number > 0, self.total / np.maximum(self.number, 1), np.nan)


def classified(prepared: Prepared, progress: Progress = lambda what, done, count: None) -> Classified:
    """Classify all cells, some rows at a time.

    Raises:
        LogError: No cell can be classified.
    """
    rows, columns, _ = prepared.mosaic.shape
    count, rng = len(prepared.classes.names), np.random.default_rng(prepared.request.seed)
    layers = Layers(
        *(np.full((rows, columns), NOT_SEEN, np.uint8) for _ in range(2)),
        *(np.full((rows, columns), np.nan, np.float32) for _ in range(3)),
        *(np.full((rows, columns, count), np.nan, np.float32) for _ in range(2)),
        *(np.full((rows, columns), np.nan, np.float32) for _ in range(2)),
    )
    sums = _Sums(prepared, _picked(prepared, rng))
    step, missed = max(int(_AT_ONCE / (4.0 * columns * len(prepared.bands))), 1), 0
    for row in range(0, rows, step):
        progress("classifying", row, rows)
        missed += _block(prepared, layers, sums, slice(row, min(row + step, rows)))
    if not (layers.value != NOT_SEEN).any():
        raise LogError(f"{prepared.mosaic.folder}: no cell knows half of the bands that count")
    progress("errors of areas", rows, rows)
    areas = _areas(prepared, layers, sums.sample(), rng)
    return Classified(prepared, layers, areas, sums.means(), sums.cells, missed)


def _picked(prepared: Prepared, rng: np.random.Generator) -> Bool[np.ndarray, " cell"]:
    rows, columns, _ = prepared.mosaic.shape
    seen = prepared.mosaic.about["figures"].get("seen_m2", np.inf) / prepared.ground.grid.cell**2
    chance = min(1.0, _SAMPLE / max(min(seen, rows * columns), 1.0))
    return rng.random(rows * columns) < chance


def _block(prepared: Prepared, layers: Layers, sums: _Sums, rows: slice) -> int:
    """Fill rows of the layers; how many cells know some bands, and too few."""
    x, known = prepared.cells(rows)
    columns = prepared.mosaic.shape[1]
    scale = prepared.scale[rows].reshape(-1).astype(float)
    bands = known.sum(axis=1)
    good = np.flatnonzero((bands >= _KNOWN * known.shape[1]) & (np.linalg.norm(x, axis=1) > 0.0))
    near = angles(x[good], known[good], prepared.classes.spectra, scale[good, None] * prepared.noise)
    shares = prepared.unmixing.shares(x[good], known[good], scale[good])
    value, limit, residual = _named(prepared, near, shares, bands[good])
    for one in (shares.value, shares.sd, shares.brightness):
        one[value == OUTSIDE] = np.nan
    for layer, one in (
        (layers.value, value), (layers.nearest, near.nearest), (layers.angle, near.value),
        (layers.margin, near.margin), (layers.limit, limit),
        (layers.share, shares.value), (layers.sd, shares.sd), (layers.brightness, shares.brightness),
        (layers.residual, residual),
    ):  # fmt: skip
        layer[rows].reshape(-1, *layer.shape[2:])[good] = one
    everywhere = np.full(len(x), NOT_SEEN, np.uint8)
    everywhere[good] = value
    whole = [np.full((len(x), *one.shape[1:]), np.nan) for one in (shares.value, shares.brightness)]
    whole[0][good], whole[1][good] = shares.value, shares.brightness
    none = np.full(len(x), np.nan)
    sums.add(rows.start * columns, x, known, everywhere, Shares(whole[0], whole[0], whole[1], none), scale)
    return int(np.count_nonzero(bands)) - len(good)


def _named(
    prepared: Prepared, near: Angles, shares: Shares, bands: Int[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Value of each cell, the limit of its angle, and the angle to the nearest mixture.

    A cell is of its nearest class where that is within the limit and what it is mostly made of. One that a mixture
    explains and no class does, or another than most of it, is mixed: sand beside maerl looks like mud by its angle.
    Where no mixture is known, the angle alone names it.
    """
    classes, each = prepared.classes, np.arange(len(near.nearest))
    usual = limits(near.noise, prepared.common, classes.variability)
    given = prepared.request.threshold
    for k, name in enumerate(classes.names):
        if (degrees := given.get(name, given.get(""))) is not None:
            usual[:, k] = np.radians(degrees)
    limit = usual[each, near.nearest]
    ratio = np.sqrt(bands) * shares.residual / np.maximum(near.length, 1e-12)
    residual = np.where(np.isfinite(shares.residual), np.arcsin(np.clip(ratio, 0.0, 1.0)), np.pi)
    of_class, explained = near.value <= limit, residual <= limit
    most = np.argmax(np.nan_to_num(shares.value), axis=1)
    without = np.isnan(shares.value).any(axis=1)  # fewer bands than classes: the angle alone names
    most = np.where(without, near.nearest, most)
    value = np.where(of_class & (most == near.nearest), near.nearest + 1, OUTSIDE)
    value[(value == OUTSIDE) & (of_class | explained)] = len(classes.names) + 1
    return value.astype(np.uint8), limit, residual


def _areas(prepared: Prepared, layers: Layers, sample: Sample, rng: np.random.Generator) -> Areas:
    count, value = len(prepared.classes.names), layers.value
    total = np.count_nonzero(value != NOT_SEEN)
    number = np.bincount(value.reshape(-1), minlength=256) / total
    explained = (value != NOT_SEEN) & (value != OUTSIDE)
    of_library = np.count_nonzero(explained) / total
    unmixed = np.array([np.nansum(layers.share[..., k][explained], dtype=float) for k in range(count)]) / total
    by_angle = explained & np.isnan(layers.share).any(axis=-1)  # each all of its class
    unmixed += np.bincount(value[by_angle], minlength=count + 2)[1 : count + 1] / total
    if len(sample.scale) < 2 or prepared.request.draws < 2:
        low, high = np.zeros(count), np.full(count, of_library)
    else:
        off = deviations(
            prepared.unmixing, sample, prepared.wavelengths, prepared.errors, prepared.classes.variability,
            prepared.request.draws, rng,
        )  # fmt: skip
        low, high = interval(unmixed, of_library * off, of_library)
    nearest = np.bincount(layers.nearest[value == OUTSIDE], minlength=count) / total
    return Areas(number[1 : count + 1], unmixed, low, high, nearest, float(number[count + 1]), float(number[OUTSIDE]))
