"""What there is to say of way-points before they are flown: every fault, each with the way-points it is of."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from rovtwin.console.engine.fence import legs_outside
from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import as_array
from rovtwin.gnc.safety.rules import inside
from rovtwin.runs.compose.inside import unreachable
from rovtwin.runs.feasibility.mission import judge
from rovtwin.runs.feasibility.point_numbers import counted, named
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Model

MOST = 20  # faults that are listed one by one
_NAMED = re.compile(r"way-point (\d+)")


@dataclass(frozen=True)
class Check:
    """`level` is ok, note, warning or error; `points` are numbers of way-points from 0."""

    level: str
    what: str
    points: list[int] = field(default_factory=list)


def faults(scenario: Scenario, here: Scenario, model: Model, *, has_terrain: bool, known_world: bool) -> list[Check]:
    """All that keeps a mission from being flown; empty where it can be.

    Args:
        scenario: Mission, start, tank, fence and depth limit.
        here: The same, begun where the vehicle is now.
        model: Of the vehicle.
        has_terrain: Whether way-points may have altitudes.
        known_world: False where the vehicle is somewhere else, behind a link: current and tank do not count then.
    """
    found = [Check("error", f"way-point {i + 1}: {what}", [i]) for i, what in _of_points(scenario, model, has_terrain)]
    refused = [finding for finding in judge(here, model, known_world) if finding.refused]
    found += [Check("error", finding.line, named(finding.line)) for finding in refused]
    if len(found) > MOST:
        rest = found[MOST:]
        points = sorted({i for one in rest for i in one.points})
        found = [*found[:MOST], Check("error", f"and {len(rest)} more faults, at {counted(points)}", points)]
    return found


def require_none(found: list[Check], name: str = "way-point") -> None:
    """Raise ConfigError with all faults, if there are any; `name` is what a way-point is called."""
    if found:
        text = "\n".join(one.what for one in found)
        raise ConfigError(text if name == "way-point" else _NAMED.sub(name, text))


def kept(scenario: Scenario) -> Check:
    """What a plan without faults keeps within."""
    fence = scenario.autopilot.supervisor.geofence
    bounds = ["the tank"] if scenario.world.tank is not None else []
    bounds += ["the fence"] if fence.limit is not None or fence.polygon is not None else []
    above = f"above the depth limit of {scenario.autopilot.supervisor.deepest:g} m"
    if not bounds:  # nothing was kept that somebody has laid down
        return Check("note", f"there is no tank and no fence to check against; {above}")
    return Check("ok", f"inside {' and '.join(bounds)}, {above}")


def _of_points(scenario: Scenario, model: Model, has_terrain: bool) -> Iterator[tuple[int, str]]:
    """Way-points that cannot be, each with the reason."""
    limit = scenario.autopilot.supervisor.deepest
    for i, point in enumerate(scenario.waypoints):
        if point.depth >= limit:
            yield i, f"found {point.depth:g} m deep, expected less than {limit:g} m"
        if point.altitude and not has_terrain:
            yield i, "has an altitude, but there is no altimeter on board"
    yield from unreachable(scenario, model)
    yield from _outside(scenario)


def _outside(scenario: Scenario) -> Iterator[tuple[int, str]]:
    """Way-points outside the supervisor's fence."""
    fence, start = scenario.autopilot.supervisor.geofence, np.array(scenario.start.position)
    for i, point in enumerate(scenario.waypoints):
        place = np.array(point.placed(scenario.origin))
        away = float(np.linalg.norm((place - start)[:2]))
        if fence.limit is not None and away > fence.limit:
            yield i, f"found {away:.1f} m from the start, expected at most {fence.limit:g} m (the fence)"
        if fence.polygon is not None and not inside(as_array(fence.polygon), as_array(place[:2])):
            yield i, "found it outside the fence, expected it inside: move it"
    if fence.polygon is not None:
        places = np.array([point.placed(scenario.origin)[:2] for point in scenario.waypoints]).reshape(-1, 2)
        for i in legs_outside(np.array(fence.polygon), places):
            yield i, "the way to it leaves the fence, expected it inside: go around the corner"
