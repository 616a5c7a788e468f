"""What does not change while an engine flies: the vehicle, the room around it, the fence."""

from typing import Any

import numpy as np

from rovtwin.console.engine.vessel import Wanted
from rovtwin.scenario.composition import Composed
from rovtwin.scenario.live.readiness import Readiness
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle.visuals import pieces_of

CORNERS = 64  # of a circle, as browsers draw it


def setup_of(
    wanted: Wanted, composed: Composed, readiness: Readiness, test: dict[str, Any] | None = None
) -> dict[str, Any]:
    """The message that tells it; `test` is what Manoeuvres lays out of one."""
    scenario = wanted.scenario
    corners = np.asarray(composed.model.hull.corners)
    return {
        "kind": "setup",
        "vehicle": composed.vehicle.name,
        "thrusters": composed.thruster_names,
        "sensors": composed.sensor_names,
        "twin": wanted.is_twin,
        "camera": wanted.is_twin and bool(scenario.cameras),
        "mesh": "/mesh/vehicle.glb" if pieces_of(composed.vehicle) else None,
        "room": _room(scenario),
        "fence": _fence(scenario),
        "deepest": scenario.autopilot.supervisor.deepest,
        "home": np.asarray(readiness.start.position),
        "size": np.ptp(corners, axis=0) if len(corners) else [0.5, 0.5, 0.3],
        "missing": list(readiness.missing),
        "waves": _waves(scenario),
        "test": test,
    }


def _room(scenario: Scenario) -> dict[str, Any]:
    world = scenario.world
    if world.tank is None:
        return {"kind": "open", "floor": world.floor}
    return {"kind": "tank", "x": list(world.tank.north), "y": list(world.tank.east), "floor": world.floor}


def _fence(scenario: Scenario) -> dict[str, Any] | None:
    """Outlines of the fence, a circle and a polygon [m], and how far they reach."""
    fence = scenario.autopilot.supervisor.geofence
    outlines = []
    if fence.limit is not None:
        around = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
        circle = np.stack([np.cos(around), np.sin(around)], axis=1) * fence.limit
        outlines.append(circle + np.asarray(scenario.start.position[:2]))
    if fence.polygon is not None:
        outlines.append(np.asarray(fence.polygon))
    if not outlines:
        return None
    every = np.concatenate(outlines)
    (north, east), (far_north, far_east) = every.min(axis=0), every.max(axis=0)
    return {"outlines": outlines, "north": [north, far_north], "east": [east, far_east]}


def _waves(scenario: Scenario) -> dict[str, Any] | None:
    waves = scenario.world.waves
    height = getattr(waves, "significant_height", None)
    direction = getattr(waves, "direction_deg", None)
    return None if height is None else {"height": height, "direction": np.radians(direction or 0.0)}
