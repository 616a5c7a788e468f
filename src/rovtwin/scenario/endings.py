"""Why a rule ended a run, in words: angle and speed of what tipped over, force and flow of what fell short."""

import math

import numpy as np
from scipy.spatial.transform import Rotation

from rovtwin.core.flow import REASONS
from rovtwin.scenario.limits import Limits
from rovtwin.scenario.score import Flown
from rovtwin.vehicle import Model
from rovtwin.vehicle.constants import AXES
from rovtwin.vehicle.trim import stability

TIPPING, SHORT = 5.0, 30.0  # what ends a run has its effect within this time [s]
LIMIT = 0.9  # share of a limit from which thrust counts as used up
SURGE, PITCH, YAW = 0, 4, 5


def why_ended(flown: Flown, model: Model, reason: str) -> str:
    """Words beside the reason of a rule; empty where the reason says it all."""
    known = {"attitude limit": tipped, "saturated": fell_short}
    return known[reason](flown, model) if reason in known else ""


def fell_short(flown: Flown, model: Model) -> str:
    """Why thrusters did not do: what was asked of those that were at their limit, and the water that asked for it."""
    rows = _before(flown, "saturated", SHORT)
    if flown.tau is None or not rows.any():
        return ""
    limits, asked = Limits.of(model), np.abs(flown.tau[rows]).mean(axis=0)
    spent = [i for i in range(6) if limits.can(i) and asked[i] > LIMIT * limits.both_ways(i)]
    # Axes that share thrusters fall short together though none of them is at its own limit.
    shown = spent or sorted(range(6), key=lambda i: -asked[i] / max(limits.both_ways(i), 1e-9) * limits.can(i))[:2]
    units = ["N"] * 3 + ["N m"] * 3
    text = ", ".join(f"{asked[i]:.2g} of {limits.both_ways(i):.2g} {units[i]} in {AXES[i]}" for i in shown)
    text = f"over the last {SHORT:.0f} s it was asked for {text}"
    speed = float(np.linalg.norm(_through(flown, rows), axis=1).mean())
    if flown.water is None:
        return text
    text += f", at {speed:.2g} m/s through the water"
    if YAW in spent and speed > limits.turns_in:
        return f"{text}: it turns its bow in up to {limits.turns_in:.2g} m/s; wait for less current"
    return f"{text}: wait for less current, or give it stronger thrusters"


def tipped(flown: Flown, model: Model) -> str:
    """Why the attitude limit ended a run: angle, the fastest it went just before, and up to which it stays level."""
    at = _ended(flown, "attitude limit")
    roll, pitch = np.degrees(flown.eta[at, 3:5])
    pitched = abs(pitch) >= abs(roll)
    through = _through(flown, _before(flown, "attitude limit", TIPPING))
    speeds = np.linalg.norm(through, axis=1)
    fastest = int(np.argmax(speeds))
    speed = float(speeds[fastest])
    clauses = (
        f"at {flown.t[at]:.1f} s {'pitch' if pitched else 'roll'} was {pitch if pitched else roll:.0f} deg, and its"
    )
    clauses += f" speed {'over ground' if flown.water is None else 'through the water'} had come to {speed:.2g} m/s"
    if not pitched or Limits.of(model).can(PITCH):
        return clauses
    level = stability(model, astern=bool(through[fastest, SURGE] < 0.0)).pitch_depth_held
    if not math.isfinite(level):
        return clauses
    clauses += f"; with its depth held it stays level up to {level:.2g} m/s"
    return f"{clauses}: fly slower, or raise BG" if speed > level else clauses


def _ended(flown: Flown, reason: str) -> int:
    return int(np.argmax(flown.mode[:, 1] == REASONS.index(reason)))


def _before(flown: Flown, reason: str, seconds: float) -> np.ndarray:
    """Samples of the last seconds before a rule ended the run, shape (n,), bool."""
    at = flown.t[_ended(flown, reason)]
    return (flown.t >= at - seconds) & (flown.t <= at)


def _through(flown: Flown, rows: np.ndarray) -> np.ndarray:
    """Velocity through the water, b [m/s], over ground where nobody knows the water, shape (m, 3)."""
    velocity = flown.nu[rows, :3]
    if flown.water is None:
        return velocity
    attitude = Rotation.from_euler("ZYX", flown.eta[rows, 5:2:-1])
    return velocity - attitude.inv().apply(flown.water[rows])
