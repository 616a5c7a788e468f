"""What an operator should know at once: each alert with its cause and its remedy."""

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rovtwin.console.clock import lasting
from rovtwin.core.flow import OPERATOR, PHASES, REASONS
from rovtwin.core.sensors import kind_of

# By core.flow.REASONS: why the supervisor acted, and what to do.
REMEDIES = {
    "not a number": ("the estimate or a block of your own broke down", "disarm, see the log, start anew"),
    "operator": ("you aborted", "Hold switches the thrusters on again where the vehicle is"),
    "depth limit": ("deeper than the supervisor allows", "Hold, then come up; or raise the depth limit"),
    "attitude limit": ("tilted beyond the limit", "check ballast and tether; Hold when it is level"),
    "estimate lost": ("the position became too uncertain", "bring back positions, then Hold"),
    "leak": ("water comes in", "recover the vehicle now"),
    "battery critical": ("the battery is nearly empty", "recover the vehicle"),
    "filter diverged": ("positions contradict the model", "check the positioning and the vehicle's parameters"),
    "positions lost": ("no position that could be accepted", "check the positioning, then Hold"),
    "thruster failed": ("too few thrusters are left", "recover the vehicle; it cannot hold itself"),
    "saturated": ("thrusters cannot give what is needed", "less current, less speed, or another heading"),
    "link lost": ("nothing came from the vehicle", "check tether and network"),
    "deadline missed": ("this computer is too slow or too busy", "close other programs"),
    "battery low": ("the battery is low", "let it come home"),
    "geofence": ("outside the fence", "Hold, then pilot it back inside"),
    "altitude limit": ("too close to the floor", "Hold, then pilot it up"),
    "time out": ("the mission took longer than allowed", "check the path; raise the time limit"),
    "operator silent": ("no sign of life from whoever is in control", "take control, then Resume"),
    "sensor silent": ("attitude or depth no longer arrives", "check the vehicle's sensors"),
    "no way home": ("the vehicle does not get nearer", "check tether and current; pilot it"),
    "off course": (
        "the vehicle leaves its path and does not come back",
        "check thrusters, tether and current; pilot it",
    ),
    "off depth": (
        "the vehicle leaves its depth and does not come back",
        "check thrusters, tether and ballast; pilot it",
    ),
}
SILENT = 3.0  # a position older than this is worth a word [s]
CHI = 2.4477  # half-axes of the 95 % ellipse of a plane, in standard deviations
UNSURE = 2.0  # a position that is known no better (95 %) is worth one, too [m]


@dataclass(frozen=True)
class Alert:
    """`level` is "note", "warning" or "danger"."""

    level: str
    what: str
    cause: str
    remedy: str


def alerts(state: dict[str, Any], thrusters: list[str]) -> list[dict[str, str]]:
    """What is worth a word in a state, the gravest first."""
    found = [*_of_stop(state), *_of_supervisor(state), *_of_sensors(state), *_of_thrusters(state, thrusters)]
    found += _of_vehicle(state)
    return [asdict(alert) for alert in sorted(found, key=lambda alert: alert.level != "danger")]


def alerts_of_link(stage: str, note: str) -> list[dict[str, str]]:
    """What there is to say while there is no vehicle."""
    if stage == "lent":
        cause, remedy = "a commissioning holds the vehicle", "it is given back in Commission"
        return [asdict(Alert("note", "not flown from here", cause, remedy))]
    if stage != "lost":
        return []
    return [asdict(Alert("danger", "no vehicle", note, "check tether, power and network, then press Reconnect"))]


def _of_stop(state: dict[str, Any]) -> list[Alert]:
    if not state["stopped"]:
        return []
    return [Alert("danger", "STOPPED: thrusters are off", "somebody pressed STOP", "Arm when it is safe to go on")]


def _of_supervisor(state: dict[str, Any]) -> list[Alert]:
    reason = state["reason"]
    if not reason or reason not in REMEDIES:
        return []
    cause, remedy = REMEDIES[reason]
    if state.get("experiment"):  # which knows no Hold
        remedy = "put right what is wrong, then Start flies the test anew"
    grave = state["phase"] in (PHASES[i] for i in (7, 11, 12)) and reason != REASONS[OPERATOR]
    level = "danger" if grave else "warning"
    return [Alert(level, f"{state['phase']}: {reason}", cause, remedy)]


def _of_sensors(state: dict[str, Any]) -> list[Alert]:
    found = []
    ages = [one["age"] for one in _of_kind(state, "position") if one.get("age") is not None]
    if ages and min(ages) > SILENT:
        found.append(Alert("warning", f"no position for {lasting(min(ages))}", "the positioning is silent", "check it"))
    if not state.get("experiment") and (radius := _radius(state.get("ellipse"))) > UNSURE:
        text = f"position uncertain: known to no better than {math.floor(radius)} m (95 %)"
        found.append(Alert("warning", text, "too few positions come, or are accepted", "check the positioning"))
    if state["link_age"] > 1.0:
        text = f"nothing from the vehicle for {lasting(state['link_age'])}"
        found.append(Alert("danger", text, "the link is broken or the vehicle is off", "check tether and network"))
    if any((leak.get("value") or [0.0])[0] > 0.5 for leak in _of_kind(state, "leak")):
        found.append(Alert("danger", "LEAK", "water comes in", "recover the vehicle now"))
    return found


def _radius(ellipse: Any) -> float:
    """Largest half-axis of the 95 % ellipse of a covariance [m]; 0 where there is none."""
    if ellipse is None or not np.all(np.isfinite(ellipse)):
        return 0.0
    return CHI * math.sqrt(max(float(np.linalg.eigvalsh(np.asarray(ellipse))[-1]), 0.0))


def _of_kind(state: dict[str, Any], kind: str) -> list[dict[str, Any]]:
    """What the sensors of a kind last reported: age and value."""
    return [status for name, status in state["sensors"].items() if kind_of(name) == kind]


def _of_thrusters(state: dict[str, Any], names: list[str]) -> list[Alert]:
    lost = [name for name, share in zip(names, state["health"], strict=False) if share < 0.5]
    if not lost:
        return []
    cause = "the force that should be there is missing"
    return [Alert("warning", f"no longer used: {', '.join(lost)}", cause, "recover it, check the propeller")]


def _of_vehicle(state: dict[str, Any]) -> list[Alert]:
    """What has changed of it since its identification, without the figures: those change all the time."""
    changed = state.get("changed")
    if not changed:
        return []
    cause = "the vehicle does not move as it did when it was identified"
    return [Alert("warning", f"changed: {', '.join(changed)}", cause, "see Changes, then recover it and look")]
