"""Routes in KML, as Google Earth and others draw them: a path, or places in order; altitudes are over the water.

Reference: Open Geospatial Consortium (2008), KML 2.2, OGC 07-147r2.
"""

from xml.etree.ElementTree import Element, SubElement

from rovtwin.core.errors import ConfigError
from rovtwin.core.log.maps import height_text, xml_text
from rovtwin.planning.exchange.route import Route, RoutePoint, depth_of, place
from rovtwin.planning.exchange.xmltext import every, number_of, text_of

_ABOVE_WATER = ("absolute",)  # altitudeMode in which altitudes count; else the line lies on the ground or the water


def read(root: Element, where: str) -> Route:
    """The one path of a document, or its places where it has no path.

    Raises:
        ConfigError: It has neither, or several things that could be meant.
    """
    lines = list(every(root, "LineString"))
    marks = [mark for mark in every(root, "Placemark") if any(True for _ in every(mark, "Point"))]
    if len(lines) + bool(marks) != 1:
        counts = f"{len(lines)} path(s) and {len(marks)} place(s)"
        areas = sum(1 for _ in every(root, "Polygon"))
        hint = ". A polygon is an area: rovtwin plan-survey lays lines over it" if areas else ""
        raise ConfigError(f"{where}: found {counts}, expected one path, or places alone{hint}")
    names = {id(line): text_of(mark, "name") for mark in every(root, "Placemark") for line in every(mark, "LineString")}
    if lines:
        return Route(names.get(id(lines[0]), ""), _points(lines[0], f"{where}: LineString"))
    places = [point for mark in marks for point in every(mark, "Point")]
    points = [p for i, one in enumerate(places, 1) for p in _points(one, f"{where}: Point {i}")]
    document = next(every(root, "Document"), None)
    return Route("" if document is None else text_of(document, "name"), points)


def write(route: Route) -> str:
    """KML 2.2 with one path; of one way-point a place."""
    root = Element("kml", {"xmlns": "http://www.opengis.net/kml/2.2"})
    document = SubElement(root, "Document")
    SubElement(document, "name").text = route.name
    mark = SubElement(document, "Placemark")
    SubElement(mark, "name").text = route.name
    shape = SubElement(mark, "LineString" if len(route.points) > 1 else "Point")
    SubElement(shape, "altitudeMode").text = _ABOVE_WATER[0]
    places = [(f"{p.longitude:.9f}", f"{p.latitude:.9f}", height_text(p.depth or 0.0)) for p in route.points]
    SubElement(shape, "coordinates").text = " ".join(",".join(numbers) for numbers in places)
    return xml_text(root)


def _points(shape: Element, where: str) -> list[RoutePoint]:
    counts = text_of(shape, "altitudeMode") in _ABOVE_WATER
    tuples = text_of(shape, "coordinates").split()
    return [_point(text, counts, f"{where}, coordinates {i}") for i, text in enumerate(tuples, 1)]


def _point(text: str, has_depth: bool, where: str) -> RoutePoint:
    numbers = [number_of(part, where) for part in text.split(",")]
    if len(numbers) not in (2, 3):
        raise ConfigError(f"{where}: found {text[:60]!r}, expected longitude,latitude,altitude without blanks between")
    depth = depth_of(numbers[2], where) if has_depth and len(numbers) == 3 else None
    return RoutePoint(*place(numbers[1], numbers[0], where), depth)
