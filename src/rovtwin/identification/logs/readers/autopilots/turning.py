"""When a log is worth reading: thrusters turn, the autopilot is armed, and what they do is known."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

TURNING = 0.05  # command beyond which a thruster turns; ESCs leave about 25 of 400 us out
BEFORE, AFTER = 1.0, 5.0  # kept around it: how it begins, and how the motion dies [s]
SHORTEST = 2.0  # [s]
GAP = 1.0  # longest that a command is assumed to hold between two rows, at least [s]


@dataclass(frozen=True)
class Stretches:
    """Spans that are used, and why the rest is not.

    Attributes:
        used: From and to [s], in order.
        text: What was cut, in words.
    """

    used: tuple[tuple[float, float], ...]
    text: str


def stretches(t: Float[np.ndarray, " m"], u: Float[np.ndarray, "m n"], armed: list[tuple[float, bool]]) -> Stretches:
    """Spans in which thrusters turn, shortly before and after too, while armed and without a gap in the commands.

    Args:
        t: Times of the commands [s], increasing.
        u: Commands.
        armed: When it was armed or disarmed; before the first it was the other way round. Empty: nobody says.
    """
    if len(t) < 2:
        return Stretches((), f"{len(t)} rows of servo outputs")
    step = np.diff(t, append=t[-1] + np.median(np.diff(t)))
    known = step <= max(GAP, 4.0 * float(np.median(step)))
    on, turning = _armed_at(t, armed), np.abs(u).max(axis=1) > TURNING
    kept = on & known & _widened(t, turning & on)
    starts = np.flatnonzero(kept & ~np.concatenate([[False], kept[:-1]]))
    ends = np.flatnonzero(kept & ~np.concatenate([kept[1:], [False]]))
    spans = [(float(t[a]), float(t[b] + step[b])) for a, b in zip(starts, ends, strict=True)]
    used = tuple(span for span in spans if span[1] - span[0] >= SHORTEST)
    lost = {
        "disarmed": float(step[known & ~on].sum()),
        "with thrusters at rest": float(step[known & on & ~kept].sum()),
        "without servo outputs": float(step[~known].sum()),
        "in pieces too short": sum(b - a for a, b in spans if b - a < SHORTEST),
    }
    cut = ", ".join(f"{length:.1f} s {why}" for why, length in lost.items() if length > 0.05)
    text = ", ".join(f"{a:.1f} to {b:.1f} s" for a, b in used) or "nothing"
    return Stretches(used, f"used: {text} of {t[0]:.1f} to {t[-1]:.1f} s; cut: {cut or 'nothing'}")


def _armed_at(t: Float[np.ndarray, " m"], armed: list[tuple[float, bool]]) -> Bool[np.ndarray, " m"]:
    if not armed:
        return np.ones(len(t), bool)
    times = np.array([when for when, _ in armed])
    states = np.array([not armed[0][1], *(state for _, state in armed)])
    return states[np.searchsorted(times, t, side="right")]


def _widened(t: Float[np.ndarray, " m"], turning: Bool[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
    """Rows that are at most BEFORE earlier or AFTER later than one in which a thruster turns."""
    when = t[turning]
    if not len(when):
        return np.zeros(len(t), bool)
    following = np.searchsorted(when, t, side="left")
    later = when[np.minimum(following, len(when) - 1)] - t
    earlier = t - when[np.maximum(np.searchsorted(when, t, side="right") - 1, 0)]
    return ((later >= 0) & (later <= BEFORE)) | ((earlier >= 0) & (earlier <= AFTER))
