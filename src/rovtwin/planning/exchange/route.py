"""What all formats of other programs are read into, and written from: places on the map in the order of the dive."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from rovtwin.core.datum import check_coordinates
from rovtwin.core.errors import ConfigError

LatLon = tuple[float, float]  # [deg]


@dataclass(frozen=True)
class RoutePoint:
    """A way-point on the map; None where the file does not give it.

    Attributes:
        latitude: WGS-84, north positive [deg].
        longitude: WGS-84, east positive [deg].
        depth: Below the water [m].
        speed: On the leg to it [m/s].
        acceptance: Radius [m].
        hold_time: Time to stay [s].
        heading_deg: Heading to keep [deg].
        altitude: Height over the floor to keep [m].
    """

    latitude: float
    longitude: float
    depth: float | None = None
    speed: float | None = None
    acceptance: float | None = None
    hold_time: float | None = None
    heading_deg: float | None = None
    altitude: float | None = None


@dataclass(frozen=True)
class Route:
    """Way-points of a mission on the map.

    Attributes:
        name: Of the mission; "" where the file gives none.
        points: In the order of the dive.
        fence: Corners of a polygon in which the vehicle has to stay; empty where there is none.
        circle: Middle and radius [m] of a circle in which it has to stay, to be written; None where there is none.
        notes: What of the file is no part of the route, a sentence each.
    """

    name: str
    points: Sequence[RoutePoint]
    fence: Sequence[LatLon] = ()
    circle: tuple[LatLon, float] | None = None
    notes: list[str] = field(default_factory=list)


def place(latitude: float, longitude: float, where: str) -> LatLon:
    """Coordinates that a file gives, checked.

    Raises:
        ConfigError: There is no such place; `where` says which one it is.
    """
    try:
        check_coordinates(latitude, longitude)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None
    return latitude, longitude


def depth_of(height: float, where: str) -> float:
    """Depth of a height over the water [m].

    Raises:
        ConfigError: It lies above the water, or is no finite number.
    """
    if not math.isfinite(height) or height > 0.0:
        raise ConfigError(
            f"{where}: found a height of {height:g} m, expected at most 0: a place under water has a negative height"
        )
    return -height + 0.0
