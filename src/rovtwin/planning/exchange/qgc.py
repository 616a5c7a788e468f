"""Plans of QGroundControl: way-points as items of a MAVLink mission, relative to home, and a fence.

An item's height is taken as that over the water: home lies at the surface, as ArduSub has it. A heading of 0 stands in
most plans where nobody gave one, and counts as none; north is written as 360.

Reference: QGroundControl Developer Guide, Plan file format, version 1; MAVLink common.xml, MAV_CMD.
"""

import json
from collections import Counter
from collections.abc import Iterator
from typing import Any

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.quantity import is_finite
from rovtwin.core.user_files.yamlfile import kind_in_words
from rovtwin.planning.exchange.route import LatLon, Route, RoutePoint, depth_of, place

WAYPOINT, LOITER_TIME, SPLINE, CHANGE_SPEED = 16, 19, 82, 178  # MAV_CMD
RELATIVE, NO_FRAME = 3, 2  # MAV_FRAME: heights over home; no place
OVER_WATER = (0, 3, 5, 6)  # MAV_FRAME in which heights count from the sea or from home
ARDUPILOT, SUBMARINE = 3, 12  # MAV_AUTOPILOT, MAV_TYPE
DEEPEST = 4  # items within items: a survey holds simple ones


def read(data: dict[str, Any], where: str) -> Route:
    """The way-points of a plan, of its surveys too, and a polygon of its fence in which to stay.

    Raises:
        ConfigError: It is not as QGroundControl writes it, or has places that no vehicle under water goes to.
    """
    mission = data.get("mission")
    if not isinstance(mission, dict) or not isinstance(mission.get("items"), list):
        raise ConfigError(f"{where}: mission.items: found none, expected those of a plan of QGroundControl")
    points, passed = _points(mission["items"], f"{where}: mission.items")
    notes = [f"MAVLink command {command} is left out ({count} of them)" for command, count in sorted(passed.items())]
    fence, more = _fence(data.get("geoFence"), f"{where}: geoFence")
    return Route("", points, fence, notes=notes + more)


def write(route: Route) -> str:
    """A plan of version 1 for ArduSub, with its fence."""
    items: list[dict[str, Any]] = []
    speed = None
    for point in route.points:
        if point.speed is not None and point.speed != speed:
            speed = point.speed
            items.append(_item(CHANGE_SPEED, NO_FRAME, [1, speed, -1, 0, 0, 0, 0]))
        height = -(point.depth or 0.0) + 0.0
        at = [round(point.latitude, 9), round(point.longitude, 9), height]
        heading = 360.0 if point.heading_deg == 0.0 else point.heading_deg
        params = [point.hold_time or 0, point.acceptance or 0, 0, heading, *at]
        shown = {"AMSLAltAboveTerrain": None, "Altitude": height, "AltitudeMode": 1}
        items.append(shown | _item(WAYPOINT, RELATIVE, params))
    for number, item in enumerate(items, 1):
        item["doJumpId"] = number
    first = route.points[0]
    cruise = first.speed or 0.5
    mission = {
        "version": 2, "firmwareType": ARDUPILOT, "vehicleType": SUBMARINE, "cruiseSpeed": cruise, "hoverSpeed": cruise,
        "globalPlanAltitudeMode": 1, "plannedHomePosition": [round(first.latitude, 9), round(first.longitude, 9), 0],
        "items": items,
    }  # fmt: skip
    plan = {"fileType": "Plan", "version": 1, "groundStation": "rovtwin", "mission": mission}
    return json.dumps(plan | {"geoFence": _written_fence(route), "rallyPoints": {"points": [], "version": 2}}, indent=1)


def _item(command: int, frame: int, params: list[Any]) -> dict[str, Any]:
    return {"type": "SimpleItem", "autoContinue": True, "command": command, "frame": frame, "params": params}


def _written_fence(route: Route) -> dict[str, Any]:
    polygon = {"inclusion": True, "polygon": [[round(v, 9) for v in corner] for corner in route.fence], "version": 1}
    circles = []
    if route.circle is not None:
        middle, radius = route.circle
        about = {"center": [round(v, 9) for v in middle], "radius": radius}
        circles = [{"circle": about, "inclusion": True, "version": 1}]
    return {"circles": circles, "polygons": [polygon] if route.fence else [], "version": 2}


def _points(items: list[Any], where: str) -> tuple[list[RoutePoint], Counter[int]]:
    """Way-points, and how often each command is there that is none."""
    points: list[RoutePoint] = []
    passed: Counter[int] = Counter()
    speed: float | None = None
    for at, item in _simple(items, where):
        command, frame, params, coordinate = _parts(item, at)
        if command == CHANGE_SPEED:
            asked = params[1] if len(params) > 1 else None
            speed = float(asked) if is_finite(asked) and asked > 0 else speed
        elif command in (WAYPOINT, LOITER_TIME, SPLINE):
            points.append(_point(command, frame, params, coordinate, speed, at))
        else:
            passed[command] += 1
    return points, passed


def _simple(items: list[Any], where: str, level: int = 0) -> Iterator[tuple[str, dict[str, Any]]]:
    """Simple items, those of surveys in place of the survey."""
    for i, item in enumerate(items):
        at = f"{where}[{i}]"
        if not isinstance(item, dict) or level > DEEPEST:
            raise ConfigError(f"{at}: found {kind_in_words(item)}, expected an item of a mission")
        if item.get("type") != "ComplexItem":
            yield at, item
            continue
        inner = item.get("TransectStyleComplexItem")
        inside = inner.get("Items") if isinstance(inner, dict) else None
        if not isinstance(inside, list):
            kind = str(item.get("complexItemType"))[:40]
            raise ConfigError(f"{at}: found a {kind} without its items, expected way-points, or a survey or corridor")
        yield from _simple(inside, f"{at}.Items", level + 1)


def _parts(item: dict[str, Any], where: str) -> tuple[int, int, list[Any], list[Any]]:
    """Command, frame, parameters and place of an item, of which older files have `coordinate`."""
    command, frame, params = item.get("command"), item.get("frame"), item.get("params")
    is_flag = isinstance(command, bool) or isinstance(frame, bool)
    if is_flag or not isinstance(command, int) or not isinstance(frame, int) or not isinstance(params, list):
        raise ConfigError(f"{where}: expected command and frame as whole numbers, and a list of params")
    coordinate = item.get("coordinate", params[4:7])
    return command, frame, params, coordinate if isinstance(coordinate, list) else []


def _point(command: int, frame: int, params: list[Any], at: list[Any], speed: float | None, where: str) -> RoutePoint:
    if frame not in OVER_WATER:
        raise ConfigError(
            f"{where}.frame: found {frame}, expected heights over home or the sea ({', '.join(map(str, OVER_WATER))}); "
            "heights over terrain are way-points' altitude here, which needs a depth beside: set it in the plan"
        )
    if len(at) != 3 or not all(is_finite(value) for value in at):
        raise ConfigError(f"{where}: found {kind_in_words(at)} as place, expected latitude, longitude and height")
    hold, acceptance, _, heading = ([*params[:4], None, None, None, None])[:4]
    return RoutePoint(
        *place(at[0], at[1], where),
        depth_of(at[2], where),
        speed=speed,
        acceptance=float(acceptance) if command == WAYPOINT and is_finite(acceptance) and acceptance > 0 else None,
        hold_time=float(hold) if is_finite(hold) and hold > 0 else None,
        heading_deg=float(heading) if command == WAYPOINT and is_finite(heading) and heading != 0 else None,
    )


def _fence(data: Any, where: str) -> tuple[list[LatLon], list[str]]:
    """The first polygon in which to stay, and what else there is."""
    if not isinstance(data, dict):
        return [], []
    polygons, circles = (_listed(data.get(key), f"{where}.{key}") for key in ("polygons", "circles"))
    inside = [one for one in polygons if one.get("inclusion", True)]
    corners = _corners(inside[0].get("polygon"), f"{where}.polygons") if inside else []
    more = len(polygons) - bool(inside) + len(circles)
    return corners, [f"{more} more area(s) of its fence left out: a fence is one polygon"] if more else []


def _listed(value: Any, where: str) -> list[dict[str, Any]]:
    if value is None:
        return []
    if not isinstance(value, list) or not all(isinstance(one, dict) for one in value):
        raise ConfigError(f"{where}: found {kind_in_words(value)}, expected a list of areas")
    return value


def _corners(value: Any, where: str) -> list[LatLon]:
    corners = value if isinstance(value, list) else []
    pairs = [one for one in corners if isinstance(one, list) and len(one) == 2 and all(is_finite(v) for v in one)]
    if len(pairs) < 3 or len(pairs) < len(corners):
        raise ConfigError(f"{where}: found {kind_in_words(value)}, expected at least 3 corners [latitude, longitude]")
    return [place(float(north), float(east), where) for north, east in pairs]
