"""Why a rule ended a run, in words.

Angle and speed of what tipped over, force and flow of what fell short, how far off its course a vehicle was and what
was asked of its thrusters there.
"""

import math

import numpy as np
from jaxtyping import Bool, Float, Shaped

from rovtwin.core.arrays.rotations import quaternion_from_euler, tilt_of
from rovtwin.core.flow import REASONS
from rovtwin.gnc.safety.off_course import limits_of
from rovtwin.runs.limits import Limits, compass_point
from rovtwin.runs.scoring.scores import Flown, distance_to_leg
from rovtwin.vehicle import Model
from rovtwin.vehicle.analysis.stability import stability
from rovtwin.vehicle.constants import AXES

TIPPING, SHORT = 5.0, 30.0  # what ends a run has its effect within this time [s]
AMISS = 0.25  # share of a force by which what was given is another one
LITTLE = 0.02  # of the largest force
LIMIT = 0.9  # share of a limit from which thrust counts as used up
SURGE, SWAY, HEAVE, ROLL, PITCH, YAW = range(6)
_CHECK = "check its thrusters one by one (dead, reversed, fouled), and its tether"


def why_ended(flown: Flown, model: Model, reason: str) -> str:
    """Words beside the reason of a rule; empty where the reason says it all."""
    known = {"attitude limit": tipped, "saturated": fell_short, "off course": strayed, "off depth": left_depth}
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
    if spent == [HEAVE]:
        ballast = "weight and buoyancy (rovtwin vehicle ballast)"
        return f"{text}: check its heave thrusters (dead, reversed, fouled), and its {ballast}"
    speed = float(np.linalg.norm(_through(flown, rows), axis=1).mean())
    if flown.water is None:
        return text
    text += f", at {speed:.2g} m/s through the water"
    if YAW in spent and speed > limits.turns_in:
        return f"{text}: it turns its bow in up to {limits.turns_in:.2g} m/s; wait for less current"
    return f"{text}: wait for less current, check its thrusters (dead, reversed, fouled), or give it stronger ones"


def strayed(flown: Flown, model: Model) -> str:
    """How far from its set-point the vehicle was, where, whether it came nearer before, and what was asked for."""
    at, rows = _last_before(flown, "off course", float(limits_of(model).after[0]))
    if flown.setpoint is None:
        return ""
    off = (flown.eta_hat - flown.setpoint)[rows, :2]
    distance, where = np.hypot(*off.T), "its set-point"
    beside = distance_to_leg(flown.eta_hat[rows, :3], flown.leg[rows])
    if distance[-1] < limits_of(model).step and beside[-1] > distance[-1]:
        distance, where = beside, "its leg"  # course keeping puts the set-point beside the vehicle
        text = f"{beside[-1]:.2g} m off {where}"
    else:
        text = f"{distance[-1]:.2g} m {compass_point(math.atan2(off[-1, 1], off[-1, 0]))} of {where}"
    since = _since(flown, rows, distance)
    return f"at {flown.t[at]:.1f} s it was {text}, {since}{_of_thrusters(flown, rows, model, (0, 1))}"


def left_depth(flown: Flown, model: Model) -> str:
    """The same of its depth."""
    at, rows = _last_before(flown, "off depth", float(limits_of(model).after[1]))
    if flown.setpoint is None:
        return ""
    below = (flown.eta_hat - flown.setpoint)[rows, 2]
    text = f"{abs(below[-1]):.2g} m {'below' if below[-1] > 0 else 'above'} its depth of {flown.setpoint[at, 2]:.3g} m"
    since = _since(flown, rows, np.abs(below))
    return f"at {flown.t[at]:.1f} s it was {text}, {since}{_of_thrusters(flown, rows, model, (2,))}"


def _last_before(flown: Flown, reason: str, seconds: float) -> tuple[int, Bool[np.ndarray, " n"]]:
    """The last sample before a rule acted, and the samples of so long before it."""
    at = max(_ended(flown, reason) - 1, 0)
    return at, (flown.t >= flown.t[at] - seconds) & (flown.t <= flown.t[at])


def _since(flown: Flown, rows: Shaped[np.ndarray, " rows"], distance: Float[np.ndarray, " n"]) -> str:
    """Whether a distance [m] grew over these samples."""
    grown, seconds = float(distance[-1] - distance[0]), float(np.ptp(flown.t[rows]))
    return f"{abs(grown):.2g} m {'farther' if grown >= 0 else 'nearer'} than {seconds:.0f} s before"


def _of_thrusters(flown: Flown, rows: Shaped[np.ndarray, " rows"], model: Model, axes: tuple[int, ...]) -> str:
    """What was asked of these axes on average, of what they have, and what they gave where that is another force."""
    if flown.tau is None:
        return ""
    limits, asked, gave = Limits.of(model), flown.tau[rows].mean(axis=0), _gave(flown, rows, model)
    has = []
    for i in (axis for axis in axes if limits.can(axis)):
        most = limits.both_ways(i)
        has.append(f"{abs(asked[i]):.2g} of {most:.3g} N in {AXES[i]}{_short_of(asked[i], gave[i], most)}")
    return f"; asked for {', '.join(has)} on average" if has else ""


def _gave(flown: Flown, rows: Shaped[np.ndarray, " rows"], model: Model) -> Float[np.ndarray, "6"]:
    """Mean wrench of the thrusters in these samples, b at CO; NaN where nobody kept their forces."""
    t = flown.t[0] + flown.control_dt * np.arange(len(flown.thrust))
    ticks = (t >= flown.t[rows][0]) & (t <= flown.t[rows][-1])
    if not ticks.any() or flown.thrust.shape[1] != model.thrusters.count:  # of a real vehicle
        return np.full(6, np.nan)
    return np.asarray(model.thrusters.configuration) @ flown.thrust[ticks].mean(axis=0)


def _short_of(asked: float, gave: float, limit: float) -> str:
    """That thrusters gave another force than was asked for, by more than a fourth and by more than a little."""
    if not abs(gave - asked) > max(AMISS * abs(asked), LITTLE * limit):
        return ""
    return f" (they gave {abs(gave):.2g}{' the other way' if gave * asked < 0.0 else ''})"


def tipped(flown: Flown, model: Model) -> str:
    """Why the attitude limit ended a run: angle, the fastest it went just before, and up to which it stays level."""
    at = _ended(flown, "attitude limit")
    roll, pitch = np.degrees(tilt_of(quaternion_from_euler(flown.eta[at, 3:])))
    pitched, tilt = abs(pitch) >= abs(roll), math.hypot(roll, pitch)
    angle = pitch if pitched else roll
    through = _through(flown, _before(flown, "attitude limit", TIPPING))
    speeds = np.linalg.norm(through, axis=1)
    fastest = int(np.argmax(speeds))
    speed = float(speeds[fastest])
    both = f", tilt {tilt:.0f} deg" if tilt > abs(angle) + 1.0 else ""
    clauses = f"at {flown.t[at]:.1f} s {'pitch' if pitched else 'roll'} was {angle:.0f} deg{both}, and its"
    clauses += f" speed {'over ground' if flown.water is None else 'through the water'} had come to {speed:.2g} m/s"
    if pitched and Limits.of(model).can(PITCH):
        return clauses
    stable = stability(model, astern=bool(through[fastest, SURGE] < 0.0))
    level = stable.pitch_depth_held if pitched else stable.roll_static
    if not math.isfinite(level):
        return clauses
    if not pitched:
        speed = float(np.abs(through[:, SWAY]).max())
        if speed < level:
            return f"{clauses}, which does not tip it: {_CHECK}"
        clauses += f", {speed:.2g} m/s of it sideways"
    held = "with its depth held" if pitched or not Limits.of(model).can(ROLL) else "without control in roll"
    clauses += f"; {held} it stays level up to {level:.2g} m/s{'' if pitched else ' in sway'}"
    return f"{clauses}: fly slower, or raise BG" if speed > level else f"{clauses}: {_CHECK}"


def _ended(flown: Flown, reason: str) -> int:
    return int(np.argmax(flown.mode[:, 1] == REASONS.index(reason)))


def _before(flown: Flown, reason: str, seconds: float) -> Bool[np.ndarray, " n"]:
    """Samples of the last seconds before a rule ended the run."""
    at = flown.t[_ended(flown, reason)]
    return (flown.t >= at - seconds) & (flown.t <= at)


def _through(flown: Flown, rows: Shaped[np.ndarray, " rows"]) -> Float[np.ndarray, "m 3"]:
    """Velocity through the water, b [m/s], over ground where nobody knows the water."""
    velocity = flown.nu[rows, :3]
    if flown.water is None:
        return velocity
    from scipy.spatial.transform import Rotation

    attitude = Rotation.from_euler("ZYX", flown.eta[rows, 5:2:-1])
    return velocity - attitude.inv().apply(flown.water[rows])
