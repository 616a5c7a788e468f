"""Messages of the Underwater GPS G2, JSON over HTTP, as Water Linked's description of its API has them.

Pure functions: bytes in, dataclass out, and no exception but LinkError.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rovtwin.core.arrays.rotations import heading_rotation
from rovtwin.core.errors import LinkError
from rovtwin.links.waterlinked.fields import flag, number, numbers, read_object

BASE = "/api/v1"
FILTERED, RAW = f"{BASE}/position/acoustic/filtered", f"{BASE}/position/acoustic/raw"
GLOBAL, MASTER = f"{BASE}/position/global", f"{BASE}/position/master"
DEPTH, ORIENTATION = f"{BASE}/external/depth", f"{BASE}/external/orientation"
EXTERNAL_MASTER, IMU = f"{BASE}/external/master", f"{BASE}/external/imu"
ABOUT, STATUS, CONFIG, ANTENNA = (
    f"{BASE}/about",
    f"{BASE}/about/status",
    f"{BASE}/config/generic",
    f"{BASE}/config/antenna",
)
CALIBRATE, WARNINGS = f"{BASE}/imu/calibrate", f"{BASE}/warnings"
NO_DATA = -1.0  # what stands for "not known" in places on the map
FARTHEST = 10_000.0  # a place beyond it is nonsense [m]; the kit's own range is 100 to 300 m

# What a client may put, by path: fields with the least and the largest value, and which of them must be there.
PUTS: dict[str, tuple[dict[str, tuple[float, float]], tuple[str, ...]]] = {
    DEPTH: ({"depth": (-10.0, FARTHEST), "temp": (-10.0, 60.0)}, ("depth",)),
    ORIENTATION: ({"orientation": (-1.0, 360.0)}, ("orientation",)),
    EXTERNAL_MASTER: (
        {
            "lat": (-90.0, 90.0),
            "lon": (-180.0, 180.0),
            "orientation": (NO_DATA, 360.0),
            "cog": (NO_DATA, 360.0),
            "sog": (NO_DATA, 1000.0),
            "hdop": (NO_DATA, 1000.0),
            "numsats": (NO_DATA, 100.0),
            "fix_quality": (0.0, 100.0),
        },
        ("lat", "lon", "orientation"),
    ),
    IMU: (
        {"roll": (-180.0, 180.0), "pitch": (-90.0, 90.0), "yaw": (-180.0, 180.0)}
        | dict.fromkeys("xyz", (-200.0, 200.0)),
        ("roll", "pitch", "yaw", "x", "y", "z"),
    ),
}


@dataclass(frozen=True)
class AcousticPosition:
    """Where the locator is: x forward and y right of the topside unit, z depth [m].

    Attributes:
        std: Its accuracy [m].
        position_valid: Whether it is one at all.
        receiver_distance: From each receiver to the locator [m].
        receiver_rssi, receiver_nsd: Signal strength and noise density of each [dB].
        receiver_valid: 1 for each receiver that hears the locator, else 0.
    """

    x: float
    y: float
    z: float
    std: float
    position_valid: bool
    receiver_distance: tuple[float, ...] = ()
    receiver_rssi: tuple[float, ...] = ()
    receiver_nsd: tuple[float, ...] = ()
    receiver_valid: tuple[float, ...] = ()


@dataclass(frozen=True)
class MapPosition:
    """A place on the map: degrees of latitude, longitude, orientation and course, speed in km/h; -1 where not known."""

    lat: float
    lon: float
    orientation: float = NO_DATA
    cog: float = NO_DATA
    sog: float = NO_DATA
    hdop: float = NO_DATA
    numsats: float = NO_DATA
    fix_quality: float = 0.0


def parse_acoustic(body: bytes) -> AcousticPosition:
    """The body of /position/acoustic/filtered or /raw.

    Raises:
        LinkError: It is not what such a kit sends.
    """
    found = read_object(body)
    distance, rssi, nsd = (
        numbers(found, f"receiver_{key}") if f"receiver_{key}" in found else () for key in ("distance", "rssi", "nsd")
    )
    x, y, z, std = (number(found, key) for key in ("x", "y", "z", "std"))
    received = _flags(found.get("receiver_valid", []))
    return AcousticPosition(x, y, z, std, flag(found, "position_valid"), distance, rssi, nsd, received)


def _flags(found: Any) -> tuple[float, ...]:
    """Described as numbers; firmware also sends true and false."""
    if isinstance(found, list):
        found = [float(item) if isinstance(item, bool) else item for item in found]
    return numbers({"receiver_valid": found}, "receiver_valid")


def parse_map(body: bytes) -> MapPosition:
    """The body of /position/global or /position/master.

    Raises:
        LinkError: It is not what such a kit sends, or no place on Earth.
    """
    found = read_object(body)
    values = {key: number(found, key, NO_DATA) for key in ("orientation", "cog", "sog", "hdop", "numsats")}
    place = MapPosition(
        number(found, "lat"), number(found, "lon"), fix_quality=number(found, "fix_quality", 0.0), **values
    )
    if abs(place.lat) > 90.0 or abs(place.lon) > 180.0:
        raise LinkError(f"lat {place.lat:g}, lon {place.lon:g}: expected a place on Earth")
    return place


def parse_put(path: str, body: bytes) -> dict[str, float]:
    """What a client tells the kit.

    Raises:
        LinkError: A field is missing, no number, or beyond what makes sense.
    """
    limits, needed = PUTS[path]
    found = read_object(body)
    values = {}
    for key, (least, most) in limits.items():
        if key in found or key in needed:
            values[key] = number(found, key)
            if not least <= values[key] <= most:
                raise LinkError(f"{key}: found {values[key]:g}, expected {least:g} to {most:g}")
    return values


def body_of(message: AcousticPosition | MapPosition) -> dict[str, Any]:
    """As the kit sends it: what it counts is whole, as clients print it."""
    counted = ("numsats", "fix_quality") if isinstance(message, MapPosition) else ()
    return asdict(message) | {key: int(getattr(message, key)) for key in counted}


def to_topside(offset: tuple[float, float], heading: float) -> tuple[float, float]:
    """x (forward) and y (right) of the topside unit [m] of a place north and east of it [m]; heading [rad]."""
    forward, right = (np.array(offset) @ heading_rotation(heading)).tolist()
    return forward, right


def from_topside(place: tuple[float, float], heading: float) -> tuple[float, float]:
    """North and east of the topside unit [m] of x (forward) and y (right) [m]; heading [rad]."""
    return to_topside(place, -heading)
