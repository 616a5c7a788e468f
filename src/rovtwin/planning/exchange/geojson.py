"""Routes in GeoJSON, as QGIS and others keep them: points with their properties, or one line.

A point written here has all that a way-point has, as properties. The standard counts heights over the ellipsoid, which
few programs do, and a depth does not need: it is a property, `depth_m`. Of a line, or a point without that property, a
third coordinate is taken as the height over the water.

Reference: Butler et al. (2016), The GeoJSON format, RFC 7946: positions are longitude, latitude.
"""

import json
from collections.abc import Iterator
from typing import Any

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.quantity import is_finite
from rovtwin.core.user_files.yamlfile import kind_in_words
from rovtwin.planning.exchange.route import Route, RoutePoint, depth_of, place

PROPERTIES = {
    "depth": "depth_m",
    "speed": "speed_m_s",
    "acceptance": "acceptance_m",
    "hold_time": "hold_s",
    "heading_deg": "heading_deg",
    "altitude": "altitude_m",
}
_PLAIN = {"MultiPoint": "Point", "MultiLineString": "LineString", "MultiPolygon": "Polygon"}
KINDS = ("FeatureCollection", "Feature", "GeometryCollection", "Point", "LineString", "Polygon", *_PLAIN)

Shape = tuple[str, str, Any, dict[str, Any]]  # its kind, where it stands, coordinates, properties


def read(data: dict[str, Any], where: str) -> Route:
    """The points of an object in their order, or the corners of its one line.

    Raises:
        ConfigError: It has neither, both, or several lines.
    """
    try:
        return _route(data)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None


def write(route: Route) -> str:
    """A feature for each way-point, a line of text each, so that versions can be compared."""
    features = ",\n".join(json.dumps(_feature(i, point)) for i, point in enumerate(route.points, 1))
    return f'{{"type": "FeatureCollection", "name": {json.dumps(route.name)}, "features": [\n{features}\n]}}\n'


def _feature(number: int, point: RoutePoint) -> dict[str, Any]:
    values = {title: getattr(point, key) for key, title in PROPERTIES.items()}
    properties = {"name": str(number)} | {title: value for title, value in values.items() if value is not None}
    coordinates = [round(point.longitude, 9), round(point.latitude, 9)]
    return {
        "type": "Feature",
        "geometry": {"type": "Point", "coordinates": coordinates},
        "properties": properties,
    }


def _route(data: dict[str, Any]) -> Route:
    shapes = list(_shapes(data, "", {}))
    points, lines, areas = ([s for s in shapes if s[0] == kind] for kind in ("Point", "LineString", "Polygon"))
    if len(lines) + bool(points) != 1:
        hint = ". A polygon is an area: rovtwin plan-survey --area lays lines over it" if areas else ""
        counts = f"{len(lines)} line(s) and {len(points)} point(s)"
        raise ConfigError(f"found {counts}, expected one line, or points alone{hint}")
    if points:
        places = [_point(coordinates, properties, at) for _, at, coordinates, properties in points]
    else:
        _, at, corners, _ = lines[0]
        places = [_point(corner, {}, f"{at}[{i}]") for i, corner in enumerate(_list(corners, at))]
    notes = [f"{len(areas)} polygon(s) beside the route left out"] if areas else []
    name = data.get("name")
    return Route(name if isinstance(name, str) else "", places, notes=notes)


def _shapes(data: Any, where: str, properties: dict[str, Any]) -> Iterator[Shape]:
    """Points, lines and polygons of an object, without parts."""
    dot = f"{where}." if where else ""
    kind = data.get("type") if isinstance(data, dict) else None
    match kind:
        case "FeatureCollection":
            for i, feature in enumerate(_list(data.get("features"), f"{dot}features")):
                yield from _shapes(feature, f"{dot}features[{i}]", {})
        case "Feature":
            given = data.get("properties")
            yield from _shapes(data.get("geometry"), f"{dot}geometry", given if isinstance(given, dict) else {})
        case "GeometryCollection":
            for i, geometry in enumerate(_list(data.get("geometries"), f"{dot}geometries")):
                yield from _shapes(geometry, f"{dot}geometries[{i}]", properties)
        case "MultiPoint" | "MultiLineString" | "MultiPolygon":
            for i, part in enumerate(_list(data.get("coordinates"), f"{dot}coordinates")):
                yield _PLAIN[kind], f"{dot}coordinates[{i}]", part, properties
        case "Point" | "LineString" | "Polygon":
            yield kind, f"{dot}coordinates", data.get("coordinates"), properties
        case _:
            raise ConfigError(f"{dot}type: found {kind_in_words(kind)}, expected one of {', '.join(KINDS)}")


def _point(coordinates: Any, properties: dict[str, Any], where: str) -> RoutePoint:
    numbers = coordinates if isinstance(coordinates, list) else []
    if len(numbers) not in (2, 3) or not all(is_finite(value) for value in numbers):
        raise ConfigError(f"{where}: found {kind_in_words(coordinates)}, expected [longitude, latitude] in degrees")
    longitude, latitude, *height = numbers
    values = {key: _property(properties, title, where) for key, title in PROPERTIES.items()}
    if values["depth"] is None and height:
        values["depth"] = depth_of(height[0], where)
    return RoutePoint(*place(latitude, longitude, where), **values)


def _property(properties: dict[str, Any], title: str, where: str) -> float | None:
    value = properties.get(title)
    if value is None:
        return None
    if not is_finite(value):
        raise ConfigError(f"{where}: properties.{title}: found {kind_in_words(value)}, expected a number")
    return float(value)


def _list(value: Any, where: str) -> list[Any]:
    if not isinstance(value, list) or not value:
        raise ConfigError(f"{where}: found {kind_in_words(value)}, expected a list that is not empty")
    return value
