"""Qualisys: a rigid body in a motion-capture lab, as QTM streams it."""

import math
from typing import TYPE_CHECKING

from rovtwin.links.endpoint import Clock, Endpoint, ServeContext, Where
from rovtwin.links.url import Url

if TYPE_CHECKING:
    from rovtwin.links.qualisys.server import QtmServer
    from rovtwin.links.qualisys.source import QtmSource


def _source(url: Url, clock: Clock) -> "QtmSource":
    import numpy as np

    from rovtwin.core.arrays.rotations import turn_about_z
    from rovtwin.links.qualisys.poses import HALF_TURN, Lab
    from rovtwin.links.qualisys.source import PORT, QtmSource

    where, _, body = url.rest.partition("/")
    host, port = Url(url.text, url.scheme, where).host_port(PORT)
    degrees, origin = _lab(url)
    turn = turn_about_z(math.radians(degrees))
    lab = Lab(R_nq=(turn @ np.array(HALF_TURN)).tolist(), origin=origin)
    return QtmSource(host, body or None, port, clock, lab)


def _lab(url: Url) -> tuple[float, tuple[float, ...]]:
    """Heading of the lab's x axis [degrees], and its origin in n [m]."""
    (degrees,) = url.options.get("heading", (0.0,))
    return degrees, url.options.get("origin", (0.0, 0.0, 0.0))


def _note(url: Url) -> str:
    degrees, (north, east, down) = _lab(url)
    return (
        f"the lab's origin at north {north:g} m, east {east:g} m, down {down:g} m, its x axis towards {degrees:g} deg, "
        "its z up"
    )


def _server(context: ServeContext, where: Where) -> "QtmServer":
    from rovtwin.links.qualisys.server import QtmServer

    return QtmServer(rate=context.rate, **where.options())


QTM = Endpoint(
    scheme="qtm",
    address="qtm://HOST/BODY",
    about="a rigid body in a Qualisys motion-capture lab",
    sensors=("position",),
    gives_position=True,
    options={"heading": "DEG", "origin": "NORTH,EAST,DOWN"},
    requires=("qtm_rt", "qualisys"),
    source=_source,
    at_origin=lambda url: ("position",),
    server=_server,
    note=_note,
    reached=lambda server: f"qtm://{server.host}:{server.port}/{server.body}",
)
