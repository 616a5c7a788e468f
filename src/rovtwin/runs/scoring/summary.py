"""The summary of a run: its scores with what only the scenario knows, such as the best filter's bound."""

from typing import Any

import numpy as np

from rovtwin.core.flow import GO, HOLD
from rovtwin.core.numerics import as_array, jax
from rovtwin.runs.compose.composition import Simulation
from rovtwin.runs.compose.world import relief_of
from rovtwin.runs.feasibility.mission import judge
from rovtwin.runs.scoring.contacts import touched
from rovtwin.runs.scoring.decisions import decisions
from rovtwin.runs.scoring.depths import not_at_depth
from rovtwin.runs.scoring.endings import why_ended
from rovtwin.runs.scoring.failures import broken_force, failed_block
from rovtwin.runs.scoring.headings import unmet_headings
from rovtwin.runs.scoring.scores import Flown, nees_interval, score, score_test
from rovtwin.runs.scoring.stalls import unfinished
from rovtwin.scenario.schema import Scenario


def summarise(flown: Flown, simulation: Simulation, interrupted: bool) -> dict[str, Any]:
    """Scores, why the mission was not completed where it was not, NEES interval and the bound of the best filter."""
    judged, twin = not simulation.scenario.test, simulation.loop.twin
    figures = score(flown) if judged else score_test(flown)
    deep = not_at_depth(flown, simulation.scenario, simulation.model) if figures["completed"] and judged else ""
    broken = broken_force(flown, simulation.scenario)
    figures["completed"] = figures["completed"] and not deep and not broken
    interrupted = (
        interrupted and not figures["completed"] and not deep
    )  # Ctrl-C in the last second of a mission changes nothing
    low, high = nees_interval([figures]) if judged else (None, None)
    if broken:
        reason = broken
    elif interrupted:
        reason = "interrupted"
    elif figures["completed"]:
        reason = ""
    else:
        reason = deep or figures["reason"] or not_finished(flown, simulation)
    speed = float(np.sqrt(np.mean(np.sum(flown.nu[:, :2] ** 2, axis=1))))
    altitude = altitude_error(flown, simulation.scenario)
    if altitude is not None:
        figures["depth_rms_m"] = None  # the depth asked for leads the floor: no error of the vehicle
    return figures | {
        "reason": reason,
        "why": failed_block(flown, simulation.scenario) or why_ended(flown, twin.model, reason),
        "interrupted": interrupted,
        "foreseen": [finding.line for finding in judge(simulation.scenario, twin.model, sensors=twin.sensors)],
        "altitude_rms_m": altitude,
        "unmet": [one.line for one in unmet_headings(flown, simulation.scenario)],
        "touched": touched(flown, twin.model, twin.world, not judged),
        "decisions": decisions(flown, simulation.thruster_names, [(0.0, simulation.scenario)], simulation.model),
        "nees_position_interval": [low, high] if judged else None,
        "bound_position_m": simulation.bound(speed) if judged and np.isfinite(speed) else None,
        "speed_rms_m_s": speed,
        "mismatch": simulation.mismatch,
    }


def ending(flown: Flown, simulation: Simulation, reason: str) -> str:
    """How a flight that was not completed ended, when and why, in one line.

    Args:
        flown: The flight.
        simulation: What flew it.
        reason: Of its rule, empty where none ended it.
    """
    if not reason:
        return not_finished(flown, simulation)
    why = failed_block(flown, simulation.scenario) or why_ended(flown, simulation.loop.twin.model, reason)
    return f"{reason} after {flown.duration:.0f} s" + (f", {why}" if why else "")


def not_finished(flown: Flown, simulation: Simulation) -> str:
    """That the time was over, and why: where it stalled, or how much is left."""
    why = unfinished(flown, simulation.scenario, simulation.model, simulation.vehicle)
    return f"not finished after {flown.duration:.0f} s: {why}"


def altitude_error(flown: Flown, scenario: Scenario) -> float | None:
    """Rms of altitude less the desired one [m], on legs and holds whose way-point has one; None where none has."""
    desired = np.array([w.altitude or 0.0 for w in scenario.waypoints])
    floor = scenario.world.floor
    if floor is None or not desired.any():
        return None
    asked = desired[np.clip(flown.mode[:, 2].astype(int), 0, len(desired) - 1)]
    follows = np.isin(flown.mode[:, 0], (GO, HOLD)) & (asked > 0.0)
    if not follows.any():
        return None
    relief, eta = relief_of(scenario.world), flown.eta[follows]
    below = floor if relief is None else np.asarray(jax.vmap(lambda at: relief.under(at)[0])(as_array(eta[:, :2])))
    return float(np.sqrt(np.mean((below - eta[:, 2] - asked[follows]) ** 2)))
