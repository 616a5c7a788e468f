"""Messages of the console's server, as its views receive them."""

from typing import Any

THRUSTERS = ["port_surge", "starboard_surge", "sway", "heave"]


def setup(**changes: Any) -> dict[str, Any]:
    room = {"kind": "tank", "x": [-2, 11], "y": [-2, 12], "floor": 5}
    fixed = {"twin": True, "room": room, "fence": None, "home": [0, 0, 0], "mesh": None}
    fixed |= {"size": [0.5, 0.8, 0.35], "waves": {"height": 0.3, "direction": 3.1}, "thrusters": THRUSTERS}
    return {"kind": "setup", "sensors": ["position"], **fixed, **changes}


def camera(live: bool, why: str = "") -> dict[str, Any]:
    return {"kind": "camera", "live": live, "why": why}


def state(**changes: Any) -> dict[str, Any]:
    flow = {"phase": "go", "reason": "", "leg": [[0, 0, 3], [6, 0, 3]], "on_leg": True, "waypoint": 1, "count": 3}
    at = {"eta": [1, 0.1, 2.5, 0.1, 0.05, 0.2], "nu": [0.2, 0, 0, 0, 0, 0], "ellipse": [[0.04, 0.01], [0.01, 0.02]]}
    expected = {"reference": [1.1, 0, 3, 0, 0, 0], "setpoint": [6, 0, 3, 0, 0, 0], "to_go": 5.0}
    actuators = {"u": [0.5, 1.0, -0.2, 0.1], "health": [1.0, 1.0, 0.6, 0.0]}
    sensors = {"altimeter": {"age": 0.1, "value": [2.5]}}
    sea = {"truth": [1.1, 0, 2.5, 0, 0, 0.2], "current": [0.1, 0.2, 0]}
    health = {"stage": "ready", "note": "", "armed": True, "arming": False, "stopped": False, "hung": False}
    parts = {"kind": "state", "t": 10.0, "link_age": 0.0, "sensors": sensors, "markers": []}
    return {**parts, **flow, **at, **expected, **actuators, **sea, **health, **changes}


def plan(*points: tuple[float, float], flown: tuple[tuple[float, float], ...] = ()) -> dict[str, Any]:
    def rows(places):
        return [{"x": x, "y": y, "depth": 3, "speed": 0.2, "hold_time": 0, "heading": None} for x, y in places]

    made = {"submitted": bool(flown), "checks": [], "undo": False, "redo": False}
    return {"kind": "plan", "draft": rows(points), "flown": rows(flown), **made}


def rights(may: bool = True) -> dict[str, Any]:
    return {
        "kind": "rights",
        "you": "b1",
        "in_control": "b1" if may else "b2",
        "asked": None,
        "watchers": 2,
        "may": may,
    }
