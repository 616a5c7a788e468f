"""From n to the coordinates of a map and back: exact at the knots of a grid, a polynomial between them.

The plane of n and a map's plane differ by a turn (the map's meridian convergence, 1.2 degrees at the default datum), a
scale and a little curvature: adding north and east to a map's coordinates is 0.2 m off at 10 m. Points are projected by
PROJ, through GDAL's WGS-84; some million of them by the polynomial that agrees with it.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.core.extras import imported

_DEGREE, _KNOTS = 3, 12
_EXACT = 1e-4  # by how much the polynomial may be off [m]
_GEODETIC = "EPSG:4326"


def rasterio(why: str) -> Any:
    """The library that reads and writes georeferenced rasters.

    Raises:
        ConfigError: It is not installed.
    """
    return imported("rasterio", "map", why)


def utm_of(datum: Datum) -> str:
    """The zone of Universal Transverse Mercator on WGS-84 that a datum lies in, as `EPSG:32632`."""
    zone = int((datum.longitude + 180.0) // 6.0) % 60 + 1
    if 56.0 <= datum.latitude < 64.0 and 3.0 <= datum.longitude < 12.0:
        zone = 32  # western Norway is wider than its meridians
    elif 72.0 <= datum.latitude <= 84.0 and 0.0 <= datum.longitude < 42.0:
        zone = 31 + 2 * int((datum.longitude + 3.0) // 12.0)  # Svalbard has 31, 33, 35, 37 alone
    return f"EPSG:{(32600 if datum.latitude >= 0 else 32700) + zone}"


def crs_of(name: Any, where: str) -> Any:
    """A projected coordinate reference system in metres, for a mosaic.

    Raises:
        ConfigError: There is no such system, or it is none in metres.
    """
    rio = rasterio(where)
    try:
        found = rio.crs.CRS.from_user_input(name)
    except rio.errors.CRSError:
        raise ConfigError(f"{where}: found '{name}', expected a coordinate system such as EPSG:32632, or utm") from None
    if not found.is_projected:
        raise ConfigError(
            f"{where}: '{name}' has no coordinates in metres on a plane; expected such as EPSG:32632 (UTM), or utm"
        )
    unit, factor = found.linear_units_factor
    if abs(factor - 1.0) > 1e-9:
        raise ConfigError(f"{where}: '{name}' counts in {unit}, expected metres")
    return found


@dataclass(frozen=True)
class Projection:
    """Between places north and east of a datum and a map's x and y, within a box.

    Attributes:
        crs: Of the map, of rasterio.
        low: Of the box, north and east [m].
        high: Of the box.
        forward: Coefficients of x and y, and of the inverse.
        inverse: Of north and east.
        origin: About which x and y are counted, for digits.
        scale: By which they are divided.
        worst: By how much the polynomials are off [m].
    """

    crs: Any
    low: Float[np.ndarray, "2"]
    high: Float[np.ndarray, "2"]
    forward: Float[np.ndarray, "k 2"]
    inverse: Float[np.ndarray, "k 2"]
    origin: Float[np.ndarray, "2"]
    scale: Float[np.ndarray, "2"]
    worst: float

    @classmethod
    def of(
        cls, datum: Datum, crs: Any, low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"], depth: float
    ) -> "Projection":
        """In a box of north and east [m] at a depth.

        Raises:
            ConfigError: The map does not reach there, or bends too much within the box.
        """
        low, high = np.asarray(low, float) - 0.5, np.asarray(high, float) + 0.5
        places = [_knots(low, high, n) for n in (_KNOTS, _KNOTS + 5)]  # to fit, and to check
        maps = [project(datum, crs, np.column_stack([p, np.full(len(p), depth)])) for p in places]
        origin, scale = maps[0].mean(0), np.maximum(np.abs(maps[0] - maps[0].mean(0)).max(0), 1e-12)
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        forward = np.linalg.lstsq(_terms((places[0] - middle) / half), (maps[0] - origin) / scale, rcond=None)[0]
        inverse = np.linalg.lstsq(_terms((maps[0] - origin) / scale), (places[0] - middle) / half, rcond=None)[0]
        made = cls(crs, low, high, forward, inverse, origin, scale, 0.0)
        worst = float(np.abs(made.to_place(maps[1]) - places[1]).max())
        worst = max(worst, float(np.abs(made.to_place(made.to_map(places[1])) - places[1]).max()))
        if not worst < _EXACT:
            raise ConfigError(
                f"{crs}: its plane bends by {worst:.2g} m within {np.ptp([low, high], axis=0).max():.0f} m, more than "
                f"{_EXACT:g}; does it hold at {datum.latitude:.4f}, {datum.longitude:.4f}? Map smaller areas"
            )
        return cls(crs, low, high, forward, inverse, origin, scale, worst)

    def to_map(self, place: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """The map's x and y of places north and east [m]."""
        middle, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        return self.origin + self.scale * (_terms((place - middle) / half) @ self.forward)

    def to_place(self, xy: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """Places north and east [m] of the map's x and y."""
        middle, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        return middle + half * (_terms((xy - self.origin) / self.scale) @ self.inverse)

    def slope(self, place: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2 2"]:
        """d(x, y) / d(north, east) at a place."""
        step = 0.01 * np.eye(2)
        return np.stack([(self.to_map(place + h) - self.to_map(place - h)) / 0.02 for h in step], axis=1)


def project(datum: Datum, crs: Any, position: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
    """The map's x and y of places in n, by PROJ.

    Raises:
        ConfigError: They cannot be projected.
    """
    rio = rasterio("projecting to a map")
    from rasterio.warp import transform

    latitude, longitude, _ = datum.geodetic(position)
    try:
        x, y, *_ = transform(_GEODETIC, crs, longitude, latitude)
    except rio.errors.RasterioError as error:
        raise ConfigError(f"{crs}: places at {datum} cannot be projected: {error}") from None
    found = np.column_stack([x, y])
    if not np.isfinite(found).all():
        raise ConfigError(f"{crs}: has no coordinates for {datum}; is it the map of another part of the world?")
    return found


def _knots(low: np.ndarray, high: np.ndarray, n: int) -> Float[np.ndarray, "k 2"]:
    return np.stack(np.meshgrid(*(np.linspace(a, b, n) for a, b in zip(low, high, strict=True))), -1).reshape(-1, 2)


def _terms(x: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n k"]:
    """Products of powers up to the third."""
    u, v = x[..., 0], x[..., 1]
    return np.stack([u**i * v**j for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)], axis=-1)
