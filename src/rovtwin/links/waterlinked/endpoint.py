"""Water Linked: the DVL A50 and A125, and the Underwater GPS."""

import math
from typing import TYPE_CHECKING

from rovtwin.core.errors import ConfigError
from rovtwin.links.endpoint import Clock, Endpoint, ServeContext, Where
from rovtwin.links.url import Url

if TYPE_CHECKING:
    from rovtwin.links.waterlinked.dvl_server import DvlServer
    from rovtwin.links.waterlinked.dvl_source import DvlSource
    from rovtwin.links.waterlinked.ugps_server import UgpsServer
    from rovtwin.links.waterlinked.ugps_source import UgpsSource

OFTEN = 10.0  # the topside unit is asked so often, by its own time [Hz]
MOST = 100.0  # but no oftener than this by ours [Hz]


def _dvl_source(url: Url, clock: Clock) -> "DvlSource":
    from rovtwin.links.waterlinked.dvl_source import PORT, DvlSource

    rotation = math.radians(_rotation(url))
    return DvlSource(*url.host_port(PORT), clock, rotation=rotation, altimeter=True)


def _rotation(url: Url) -> float:
    (degrees,) = url.options.get("rotation", (0.0,))
    return degrees


def _dvl_server(context: ServeContext, where: Where) -> "DvlServer":
    from rovtwin.links.waterlinked.dvl_server import WEB_PORT, DvlServer

    return DvlServer(floor=context.floor, web_port=WEB_PORT, **where.options())


DVL = Endpoint(
    scheme="dvl",
    address="dvl://HOST",
    about="a Water Linked DVL A50 or A125",
    sensors=("dvl", "altimeter"),
    options={"rotation": "DEG"},
    source=_dvl_source,
    server=_dvl_server,
    note=lambda url: f"its forward axis turned {_rotation(url):g} deg clockwise from the vehicle's",
    reached=lambda server: f"dvl://{server.host}:{server.port}",
)


def _ugps_source(url: Url, clock: Clock) -> "UgpsSource":
    from rovtwin.links.waterlinked.ugps_source import PORT, UgpsSource

    north, east, degrees = _topside(url)
    topside = (north, east, math.radians(degrees))
    rate = min(MOST, OFTEN * clock.speed)
    return UgpsSource(*url.host_port(PORT), clock, topside=topside, rate=rate, raw=_raw(url))


def _topside(url: Url) -> tuple[float, ...]:
    return url.options.get("topside", (0.0, 0.0, 0.0))


def _raw(url: Url) -> bool:
    """Positions before the kit's own filter, unless asked otherwise: the autopilot filters itself."""
    if {"raw", "filtered"} <= url.options.keys():
        raise ConfigError(f"--sensor {url.text}: found the options 'raw' and 'filtered', expected one of them")
    return "filtered" not in url.options


def _ugps_note(url: Url) -> str:
    north, east, degrees = _topside(url)
    kind = "raw" if _raw(url) else "filtered"
    return f"topside at north {north:g} m, east {east:g} m, its mark towards {degrees:g} deg; {kind} positions"


def _ugps_server(context: ServeContext, where: Where) -> "UgpsServer":
    from rovtwin.links.waterlinked.ugps_server import UgpsServer

    return UgpsServer(datum=context.datum, **where.options())


UGPS = Endpoint(
    scheme="ugps",
    address="ugps://HOST",
    about="a Water Linked Underwater GPS",
    sensors=("position",),
    gives_position=True,
    options={"topside": "NORTH,EAST,HEADING_DEG", "raw": "", "filtered": ""},
    source=_ugps_source,
    server=_ugps_server,
    note=_ugps_note,
    reached=lambda server: f"ugps://{server.host}:{server.port}",
)
