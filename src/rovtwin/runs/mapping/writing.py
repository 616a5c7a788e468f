"""All files of a mosaic but its cube, and the note that makes it whole."""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from rovtwin._version import __version__
from rovtwin.core.log.files import write_error
from rovtwin.core.user_files.files import write_text
from rovtwin.mapping.cells.mosaic import Job, Joined
from rovtwin.mapping.cells.radiometry import Budget
from rovtwin.mapping.formats.colours import picture
from rovtwin.mapping.formats.envi import NO_DATA
from rovtwin.mapping.formats.geotiff import write_cube, write_layers, write_picture
from rovtwin.mapping.formats.netcdf import write_netcdf
from rovtwin.mapping.formats.vectors import polygons, write_geojson, write_immersion
from rovtwin.report.mapping import figures
from rovtwin.report.mapping.page import write_map_page
from rovtwin.report.parts.page import Picture, save
from rovtwin.report.parts.tables import Table
from rovtwin.runs.mapping.area import Rings, gaps_of, hull_of
from rovtwin.runs.mapping.noting import WHAT, hashes_of, settings_of
from rovtwin.runs.mapping.points import (
    Agreement,
    Point,
    agreement,
    read_points,
    usual_points,
    with_spectra,
    without_value,
    write_spectra,
)
from rovtwin.runs.mapping.result import NOTE, Mosaic
from rovtwin.runs.mapping.sources import Inputs

_SMALL = 300e6  # bytes of a cube that is written as GeoTIFF unasked


@dataclass(frozen=True)
class Products:
    """What there is to be written.

    Attributes:
        inputs: Sources.
        job: What was done with them.
        joined: Layers.
        budget: Of uncertainty; None for radiances.
        remarks: For people.
        counts: Of what was left out.
        resumed: Parts that an earlier, broken call had made.
        lines_used: How many lines count.
        registration: Figures of it; empty without.
        area: That was to be seen, rings of x and y; None: the hull of what was.
    """

    inputs: Inputs
    job: Job
    joined: Joined
    budget: Budget | None
    remarks: list[str]
    counts: dict[str, int]
    resumed: int
    lines_used: int
    registration: dict[str, Any]
    area: Rings | None


def write_all(products: Products, out: Path, begun: float, progress: Callable[[str, int, int], None]) -> Mosaic:
    """Write them; the note comes last.

    Raises:
        LogError: They cannot be written.
    """
    job, inputs = products.job, products.inputs
    about = _about(products)
    mosaic = Mosaic(out, about)
    alike = job.calibrated.correction.model is not None
    whole = np.isfinite(products.joined.rgb).all(-1)  # without one of the three colours a cell has none
    rgb = picture(products.joined.rgb, products.joined.seen & whole, alike)
    progress("writing", 1, 4)
    _rasters(products, mosaic, rgb)
    progress("writing", 2, 4)
    about["figures"]["gaps_m2"] = _vectors(products, out)
    asked = inputs.request.points
    places = (
        usual_points(mosaic, job.grid, job.projection, products.joined.direct)
        if asked is None
        else read_points(asked, inputs.datum)
    )
    scene = None if inputs.request.radiance else inputs.scene
    points = with_spectra(places, mosaic, job.projection, scene)
    products.remarks.extend(without_value(points))
    write_spectra(out / "spectra.csv", points, mosaic.wavelengths)
    agreed = None if scene is None else agreement(mosaic, job.grid, job.projection, scene, products.joined.direct)
    if agreed is not None:
        about["figures"] |= {"error_median": agreed.error, "angle_deg": float(np.degrees(agreed.angle))}
    _uncertainty(products, out, agreed)
    progress("writing", 3, 4)
    about["sha256"] = hashes_of(inputs, job.georeference.navigation.source)
    about["figures"]["seconds"] = time.monotonic() - begun
    _page(products, mosaic, rgb, points, agreed)
    try:
        write_text(out / NOTE, json.dumps(about, indent=1))
    except OSError as error:
        raise write_error(out / NOTE, error) from error
    progress("writing", 4, 4)
    return mosaic


def _about(products: Products) -> dict[str, Any]:
    inputs, job, joined = products.inputs, products.job, products.joined
    lines, grid = inputs.lines, job.grid
    span = joined.layers["range"][0]
    figures = {
        "lines": lines.shape[0],
        "lines_used": products.lines_used,
        "seen_m2": float(joined.seen.sum()) * grid.cell**2,
        "range_m": float(np.nanmedian(span)),
        "pixels_per_cell": float(np.nanmean(joined.layers["coverage"][0])),
        "masked": float(joined.masked.mean()),
        "resumed_parts": products.resumed,
        **{f"pixels_{name}": count for name, count in products.counts.items() if name != "samples"},
    }
    if products.registration:
        figures["registration"] = products.registration
    return {
        "rovtwin": __version__,
        "quantity": job.calibrated.correction.quantity,
        "unit": job.calibrated.correction.unit,
        "grid": {
            "crs": str(grid.crs),
            "left_m": grid.left,
            "top_m": grid.top,
            "cell_m": grid.cell,
            "rows": grid.rows,
            "columns": grid.columns,
        },
        "datum": json.loads(inputs.datum.metadata()),
        "figures": figures,
        "settings": settings_of(inputs, job.georeference.navigation.source),
        "remarks": products.remarks,
        "wavelengths_nm": lines.wavelengths.tolist(),
        "fwhm_nm": lines.fwhm.tolist(),
    }


def _rasters(products: Products, mosaic: Mosaic, rgb: np.ndarray) -> None:
    job, out, request = products.job, mosaic.folder, products.inputs.request
    lines, grid = products.inputs.lines, job.grid
    about = {"quantity": job.calibrated.correction.quantity, "units": job.calibrated.correction.unit}
    Image.fromarray(rgb, "RGBA").save(out / "rgb.png")
    write_picture(out / "rgb.tif", grid, rgb)
    write_layers(out / "layers.tif", grid, products.joined.layers, about)
    small = 4.0 * grid.rows * grid.columns * len(lines.wavelengths) <= _SMALL
    if "cube" in request.formats or ("cog" in request.formats and small):
        write_cube(out / "cube.tif", grid, mosaic.cube, lines.wavelengths, lines.fwhm, NO_DATA, about)
    if "netcdf" in request.formats:
        what, bands = job.calibrated.correction, (lines.wavelengths, lines.fwhm)
        layers = products.joined.layers
        write_netcdf(out / "mosaic.nc", grid, mosaic.cube, bands, (what.quantity, what.unit), layers, NO_DATA, about)


def _vectors(products: Products, out: Path) -> float:
    """Gaps and navigation; how large all gaps are [m2]."""
    job, inputs = products.job, products.inputs
    rings = hull_of(products.joined.seen, job.grid) if products.area is None else products.area
    features = polygons(*gaps_of(rings, products.joined.seen, job.grid))
    total = float(sum(feature["properties"]["area_m2"] for feature in features))
    write_geojson(out / "gaps.geojson", features, name="gaps", area_m2=total)
    navigation = job.georeference.navigation
    depth = job.georeference.floor.depth_and_slope(navigation.position[:, :2])[0] - navigation.position[:, 2]
    write_immersion(out / "navigation.csv", navigation, inputs.datum, job.projection, depth)
    return total


def _uncertainty(products: Products, out: Path, agreed: Agreement | None) -> None:
    if products.budget is None:
        return
    b = products.budget
    columns = {
        "wavelength_nm": b.wavelengths,
        "noise_of_a_pixel": b.noise,
        "height": b.height,
        "water": b.water,
        "lamps": b.lamps,
        "masked_share": products.joined.masked,
    }
    if agreed is not None:
        columns |= {"error_made": agreed.by_band, "bias_made": agreed.bias}
    rows = [",".join(f"{x:.6g}" if np.isfinite(x) else "" for x in row) for row in np.column_stack([*columns.values()])]
    try:
        write_text(out / "uncertainty.csv", "\n".join([",".join(columns), *rows]) + "\n")
    except OSError as error:
        raise write_error(out / "uncertainty.csv", error) from error


def _page(products: Products, mosaic: Mosaic, rgb: np.ndarray, points: list[Point], agreed: Agreement | None) -> None:
    job, out, grid = products.job, mosaic.folder, products.job.grid
    bottom = grid.top - grid.rows * grid.cell
    without = products.joined.seen & ~np.isfinite(products.joined.rgb).all(-1)
    sheet = figures.Sheet(rgb, grid.left, bottom, grid.cell, str(grid.crs), without)
    spectra = []
    for point in points:
        if not np.isfinite(point.value).any():
            continue  # named in a remark
        x, y = job.projection.to_map(point.place) - [grid.left, bottom]
        spectra.append(figures.Spectrum(point.name, (float(x), float(y)), point.value, point.spread, point.truth))
    navigation = job.georeference.navigation
    way = job.projection.to_map(navigation.position[:, :2])
    what = job.calibrated.correction
    pictures: list[Picture] = [
        save(
            figures.picture(sheet, spectra, [way]), out, "rgb", "The mosaic",
            f"Means of {what.quantity} in red (590-660 nm), green (520-580 nm) and blue (445-500 nm), one scale for "
            "all. White line: the vehicle's way. Letters: places of the spectra below. Hatched: seen, but without a "
            "number in one of the three.",
        ),
        save(figures.spectra(mosaic.wavelengths, spectra, what.quantity, what.unit), out, "spectra",
             "Spectra of places", "Means over 8 cm; bands that noise hides are left out."),
        save(figures.layers(sheet, _panels(products)), out, "layers", "Coverage and geometry",
             "Pixels a cell, way through the water, angle at the floor, and what else was asked for."),
    ]  # fmt: skip
    if products.budget is not None:
        b = products.budget
        parts = {"noise of a pixel": b.noise, "floor's height": b.height, "water": b.water, "lamps": b.lamps}
        shown = figures.budget(b.wavelengths, parts, None if agreed is None else agreed.by_band, products.joined.masked)
        pictures.append(
            save(shown, out, "uncertainty", "How sure reflectance is",
                 "By band: standard deviations as stated for water and lamps, as found for noise and the floor's "
                 "height. Below: share of cells in which noise is more than a fifth of the signal, or of 5 %.")
        )  # fmt: skip
    rows = [[label, _shown(value), unit] for label, value, unit in mosaic.figures_table()]
    files = {name: what for name, what in WHAT.items() if (out / name).exists() or name == NOTE}
    title = f"Mosaic of {products.inputs.lines.path.name}"
    write_map_page(out, title, Table("", ["", "", ""], rows), products.remarks, pictures, files)


def _shown(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _panels(products: Products) -> dict[str, tuple[np.ndarray, str]]:
    shown = {name: layer for name, layer in products.joined.layers.items() if name not in ("time",)}
    return {"coverage": shown.pop("coverage"), **shown}
