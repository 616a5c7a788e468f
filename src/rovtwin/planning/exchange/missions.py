"""Missions from and into files of other programs: which format a text is, and what it cannot hold."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rovtwin.core.datum import FARTHEST, Datum
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import parse
from rovtwin.core.user_files.jsontext import parse_json
from rovtwin.planning.exchange import geojson, gpx, kml, qgc
from rovtwin.planning.exchange.route import LatLon, Route, RoutePoint
from rovtwin.planning.exchange.xmltext import local, parse_xml
from rovtwin.scenario.schema import MissionSection, Scenario
from rovtwin.scenario.schema.datum import require_near
from rovtwin.survey.area import require_on_earth

MOST = 10_000_000  # characters of a file of another program
NO_DATUM = (
    "where the plan lies on the map is not known: set the origin of its metres, such as "
    "--set 'datum={latitude: 63.44, longitude: 10.42}', or in the scenario's file"
)


@dataclass(frozen=True)
class Format:
    """Files of a kind.

    Attributes:
        name: For people.
        ending: Of files.
        write: The text of a route.
        holds: What of a way-point it holds beside its place, keys of `LEFT_OUT`.
    """

    name: str
    ending: str
    write: Callable[[Route], str]
    holds: frozenset[str]


LEFT_OUT = {
    "speed": "speeds",
    "acceptance": "acceptance radii",
    "hold_time": "hold times",
    "heading_deg": "headings to keep",
    "altitude": "heights over the floor",
}
FORMATS = {
    "gpx": Format("GPX", ".gpx", gpx.write, frozenset()),
    "kml": Format("KML", ".kml", kml.write, frozenset()),
    "geojson": Format("GeoJSON", ".geojson", geojson.write, frozenset(LEFT_OUT)),
    "plan": Format("QGroundControl", ".plan", qgc.write, frozenset(LEFT_OUT) - {"altitude"}),
}


def read_route(text: str, where: str) -> Route | None:
    """The route that a text of another program is, whatever its file is called; None where it may be YAML.

    Args:
        text: Of the file.
        where: The file's name, for messages.

    Raises:
        ConfigError: It is none, or has none of the routes that could be meant.
    """
    if len(text) > MOST:
        raise ConfigError(f"{where}: found {len(text) / 1e6:.0f} MB, expected at most {MOST / 1e6:g} MB")
    if text.startswith("PK"):
        raise ConfigError(f"{where}: is a packed file; unpack it: a KMZ holds a doc.kml")
    begin = text.lstrip("\ufeff \t\r\n")
    if begin.startswith("<"):
        route = _of_xml(text.lstrip("\ufeff \t\r\n"), where)
    elif begin.startswith("{") and (data := _of_json(begin, where)) is not None:
        route = data
    else:
        return None
    if not route.points:
        raise ConfigError(f"{where}: has no way-points, expected at least one")
    return route


def _of_xml(text: str, where: str) -> Route:
    root = parse_xml(text, where)
    readers = {"gpx": gpx.read, "kml": kml.read}
    if local(root) not in readers:
        raise ConfigError(f"{where}: found <{local(root)[:40]}>, expected a GPX or a KML file")
    return readers[local(root)](root, where)


def _of_json(text: str, where: str) -> Route | None:
    """None where a mapping is no JSON, or of neither format: it may be YAML."""
    try:
        data: Any = parse_json(text, where)
    except ConfigError:
        if '"' not in text.partition(":")[0]:  # keys of JSON have them
            return None
        raise
    if data.get("fileType") == "Plan":
        return qgc.read(data, where)
    if data.get("type") in geojson.KINDS:
        require_on_earth(data, where)
        return geojson.read(data, where)
    return None


def mission_data(route: Route, datum: Datum | None, where: str, depth: float | None = None) -> dict[str, Any]:
    """A mission as its file has it.

    Args:
        route: On the map.
        datum: Origin of its positions in metres; None leaves them on the map.
        where: The file's name, for messages.
        depth: Of way-points whose depth the file does not give [m].

    Raises:
        ConfigError: It lies far from the datum, or depths are missing.
    """
    if depth is None and depthless(route):
        raise ConfigError(f"{where}: gives no depth of {depthless(route)} of {len(route.points)} way-points")
    points = []
    for i, point in enumerate(route.points, 1):
        on_map = [point.latitude, point.longitude, depth if point.depth is None else point.depth]
        if datum is not None:
            try:
                require_near(datum, on_map, f"{where}: way-point {i}")
            except ValueError as error:
                raise ConfigError(str(error)) from None
            place = {"position": [round(float(v), 3) for v in datum.position(*on_map)]}
        else:
            place = {"geodetic": [round(v, 9) for v in on_map[:2]] + [round(on_map[2], 3)]}
        values = {key: getattr(point, key) for key in LEFT_OUT}
        points.append(place | {key: value for key, value in values.items() if value is not None})
    data = {"name": route.name or "mission", "waypoints": points}
    parse(MissionSection, data, where)
    return data


def depthless(route: Route) -> int:
    """How many way-points have no depth."""
    return sum(point.depth is None for point in route.points)


def route_of(mission: MissionSection, datum: Datum | None, scenario: Scenario | None = None) -> Route:
    """A mission on the map, with the fence of its scenario.

    Args:
        mission: Its way-points.
        datum: Origin of positions in metres; None where nobody has given it.
        scenario: That it is flown in, if that is known.

    What a way-point does not say, as its speed, is the vehicle's own, and left out.

    Raises:
        ConfigError: Without a datum it has positions in metres.
    """
    points = []
    for waypoint in mission.waypoints:
        if waypoint.geodetic is not None:
            latitude, longitude, depth = waypoint.geodetic
        elif datum is None:
            raise ConfigError(NO_DATUM)
        else:
            (latitude, longitude), depth = _on_map(datum, waypoint.placed(datum)), waypoint.depth
        values = {key: getattr(waypoint, key) if key in waypoint.model_fields_set else None for key in LEFT_OUT}
        points.append(RoutePoint(latitude, longitude, depth, **values | {"hold_time": waypoint.hold_time or None}))
    fence = None if scenario is None or datum is None else scenario.autopilot.supervisor.geofence
    corners = [_on_map(datum, [*corner, 0.0]) for corner in (fence and fence.polygon) or [] if datum is not None]
    circle = None
    if fence is not None and fence.limit is not None and datum is not None and scenario is not None:
        circle = (_on_map(datum, [*scenario.start.position[:2], 0.0]), fence.limit)
    return Route(mission.name, points, corners, circle)


def left_out(route: Route, kind: str) -> list[str]:
    """What a format does not hold of a route, a sentence each."""
    holds = FORMATS[kind].holds
    lost = [words for key, words in LEFT_OUT.items() if key not in holds and any(getattr(p, key) for p in route.points)]
    notes = [f"{FORMATS[kind].name} does not hold {_listed(lost)}: left out"] if lost else []
    if kind != "plan" and (route.fence or route.circle):
        notes.append(f"{FORMATS[kind].name} does not hold the fence: left out")
    return notes


def fence_in_words(route: Route, datum: Datum | None) -> list[str]:
    """How to set the fence that a plan brings along: it is a scenario's, not a mission's."""
    if not route.fence:
        return []
    if datum is None:
        return ["its fence is left out: a mission has none, a scenario has"]
    corners = [datum.position(*corner, 0.0)[:2] for corner in route.fence]
    if np.abs(corners).max() > FARTHEST:
        return [f"its fence is left out: it reaches more than {FARTHEST / 1000:.0f} km from the datum"]
    polygon = ", ".join(f"[{north:.2f}, {east:.2f}]" for north, east in corners)
    return [f"its fence is no part of a mission; to have it: --set autopilot.supervisor.geofence.polygon='[{polygon}]'"]


def _on_map(datum: Datum, position: list[float]) -> LatLon:
    latitude, longitude, _ = datum.geodetic(position)
    return float(latitude), float(longitude)


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
