"""Mistakes in logs, found before they become parameters: units, signs, axes, frames, clocks, gaps, clipping.

Comparisons: readings with what is possible at all (here), signals with each other (`among_signals`), accelerations
with what the thrusters push (`against_model`), places with where they push (`horizontal`). A model that is not
identified yet must raise no alarm: only patterns and factors of a slip of units count, never sizes.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import angle_between, rotation_from_euler
from rovtwin.identification.checks.against_model import check_response
from rovtwin.identification.checks.among_signals import check_motion
from rovtwin.identification.checks.findings import RANK, Finding
from rovtwin.identification.checks.horizontal import check_horizontal
from rovtwin.identification.logs.motion import Motion
from rovtwin.identification.logs.record import Record, Signal
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.physics.model import Model

FASTEST_TURN, FASTEST = 35.0, 15.0  # [rad/s] full scale of an ROV's gyro, 2000 deg/s; [m/s] no ROV does
SPIN = 12.0  # [rad/s] of an attitude between two readings
SHORTEST = 2.0  # [s]
RARE = 0.15  # [s]; commands that are read less often are judged against how fast thrusters follow
AXIS_NAMES = ("surge", "sway", "heave", "roll", "pitch", "yaw")


def check_record(record: Record, model: Model, thrusters: Sequence[str] = ()) -> list[Finding]:
    """Everything that is wrong with a record, errors first.

    Args:
        record: One test.
        model: Of the vehicle that flew it, not necessarily identified; how its thrusters act on it counts.
        thrusters: Their names; without them thrusters are numbered from 1.
    """
    found = [*check_commands(record, model), *check_readings(record)]
    if record.duration < SHORTEST:
        text = f"{record.duration:.2g} s long, expected {SHORTEST:g} s or more"
        found.append(Finding("error", "gap", "record", f"the record is {text}.", "Check span and clocks."))
    elif not any(f.severity == "error" and f.what in ("degrees", "millimetres", "beyond") for f in found):
        motion = Motion.of(record)
        found += check_motion(model, motion)
        if not any(f.severity == "error" for f in found):
            found += check_response(model, motion)
        if not any(f.severity == "error" for f in found):
            found += check_horizontal(model, motion)
    once = {(f.what, f.where): f for f in reversed(found)}
    return sorted((one.named(thrusters) for one in once.values()), key=lambda f: RANK[f.severity])


def check_commands(record: Record, model: Model) -> list[Finding]:
    """Commands by themselves: range, excitation, clipping."""
    u, found = record.command, []
    largest = float(np.abs(u).max())
    if largest > 1.0 + 1e-6:
        looks = "like PWM in microseconds" if largest > 800 else "like percent" if largest > 5 else "too large"
        fix = {"like PWM in microseconds": "Write unit: pwm.", "like percent": "Write unit: percent."}.get(
            looks, "Check the unit, or the gains of mix."
        )
        text = f"commands reach {largest:.4g}, expected -1 to 1; they look {looks}."
        return [Finding("error", "beyond", "commands", text, fix)]
    weight = np.diff(np.append(record.t_command, record.end))
    mean = (weight @ u) / weight.sum()
    moved = np.sqrt(weight @ (u - mean) ** 2 / weight.sum())
    if np.abs(u).max() < 0.01 and _swings(record):
        text = "thrusters rest and the vehicle swings: a release; it tells ratios of inertia, damping, restoring."
        return [Finding("note", "release", "commands", text, "Fit it together with a test in which thrusters push.")]
    if moved.max() < 0.01:
        text = f"no excitation: no command moves by more than {moved.max():.2g} of its range."
        fix = "Fly a test in which thrusters push; a decay test goes to `rovtwin evidence decay`."
        return [Finding("error", "no_excitation", "commands", text, fix)]
    T = np.asarray(model.thrusters.configuration)
    wrench = np.sqrt(weight @ ((u - mean) @ T.T) ** 2 / weight.sum())
    still = wrench < 0.01 * np.abs(T).sum(axis=1)
    for axis in np.flatnonzero(still & (np.abs(T).sum(axis=1) > 1e-9)):
        text = "not excited: its own parameters cannot be known from this record."
        found.append(Finding("note", "unexcited", AXIS_NAMES[axis], text, "Fly a test that pushes there too."))
    return found + _rarely_read(record, model) + _flat_tops(record, weight)


def _rarely_read(record: Record, model: Model) -> list[Finding]:
    """Commands that were read more rarely than thrusters follow them: what happened in between is not known."""
    interval, follows = record.command_interval, float(np.max(np.asarray(model.thrusters.time_constant)))
    if interval is None or interval <= max(RARE, 2.0 * follows):
        return []
    text = (
        f"read every {interval:.2g} s, while thrusters follow them within {follows:.2g} s: pushes in between are not "
        "known. Pushes held for several readings still tell thrust, drag and restoring; added mass, inertia, lags and "
        "short or fed-back pushes cannot be recognised in this record."
    )
    fix = "Use the autopilot's own log of the same dive, or ask it for servo outputs 10 times a second or more."
    return [Finding("warning", "rare", "commands", text, fix)]


def _swings(record: Record) -> bool:
    """Whether roll or pitch moves by more than 6 degrees."""
    attitude = record.signals.get("attitude")
    return attitude is not None and float(np.ptp(attitude.value[:, :2], axis=0).max()) > 0.1


def _flat_tops(record: Record, weight: Float[np.ndarray, " n"]) -> list[Finding]:
    """Commands that run smoothly and then stay at one largest value were cut off; steps between few levels were not."""
    cut = []
    for i, column in enumerate(record.command.T):
        limit = np.abs(column).max()
        at_limit = np.abs(np.abs(column) - limit) < 1e-9
        share = weight[at_limit].sum() / weight.sum()
        if limit > 0 and len(np.unique(np.round(column, 6))) > 20 and share > 0.04:
            cut.append((i, limit, share))
    if not cut:
        return []
    i, limit, share = max(cut, key=lambda c: c[2])
    text = (
        f"of {record.command.shape[1]} thrusters' commands {len(cut)} rest at the largest value again and again, "
        f"that of thruster {i + 1} at {limit:.3g} for {share:.0%} of the time."
    )
    fix = "If a limit acts after they are logged, log what it lets through; if not, all is well."
    return [Finding("warning", "clipped", "commands", text, fix)]


def check_readings(record: Record) -> list[Finding]:
    """Signals by themselves: what cannot be, and what is missing."""
    found = []
    for name, signal in record.signals.items():
        if len(signal.t) < 3:
            text = f"{len(signal.t)} readings."
            found.append(Finding("warning", "gap", name, text, "Leave the signal out, or check its clock."))
            continue
        found += _impossible(name, signal)
        found += _gaps(name, signal, record)
    return found


def _impossible(name: str, signal: Signal) -> list[Finding]:
    largest = np.abs(signal.value).max(axis=0)
    jump = np.abs(np.diff(signal.value, axis=0))
    rate = np.percentile(jump / np.maximum(np.diff(signal.t), 1e-6)[:, None], 95, axis=0)
    if name == "attitude":
        if largest[0] > np.pi + 0.1 or largest[1] > np.pi / 2 + 0.1 or (np.abs(jump[:, 2] - 360) < 40).any():
            text = f"attitude reaches {largest.max():.4g} rad, which looks like degrees."
            return [Finding("error", "degrees", name, text, "Write unit: deg.")]
        return _spins(signal)
    if name == "gyro" and largest.max() > FASTEST_TURN:
        text = f"body rates reach {largest.max():.4g} rad/s, which looks like degrees per second."
        return [Finding("error", "degrees", name, text, "Write unit: deg/s.")]
    if name == "accelerometer":
        return _gravity(signal)
    speed = largest.max() if name == "velocity" else rate.max() if name in ("position", "horizontal", "depth") else 0.0
    if speed > FASTEST and _steady(name, signal) > FASTEST:
        text = f"a speed of {speed:.4g} m/s, which looks like millimetres."
        return [Finding("error", "millimetres", name, text, f"Write unit: {'mm/s' if name == 'velocity' else 'mm'}.")]
    if name == "depth" and np.median(signal.value) < -0.3:
        text = f"depth is {np.median(signal.value):.3g} m, above the surface: it looks like z up instead of down."
        return [Finding("error", "z_up", name, text, "Write frame: up.")]
    return []


def _gravity(signal: Signal) -> list[Finding]:
    """A vehicle under water hardly accelerates: its accelerometer shows gravity, -9.81 m/s2 on z when level."""
    size, mean = float(np.median(np.linalg.norm(signal.value, axis=1))), signal.value.mean(axis=0)
    if not 0.7 * GRAVITY < size < 1.4 * GRAVITY:
        unit = "g" if 0.7 < size < 1.4 else "mm/s2" if 700 < size / GRAVITY < 1400 else None
        text = f"specific force is {size:.4g} m/s2 in the median, expected about {GRAVITY:g}."
        fix = f"Write unit: {unit}." if unit else "Check the unit; was gravity taken off? Then leave it out."
        return [Finding("error", "units", "accelerometer", text, fix)]
    if mean[2] > 0.7 * size:
        text = f"specific force is {mean[2]:.3g} m/s2 on z, expected {-GRAVITY:g} when level: z up, or its sign."
        return [Finding("error", "z_up", "accelerometer", text, "Write frame: flu, or turn the sign.")]
    return []


def _steady(name: str, signal: Signal) -> float:
    """Speed over half seconds [m/s]: noise of single readings is no speed."""
    if name == "velocity":
        return float(np.median(np.abs(signal.value).max(axis=1)) * 3)
    at = np.arange(signal.t[0], signal.t[-1], 0.5)
    mean = np.stack([np.interp(at, signal.t, column) for column in signal.value.T], axis=1)
    return float(np.percentile(np.abs(np.diff(mean, axis=0)) / 0.5, 95)) if len(at) > 2 else 0.0


def _spins(signal: Signal) -> list[Finding]:
    """Turns between readings that no vehicle makes: means and interpolations across a wrap of an angle."""
    R = rotation_from_euler(signal.value)
    turn = angle_between(R[1:], R[:-1])
    rate = turn / np.maximum(np.diff(signal.t), 1e-6)
    bad = (rate > SPIN) & (turn > 0.25) & (rate > 8 * np.percentile(rate, 90))
    if bad.any() and bad.mean() < 0.05:
        when = signal.t[1:][bad][0]
        text = f"turns of up to {np.degrees(turn[bad].max()):.0f} deg between readings, {bad.sum()} times, first at "
        text += f"{when:.2f} s: angles were averaged or interpolated where they wrap."
        fix = "Unwrap before you filter, or log a quaternion; leave those readings out."
        return [Finding("error", "wrap", "attitude", text, fix)]
    wraps = (np.abs(np.diff(signal.value[:, [0, 2]], axis=0)) > np.pi).sum()
    if wraps:
        text = f"angles wrap {wraps} times."
        return [Finding("note", "wrap", "attitude", text, "Nothing to do: angles are compared on the circle.")]
    return []


def _gaps(name: str, signal: Signal, record: Record) -> list[Finding]:
    inner = np.diff(signal.t)
    edges = np.array([signal.t[0] - record.start, record.end - signal.t[-1]])
    missing = np.concatenate(
        [inner[inner > max(8 * np.median(inner), 0.5)], edges[edges > max(0.05 * record.duration, 3.0)]]
    )
    if not len(missing):
        return []
    longest, share = missing.max(), missing.sum() / record.duration
    text = f"{len(missing)} gaps, the longest {longest:.2g} s, {share:.0%} of the record."
    fix = "Nothing inside a gap is used; fly it again where much is missing."
    return [Finding("warning", "gap", name, text, fix)]
