"""The page of a classification."""

from pathlib import Path

import numpy as np

from rovtwin.core.errors import LogError
from rovtwin.mapping.classes.accuracy import Confusion
from rovtwin.mapping.projection import project
from rovtwin.report.mapping import classes as figures
from rovtwin.report.mapping.figures import Sheet, layers
from rovtwin.report.mapping.page import write_map_page
from rovtwin.report.parts.page import Picture, save
from rovtwin.report.parts.tables import Table
from rovtwin.runs.mapping.classification.refusals import MIXED_NAME
from rovtwin.runs.mapping.classification.work import Classified
from rovtwin.runs.mapping.classification.writing import FILES, Judged, alike, areas_of, remarks_of

_PANELS, _LEAST = 9, 0.005  # shares that are shown at most, and of how much of the area


def write_classes_page(folder: Path, judged: Judged) -> Path:
    """Write `report.html` and its figures.

    Raises:
        LogError: The mosaic's picture cannot be read.
    """
    found, prepared = judged.found, judged.found.prepared
    sheet, names, areas = _sheet(found), found.names, areas_of(judged)
    own = judged.colours[1:-1]
    pictures = [
        save(
            figures.class_map(sheet, found.layers.value, found.mapped, judged.colours), folder, "classes",
            "What lies where",
            "A cell is of the class of the least spectral angle, if that is within its limit and what the cell is "
            "mostly made of; mixed: a mixture explains it and no single class; not of this library: neither does.",
        ),
        save(
            figures.areas(areas, own), folder, "areas", "Areas",
            "Bars: sums of shares. Dashed: with the cells not of this library that are nearest to the class.",
        ),
        save(
            figures.spectra(prepared.wavelengths, names, own, found.means, found.cells, prepared.classes.spectra),
            folder, "spectra", "Spectra of the classes",
            "Coloured: mean of the cells of the class, each less its brightness. Dashed: the library's.",
        ),
        _angles(folder, found),
    ]  # fmt: skip
    if shares := _shares(found):
        words = f"By cell, of the classes with {_LEAST:.1%} of the area or more."
        pictures.insert(3, save(layers(sheet, shares, (0.0, 1.0)), folder, "shares", "Shares", words))
    if judged.truth is not None:
        pictures.append(_confusion(folder, judged.truth.confusion, "confusion", "Against the truth", "cells"))
    if judged.checked is not None:
        pictures.append(_confusion(folder, judged.checked.confusion, "checks", "Check points", "points"))
    return write_map_page(
        folder, f"Classes of {prepared.mosaic.folder.name}", _table(judged), remarks_of(judged), pictures, FILES
    )


def _table(judged: Judged) -> Table:
    heads = ["class", "area [m2]", "95 %", "at most", "counted"]
    rows = areas_of(judged)
    checked, true = "checked_m2" in rows[0], "true_m2" in rows[0]
    heads += ["check points", "95 %"] * checked + ["truth"] * true
    lines = []
    for row in rows:
        line = [row["class"], f"{row['area_m2']:.2f}", f"{row['low_m2']:.2f} to {row['high_m2']:.2f}"]
        line += [f"{row['most_m2']:.2f}", f"{row['counted_m2']:.2f}"]
        if checked:
            line += [f"{row['checked_m2']:.2f}", f"{row['checked_low_m2']:.2f} to {row['checked_high_m2']:.2f}"]
        if true:
            line.append(f"{row['true_m2']:.2f}")
        lines.append(line)
    a, total = judged.found.areas, judged.found.total_m2
    words = (
        f"Of {total:.2f} m2 classified, {total * a.mixed:.2f} m2 are mixed cells and {total * a.outside:.2f} m2 not of "
        "this library. Areas are sums of shares, on the horizontal plane."
    )
    return Table("", heads, lines, words)


def _sheet(found: Classified) -> Sheet:
    import rasterio

    ground, path = found.prepared.ground, found.prepared.mosaic.folder / "rgb.tif"
    grid = ground.grid
    try:
        with rasterio.open(path) as file:
            rgb = np.moveaxis(file.read(), 0, -1)
    except rasterio.RasterioIOError as error:
        raise LogError(f"{path}: cannot be read: {error}") from None
    x, y = project(ground.datum, grid.crs, np.zeros((1, 3)))[0].tolist()
    return Sheet(rgb, grid.left, grid.top - grid.rows * grid.cell, grid.cell, str(grid.crs), (x, y))


def _shares(found: Classified) -> dict[str, tuple[np.ndarray, str]]:
    most = np.argsort(-found.areas.unmixed)[:_PANELS]
    return {found.names[k]: (found.layers.share[..., k], "1") for k in most if found.areas.unmixed[k] >= _LEAST}


def _angles(folder: Path, found: Classified) -> Picture:
    between, names = np.degrees(found.prepared.classes.between), found.names
    marked = np.zeros(between.shape, bool)
    for one, other, _ in alike(found):
        i, k = names.index(one), names.index(other)
        marked[i, k] = marked[k, i] = True
    text = [["" if i == k else f"{between[i, k]:.1f}" for k in range(len(names))] for i in range(len(names))]
    dark = np.where(np.eye(len(names), dtype=bool), 0.0, np.clip(1.0 - between / 30.0, 0.0, 1.0))
    return save(
        figures.table(names, names, dark, text, marked), folder, "angles", "What can be told apart",
        "Angles between the classes' spectra in the bands that count [deg]. Framed: closer than what both may be off "
        "by (their variability, and the mosaic's errors of height, water and lamps).",
    )  # fmt: skip


def _confusion(folder: Path, confusion: Confusion, name: str, title: str, what: str) -> Picture:
    count = confusion.count
    there = count.sum(axis=1) > 0
    rows = [row for row, some in zip(confusion.mapped, there, strict=True) if some]
    part = count[there] / np.maximum(count.sum(axis=0, keepdims=True), 1)
    text = [
        [str(n) if n else "" for n in line] + [_percent(None if row == MIXED_NAME else confusion.users(row))]
        for row, line in zip(rows, count[there], strict=True)
    ]
    text.append([_percent(confusion.producers(column)) for column in confusion.true] + [""])
    dark = np.zeros((len(rows) + 1, len(confusion.true) + 1))
    dark[:-1, :-1] = part
    marked = np.zeros(dark.shape, bool)
    for i, row in enumerate(rows):
        if row in confusion.true:
            marked[i, confusion.true.index(row)] = True
    words = (
        f"{int(count.sum())} {what}, {confusion.overall:.1%} mapped as what they are, kappa {confusion.kappa:.2f}. "
        "User's accuracy: of what is mapped so; producer's: of what is so. Framed: mapped as what they are."
    )
    shown = figures.table(
        [*rows, "producer's"], [*confusion.true, "user's"], dark, text, marked, ("mapped", "there is")
    )
    return save(shown, folder, name, title, words)


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{share:.0%}"
