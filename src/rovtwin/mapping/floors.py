"""Floors as maps know them: a grid of depths with a smooth surface through it, an elevation model of a file."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import distance_transform_edt

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.files import checked
from rovtwin.mapping.projection import Projection, project, rasterio

_MOST = 4000  # cells a side that are read of an elevation model, about the survey
_MARGIN = 3  # cells about the survey that a spline needs


@dataclass(frozen=True)
class GridFloor:
    """Depths on a grid, a bicubic spline between them: smooth, as Newton's method on rays likes it.

    Attributes:
        north: Of the grid's rows [m], increasing.
        east: Of its columns [m], increasing.
        depth: [m].
        sigma: Standard deviation of each depth [m].
        known: Where there is a depth; None: everywhere.
        source: What it was made of, for people.
    """

    north: Float[np.ndarray, " rows"]
    east: Float[np.ndarray, " columns"]
    depth: Float[np.ndarray, "rows columns"]
    sigma: Float[np.ndarray, "rows columns"]
    known: Bool[np.ndarray, "rows columns"] | None = None
    source: str = ""

    @cached_property
    def _spline(self) -> RectBivariateSpline:
        return RectBivariateSpline(self.north, self.east, self.depth, kx=3, ky=3)

    def depth_and_slope(
        self, place: Float[np.ndarray, "*n 2"]
    ) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n 2"]]:
        """See `imaging.floor.Floor`; no number beyond the grid, and where nothing is known."""
        north, east = np.nan_to_num(place[..., 0]).ravel(), np.nan_to_num(place[..., 1]).ravel()
        value = self._spline.ev(north, east)
        slope = np.stack([self._spline.ev(north, east, dx=1), self._spline.ev(north, east, dy=1)], axis=-1)
        outside = (north < self.north[0]) | (north > self.north[-1]) | (east < self.east[0]) | (east > self.east[-1])
        outside |= ~np.isfinite(place).all(-1).ravel()
        if self.known is not None:
            outside |= ~self.known[self._nearest(north, east)]
        value = np.where(outside, np.nan, value)
        return value.reshape(place.shape[:-1]), slope.reshape(place.shape)

    def depth_sigma(self, place: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n"]:
        """Standard deviation of the depth at places [m], that of the nearest cell."""
        return self.sigma[self._nearest(np.nan_to_num(place[..., 0]), np.nan_to_num(place[..., 1]))]

    def _nearest(self, north: np.ndarray, east: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rows, columns = (
            np.clip(np.rint((x - axis[0]) / (axis[1] - axis[0])).astype(int), 0, len(axis) - 1)
            for x, axis in ((north, self.north), (east, self.east))
        )
        return rows, columns


@dataclass(frozen=True)
class Elevation:
    """How the numbers of an elevation model are meant.

    Attributes:
        depths: Whether they are depths below the water, positive down; else heights over the ellipsoid, up, as the
            height of the datum is.
        sigma: Standard deviation of them [m].
    """

    depths: bool = False
    sigma: float = 0.05


def elevation_model(
    path: Path, datum: Datum, low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"], given: Elevation
) -> GridFloor:
    """Of a raster file such as a GeoTIFF, in whatever coordinate system it says, laid out north and east.

    Args:
        path: Of the file.
        datum: Where n lies.
        low: North and east [m] of what must be covered.
        high: Of the other corner.
        given: What its numbers are.

    Raises:
        ConfigError: It cannot be read, says no coordinate system or none of the map's, does not reach there, or its
            floor lies above the water.
    """
    rio = rasterio(f"--floor {path}")
    try:
        with rio.open(checked(path, np.inf)) as file:
            check_system(file, path)
            corners = _box(low, high)
            xy = project(datum, file.crs, np.column_stack([corners, np.zeros(len(corners))]))
            window = _window(file, xy, path)
            values = file.read(1, window=window, masked=True).astype(float) * file.scales[0] + file.offsets[0]
            step = file.window_transform(window)
            crs = file.crs
    except rio.errors.RasterioError as error:
        raise ConfigError(f"{path}: cannot be read as a raster ({error}); expected such as a GeoTIFF") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from None
    known = ~np.ma.getmaskarray(values) & np.isfinite(values.filled(np.nan))
    if not known.any():
        raise ConfigError(f"{path}: has no heights where the survey is; is it the model of another place?")
    depth = np.where(known, values.filled(0.0), np.nan)
    depth = depth if given.depths else datum.height - depth
    _check_depth(depth, path, given, datum)
    return _laid_out(depth, known, step, Projection.of(datum, crs, low, high, float(np.nanmedian(depth))), path, given)


def _box(low: np.ndarray, high: np.ndarray) -> Float[np.ndarray, "4 2"]:
    return np.array([[a, b] for a in (low[0], high[0]) for b in (low[1], high[1])])


def check_system(file: Any, path: Path) -> None:
    """Refuse a raster that does not say where it lies.

    Raises:
        ConfigError: See there.
    """
    if file.crs is None:
        raise ConfigError(
            f"{path}: says no coordinate system, so nobody knows where it lies. Write it in: "
            "gdal_edit -a_srs EPSG:32632 FILE, or QGIS: Raster, Projections, Assign"
        )
    if not (file.crs.is_projected or file.crs.is_geographic):
        raise ConfigError(
            f"{path}: its coordinate system is neither one of a map nor latitude and longitude: "
            f"{file.crs.to_wkt()[:80]}"
        )
    if file.transform.is_identity:
        raise ConfigError(f"{path}: says no place of its cells (geotransform)")
    if file.transform.b or file.transform.d:
        raise ConfigError(f"{path}: its rows are turned against the map's axes; resample it: gdalwarp FILE OUT")


def _window(file: Any, xy: np.ndarray, path: Path) -> Any:
    """The part of a file about the survey."""
    columns, rows = _cells(file.transform, xy)
    first, last = np.floor([rows.min(), columns.min()]) - _MARGIN, np.ceil([rows.max(), columns.max()]) + _MARGIN
    begin, end = np.maximum(first, 0), np.minimum(last, file.shape)
    if (end - begin < 4).any():
        b = file.bounds
        raise ConfigError(
            f"{path}: lies at x {b.left:.6g} to {b.right:.6g}, y {b.bottom:.6g} to {b.top:.6g} ({file.crs}); the "
            f"survey at x {xy[:, 0].min():.6g} to {xy[:, 0].max():.6g}, y {xy[:, 1].min():.6g} to "
            f"{xy[:, 1].max():.6g} in that system. Is it of another place or in another system than it says, or is "
            "the datum another one?"
        )
    if (end - begin > _MOST).any():
        raise ConfigError(f"{path}: has {end - begin} cells where the survey is, more than {_MOST} a side; resample it")
    window = rasterio("an elevation model").windows.Window
    return window(int(begin[1]), int(begin[0]), int(end[1] - begin[1]), int(end[0] - begin[0]))


def _cells(step: Any, xy: Float[np.ndarray, "*n 2"]) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows of a map's x and y, whole at cells' corners."""
    back = ~step
    x, y = xy[..., 0], xy[..., 1]
    return back.a * x + back.b * y + back.c, back.d * x + back.e * y + back.f


def _check_depth(depth: np.ndarray, path: Path, given: Elevation, datum: Datum) -> None:
    middle = float(np.nanmedian(depth))
    if middle <= 0:
        how = "as heights" if given.depths else f"as depths, or is the datum's height not {datum.height:g} m"
        raise ConfigError(
            f"{path}: its floor lies {-middle:.1f} m above the water; are its numbers to be taken {how}? "
            "--dem-values height or depth"
        )


def _laid_out(
    depth: np.ndarray, known: np.ndarray, step: Any, projection: Projection, path: Path, given: Elevation
) -> GridFloor:
    """The file's cells, read by splines in its own axes, on a grid of north and east as fine as they."""
    rows, columns = np.arange(depth.shape[0]) + 0.5, np.arange(depth.shape[1]) + 0.5
    if not known.all():  # the spline needs a number everywhere: that of the nearest cell, which counts as unknown
        nearest: Any = distance_transform_edt(~known, return_distances=False, return_indices=True)
        depth = depth[tuple(nearest)]
    spline = RectBivariateSpline(rows, columns, depth, kx=min(3, len(rows) - 1), ky=min(3, len(columns) - 1))
    slope = projection.slope(0.5 * (projection.low + projection.high))
    cell = np.sqrt(abs(step.a * step.e / np.linalg.det(slope)))  # as large on the floor [m]
    axes = [
        np.linspace(a, b, int(np.clip(np.ceil((b - a) / (0.5 * cell)), 8, _MOST)))
        for a, b in zip(projection.low, projection.high, strict=True)
    ]
    place = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    xy = projection.to_map(place)
    column, row = _cells(step, xy)
    found = spline.ev(row, column)
    inside = (row >= 0) & (row < len(rows)) & (column >= 0) & (column < len(columns))
    cells = tuple(np.clip(x.astype(int), 0, n - 1) for x, n in ((row, len(rows)), (column, len(columns))))
    sure = inside & known[cells]
    return GridFloor(axes[0], axes[1], found, np.full(found.shape, given.sigma), sure, f"elevation model {path.name}")
