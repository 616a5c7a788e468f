"""The page of a mosaic."""

from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.mapping.projection import Projection, project
from rovtwin.report.mapping import figures
from rovtwin.report.mapping.figures import Plan
from rovtwin.report.mapping.page import write_map_page
from rovtwin.report.mapping.residuals import residuals as draw_residuals
from rovtwin.report.parts.page import Picture, save
from rovtwin.report.parts.tables import Table
from rovtwin.runs.mapping.output.clicked import viewer_of
from rovtwin.runs.mapping.output.noting import WHAT
from rovtwin.runs.mapping.output.products import Products
from rovtwin.runs.mapping.points import Agreement, Point
from rovtwin.runs.mapping.residuals import Residuals
from rovtwin.runs.mapping.result import NOTE, Mosaic


def write_mosaic_page(
    products: Products, mosaic: Mosaic, rgb: np.ndarray, points: list[Point], agreed: Agreement | None, plan: Plan
) -> None:
    """Write `report.html` and its figures."""
    job, out, grid = products.job, mosaic.folder, products.job.grid
    bottom = grid.top - grid.rows * grid.cell
    without = products.joined.seen & ~np.isfinite(products.joined.rgb).all(-1)
    origin = project(products.inputs.datum, grid.crs, np.zeros((1, 3)))[0]  # which may lie far from the mosaic
    sheet = figures.Sheet(rgb, grid.left, bottom, grid.cell, str(grid.crs), tuple(origin.tolist()), without)
    spectra = []
    for point in points:
        if not np.isfinite(point.value).any():
            continue  # named in a remark
        x, y = job.projection.to_map(point.place) - origin
        spectra.append(figures.Spectrum(point.name, (float(x), float(y)), point.value, point.spread, point.truth))
    navigation = job.georeference.navigation
    way = job.projection.to_map(navigation.position[:, :2])
    what = job.calibrated.correction
    scene = None if products.inputs.request.radiance else products.inputs.scene
    pictures: list[Picture] = [
        save(
            figures.picture(sheet, spectra, [way], plan), out, "rgb", "The mosaic",
            f"Means of {what.quantity} in red (590-660 nm), green (520-580 nm) and blue (445-500 nm), one scale for "
            "all. White line: the vehicle's way. Letters: places of the spectra below. Hatched: seen, but without a "
            f"number in one of the three. Orange: not seen inside the {'dashed area' if plan.outlines else 'hull'}. "
            f"Axes are those of the map; north of the run is turned by {_turn(job.projection):+.2f} deg against them.",
        ),
        save(figures.spectra(mosaic.wavelengths, spectra, what.quantity, what.unit), out, "spectra",
             "Spectra of places", "Means over 8 cm; bands that noise hides are left out."),
        save(figures.layers(sheet, _panels(products)), out, "layers", "Coverage and geometry",
             "Pixels a cell, way through the water, angle at the floor, and what else was asked for."),
    ]  # fmt: skip
    if products.budget is not None:
        b = products.budget
        parts = {"noise of a pixel": b.noise, "floor's height": b.height, "water": b.water, "lamps": b.lamps}
        if products.panel is not None:  # takes the place of the lamps
            parts["panel"] = parts.pop("lamps") + b.panel
        shown = figures.budget(b.wavelengths, parts, None if agreed is None else agreed.by_band, products.joined.masked)
        pictures.append(
            save(shown, out, "uncertainty", "How sure reflectance is",
                 "By band: standard deviations as stated for water and lamps, as found for noise and the floor's "
                 "height. Below: share of cells in which noise is more than a fifth of the signal, or of 5 %.")
        )  # fmt: skip
    if products.registration is not None:
        pictures.insert(1, _arrows(products, products.registration.residuals, sheet, out))
    rows = [[label, _shown(value), unit] for label, value, unit in mosaic.figures_table()]
    files = {name: what for name, what in WHAT.items() if (out / name).exists() or name == NOTE}
    title = f"Mosaic of {products.inputs.lines.name}"
    write_map_page(out, title, Table("", ["", "", ""], rows), products.remarks, pictures, files,
                   viewer_of(mosaic, grid, job.projection, sheet, spectra, scene))  # fmt: skip


def _turn(projection: Projection) -> float:
    """Of north of the run from north of the map, clockwise [deg]."""
    x, y = projection.slope(0.5 * (projection.low + projection.high))[:, 0]
    return float(np.degrees(np.arctan2(x, y)))


def _arrows(products: Products, residuals: Residuals, sheet: figures.Sheet, out: Path) -> Picture:
    """Residuals of a registration, on the map."""
    projection, what = products.job.projection, residuals.observed
    slope = projection.slope(0.5 * (projection.low + projection.high))
    before, after = what.d @ slope.T, residuals.registration.left @ slope.T
    at = projection.to_map(what.place) - sheet.origin
    control = np.asarray(~np.isfinite(residuals.lines).all(axis=1))
    figure = draw_residuals(sheet, at, before, after, residuals.used, control)
    return save(
        figure, out, "residuals", "Residuals of the overlaps",
        "Where ties put the same feature in two lines: from one to the other, before and after the registration, on "
        "one scale. Triangles: control points, from where the line puts them to where they are. Purple: dropped.",
    )  # fmt: skip


def _shown(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _panels(products: Products) -> dict[str, tuple[np.ndarray, str]]:
    shown = {name: layer for name, layer in products.joined.layers.items() if name not in ("time",)}
    return {"coverage": shown.pop("coverage"), **shown}
