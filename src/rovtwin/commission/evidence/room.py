"""A planned part in the test tank: the fence that ends it, the way to the middle that it begins with."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from rovtwin.commission.stage import Check
from rovtwin.commission.work import Work
from rovtwin.core.errors import ConfigError
from rovtwin.live.connect import on_this_machine
from rovtwin.planning.plan import Plan
from rovtwin.planning.tank import ERRS
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.runs.compose.experiment import pieces_of
from rovtwin.runs.compose.sensors import sensors_of
from rovtwin.scenario.schema import Scenario

LASTING = 0.3  # outside the fence, before thrusters stop [s]: one position that is off ends nothing
LEAST_HOME = 5.0  # for the way to the middle [s]
CARRIES = 2  # times that a flight waits for a vehicle that is brought to the middle
PLACE = "Bring it there; the origin of positions belongs in the middle of the tank, north along its length."


def in_tank(work: Work, plan: Plan) -> Scenario:
    """The plan as a scenario that goes to the tank's middle first and is ended by a fence.

    Raises:
        ConfigError: Positions err by too much for a fence in this tank.
    """
    assert plan.scenario.test is not None  # a plan is a test
    manoeuvres = [one.model_dump(mode="json") for one in plan.scenario.test.manoeuvres]
    home = max([2.0 * one["home"] for one in manoeuvres] + [LEAST_HOME])
    first = {"manoeuvre": "rest", "duration": 0.5, "home": home}
    test = {"name": "excite", "home_at_start": True, "manoeuvres": [first, *manoeuvres]}
    sensor = sensors_of(plan.scenario, vehicle_of(plan.scenario))["position"]
    errs, interval = float(np.max(np.asarray(sensor.noise))), 1000.0 / float(sensor.rate)
    tank = work.request.room
    tank.require_fence(plan.model, errs)
    half, deepest = plan.fence[:2], float(plan.fence[2])
    if np.any(half + ERRS * errs > tank.touches(plan.model, plan.flown)):
        raise ConfigError(
            f"the planned path leaves no room for a fence before the walls of {tank}, as positions err by {errs:.2g} m "
            "(one standard deviation). Repeat this stage with another --seed, or a larger --tank"
        )
    corners = [[north * half[0], east * half[1]] for north, east in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
    rules: dict[str, Any] = {
        "geofence": {"polygon": corners, "after": max(LASTING, 1.5 * interval), "action": "stop"},
        "depth_limit": {"limit": deepest},
    }
    if on_this_machine(work.request.link):  # its time waits for a busy machine, or is another's: late ticks harm nobody
        rules["deadline_missed"] = {"action": "ignore"}
    changes = {
        "sensors": plan.scenario.sensors.model_dump(mode="json", exclude_defaults=True),
        "autopilot": {"supervisor": rules},
        "duration": 86_400.0,
        "test": test,
    }
    scenario = work.scenario(changes, str(plan.scenario.vehicle))
    seconds = sum(len(piece.share) for piece in pieces_of(scenario)) * scenario.control_dt
    return scenario.model_copy(update={"duration": float(math.ceil(seconds) + 1)})


def from_the_middle(work: Work, name: str, fly: Callable[[str], Check | None]) -> Check | None:
    """Fly; where the vehicle is not in the middle, again once somebody has brought it there.

    Args:
        work: With the person who may.
        name: Of the folder of the flight: a further one gets a name of its own.
        fly: Into a folder of that name: a reason why it was not flown, named `place` where the vehicle is elsewhere.
    """
    stop = fly(name)
    for again in range(CARRIES):
        if stop is None or stop.what != "place":
            break
        if not work.person.confirm(f"The flight waits: {stop.text} {stop.fix} Is it there now?"):
            break
        stop = fly(f"{name}-{again + 2}")
    return stop


def outside(scenario: Scenario, position: Any) -> str:
    """Where a vehicle is that may not begin here, in words; empty where it is inside the fence."""
    fence = scenario.autopilot.supervisor.geofence.polygon
    assert fence is not None  # of `in_tank`
    north, east, depth = (float(x) for x in position)
    half = np.abs(np.array(fence)).max(axis=0)
    if abs(north) <= half[0] and abs(east) <= half[1] and depth <= scenario.autopilot.supervisor.deepest:
        return ""
    return (
        f"the vehicle is at north {north:.2f}, east {east:.2f}, depth {depth:.2f} m; expected within {half[0]:.2f} and "
        f"{half[1]:.2f} m of the tank's middle and above {scenario.autopilot.supervisor.deepest:.2f} m."
    )
