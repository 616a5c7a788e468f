"""Routes in GPX, as chart plotters exchange them; an elevation is that over the water.

One above the water is that of a boat's antenna, or of the land: it gives no depth.

Reference: Foster (2004), GPX 1.1 schema, http://www.topografix.com/GPX/1/1. Files of GPX 1.0 are read as well.
"""

from xml.etree.ElementTree import Element, SubElement

from rovtwin.core.errors import ConfigError
from rovtwin.core.log.maps import height_text, xml_text
from rovtwin.planning.exchange.route import Route, RoutePoint, depth_of, place
from rovtwin.planning.exchange.xmltext import children, every, number_of, text_of

_POINTS = {"rte": "rtept", "trk": "trkpt"}


def read(root: Element, where: str) -> Route:
    """The one route of a document; else its way-points, if there is nothing else; else its one track.

    Raises:
        ConfigError: It has no route, or several things that could be meant.
    """
    routes, tracks, marks = children(root, "rte"), children(root, "trk"), children(root, "wpt")
    notes = []
    if routes:
        lines, beside = routes, {"track": tracks, "mark": marks}
        notes += [f"{_counted(len(one), what)} beside the route left out" for what, one in beside.items() if one]
    elif not tracks and not marks:
        raise ConfigError(f"{where}: has no route (rte), no way-points (wpt) and no track (trk); expected one of them")
    elif tracks and marks:
        raise ConfigError(
            f"{where}: found {_counted(len(marks), 'way-point')} and {_counted(len(tracks), 'track')}, expected a "
            "route (rte), or one of these alone: delete the others"
        )
    else:
        lines = tracks
    if len(lines) > 1:
        names = ", ".join(text_of(line, "name") or "without a name" for line in lines[:5])
        raise ConfigError(f"{where}: found {len(lines)} routes or tracks ({names}), expected one: delete the others")
    if not lines:
        return Route(text_of(root, "name"), [_point(mark, f"{where}: wpt {i}") for i, mark in enumerate(marks, 1)])
    kind = "rte" if routes else "trk"
    points = [_point(p, f"{where}: {_POINTS[kind]} {i}") for i, p in enumerate(every(lines[0], _POINTS[kind]), 1)]
    return Route(text_of(lines[0], "name"), points, notes=notes)


def write(route: Route) -> str:
    """GPX 1.1 with one route."""
    root = Element("gpx", {"xmlns": "http://www.topografix.com/GPX/1/1", "version": "1.1", "creator": "rovtwin"})
    line = SubElement(root, "rte")
    SubElement(line, "name").text = route.name
    for i, point in enumerate(route.points, 1):
        at = {"lat": f"{point.latitude:.9f}", "lon": f"{point.longitude:.9f}"}
        element = SubElement(line, "rtept", at)
        SubElement(element, "ele").text = height_text(point.depth or 0.0)
        SubElement(element, "name").text = str(i)
    return xml_text(root)


def _point(element: Element, where: str) -> RoutePoint:
    latitude, longitude = (number_of(element.get(key, ""), f"{where}.{key}") for key in ("lat", "lon"))
    elevation = text_of(element, "ele")
    height = number_of(elevation, f"{where}.ele") if elevation else 1.0
    return RoutePoint(*place(latitude, longitude, where), None if height > 0.0 else depth_of(height, f"{where}.ele"))


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
