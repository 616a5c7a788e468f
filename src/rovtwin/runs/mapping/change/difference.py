"""Two mosaics of one place held against each other: what changed beyond their errors."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.errors import ConfigError, LogError
from rovtwin.mapping.cells.grid import Grid
from rovtwin.mapping.change.channels import Channels, channels_of, noise_of, without_trend
from rovtwin.mapping.change.detect import TREND, Test, tested
from rovtwin.mapping.change.displacement import Displacement, displacement
from rovtwin.mapping.change.relief import explained
from rovtwin.mapping.change.tail import FEWEST as PLACES
from rovtwin.mapping.change.things import Thing, least_contrast, sorted_out
from rovtwin.mapping.change.variance import FEWEST
from rovtwin.mapping.formats.envi import NO_DATA
from rovtwin.runs.mapping.result import Mosaic

CHANNELS, FIRST, LAST = 6, 420.0, 690.0  # compared are means over so many groups of bands between these [nm]
ABSOLUTE, WITHIN = 0.3, 0.03  # standard deviations of places that a mosaic does not state [m]
_ROOM = 0.1  # farther than four standard deviations that the second may lie [m]
_TURN = 3.0  # without a line that is used, after which another line of the survey begins [s]
_SMALL = 5  # cells of the least thing, at least a side
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Difference:
    """What changed from the first mosaic to the second.

    Attributes:
        things: That changed, the surest first.
        elsewhere: Things that both show, the second in another place: they stand above the floor, or were moved.
        faintest: Change of a single least thing that is named over half of the floor, as a share.
        test: Of each cell.
        moved: From the first mosaic to the second.
        grid: Of the cells that are compared.
        seen: Cells that both have seen.
        wavelengths: Of the channels [nm].
        remarks: For people.
    """

    things: list[Thing]
    elsewhere: list[Thing]
    faintest: float
    test: Test
    moved: Displacement
    grid: Grid
    seen: Bool[np.ndarray, "row column"]
    wavelengths: Float[np.ndarray, " channel"]
    remarks: list[str]

    @property
    def figures(self) -> dict[str, Any]:
        """For people and programs."""
        shift = self.moved.shift[self.seen].mean(axis=0) * self.grid.cell
        return {
            "compared_m2": float(self.seen.sum() * self.grid.cell**2),
            "changes": len(self.things),
            "changed_m2": float(sum(thing.area for thing in self.things)),
            "standing_or_moved": len(self.elsewhere),
            "shift_north_east_m": [float(-shift[0]), float(shift[1])],
            "shift_varies_m": float(self.moved.shift[self.seen].std(axis=0).mean() * self.grid.cell),
            "shift_sd_m": float(np.sqrt(np.mean(self.moved.sd[self.seen] ** 2)) * self.grid.cell),
            "patches": len(self.moved.matches.score),
            "patches_dropped": self.moved.dropped,
            "least_contrast_named": self.faintest if np.isfinite(self.faintest) else None,
            "sd_of_change": float(np.nanmedian(self.test.sd)),
        }


def compared(
    first: Mosaic,
    second: Mosaic,
    least: float = 0.1,
    contrast: float = 0.1,
    false_share: float = 0.05,
    relief: float = 0.3,
    progress: Progress = lambda what, done, count: None,
) -> Difference:
    """Register the second to the first and test each cell.

    Args:
        first: Mosaic.
        second: Mosaic of the same place later.
        least: Size of the smallest thing that is looked for [m].
        contrast: Least change of reflectance that is of interest, as a share.
        false_share: Of the named places, that may be false.
        relief: How far things may stand above the mosaics' floor, or lie below it [m]; 0: not looked for.
        progress: Called with what is done, of how many steps.

    Raises:
        ConfigError: They are not of one kind, cell and coordinate system, or not of one place; cells are too large.
        LogError: Their pictures have nothing in common, or too few cells.
    """
    _require_alike(first, second, least)
    rows, columns, grid = _overlap(first, second)
    usable, words = _usable(first, second)
    channels = []
    for k, one in enumerate((first, second)):
        progress("reading", k, 5)
        channels.append(_channels(one, rows[k], columns[k], usable))
    a, b = channels
    absolute, within, remarks = _stated(first, second)
    progress("registering", 2, 5)
    wide = max(round(TREND * least / grid.cell), 3)
    x, y = (without_trend(one.value, wide).mean(axis=2) for one in (a, b))
    lines = (_lines(first, rows[0], columns[0]), _lines(second, rows[1], columns[1]))
    moved = displacement(x, y, grid.cell, 4.0 * absolute + _ROOM, within, lines)
    if moved is None:
        raise LogError(
            f"{second.folder}: fewer than 3 patches of {first.folder} were found in it within "
            f"{4.0 * absolute + _ROOM:.2f} m, so the two cannot be laid upon each other. Do they show one place, with "
            "texture, and in one season?"
        )
    progress("testing", 3, 5)
    test = tested(a, b, moved, grid.cell, least, false_share)
    _require_cells(test, first, second)
    progress("trying heights", 4, 5)
    slants, more = _slants((first, second), rows, columns)
    by_height = np.zeros(test.changed.shape, bool)
    if slants is not None:
        by_height = explained(test, a, b, moved, slants, grid.cell, least, relief)
    changes, elsewhere = sorted_out(test, by_height, grid.cell, least, contrast)
    faintest = least_contrast(test, grid.cell, least, false_share)
    remarks = [words, *remarks, *more, *_spoken(faintest, contrast, least, elsewhere, relief)]
    seen = np.isfinite(test.statistic)
    return Difference(changes, elsewhere, faintest, test, moved, grid, seen, a.wavelengths, remarks)


def _spoken(faintest: float, contrast: float, least: float, elsewhere: list[Thing], relief: float) -> list[str]:
    remarks = []
    if np.isfinite(faintest) and faintest > contrast:
        remarks.append(
            f"a single thing of {least:g} m is named over half of the floor only if it differs by {faintest:.0%} or "
            f"more; asked for were {contrast:.0%}. Lines flown as the first time, and a better floor, help"
        )
    if elsewhere:
        remarks.append(
            f"{len(elsewhere)} things are standing or moved: both mosaics show them, only elsewhere, as what stands "
            f"up to {relief:g} m above or below their floor, or was moved by as little; they do not count as changes"
        )
    return remarks


def _require_cells(test: Test, first: Mosaic, second: Mosaic) -> None:
    if not np.isfinite(test.statistic).any():
        count = int(np.isfinite(test.difference).all(axis=2).sum())
        raise LogError(
            f"{second.folder}: found {count} cells to be compared with {first.folder}, expected about {FEWEST} or "
            "more: the spread of cells that did not change is read off them. Make both mosaics of smaller cells "
            "(--resolution), or of more of the floor"
        )
    if not np.isfinite(test.unchanged.middle):
        raise LogError(
            f"{second.folder}: found {test.unchanged.count} places of the size of --least to be compared with "
            f"{first.folder}, expected {PLACES} or more: how much unchanged ones differ is read off them. Compare more "
            "of the floor, or look for smaller things"
        )


def _require_alike(first: Mosaic, second: Mosaic, least: float) -> None:
    for name, one, other in (
        ("quantity", first.about["quantity"], second.about["quantity"]),
        ("coordinate system", first.about["grid"]["crs"], second.about["grid"]["crs"]),
        ("cell [m]", first.about["grid"]["cell_m"], second.about["grid"]["cell_m"]),
    ):
        if one != other:
            raise ConfigError(
                f"{second.folder}: found {name} {other}, expected {one} as {first.folder} has it; make one of them "
                "again with `rovtwin map` (--resolution, --crs, --radiance)"
            )
    if least < _SMALL * first.about["grid"]["cell_m"]:
        raise ConfigError(
            f"--least {least:g}: found less than {_SMALL} cells of {first.about['grid']['cell_m']:g} m; look for "
            "larger things, or make mosaics of smaller cells"
        )


def _overlap(first: Mosaic, second: Mosaic) -> tuple[list[slice], list[slice], Grid]:
    """Rows and columns of each that lie upon each other, and their grid."""
    from rasterio.crs import CRS

    grids = [one.about["grid"] for one in (first, second)]
    cell = grids[0]["cell_m"]
    top = [round(grid["top_m"] / cell) for grid in grids]
    left = [round(grid["left_m"] / cell) for grid in grids]
    north, west = min(top), max(left)
    south = max(t - grid["rows"] for t, grid in zip(top, grids, strict=True))
    east = min(w + grid["columns"] for w, grid in zip(left, grids, strict=True))
    if north - south < 2 * _SMALL or east - west < 2 * _SMALL:
        raise ConfigError(
            f"{second.folder}: does not overlap {first.folder}: they are {abs(top[0] - top[1]) * cell:.1f} m apart to "
            f"the north, {abs(left[0] - left[1]) * cell:.1f} m to the east. Is the datum the same?"
        )
    rows = [slice(t - north, t - south) for t in top]
    columns = [slice(west - w, east - w) for w in left]
    grid = Grid(CRS.from_user_input(grids[0]["crs"]), west * cell, north * cell, cell, north - south, east - west)
    return rows, columns, grid


def _usable(first: Mosaic, second: Mosaic) -> tuple[Bool[np.ndarray, " band"], str]:
    """Bands that most cells of both have, and how many there are in words."""
    w = first.wavelengths
    if len(w) != len(second.wavelengths) or np.max(np.abs(w - second.wavelengths)) > 1.0:
        raise ConfigError(
            f"{second.folder}: its bands differ from those of {first.folder} by more than 1 nm: mosaics of one imager "
            "are compared"
        )
    shares = [one.share_known() for one in (first, second)]
    usable = (w >= FIRST) & (w <= LAST) & (np.minimum(*shares) > 0.9)
    if not usable.any():
        raise ConfigError(
            f"{second.folder}: has no band between {FIRST:g} and {LAST:g} nm in common with {first.folder}"
        )
    return usable, f"compared in {usable.sum()} bands between {w[usable][0]:.0f} and {w[usable][-1]:.0f} nm"


def _channels(one: Mosaic, rows: slice, columns: slice, usable: Bool[np.ndarray, " band"]) -> Channels:
    """Of the overlap."""
    bands = np.flatnonzero(usable)
    cube = np.moveaxis(np.asarray(one.cube[rows][:, bands[0] : bands[-1] + 1, columns]), 1, 2)
    cube = np.where(cube == np.float32(NO_DATA), np.float32(np.nan), cube)
    own = usable[bands[0] : bands[-1] + 1]
    w = one.wavelengths[bands[0] : bands[-1] + 1]
    return channels_of(cube, w, own, CHANNELS, noise_of(cube[:: max(len(cube) // 200, 1)]))


def _lines(one: Mosaic, rows: slice, columns: slice) -> Float[np.ndarray, "row column"]:
    """Number of the survey line that saw each cell; one for all where cells are means of several, or do not say it."""
    t, coverage = one.layer("time"), one.layer("coverage")
    if t is None or coverage is None or one.about["settings"]["blend"] != "best":
        return np.zeros(one.shape[:2])[rows, columns]
    seen = np.isfinite(t) & (coverage > 0)  # what is filled between two lines has their mean
    stamps = np.unique(t[seen])
    begins = stamps[1:][np.diff(stamps) > _TURN]
    return np.where(seen, np.searchsorted(begins, t, side="right"), np.nan)[rows, columns]


def _slants(
    mosaics: tuple[Mosaic, Mosaic], rows: list[slice], columns: list[slice]
) -> tuple[tuple[np.ndarray, np.ndarray] | None, list[str]]:
    """Rows and columns that a thing one cell higher lies farther out, in the overlap of each; None where not stated."""
    x, y = ([one.layer(name) for one in mosaics] for name in ("slant_x", "slant_y"))
    missing = [one.folder.name for one, given in zip(mosaics, x, strict=True) if given is None]
    if missing:
        return None, [
            f"{' and '.join(missing)} does not state from where its cells were seen: edges of what stands above the "
            "floor count as changes. Make it again with `rovtwin map`"
        ]
    first, second = (
        np.stack([-np.asarray(v)[r, c], np.asarray(u)[r, c]], axis=2).astype(float)
        for u, v, r, c in zip(x, y, rows, columns, strict=True)
    )
    return (first, second), []


def _stated(first: Mosaic, second: Mosaic) -> tuple[float, float, list[str]]:
    """Standard deviations of the difference of places, as a whole and within [m], and what was assumed."""
    import rasterio

    found, remarks = [], []
    for one in (first, second):
        sigmas = [ABSOLUTE, WITHIN]
        path = one.folder / "layers.tif"
        try:
            with rasterio.open(path) as file:
                names = list(file.descriptions)
                given = [float(np.nanmedian(file.read(names.index(n) + 1))) for n in ("sigma", "sigma_within")]
        except rasterio.RasterioIOError as error:
            raise LogError(f"{path}: cannot be read: {error}") from None
        except ValueError:
            given = sigmas
            remarks.append(
                f"{one.folder.name} does not state how unsure its places are: {ABSOLUTE:g} and {WITHIN:g} m taken"
            )
        found.append(given)
    absolute, within = np.sqrt(np.sum(np.square(found), axis=0))
    return float(absolute), float(within), remarks
