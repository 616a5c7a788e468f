"""A planned part in the test tank: the fence that ends it, the way to the middle that it begins with."""

import math
from typing import Any

import numpy as np

from rovtwin.commission.work import Work
from rovtwin.core.errors import ConfigError
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import jax
from rovtwin.live.connect import on_this_machine
from rovtwin.planning.plan import Plan
from rovtwin.planning.tank import Tank
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.runs.compose.experiment import pieces_of
from rovtwin.runs.compose.sensors import sensors_of
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Model

HALF = 0.5  # of the way from the planned path to where the hull touches: there the fence ends the part
LASTING = 0.3  # outside the fence, before thrusters stop [s]: one position that is off ends nothing
LEAST_HOME = 5.0  # for the way to the middle [s]
ERRS = 2.5  # standard deviations of a position by which the fence stands further out

_rotations = jax.jit(jax.vmap(rotation_from_quaternion))


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
    half, deepest, touches = fence(plan.model, plan.flown, work.request.room)
    sensor = sensors_of(plan.scenario, vehicle_of(plan.scenario))["position"]
    errs, interval = float(np.max(np.asarray(sensor.noise))), 1000.0 / float(sensor.rate)
    if np.any(half + ERRS * errs > touches):
        raise ConfigError(
            f"positions err by {errs:.2g} m (one standard deviation): in a tank of {work.request.room} no fence can "
            "end a part before a wall. Use motion capture (--sensor qtm://HOST/BODY), or a larger --tank"
        )
    half = half + ERRS * errs
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


def fence(model: Model, flown: Any, tank: Tank) -> tuple[np.ndarray, float, np.ndarray]:
    """How far CO may be from the tank's middle to north and east [m], shape (2,), how deep [m], and where the hull
    touches the walls [m], shape (2,).

    Args:
        model: With its hull.
        flown: The plan's path, as `planning.rehearsal` gives it.
        tank: Its middle is the path's start.
    """
    R_nb = np.asarray(_rotations(flown.attitude))
    reach = np.einsum("tij,mj->tmi", R_nb, np.asarray(model.hull.corners))
    away = np.abs(flown.position[:, :2]).max(axis=0)
    touches = 0.5 * np.array(tank.sizes[:2]) - np.abs(reach[..., :2]).max(axis=(0, 1))
    deepest = float(flown.position[:, 2].max())
    grounds = tank.depth - float(reach[..., 2].max())
    return away + HALF * np.maximum(touches - away, 0.0), deepest + HALF * max(grounds - deepest, 0.0), touches


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
