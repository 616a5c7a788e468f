"""Maps under the chart: a user's rasters, warped to north and east of the datum, tile by tile. For a worker.

The plane of n is the orthographic projection of the ellipsoid about the datum, which PROJ knows. GDAL warps what a tile
needs from the overview that is fine enough, so that memory does not depend on the size of the file.

Reference: PROJ, Orthographic projection, ellipsoidal form.
"""

from dataclasses import asdict, dataclass
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.datum import FARTHEST, Datum
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.files import checked
from rovtwin.mapping.floors import check_system
from rovtwin.mapping.projection import rasterio

SIDE = 256  # of a tile [px]
LEVELS = (-7, 12)  # of tiles: 2^-level metres per pixel
MOST_PIXELS = 4e8  # of a file without overviews, which would be read whole for a picture of it
CLOSE = 1.01  # by how much coarser than a tile an overview may be: a map's metres are not quite those on the ground
MEMORY = 64  # of a warp, and of what GDAL keeps of files [MB]
SAMPLE = 512  # side of the picture by which shades are chosen [px]
VECTORS = (".000", ".shp", ".geojson", ".kml", ".gpx")


@dataclass(frozen=True)
class MapFile:
    """A raster as the chart has it.

    Attributes:
        path: Of the file.
        name: For people.
        north, east: Extent about the datum [m].
        pixel: Of the file [m].
        shades: Values that are black and white, where the file has no colours; else None.
    """

    path: str
    name: str
    north: tuple[float, float]
    east: tuple[float, float]
    pixel: float
    shades: tuple[float, float] | None

    def message(self) -> dict[str, Any]:
        """For pages."""
        finest = min(int(np.ceil(-np.log2(self.pixel))), LEVELS[1])
        return asdict(self) | {"coarsest": LEVELS[0], "finest": max(finest, LEVELS[0]), "side": SIDE}


def describe(path: str | Path, datum: Datum) -> MapFile:
    """What there is of a file about a datum.

    Raises:
        ConfigError: It is no raster, does not say where it lies, or lies somewhere else.
    """
    rio = rasterio(f"--map {path}")
    path = Path(path)
    try:
        with rio.open(checked(path, np.inf)) as file:
            _require_raster(file, path)
            north, east = _extent(file, datum, path)
            pixel = _pixel(file, datum, north, east)
            shades = _shades(file)
    except rio.errors.RasterioError as error:
        hint = ". Vectors, S-57 too, have to be drawn first: QGIS, Convert map to raster" * (path.suffix in VECTORS)
        raise ConfigError(f"--map {path}: cannot be read as a raster ({error}){hint}") from None
    except OSError as error:
        raise ConfigError(f"--map {path}: cannot be read: {error.strerror or error}") from None
    return MapFile(str(path.resolve()), path.name, north, east, pixel, shades)


def tile(file: MapFile, datum: Datum, level: int, row: int, column: int) -> bytes | None:
    """A picture (PNG) of a square of the map, north up; None where it lies outside.

    Args:
        file: As described.
        datum: Of the chart.
        level: 2^-level metres are a pixel.
        row: Of the square: how far north its lower left corner lies, in its own sides.
        column: The same to the east.

    Raises:
        ConfigError: The file cannot be read any more.
    """
    size = SIDE * 2.0**-level
    south, west = row * size, column * size
    if south > file.north[1] or south + size < file.north[0] or west > file.east[1] or west + size < file.east[0]:
        return None
    rio = rasterio("a map")
    try:
        colours = _warped(file, datum, 2.0**-level, south + size, west)
    except (rio.errors.RasterioError, OSError) as error:
        raise ConfigError(f"{file.name}: cannot be read any more ({error})") from None
    if not colours[..., 3].any():
        return None
    from PIL import Image

    packed = BytesIO()
    Image.fromarray(colours, "RGBA").save(packed, "PNG", compress_level=1)
    return packed.getvalue()


def plane_of(datum: Datum) -> Any:
    """The coordinate reference system whose x and y are east and north of a datum [m]."""
    text = f"+proj=ortho +lat_0={datum.latitude!r} +lon_0={datum.longitude!r} +ellps=WGS84 +units=m +no_defs"
    return rasterio("a map").crs.CRS.from_proj4(text)


def _require_raster(file: Any, path: Path) -> None:
    if not file.count:
        names = ", ".join(file.subdatasets[:5]) or "nothing"
        raise ConfigError(
            f"--map {path}: holds {names}, expected one raster: gdal_translate NAME OUT.tif takes one out"
        )
    check_system(file, path)
    if file.width * file.height > MOST_PIXELS and not file.overviews(1):
        raise ConfigError(
            f"--map {path}: has {file.width} x {file.height} pixels and no overviews: "
            "gdaladdo -r average FILE 2 4 8 16 32 64 writes them"
        )


def _extent(file: Any, datum: Datum, path: Path) -> tuple[tuple[float, float], tuple[float, float]]:
    """North and east of the part that lies within the datum's reach [m]."""
    from rasterio.warp import transform_bounds

    plane, reach = plane_of(datum), FARTHEST
    left, bottom, right, top = transform_bounds(plane, file.crs, -reach, -reach, reach, reach)
    bounds = file.bounds
    low, high = np.maximum([left, bottom], bounds[:2]), np.minimum([right, top], bounds[2:])
    if not (low < high).all():
        raise ConfigError(
            f"--map {path}: lies at x {bounds.left:.6g} to {bounds.right:.6g}, y {bounds.bottom:.6g} to "
            f"{bounds.top:.6g} ({file.crs}), more than {reach / 1000:.0f} km from the datum, which has x {left:.6g} to "
            f"{right:.6g}, y {bottom:.6g} to {top:.6g} there; is it of another place, or the datum another one?"
        )
    west, south, east, north = np.clip(transform_bounds(file.crs, plane, *low, *high), -reach, reach).tolist()
    return (south, north), (west, east)


def _pixel(file: Any, datum: Datum, north: tuple[float, float], east: tuple[float, float]) -> float:
    """Side of the file's pixels in the middle of what is shown [m]."""
    from rasterio.warp import transform

    plane = plane_of(datum)
    (x,), (y,), *_ = transform(plane, file.crs, [sum(east) / 2], [sum(north) / 2])
    step = file.transform
    xs, ys, *_ = transform(file.crs, plane, [x, x + step.a], [y, y + step.e])
    return float(np.hypot(xs[1] - xs[0], ys[1] - ys[0]) / np.sqrt(2.0))


def _shades(file: Any) -> tuple[float, float] | None:
    """Values of numbers, as depths, that become black and white; None of colours."""
    if _is_coloured(file):
        return None
    shape = tuple(min(SAMPLE, side) for side in file.shape)
    values = file.read(1, out_shape=shape, masked=True)
    numbers = np.asarray(values.compressed(), dtype=float)
    numbers = numbers[np.isfinite(numbers)]
    if not numbers.size:
        return 0.0, 1.0
    low, high = np.percentile(numbers, (2, 98))
    return float(low), float(max(high, low + 1e-9))


def _is_coloured(file: Any) -> bool:
    palette = file.colorinterp[0].name == "palette"
    return palette or (file.dtypes[0] == "uint8" and file.count != 2)


def _warped(file: MapFile, datum: Datum, metres: float, north: float, west: float) -> Float[np.ndarray, "s s 4"]:
    """Red, green, blue and opacity of a square."""
    from rasterio.enums import Resampling
    from rasterio.transform import from_origin
    from rasterio.vrt import WarpedVRT

    source, _ = _opened(file.path, _overview(file, metres))
    palette = source.colorinterp[0].name == "palette"
    opaque = source.nodata is None and "alpha" not in [one.name for one in source.colorinterp]
    how = {"crs": plane_of(datum), "transform": from_origin(west, north, metres, metres), "width": SIDE, "height": SIDE}
    how |= {"resampling": Resampling.nearest if palette else Resampling.bilinear, "add_alpha": opaque}
    with (
        rasterio("a map").Env(GDAL_CACHEMAX=MEMORY),
        WarpedVRT(source, **how, warp_mem_limit=MEMORY) as warped,
    ):
        opacity = warped.dataset_mask()
        bands = warped.read(list(range(1, 4 if source.count >= 3 else 2)))
    if palette:
        colours = np.zeros((256, 4), np.uint8)
        for value, colour in source.colormap(1).items():
            colours[value] = colour
        painted = colours[np.clip(bands[0], 0, 255)]
        return np.dstack([painted[..., :3], np.minimum(painted[..., 3], opacity)])
    if file.shades is not None:
        low, high = file.shades
        share = (bands.astype(float) - low) / (high - low)
        opacity = np.where(np.isfinite(share).all(axis=0), opacity, 0)
        bands = np.clip(255 * np.nan_to_num(share), 0, 255)
    picture = np.broadcast_to(bands, (3, SIDE, SIDE))
    return np.dstack([*picture, opacity]).astype(np.uint8)


def _overview(file: MapFile, metres: float) -> int:
    """Number of the overview that is as coarse as pixels of this size allow; -1 is the file itself."""
    _, factors = _opened(file.path, -1)
    return sum(factor * file.pixel <= CLOSE * metres for factor in factors) - 1


@lru_cache(8)
def _opened(path: str, overview: int) -> tuple[Any, list[int]]:
    """A file that stays open, at an overview, and by what its overviews are coarser."""
    rio = rasterio("a map")
    source = rio.open(path) if overview < 0 else rio.open(path, overview_level=overview)
    return source, list(source.overviews(1)) if overview < 0 else []
