"""Plans from and into files of other programs. For a worker: to read one takes time."""

from typing import Any

from rovtwin.console.planning import rows_from, rows_of, waypoint_of
from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import parse
from rovtwin.planning.exchange.missions import (
    FORMATS,
    NO_DATUM,
    depthless,
    fence_in_words,
    left_out,
    mission_data,
    read_route,
    route_of,
)
from rovtwin.scenario.schema import MissionSection, Scenario

DEPTH = 1.0  # of way-points whose file gives none, as everywhere in the plan [m]


def imported(text: str, name: str, datum: Datum | None) -> tuple[list[dict[str, Any]], list[str]]:
    """The way-points of a file as rows of the plan, and what there is to say of it.

    Args:
        text: Of the file.
        name: Of the file.
        datum: Of the plan's metres; None where nobody has given it.

    Raises:
        ConfigError: It has none, or they cannot be placed.
    """
    route = read_route(text, name)
    if route is None:
        return rows_of(text, datum), []
    if datum is None:
        raise ConfigError(f"{name}: {NO_DATUM}")
    mission = parse(MissionSection, mission_data(route, datum, name, DEPTH), name)
    notes = [*route.notes, *fence_in_words(route, datum)]
    if missing := depthless(route):
        notes.insert(0, f"{name} gives no depth of {missing} way-point(s): {DEPTH:g} m was put in")
    return rows_from(mission, datum), notes


def exported(rows: list[dict[str, Any]], kind: str, scenario: Scenario) -> tuple[str, list[str]]:
    """The text of a plan in a format, one of `FORMATS`, and what that leaves out.

    Raises:
        ConfigError: There is nothing in it, or nobody has given where it lies on the map.
    """
    if not rows:
        raise ConfigError("the plan is empty: add way-points first")
    mission = parse(MissionSection, {"waypoints": [waypoint_of(row) for row in rows]}, "the plan")
    route = route_of(mission, scenario.origin if scenario.datum.is_given else None, scenario)
    return FORMATS[kind].write(route), left_out(route, kind)
