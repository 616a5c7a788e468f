"""Places on a mosaic: of training and of checks, named in files by north and east, or by latitude and longitude."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.mapping.cells.grid import Grid
from rovtwin.mapping.projection import Projection
from rovtwin.runs.mapping.points import RADIUS, columns_of
from rovtwin.runs.mapping.result import Mosaic

_KINDS = (
    ("name", "north", "east", "radius"),
    ("name", "latitude", "longitude", "radius"),
    ("name", "north", "east"),
    ("name", "latitude", "longitude"),
)
_LARGEST = 10.0  # of a radius [m]


@dataclass(frozen=True)
class Ground:
    """A mosaic's cells and where they lie.

    Attributes:
        grid: Cells.
        projection: Of places to the map.
        datum: Of places.
        cell_m2: Area of a cell on the ground, less than its square on the map by the map's scale [m2].
    """

    grid: Grid
    projection: Projection
    datum: Datum
    cell_m2: float

    @classmethod
    def of(cls, mosaic: Mosaic) -> "Ground":
        """Of a mosaic's note."""
        from rasterio.crs import CRS

        about = mosaic.about["grid"]
        crs = CRS.from_user_input(about["crs"])
        grid = Grid(crs, about["left_m"], about["top_m"], about["cell_m"], about["rows"], about["columns"])
        datum = Datum(**mosaic.about["datum"])
        low, high = _box(grid, datum)
        projection = Projection.of(datum, crs, low, high, 0.0)
        scale = abs(float(np.linalg.det(projection.slope(0.5 * (low + high)))))
        return cls(grid, projection, datum, grid.cell**2 / scale)


def _box(grid: Grid, datum: Datum) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """North and east of the corners."""
    from rasterio.warp import transform

    x = [grid.left, grid.left + grid.columns * grid.cell]
    y = [grid.top - grid.rows * grid.cell, grid.top]
    longitude, latitude = transform(grid.crs, "EPSG:4326", [x[0], x[0], x[1], x[1]], [*y, *y])[:2]
    place = np.array([datum.position(a, b, 0.0)[:2] for a, b in zip(latitude, longitude, strict=True)])
    return place.min(axis=0), place.max(axis=0)


@dataclass(frozen=True)
class Place:
    """Of a file.

    Attributes:
        name: Of the class.
        xy: On the map [m].
        radius: Of the circle of cells [m].
    """

    name: str
    xy: Float[np.ndarray, "2"]
    radius: float


def read_places(option: str, path: Path, ground: Ground) -> list[Place]:
    """Of a file, all on the mosaic.

    Raises:
        ConfigError: It cannot be read, has other columns, or a place lies outside the mosaic.
    """
    names, table, kind = columns_of(option, path, *_KINDS)
    places = []
    for row, (name, numbers) in enumerate(zip(names, table, strict=True), 2):
        north_east = numbers[:2] if kind[1] == "north" else ground.datum.position(numbers[0], numbers[1], 0.0)[:2]
        radius = float(numbers[2]) if len(numbers) == 3 else RADIUS
        if not 0.0 < radius <= _LARGEST:
            raise ConfigError(
                f"{option} {path}: row {row} ({name}): found a radius of {radius:g} m, expected more than 0, at most "
                f"{_LARGEST:g}"
            )
        xy = ground.projection.to_map(np.asarray(north_east, float))
        if ground.grid.number(xy) < 0:
            low, high = ground.projection.low, ground.projection.high
            raise ConfigError(
                f"{option} {path}: row {row} ({name}): lies outside the mosaic, at north {north_east[0]:.2f}, east "
                f"{north_east[1]:.2f}; the mosaic has north {low[0]:.1f} to {high[0]:.1f}, east {low[1]:.1f} to "
                f"{high[1]:.1f} from the datum {ground.datum}"
            )
        places.append(Place(name.strip(), xy, radius))
    return places
