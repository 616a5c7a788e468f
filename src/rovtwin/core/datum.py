"""Where on Earth the frame n lies and when a run began: the only module that knows map coordinates.

The datum is the origin of n, a point at the mean water level given by latitude, longitude and height over the WGS-84
ellipsoid. North and east are those of the plane that touches the water there; the third coordinate is the depth below
the water. A plane leaves the round Earth by d^2 / (2 R): 8 cm at 1 km, 8 m at 10 km. The twin's water is that plane,
and a pressure sensor follows the real one: so the map keeps the depth, and the height is the water's less the depth.

Reference: You (2000), Transformation of Cartesian to geodetic coordinates without iterations, J. Surv. Eng. 126(1), as
pymap3d has it.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rovtwin.core.errors import ConfigError

SEMI_MAJOR_AXIS, INVERSE_FLATTENING = 6378137.0, 298.257223563  # WGS-84: [m], [-]
METADATA_KEY = "datum"
FARTHEST = 10_000.0  # a place on the map beyond it is taken for a mistake; the plane is 8 m off the sea there [m]


@dataclass(frozen=True)
class Datum:
    """The origin of n on the map, and the start of the run. The default lies in the Trondheimsfjord off Trondheim.

    Attributes:
        latitude: WGS-84, north positive [deg].
        longitude: WGS-84, east positive [deg].
        height: Of the mean water level over the ellipsoid [m]; 0 when nobody looked it up (off Trondheim about 40).
        utc_start: Time zero of the run's clock, ISO 8601 in UTC: `2021-06-01T10:00:00Z`.
    """

    latitude: float = 63.45
    longitude: float = 10.36
    height: float = 0.0
    utc_start: str = "2021-06-01T10:00:00Z"

    def __post_init__(self) -> None:
        check_coordinates(self.latitude, self.longitude)
        if not np.isfinite(self.height):
            raise ConfigError(f"height {self.height}: expected a finite number [m]")
        object.__setattr__(self, "utc_start", utc_text(self.utc_start))

    def geodetic(self, position: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Map coordinates of places in n.

        Args:
            position: North, east, down [m], shape (..., 3).

        Returns:
            Latitude [deg], longitude in [-180, 180] [deg] and height over the ellipsoid [m], each of shape (...).
        """
        from pymap3d import ned2geodetic

        north, east, down = np.moveaxis(np.asarray(position, dtype=float), -1, 0)
        latitude, longitude, _ = ned2geodetic(north, east, down, self.latitude, self.longitude, self.height)
        return np.asarray(latitude), np.asarray(longitude), self.height - down

    def ecef(self, position: ArrayLike) -> np.ndarray:
        """Earth-centred, Earth-fixed coordinates (EPSG:4978) of places in n [m], same shape (..., 3)."""
        from pymap3d import geodetic2ecef

        return np.stack(geodetic2ecef(*self.geodetic(position)), axis=-1)

    def position(self, latitude: ArrayLike, longitude: ArrayLike, depth: ArrayLike) -> np.ndarray:
        """Places in n of map coordinates: the inverse of `geodetic`, with the depth in place of the height.

        Args:
            latitude: [deg], any shape.
            longitude: [deg], the same shape.
            depth: Below the water [m], the same shape.

        Returns:
            North, east, down [m], shape (..., 3).

        Raises:
            ConfigError: No such latitude or longitude.
        """
        check_coordinates(latitude, longitude)
        depth = np.asarray(depth, dtype=float)
        # The vertical there leans against that of the datum: go along it until the third coordinate is the depth.
        span = 1000.0
        foot = self._tangent(latitude, longitude, self.height - depth)
        up = (self._tangent(latitude, longitude, self.height - depth + span) - foot) / span
        place = foot + ((depth - foot[..., 2]) / up[..., 2])[..., None] * up
        place[..., 2] = depth
        return place

    def position_of_ecef(self, ecef: ArrayLike) -> np.ndarray:
        """Places in n of Earth-centred, Earth-fixed coordinates [m], the inverse of `ecef`, same shape (..., 3)."""
        from pymap3d import ecef2geodetic

        latitude, longitude, height = ecef2geodetic(*np.moveaxis(np.asarray(ecef, dtype=float), -1, 0))
        return self.position(latitude, longitude, self.height - np.asarray(height))

    def distance(self, latitude: ArrayLike, longitude: ArrayLike) -> np.ndarray:
        """Straight line from the datum to places at the water level, through the Earth where need be [m]."""
        check_coordinates(latitude, longitude)
        return np.linalg.norm(self._tangent(latitude, longitude, self.height), axis=-1)

    def utc(self, t: ArrayLike) -> np.ndarray:
        """UTC of times on the run's clock [s], as datetime64[ns] of the same shape."""
        start = np.datetime64(self.utc_start.removesuffix("Z"), "ns")
        return start + np.round(np.asarray(t, dtype=float) * 1e9).astype("timedelta64[ns]")

    def metadata(self) -> str:
        """As the metadata of a log hold it, JSON."""
        return json.dumps(asdict(self))

    def __str__(self) -> str:
        return (
            f"{coordinates_text(self.latitude, self.longitude)}, water level {self.height:g} m, start {self.utc_start}"
        )

    def _tangent(self, latitude: ArrayLike, longitude: ArrayLike, height: ArrayLike) -> np.ndarray:
        """North, east, down in the plane's own axes, where down is straight and no depth, shape (..., 3)."""
        from pymap3d import geodetic2ned

        there = [np.asarray(value, dtype=float) for value in (latitude, longitude, height)]
        north, east, down = geodetic2ned(there[0], there[1], there[2], self.latitude, self.longitude, self.height)
        return np.stack([north, east, down], axis=-1)


def check_coordinates(latitude: ArrayLike, longitude: ArrayLike) -> None:
    """Raise ConfigError where there is no such latitude or longitude [deg]."""
    for name, value, limit in (("latitude", latitude, 90.0), ("longitude", longitude, 180.0)):
        values = np.asarray(value, dtype=float)
        wrong = values[~(np.abs(values) <= limit)]
        if wrong.size:
            hint = " Are latitude and longitude swapped?" if name == "latitude" and abs(wrong.flat[0]) <= 180 else ""
            raise ConfigError(f"{name} {wrong.flat[0]:g}: expected degrees between -{limit:g} and {limit:g}.{hint}")


def latitude_longitude(text: str, where: str, expected: str = "latitude,longitude [deg]") -> tuple[float, float]:
    """The two numbers of a text such as `63.45,10.36` [deg].

    Raises:
        ConfigError: It is none; the message begins with `where`.
    """
    try:
        latitude, longitude = (float(piece) for piece in text.split(","))
    except ValueError:
        raise ConfigError(f"{where}: found {text!r}, expected {expected}") from None
    return latitude, longitude


def utc_text(text: str) -> str:
    """An ISO 8601 time with its zone in one form, `2021-06-01T10:00:00Z` or with as many digits as it takes.

    Raises:
        ConfigError: It is no time, or does not say its zone.
    """
    expected = "expected a time in UTC such as 2021-06-01T10:00:00Z"
    try:
        time = datetime.fromisoformat(text)
    except (TypeError, ValueError):
        raise ConfigError(f"utc_start: found {text!r}, {expected}") from None
    if time.tzinfo is None:
        raise ConfigError(f"utc_start: found {text!r} without a zone, {expected}: add a Z if it is UTC")
    return time.astimezone(UTC).isoformat().replace("+00:00", "Z")


def utc_now(ahead: float = 0.0) -> str:
    """The time in so many seconds, ISO 8601 in UTC to the millisecond."""
    return (datetime.now(UTC) + timedelta(seconds=ahead)).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def datum_of(metadata: Mapping[str, str]) -> Datum | None:
    """The datum that the metadata of a log hold; None when there is none, or none that makes sense."""
    try:
        found: Any = json.loads(metadata.get(METADATA_KEY, ""))
        latitude, longitude, height = (float(found[key]) for key in ("latitude", "longitude", "height"))
        return Datum(latitude, longitude, height, found["utc_start"])
    except (ValueError, TypeError, KeyError, ConfigError):
        return None


def coordinates_text(latitude: float, longitude: float) -> str:
    """Coordinates as people read them, to 0.1 m: 63.450000° N, 10.360000° E."""
    north, east = "N" if latitude >= 0 else "S", "E" if longitude >= 0 else "W"
    return f"{abs(latitude):.6f}° {north}, {abs(longitude):.6f}° {east}"
