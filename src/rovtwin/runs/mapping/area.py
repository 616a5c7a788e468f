"""The area that was to be seen, and what of it was not, also where it reaches beyond the mosaic."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.datum import Datum
from rovtwin.mapping.cells.grid import Grid
from rovtwin.mapping.projection import Projection
from rovtwin.survey.area import read_area

Rings = list[list[Float[np.ndarray, "k 2"]]]  # of each polygon: outline and holes, closed


def rings_of(path: Path, datum: Datum) -> Rings:
    """Of a file of an area: north and east [m].

    Raises:
        ConfigError: It cannot be used.
    """
    shape = read_area(path, datum).shape
    return [[np.array(ring.coords)[:, :2] for ring in (part.exterior, *part.interiors)] for part in shape.geoms]


def hull_of(seen: Bool[np.ndarray, "row column"], grid: Grid) -> Rings:
    """The convex hull of the cells that were seen, x and y of the map."""
    from scipy.spatial import ConvexHull

    rows, columns = np.nonzero(seen)
    xy = np.column_stack([grid.x[columns], grid.y[rows]])
    hull = xy[ConvexHull(xy).vertices] if len(xy) > 3 and np.ptp(xy, axis=0).min() > 0 else xy[:1].repeat(3, 0)
    return [[np.concatenate([hull, hull[:1]])]]


def on_map(rings: Rings, projection: Projection) -> Rings:
    """Rings of north and east as x and y."""
    return [[projection.to_map(ring) for ring in part] for part in rings]


def gaps_of(
    rings: Rings, seen: Bool[np.ndarray, "row column"], grid: Grid
) -> tuple[Bool[np.ndarray, "high wide"], Grid]:
    """Cells of an area that were not seen, on a grid that holds mosaic and area; its cells are those of the mosaic.

    Raises:
        ConfigError: The area would have too many cells.
    """
    from rasterio.features import rasterize

    corners = [[grid.x[0], grid.y[0]], [grid.x[-1], grid.y[-1]]]
    wide = Grid.over(grid.crs, np.concatenate([corners, *(ring for part in rings for ring in part)]), grid.cell)
    down, right = round((wide.top - grid.top) / grid.cell), round((grid.left - wide.left) / grid.cell)
    wide = replace(wide, top=grid.top + down * grid.cell, left=grid.left - right * grid.cell)
    shapes = [{"type": "Polygon", "coordinates": [ring.tolist() for ring in part]} for part in rings]
    gaps = np.asarray(rasterize(shapes, wide.shape, transform=wide.transform, dtype="uint8")) > 0
    gaps[down : down + grid.rows, right : right + grid.columns] &= ~seen
    return gaps, wide
