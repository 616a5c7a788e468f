"""What the autopilot decided during a run, when and why, in words: for the summary and the report."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Real

from rovtwin.core.arrays.stretches import stretches
from rovtwin.core.flow import ABORTED, HELD, PAUSED, PHASES, PILOTED, REASONS, RETURNED, RETURNING, SURFACED, SURFACING
from rovtwin.core.user_files.quantity import plain
from rovtwin.runs.scoring.headings import reason_for, unmet_headings
from rovtwin.runs.scoring.scores import Flown
from rovtwin.runs.scoring.stalls import cause, stalls
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Model

MOST_BAD = 3  # stretches of them that are listed: more say no more
COARSER = 2.0  # times the best standard deviation of a position so far, from which on it is bad
BRIEF, SETTLING = 10.0, 20.0  # a stretch that does not count, and the time in which the filter settles [s]
_OWN = (PAUSED, PILOTED, HELD, RETURNING, RETURNED, SURFACING, SURFACED, ABORTED)  # not the mission's own course


def decisions(
    flown: Flown, thrusters: Sequence[str], missions: Sequence[tuple[float, Scenario]], model: Model
) -> list[dict[str, Any]]:
    """Each with its time t [s], `what` and `cause`, in order of time; thrusters by name.

    `missions` are those that were flown, in order, each with the time at which it was started [s].
    """
    found = courses(flown.t, flown.mode[:, 0].astype(int), flown.mode[:, 1].astype(int))
    if flown.health is not None:
        found += losses(flown.t, flown.health, thrusters)
    starts = [start for start, _ in missions] + [np.inf]
    for i, (start, scenario) in enumerate(missions):
        part = flown.during(start, starts[i + 1])
        if scenario.waypoints and len(part.t):
            found += without_headway(part, scenario, model)
            found += badly_placed(part, scenario)
            found += [_one(one.t, one.what, reason_for(one, model)) for one in unmet_headings(part, scenario)]
    return sorted(found, key=lambda one: one["t"])


def without_headway(flown: Flown, scenario: Scenario, model: Model) -> list[dict[str, Any]]:
    """Stalls, each reported when it had lasted so long that it counted as one."""
    return [
        _one(
            stall.start + stall.patience,
            f"no headway for {stall.patience:.0f} s, at way-point {stall.waypoint + 1} of {len(scenario.waypoints)}",
            cause(stall, flown, scenario, model),
        )
        for stall in stalls(flown, scenario, model)
    ]


def badly_placed(flown: Flown, scenario: Scenario) -> list[dict[str, Any]]:
    """Stretches in which the filter knew the position far worse than at its best before, and than the acceptance.

    Its first seconds do not count: it starts from a place that it takes as known, and settles.
    """
    variance = np.max(np.diagonal(flown.covariance, axis1=1, axis2=2)[:, :2], axis=1)
    std = np.sqrt(np.nan_to_num(variance, nan=np.inf))
    settled = flown.t - flown.t[0] > SETTLING
    accepted = np.array([w.acceptance or 0.0 for w in scenario.waypoints])
    accepted = accepted[np.clip(flown.mode[:, 2].astype(int), 0, len(accepted) - 1)]
    best, half = np.minimum.accumulate(np.where(settled, std, np.inf)), 1.96 * std
    bad = settled & (std > COARSER * best) & (half > np.maximum(accepted, 1e-9))
    found = []
    for a, b in stretches(bad):
        if flown.t[b - 1] - flown.t[a] > BRIEF:
            what = f"until {flown.t[b - 1]:.0f} s the position is known to {plain(float(half[a:b].max()))} m at worst"
            cause = f"readings of a position are missing or bad (acceptance {accepted[a]:g} m)"
            found.append(_one(float(flown.t[a]), what, cause))
    return found[:MOST_BAD]


def courses(
    t: Float[np.ndarray, " n"], phase: Real[np.ndarray, " n"], reason: Real[np.ndarray, " n"]
) -> list[dict[str, Any]]:
    """Changes to and from what is not the mission's own course; times [s], numbers of phase and reason, shape (n,)."""
    found = []
    for k in np.flatnonzero((np.diff(phase) != 0) | (np.diff(reason) != 0)) + 1:
        if phase[k] in _OWN:
            found.append(_one(t[k], PHASES[phase[k]], REASONS[reason[k]] or "operator"))
        elif phase[k - 1] in _OWN:
            found.append(_one(t[k], f"goes on ({PHASES[phase[k]]})", "operator"))
    return found


def losses(
    t: Float[np.ndarray, " n"], health: Float[np.ndarray, "n thrusters"], thrusters: Sequence[str]
) -> list[dict[str, Any]]:
    """Thrusters no longer used, and those used again; health is a share, shape (n, thrusters)."""
    lost = health < 0.5
    found = []
    for k in np.flatnonzero(np.any(lost[1:] != lost[:-1], axis=1)) + 1:
        for gone, what in ((lost[k] & ~lost[k - 1], "no longer used"), (~lost[k] & lost[k - 1], "used again")):
            if gone.any():
                names = ", ".join(name for name, one in zip(thrusters, gone, strict=True) if one)
                found.append(_one(t[k], f"{names} {what}", "the force that should be there is missing"))
    return found


def _one(t: float, what: str, cause: str) -> dict[str, Any]:
    return {"t": round(float(t), 2), "what": what, "cause": cause}
