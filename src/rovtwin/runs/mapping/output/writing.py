"""All files of a mosaic but its cube, and the note that makes it whole."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from rovtwin._version import __version__
from rovtwin.core.log.files import write_error
from rovtwin.core.user_files.files import write_text
from rovtwin.mapping.formats.colours import picture
from rovtwin.mapping.formats.envi import NO_DATA
from rovtwin.mapping.formats.geotiff import write_cube, write_layers, write_picture
from rovtwin.mapping.formats.netcdf import write_netcdf
from rovtwin.mapping.formats.vectors import polygons, write_geojson, write_immersion
from rovtwin.report.mapping.figures import Plan
from rovtwin.runs.mapping.area import gaps_of, hull_of
from rovtwin.runs.mapping.output.mosaic_page import write_mosaic_page
from rovtwin.runs.mapping.output.noting import hashes_of, settings_of
from rovtwin.runs.mapping.output.products import Products
from rovtwin.runs.mapping.points import (
    Agreement,
    agreement,
    read_points,
    usual_points,
    with_spectra,
    without_value,
    write_spectra,
)
from rovtwin.runs.mapping.residuals import write_ties
from rovtwin.runs.mapping.result import NOTE, Mosaic

_SMALL = 300e6  # bytes of a cube that is written as GeoTIFF unasked


def write_all(products: Products, out: Path, begun: float, progress: Callable[[str, int, int], None]) -> Mosaic:
    """Write them; the note comes last.

    Raises:
        LogError: They cannot be written.
    """
    job, inputs = products.job, products.inputs
    about = _about(products)
    mosaic = Mosaic(out, about)
    alike = job.calibrated.correction.reflects
    whole = np.isfinite(products.joined.rgb).all(-1)  # without one of the three colours a cell has none
    rgb = picture(products.joined.rgb, products.joined.seen & whole, alike)
    progress("writing", 1, 4)
    _rasters(products, mosaic, rgb)
    progress("writing", 2, 4)
    about["figures"]["gaps_m2"], plan = _vectors(products, out)
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
    write_mosaic_page(products, mosaic, rgb, points, agreed, plan)
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
    if products.panel is not None:
        figures["panel"] = products.panel.figures
    if products.registration is not None:
        figures["registration"] = products.registration.figures
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


def _vectors(products: Products, out: Path) -> tuple[float, Plan]:
    """Gaps, ties and navigation; how large all gaps are [m2], and where."""
    job, inputs = products.job, products.inputs
    rings = hull_of(products.joined.seen, job.grid) if products.area is None else products.area
    gaps, wide = gaps_of(rings, products.joined.seen, job.grid)
    features = polygons(gaps, wide)
    total = float(sum(feature["properties"]["area_m2"] for feature in features))
    write_geojson(out / "gaps.geojson", features, name="gaps", area_m2=total)
    if products.registration is not None:
        write_ties(out, products.registration.residuals, inputs.datum)
    navigation = job.georeference.navigation
    depth = job.georeference.floor.depth_and_slope(navigation.position[:, :2])[0] - navigation.position[:, 2]
    write_immersion(out / "navigation.csv", navigation, inputs.datum, job.projection, depth)
    outlines = [] if products.area is None else [ring for part in rings for ring in part]
    extent = (wide.left, wide.left + wide.columns * wide.cell, wide.top - wide.rows * wide.cell, wide.top)
    return total, Plan(outlines, gaps, extent)


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
        "panel": b.panel,
        "masked_share": products.joined.masked,
    }
    if agreed is not None:
        columns |= {"error_made": agreed.by_band, "bias_made": agreed.bias}
    rows = [",".join(f"{x:.6g}" if np.isfinite(x) else "" for x in row) for row in np.column_stack([*columns.values()])]
    try:
        write_text(out / "uncertainty.csv", "\n".join([",".join(columns), *rows]) + "\n")
    except OSError as error:
        raise write_error(out / "uncertainty.csv", error) from error
