"""The plan on the table: way-points that an operator adds, moves and takes back before they are submitted."""

import math
from typing import Any

from rovtwin.console.surveys import SurveyArea
from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import parse
from rovtwin.core.user_files.yamlfile import dump_yaml, parse_yaml
from rovtwin.scenario.schema import MissionSection, Waypoint

MOST = 512
PLACES = 3  # decimals of a place in metres
DEPTHS = 200  # of undo


class Draft:
    """A list of way-points with undo; every change is checked before it counts.

    Attributes:
        rows: Each with x, y, depth [m], speed [m/s], acceptance [m], hold_time [s], heading_deg, altitude (None where
            not given).
        area: That they survey; None where they survey none.
        own: Speed and acceptance that rows get which say none: the vehicle's.
    """

    def __init__(self, waypoints: list[Waypoint] | None = None, own: dict[str, float] | None = None):
        self.own = {"speed": 0.2, "acceptance": 0.2} if own is None else own
        self.rows: list[dict[str, Any]] = [row_of(waypoint) for waypoint in waypoints or []]
        self.area: SurveyArea | None = None
        self._past: list[tuple[list[dict[str, Any]], SurveyArea | None]] = []
        self._future: list[tuple[list[dict[str, Any]], SurveyArea | None]] = []

    @property
    def can_undo(self) -> bool:
        return bool(self._past)

    @property
    def can_redo(self) -> bool:
        return bool(self._future)

    def add(self, row: dict[str, Any]) -> None:
        """One more at the end; what it does not say is as in the one before."""
        self.insert(len(self.rows), row)

    def insert(self, i: int, row: dict[str, Any]) -> None:
        """One more before number i."""
        like = self.rows[min(i, len(self.rows)) - 1] if self.rows and i > 0 else {}
        kept = {key: like[key] for key in ("depth", "speed", "acceptance") if key in like}
        self._change([*self.rows[:i], kept | row, *self.rows[i:]])

    def edit(self, i: int, row: dict[str, Any]) -> None:
        """Other values for number i; what is not said stays."""
        self._require(i)
        self._change([*self.rows[:i], self.rows[i] | row, *self.rows[i + 1 :]])

    def delete(self, i: int) -> None:
        self._require(i)
        self._change([*self.rows[:i], *self.rows[i + 1 :]])

    def cancel_last(self) -> None:
        """Take the last one away."""
        self.delete(len(self.rows) - 1)

    def reorder(self, i: int, to: int) -> None:
        """Number i becomes number `to`."""
        self._require(i)
        self._require(to)
        rest = [*self.rows[:i], *self.rows[i + 1 :]]
        self._change([*rest[:to], self.rows[i], *rest[to:]])

    def clear(self) -> None:
        self.load([])

    def load(self, rows: list[dict[str, Any]], area: SurveyArea | None = None) -> None:
        """Other way-points altogether, which survey an area or none."""
        self._change(rows)
        self.area = area

    def undo(self) -> None:
        if self._past:
            self._future.append((self.rows, self.area))
            self.rows, self.area = self._past.pop()

    def redo(self) -> None:
        if self._future:
            self._past.append((self.rows, self.area))
            self.rows, self.area = self._future.pop()

    def as_yaml(self, name: str = "mission") -> str:
        """A mission file."""
        data = {"name": name, "waypoints": [waypoint_of(row) for row in self.rows]}
        return dump_yaml(data)

    def length(self) -> float:
        """From the first to the last [m]."""
        places = [(row["x"], row["y"], row["depth"]) for row in self.rows]
        return sum(math.dist(a, b) for a, b in zip(places, places[1:], strict=False))

    def seconds(self) -> float:
        """What the legs take at their speeds, and the holds [s]; turns, dives and corners come on top."""
        time = sum(row["hold_time"] for row in self.rows)
        for a, b in zip(self.rows, self.rows[1:], strict=False):
            time += math.dist((a["x"], a["y"], a["depth"]), (b["x"], b["y"], b["depth"])) / b["speed"]
        return time

    def _require(self, i: int) -> None:
        if not 0 <= i < len(self.rows):
            raise ConfigError(f"way-point {i + 1}: found {len(self.rows)} of them")

    def _change(self, rows: list[dict[str, Any]]) -> None:
        if len(rows) > MOST:
            raise ConfigError(f"the plan: found {len(rows)} way-points, expected at most {MOST}")
        known = {id(row) for row in self.rows}  # checked already
        checked = [row if id(row) in known else self._checked(row, i) for i, row in enumerate(rows)]
        self._past = [*self._past[1 - DEPTHS :], (self.rows, self.area)]
        self._future = []
        self.rows = checked

    def _checked(self, row: dict[str, Any], i: int) -> dict[str, Any]:
        whole = self.own | {key: value for key, value in row.items() if value is not None}
        return row_of(parse(Waypoint, waypoint_of(whole), f"way-point {i + 1}"))


KEYS = ("speed", "acceptance", "hold_time", "heading_deg", "altitude")


def row_of(waypoint: Waypoint) -> dict[str, Any]:
    """A way-point as a row of the table."""
    x, y, depth = (round(value, PLACES) for value in waypoint.position or (0.0, 0.0, 0.0))
    return {"x": x, "y": y, "depth": depth} | {key: getattr(waypoint, key) for key in KEYS}


def row_from(waypoint: dict[str, Any]) -> dict[str, Any]:
    """A way-point as scenarios write it, as a row of the table; what it does not say is as by default."""
    x, y, depth = waypoint.get("position") or (0.0, 0.0, 0.0)
    row = {"speed": 0.2, "acceptance": 0.2, "hold_time": 0.0, "heading_deg": None, "altitude": None}
    return {"x": x, "y": y, "depth": depth} | row | {k: v for k, v in waypoint.items() if k in row}


def for_browser(row: dict[str, Any]) -> dict[str, Any]:
    """A row with its heading in radians, as views want it."""
    degrees = row["heading_deg"]
    return row | {"heading": None if degrees is None else math.radians(degrees)}


def waypoint_of(row: dict[str, Any]) -> dict[str, Any]:
    """A row of the table as scenarios write it.

    Raises:
        ConfigError: A column that there is not, or a place that is missing.
    """
    if unknown := [key for key in row if key not in ("x", "y", "depth", *KEYS)]:
        raise ConfigError(f"way-point: found {unknown[0]!r}, expected one of x, y, depth, {', '.join(KEYS)}")
    place = [row.get(key, default) for key, default in (("x", None), ("y", None), ("depth", 1.0))]
    return {"position": place} | {key: row[key] for key in KEYS if row.get(key) is not None}


def rows_of(text: str, datum: Datum | None = None) -> list[dict[str, Any]]:
    """The way-points of a mission file, or of a scenario; without the speed and acceptance that it leaves out.

    Args:
        text: Of the file.
        datum: Of the plan's metres; None where nobody has given it.

    Raises:
        ConfigError: It is none; every mistake is named.
    """
    data = parse_yaml(text, "the file")
    if isinstance(data, dict) and isinstance(data.get("mission"), dict):  # a scenario
        data = data["mission"]
    return rows_from(parse(MissionSection, data, "the file"), datum)


def rows_from(mission: MissionSection, datum: Datum | None) -> list[dict[str, Any]]:
    """The way-points of a mission as rows, see `rows_of`."""
    if datum is None and any(waypoint.geodetic for waypoint in mission.waypoints):
        raise ConfigError(
            "the file: found geodetic way-points, expected position: [north, east, down] in metres, for the scenario "
            "gives no datum: --set 'datum={latitude: 63.44, longitude: 10.42}'"
        )
    left_out = [{"speed", "acceptance"} - waypoint.model_fields_set for waypoint in mission.waypoints]
    places = [waypoint.placed(datum) if datum else waypoint.position for waypoint in mission.waypoints]
    rows = [row_of(one.model_copy(update={"position": p})) for one, p in zip(mission.waypoints, places, strict=True)]
    return [{key: row[key] for key in row if key not in out} for row, out in zip(rows, left_out, strict=True)]


def square(x: float, y: float, side: float, depth: float, speed: float) -> list[dict[str, Any]]:
    """Four corners and back to the first, from a corner at (x, y) northwards [m]."""
    corners = ((0.0, 0.0), (side, 0.0), (side, side), (0.0, side), (0.0, 0.0))
    return [{"x": x + dx, "y": y + dy, "depth": depth, "speed": speed} for dx, dy in corners]
