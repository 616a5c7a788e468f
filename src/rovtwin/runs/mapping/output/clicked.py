"""A mosaic in coarser cells and bands, for the spectra that its page shows where one clicks."""

import numpy as np
from jaxtyping import Float

from rovtwin.mapping.cells.grid import Grid
from rovtwin.mapping.formats.envi import NO_DATA
from rovtwin.mapping.projection import Projection
from rovtwin.report.mapping.figures import Sheet, Spectrum
from rovtwin.report.mapping.viewer import Viewer, coarser
from rovtwin.runs.mapping.result import Mosaic
from rovtwin.simulation.imager.ground import Ground
from rovtwin.simulation.scene import Scene

_ENOUGH = 0.5  # share of the cells seen that must have a number in a band for a coarser cell to have one
_ACROSS = 3  # places a side of a coarser cell at which the truth is taken


def viewer_of(
    mosaic: Mosaic,
    grid: Grid,
    projection: Projection,
    sheet: Sheet,
    spectra: list[Spectrum],
    scene: Scene | None,
) -> Viewer:
    """Of a mosaic, with the truth where a scene knows it."""
    rows, columns, bands = mosaic.shape
    ground = None if scene is None or scene.floor is None else Ground(scene, mosaic.wavelengths)
    side, together = coarser(rows, columns, bands, ground is not None)
    value, spread = means(mosaic.cube, side, together)
    corner = np.array([grid.left, grid.top - grid.rows * grid.cell])
    middle = corner + 0.5 * grid.cell * np.array([columns, rows])
    slope = np.stack([projection.to_place(middle + h) - projection.to_place(middle - h) for h in np.eye(2)], axis=1) / 2
    first = projection.to_place(middle) - slope @ (middle - corner)
    truth = None
    if ground is not None:
        truth = _truth(ground, projection, grid, side, value.shape[:2])
        truth[np.isnan(value).all(axis=-1)] = np.nan
        truth = _in_bands(truth, together)
    unit = mosaic.about["unit"]
    places = [(one.name, (one.at[0] - sheet.extent[0], one.at[1] - sheet.extent[2])) for one in spectra]
    return Viewer(
        mosaic.about["quantity"].capitalize() + ("" if unit == "1" else f" [{unit}]"),
        _in_bands(mosaic.wavelengths, together), value, spread, truth, sheet.rgb, side * grid.cell,
        (columns * grid.cell, rows * grid.cell), (float(corner[0]), float(corner[1])), str(grid.crs),
        np.column_stack([first, slope]), places,
    )  # fmt: skip


def means(
    cube: Float[np.ndarray, "row band column"], side: int, together: int
) -> tuple[Float[np.ndarray, "down across group"], Float[np.ndarray, "down across group"]]:
    """Means and standard deviations over squares of cells, and over so many bands each; no number where few have one.

    Args:
        cube: As it lies on the disk.
        side: Cells a side that become one; the last ones may be smaller.
        together: Bands that become one.
    """
    rows, bands, columns = cube.shape
    begins, groups = np.arange(0, columns, side), np.arange(0, bands, together)
    value, spread = np.full((2, -(-rows // side), len(begins), len(groups)), np.nan, np.float32)
    for down in range(len(value)):
        block = np.array(cube[down * side : (down + 1) * side], float)
        known = (block != np.float32(NO_DATA)) & np.isfinite(block)
        seen = np.add.reduceat(known.any(axis=1).sum(axis=0), begins)
        block[~known] = 0.0
        count = known.sum(axis=0)
        sums = [np.add.reduceat(x, begins, axis=1) for x in (count, block.sum(axis=0), np.square(block).sum(axis=0))]
        count, total, squares = sums
        with np.errstate(invalid="ignore", divide="ignore"):
            mean, of = total / count, squares / count
            sd = np.sqrt(np.maximum(of - mean**2, 0.0))
        hidden = count < np.maximum(_ENOUGH * seen, 1.0)
        mean[hidden], sd[hidden] = np.nan, np.nan
        value[down], spread[down] = _in_bands(mean.T, together), _in_bands(sd.T, together)
    return value, spread


def _in_bands(x: Float[np.ndarray, "*n band"], together: int) -> Float[np.ndarray, "*n group"]:
    """Means over so many bands each, over those that have a number."""
    begins, known = np.arange(0, x.shape[-1], together), np.isfinite(x)
    total = np.add.reduceat(np.where(known, x, 0.0), begins, axis=-1)
    count = np.add.reduceat(known.astype(float), begins, axis=-1)
    return np.where(count > 0, total / np.maximum(count, 1.0), np.nan)


def _truth(
    ground: Ground, projection: Projection, grid: Grid, side: int, shape: tuple[int, int]
) -> Float[np.ndarray, "down across band"]:
    wide = side * grid.cell
    x = grid.left + wide * (np.arange(shape[1]) + 0.5)
    y = grid.top - wide * (np.arange(shape[0]) + 0.5)
    middles = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    offsets = wide * ((np.arange(_ACROSS) + 0.5) / _ACROSS - 0.5)
    parts = [
        ground.from_above(projection.to_place(middles + [dx, dy])) / _ACROSS**2 for dx in offsets for dy in offsets
    ]
    return np.sum(parts, axis=0).reshape(*shape, -1)
