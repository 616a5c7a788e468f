"""What happened during a run, when: for the event log of a replay and the marks on its slider."""

import json
from typing import Any

import numpy as np

from rovtwin.console.clock import clock
from rovtwin.console.engine.reporting.state import BY_OPERATOR, counted
from rovtwin.console.replays.replay import Recording
from rovtwin.console.replays.shelf import BY_HAND
from rovtwin.core.flow import PHASES
from rovtwin.runs.scoring.decisions import courses, losses

OWN = ("idle", "dive", "turn", "go", "hold", "finished")  # phases of the mission's own course
MOST = 400  # that are reported


def marks_of(recording: Recording) -> list[dict[str, Any]]:
    """Each an event with its time t [s], in order of time.

    `mark` says what it is: note, start, mission, waypoint, phase, decision, fault, manoeuvre or end.
    """
    start = f"{recording.name} begins"
    found = [_mark(recording.start, "start", "info", start)]
    found += [_mark(recording.start, "note", "warning", note) for note in recording.notes]
    found += [*_course(recording), *_decisions(recording), *_planned(recording), *_end(recording)]
    found.sort(key=lambda mark: mark["t"])
    if len(found) > MOST:  # phases matter least
        found = [mark for mark in found if mark["mark"] != "phase"][:MOST]
    return found


def _mark(t: float, mark: str, level: str, text: str) -> dict[str, Any]:
    return {"kind": "event", "t": float(t), "clock": clock(t), "level": level, "text": text, "mark": mark}


def _course(recording: Recording) -> list[dict[str, Any]]:
    """Phases of the mission, and way-points that were reached."""
    if "mode" not in recording.tape:
        return []
    t, mode = recording.tape["mode"].t, recording.tape["mode"].values
    phase, waypoint = mode[:, 0].astype(int), mode[:, 2].astype(int)
    found = []
    for one in recording.missions:
        if one.t >= recording.start:
            found.append(_mark(one.t, "mission", "info", f"mission started: {counted(len(one.waypoints))}"))
    for k in np.flatnonzero(np.diff(waypoint) > 0) + 1:
        if recording.mission_at(t[k]) == recording.mission_at(t[k - 1]):  # else it is the number of another plan
            found.append(_mark(t[k], "waypoint", "info", f"way-point {waypoint[k]} of {recording.count(t[k])} reached"))
    for k in np.flatnonzero(np.diff(phase)) + 1:
        if PHASES[phase[k]] in OWN and PHASES[phase[k - 1]] in OWN:
            found.append(_mark(t[k], "phase", "info", PHASES[phase[k]]))
    return found


def _decisions(recording: Recording) -> list[dict[str, Any]]:
    found = []
    if (mode := recording.tape.get("mode")) is not None:
        found += courses(mode.t, mode.values[:, 0].astype(int), mode.values[:, 1].astype(int))
    if (health := recording.tape.get("health")) is not None:
        found += losses(health.t, health.values, recording.thrusters)
    return [_decision(one["t"], one["what"], one["cause"]) for one in found]


def _decision(t: float, what: str, cause: str) -> dict[str, Any]:
    return _mark(t, "decision", "info" if cause == BY_OPERATOR else "danger", f"{what}: {cause}")


def _planned(recording: Recording) -> list[dict[str, Any]]:
    """What the scenario had planned to happen: faults, and the manoeuvres of a test."""
    found, metadata = [], recording.log.metadata
    for fault in json.loads(metadata.get("faults") or "[]"):
        found.append(_mark(fault["start"], "fault", "warning", f"fault: {fault['what']}"))
        if fault["end"] is not None:
            found.append(_mark(fault["end"], "fault", "info", f"over: {fault['what']}"))
    for span in json.loads(metadata.get("test") or "[]"):
        found.append(_mark(span["start"], "manoeuvre", "info", span["what"]))
    return [mark for mark in found if recording.start <= mark["t"] <= recording.end]


def _end(recording: Recording) -> list[dict[str, Any]]:
    summary = json.loads(recording.log.metadata.get("summary") or "{}")
    if not summary:
        return [_mark(recording.end, "end", "warning", "the log ends; it does not say how the run ended")]
    if summary.get("completed"):
        return [_mark(recording.end, "end", "info", "completed")]
    reason = summary.get("reason") or summary.get("phase")
    level = "warning" if reason in BY_HAND else "danger"
    return [_mark(recording.end, "end", level, f"not completed: {reason}")]
