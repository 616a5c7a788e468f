"""What a mission leaves out, from the vehicle that flies it: speed and acceptance of way-points, the time limit.

    speed       FROUDE sqrt(g L), at most SHARE of the top speed ahead      (Double Blueye: 0.2 m/s)
    acceptance  REACHED L, without thrust in sway twice that, and no less
                than the room in which it turns at its speed                (Double Blueye: 0.2 m)
    duration    LONGEST, or its holds and PATIENCE times what its ways take at these speeds

L is the cube root of the displaced volume. Equal Froude numbers mean equal patterns of motion (Froude's law). What a
file says counts as it stands; what was taken is written into the run's own scenario.
"""

import math

import numpy as np

from rovtwin.runs.limits import Limits
from rovtwin.scenario.schema import Scenario, Waypoint
from rovtwin.vehicle import Model
from rovtwin.vehicle.constants import GRAVITY

FROUDE, SHARE, REACHED = 0.115, 0.7, 0.65
WIDEST = 2.0  # of an acceptance that gives room to turn, times the one of length
LONGEST, PATIENCE = 1500.0, 4.0  # [s], and times
SLOWEST = 0.01  # [m/s]


def fitted(scenario: Scenario, model: Model) -> Scenario:
    """The scenario with speeds, acceptances and time limit that it leaves out as fit the vehicle."""
    if not scenario.waypoints or scenario.mission is None:
        return scenario
    limits = Limits.of(model)
    points = [_completed(point, limits) for point in scenario.waypoints]
    made = scenario.model_copy(update={"mission": scenario.mission.model_copy(update={"waypoints": points})})
    if "duration" in scenario.model_fields_set:
        return made
    held = sum(point.hold_time for point in points)
    needed = 100.0 * math.ceil((held + PATIENCE * travel(made)) / 100.0)
    return made.model_copy(update={"duration": min(max(LONGEST, needed), 86_400.0)})


def own_values(limits: Limits, speed: float | None = None) -> dict[str, float]:
    """Speed [m/s] and acceptance [m] of a vehicle, to the centimetre; the acceptance for `speed` where one is given."""
    wide = max(round(REACHED * limits.length * (1.0 if limits.can(1) else 2.0), 2), SLOWEST)
    own = min(FROUDE * math.sqrt(GRAVITY * limits.length), SHARE * float(limits.top[0, 1]) or math.inf)
    if limits.turning_room(own) > WIDEST * wide:  # it turns so slowly that way-points would be anywhere
        own *= WIDEST * wide / limits.turning_room(own)
    own = max(round(own, 2), SLOWEST)
    room = math.ceil(100.0 * limits.turning_room(own if speed is None else speed)) / 100.0
    return {"speed": own, "acceptance": max(wide, room)}


def assumptions(given: Scenario, made: Scenario) -> list[str]:
    """What was taken from the vehicle, in lines: speed, acceptance, time limit; of a test what was changed for it.

    Also what never happens, for the run ends before.
    """
    return [*_taken(given, made), *_too_late(made)]


def _too_late(scenario: Scenario) -> list[str]:
    """Faults and requests of the operator after the end of the run."""
    events = [(f"faults[{i}]", fault.fault, fault.at) for i, fault in enumerate(scenario.faults)]
    events += [(f"operator[{i}]", request.ask, request.at) for i, request in enumerate(scenario.operator)]
    return [
        f"{where}, {what} at {at:g} s, never happens: the run ends at {scenario.duration:g} s at the latest; give it "
        "an earlier 'at', or the scenario a longer 'duration'"
        for where, what, at in events
        if at >= scenario.duration
    ]


def _taken(given: Scenario, made: Scenario) -> list[str]:
    if given.test and made.test:
        lines = [note for note in made.test.notes if note not in given.test.notes]
        if made.duration != given.duration:
            lines.append(f"the test's time limit is {made.duration:g} s, in place of {given.duration:g} s")
        return lines
    default = {key: Waypoint.model_fields[key].default for key in ("speed", "acceptance")}
    taken: dict[str, str] = {}
    for before, after in zip(given.waypoints, made.waypoints, strict=True):
        for key in default:
            if key not in before.model_fields_set and getattr(after, key) != default[key]:
                taken[key] = f"{key} {getattr(after, key):g} {'m/s' if key == 'speed' else 'm'}"
    if made.duration != given.duration:
        taken["duration"] = f"duration {made.duration:g} s"
    if not taken:
        return []
    return [f"the mission gives no {' and no '.join(taken)}; taken from the vehicle: {', '.join(taken.values())}"]


def travel(scenario: Scenario) -> float:
    """Time at the way-points' speeds, straight from one to the next [s]."""
    places = [np.asarray(scenario.start.position), *(np.asarray(w.placed(scenario.origin)) for w in scenario.waypoints)]
    ways = np.linalg.norm(np.diff(places, axis=0), axis=1)
    return sum(float(way) / w.speed for way, w in zip(ways, scenario.waypoints, strict=True))


def _completed(point: Waypoint, limits: Limits) -> Waypoint:
    given = point.speed if "speed" in point.model_fields_set else None
    left_out = {key: v for key, v in own_values(limits, given).items() if key not in point.model_fields_set}
    return point.model_copy(update=left_out) if left_out else point
