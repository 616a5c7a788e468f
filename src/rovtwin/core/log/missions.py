"""Missions in a log's metadata: which way-points were flown, and from when.

`mission` has the way-points of the mission that was flown last. A log in which missions may change, of a flight from
the console, has all of them in `missions`: a list of {"t": seconds, "waypoints": [...]} in order of time.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

LAST, ALL = "mission", "missions"  # keys of the metadata


@dataclass(frozen=True)
class FlownMission:
    """A mission that was started.

    Attributes:
        t: When, on the log's clock [s]; -inf: from the beginning.
        waypoints: As scenarios write them, `position` in n: north, east, down [m].
    """

    t: float
    waypoints: list[dict[str, Any]]


def missions_of(metadata: Mapping[str, str]) -> list[FlownMission]:
    """Missions in order of time; empty where nothing was flown or where the log does not tell."""
    if (several := _parsed(metadata.get(ALL))) is not None:
        return [FlownMission(float(one["t"]), _points(one["waypoints"])) for one in several if _is_mission(one)]
    only = _points(_parsed(metadata.get(LAST)) or [])
    return [FlownMission(-float("inf"), only)] if only else []


def missions_metadata(missions: Sequence[FlownMission]) -> dict[str, str]:
    """Missions as metadata of a log that may get more of them."""
    last = missions[-1].waypoints if missions else []
    listed = [{"t": one.t, "waypoints": one.waypoints} for one in missions]
    return {LAST: json.dumps(last), ALL: json.dumps(listed)}


def mission_at(missions: Sequence[FlownMission], t: float) -> int:
    """Number of the mission under way at a time [s], from 0; -1 before the first was started."""
    return sum(one.t <= t + 1e-9 for one in missions) - 1


def point_name(missions: Sequence[FlownMission], mission: int, point: int) -> str:
    """What people call a way-point, both numbers from 0: "3", or "2.3" where several missions were flown."""
    return str(point + 1) if len(missions) < 2 else f"{mission + 1}.{point + 1}"


def _parsed(text: str | None) -> list[Any] | None:
    """A list from JSON; None where there is none."""
    try:
        found = json.loads(text or "null")
    except ValueError:
        return None
    return found if isinstance(found, list) else None


def _points(found: Any) -> list[dict[str, Any]]:
    return [one for one in found if isinstance(one, dict)] if isinstance(found, list) else []


def _is_mission(one: Any) -> bool:
    return isinstance(one, dict) and isinstance(one.get("t"), int | float) and isinstance(one.get("waypoints"), list)
