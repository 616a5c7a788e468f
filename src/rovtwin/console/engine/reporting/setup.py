"""What does not change while an engine flies: the vehicle, the room around it, the fence."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rovtwin.core.flow import REASONS
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.analysis.visuals import pieces_of

if TYPE_CHECKING:  # a replay needs none of it, and begins seconds sooner
    from rovtwin.console.engine.vehicle_session import EngineConfig
    from rovtwin.live.readiness import Readiness
    from rovtwin.runs.compose.composition import Simulation

CORNERS = 64  # of a circle, as browsers draw it
SIZE = (0.5, 0.5, 0.3)  # shown of a vehicle whose shape nobody gave [m]


def setup_of(
    config: "EngineConfig", simulation: "Simulation", readiness: "Readiness", test: dict[str, Any] | None = None
) -> dict[str, Any]:
    """The message that tells it; `test` is what Manoeuvres lays out of one."""
    return described(config.scenario, simulation.vehicle) | {
        "kind": "setup",
        "thrusters": simulation.thruster_names,
        "sensors": simulation.sensor_names,
        "readings": values_of({name: (kind.fields, kind.units) for name, kind in simulation.sensor_kinds.items()}),
        "twin": config.is_twin,
        "mesh": "/mesh/vehicle.glb" if pieces_of(simulation.vehicle) else None,
        "home": np.asarray(readiness.start.position),
        "missing": list(readiness.missing),
        "operator_silent": _operator_rule(simulation),
        "test": test,
    }


def _operator_rule(simulation: "Simulation") -> dict[str, Any]:
    """What the autopilot does without an operator, one of gnc.safety.rules.ACTIONS, and after how long [s]."""
    from rovtwin.gnc.safety.rules import ACTIONS  # not for a replay, which begins sooner without it

    autopilot: Any = simulation.loop.autopilot
    rules = autopilot.supervisor.rules
    i = REASONS.index("operator silent")
    return {"limit": float(rules.limit[i] + rules.after[i]), "action": ACTIONS[int(rules.action[i])]}


def values_of(sensors: Mapping[str, tuple[Sequence[str], Sequence[str]]]) -> dict[str, dict[str, list[str]]]:
    """Names and units of the values of each sensor's readings, which are given by the sensor's name."""
    return {
        name: {"fields": list(fields), "units": ["" if unit == "1" else unit for unit in units]}
        for name, (fields, units) in sensors.items()
    }


def described(scenario: Scenario, vehicle: Vehicle) -> dict[str, Any]:
    """What follows from the scenario and its vehicle alone, without composing anything."""
    boxes = vehicle.assembly.boxes
    return {
        "vehicle": vehicle.name,
        "datum": _datum(scenario),
        "room": _room(scenario),
        "fence": _fence(scenario),
        "deepest": scenario.autopilot.supervisor.deepest,
        "size": np.ptp(np.concatenate([box.corners() for box in boxes]), axis=0) if boxes else SIZE,
        "waves": _waves(scenario),
    }


def _datum(scenario: Scenario) -> dict[str, float] | None:
    """Where the origin of n lies on the map [deg, m]; None where nobody has given it."""
    datum = scenario.datum
    return (
        {"latitude": datum.latitude, "longitude": datum.longitude, "height": datum.height} if datum.is_given else None
    )


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
    reach = {"north": [north, far_north], "east": [east, far_east]}
    return {"outlines": outlines, "polygon": fence.polygon} | reach


def _waves(scenario: Scenario) -> dict[str, Any] | None:
    waves = scenario.world.waves
    height = getattr(waves, "significant_height", None)
    direction = getattr(waves, "direction_deg", None)
    return None if height is None else {"height": height, "direction": np.radians(direction or 0.0)}
