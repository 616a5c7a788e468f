"""The page of what changed between two mosaics."""

import json
from pathlib import Path

import numpy as np

from rovtwin.core.datum import datum_of
from rovtwin.core.errors import LogError
from rovtwin.mapping.change.things import Thing
from rovtwin.mapping.projection import project
from rovtwin.report.mapping import change as figures
from rovtwin.report.mapping.figures import Sheet
from rovtwin.report.mapping.page import write_map_page
from rovtwin.report.parts.page import save
from rovtwin.report.parts.tables import Table
from rovtwin.runs.mapping.change.difference import Difference
from rovtwin.runs.mapping.result import Mosaic

_LABELS = {
    "compared_m2": "compared [m2]",
    "changes": "changes",
    "changed_m2": "changed [m2]",
    "standing_or_moved": "standing or moved: in both mosaics, only elsewhere (s)",
    "shift_north_east_m": "second lies north, east of the first by [m]",
    "shift_varies_m": "shift within, standard deviation [m]",
    "shift_sd_m": "shift, uncertainty [m]",
    "patches": "patches found again",
    "patches_dropped": "patches that disagreed",
    "least_contrast_named": "change of a single thing that is named over half of the floor",
    "sd_of_change": "standard deviation of a change, median",
}
_FILES = {
    "changes.geojson": "outlines of the changes, and of things standing or moved, with size and contrast",
    "change.tif": "change, its standard deviation, its chance, shift: cloud-optimised GeoTIFF",
    "change.json": "figures, and all changes",
}
_MOST = 60  # changes that the table lists


def write_change_page(folder: Path, found: Difference, first: Mosaic, second: Mosaic) -> Path:
    """Write `report.html` and its figures."""
    grid, sheet = found.grid, _sheet(found, first)
    rings, elsewhere = _rings(found.things, sheet), _rings(found.elsewhere, sheet)
    shift = np.stack([found.moved.shift[:, :, 1], -found.moved.shift[:, :, 0]], axis=2) * grid.cell
    brightness = np.expm1(found.test.difference.mean(axis=2))
    pictures = [
        save(
            figures.changes(sheet, rings, elsewhere), folder, "changes", "What changed",
            "The first mosaic; a ring about each change, numbered from the surest; dashed (s) things standing or "
            "moved: both mosaics show them, only elsewhere, as what stands above or below their floor.",
        ),
        save(
            figures.difference(sheet, brightness, shift, found.seen), folder, "difference", "Difference and shift",
            "Change of reflectance over the least thing, less what varies slowly (light, range); and how the second "
            "mosaic lies within the first: errors of navigation of both.",
        ),
    ]  # fmt: skip
    rows = [[_LABELS[name], _shown(value)] for name, value in found.figures.items()]
    rows += _listed("", found.things, rings, sheet) + _listed("s", found.elsewhere, elsewhere, sheet)
    hidden = max(len(found.things) - _MOST, 0) + max(len(found.elsewhere) - _MOST, 0)
    more = f"{hidden} more are in changes.geojson." if hidden else ""
    title = f"What changed: {first.folder.name} to {second.folder.name}"
    return write_map_page(folder, title, Table("", ["", ""], rows, more), found.remarks, pictures, _FILES)


def _rings(some: list[Thing], sheet: Sheet) -> figures.Rings:
    left, _, _, top = sheet.extent
    return [
        (
            (left + (one.place[1] + 0.5) * sheet.cell, top - (one.place[0] + 0.5) * sheet.cell),
            0.75 * max(*one.size, 0.1),
        )
        for one in some
    ]


def _listed(kind: str, some: list[Thing], rings: figures.Rings, sheet: Sheet) -> list[list[str]]:
    return [
        [
            f"{kind}{number}: x {sheet.origin[0] + x:.2f}, y {sheet.origin[1] + y:.2f}",
            f"{100 * one.contrast.mean():+.0f} ± {100 * 2.0 * one.sd:.0f} %, {1e4 * one.area:.0f} cm2",
        ]
        for number, (one, ((x, y), _)) in enumerate(zip(some, rings, strict=True), start=1)
        if number <= _MOST
    ]


def _sheet(found: Difference, first: Mosaic) -> Sheet:
    """The part of the first mosaic's picture that is compared."""
    import rasterio

    grid, path = found.grid, first.folder / "rgb.tif"
    row = round((first.about["grid"]["top_m"] - grid.top) / grid.cell)
    column = round((grid.left - first.about["grid"]["left_m"]) / grid.cell)
    try:
        with rasterio.open(path) as file:
            rgb = np.moveaxis(file.read(), 0, -1)
    except rasterio.RasterioIOError as error:
        raise LogError(f"{path}: cannot be read: {error}") from None
    part = rgb[row : row + grid.rows, column : column + grid.columns]
    bottom, datum = grid.top - grid.rows * grid.cell, datum_of({"datum": json.dumps(first.about.get("datum", ""))})
    x, y = (grid.left, bottom) if datum is None else project(datum, grid.crs, np.zeros((1, 3)))[0].tolist()
    return Sheet(part, grid.left, bottom, grid.cell, str(grid.crs), (x, y))


def _shown(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(f"{one:+.3f}" for one in value)
    if value is None:
        return "not known"
    return f"{value:.3g}" if isinstance(value, float) else str(value)
