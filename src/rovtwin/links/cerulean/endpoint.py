"""Cerulean Sonar: the DVL-75 and the Tracker 650."""

from typing import TYPE_CHECKING

from rovtwin.links.endpoint import Clock, Endpoint
from rovtwin.links.url import Url

if TYPE_CHECKING:
    from rovtwin.links.cerulean.source import CeruleanSource


def _source(url: Url, clock: Clock) -> "CeruleanSource":
    from rovtwin.links.cerulean.source import PORT, CeruleanSource

    return CeruleanSource(*url.host_port(PORT), clock, flu="flu" in url.options)


def _note(url: Url) -> str:
    axes = "forward, port, up" if "flu" in url.options else "forward, starboard, down"
    return f"listens there for what the DVL sends; its axes taken as {axes}"


CERULEAN = Endpoint(
    scheme="cerulean",
    address="cerulean://OUR_ADDRESS",
    about="a Cerulean DVL-75 or Tracker 650",
    sensors=("dvl", "altimeter"),
    options={"flu": ""},
    source=_source,
    note=_note,
)
