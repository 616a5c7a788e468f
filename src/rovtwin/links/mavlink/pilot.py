"""A pilot's input as ArduSub takes it, MANUAL_CONTROL and RC_CHANNELS_OVERRIDE, as axes in FRD.

Axes: surge, sway, heave (down), roll, pitch, yaw (clockwise), each -1 to 1. Signs are ArduSub's own (joystick.cpp,
AP_Motors6DOF.cpp): up, right, clockwise and nose up are positive sticks. MAVLink's text calls counter-clockwise a
positive `r`; ArduSub and all its ground stations do the opposite.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

FULL = 1000.0  # of a stick of MANUAL_CONTROL
ABSENT = 0x7FFF  # a stick that is not there
NEUTRAL_Z = 500  # z runs from 0 (down) to 1000 (up)
PITCH_BIT, ROLL_BIT = 1, 2  # of enabled_extensions: s and t count
NEUTRAL_PWM, HALF_PWM = 1500.0, 400.0  # RC channels run from 1100 to 1900 us
LOW_PWM, HIGH_PWM = 1100, 1900
# RC channel (from 1) -> axis and sign; ArduSub's order: pitch, roll, throttle, yaw, forward, lateral.
RC_CHANNELS = {1: (4, 1.0), 2: (3, 1.0), 3: (2, -1.0), 4: (5, 1.0), 5: (0, 1.0), 6: (1, 1.0)}
IGNORED = (0, 65535)  # values of RC_CHANNELS_OVERRIDE: channel given back, channel left as it is


@dataclass(frozen=True)
class Sticks:
    """Fields of a MANUAL_CONTROL message, as they are on the wire."""

    x: int = 0
    y: int = 0
    z: int = NEUTRAL_Z
    r: int = 0
    s: int = 0
    t: int = 0
    enabled_extensions: int = 0


def axes_of_sticks(sticks: Sticks, gain: float = 1.0) -> np.ndarray | None:
    """Axes, shape (6,), or None where a stick is not one: beyond +-1000, z outside 0 to 1000.

    INT16_MAX is MAVLink's way to say that an axis is not there; it counts as let go.
    """
    raw = np.array([sticks.x, sticks.y, sticks.z, 0, 0, sticks.r], dtype=float)
    if sticks.enabled_extensions & ROLL_BIT:
        raw[3] = sticks.t
    if sticks.enabled_extensions & PITCH_BIT:
        raw[4] = sticks.s
    absent = raw == ABSENT
    raw[2] = (NEUTRAL_Z - raw[2]) * 2.0
    raw[absent] = 0.0
    return None if np.any(np.abs(raw) > FULL) else gain * raw / FULL


def sticks_of_axes(axes: np.ndarray, gain: float = 1.0) -> Sticks:
    """MANUAL_CONTROL for axes, shape (6,); the inverse of `axes_of_sticks` within a stick's step, clipped to full."""
    x, y, down, roll, pitch, yaw = (
        int(value) for value in np.round(np.clip(np.asarray(axes, dtype=float) / gain, -1.0, 1.0) * FULL)
    )
    bits = (PITCH_BIT if pitch else 0) | (ROLL_BIT if roll else 0)
    return Sticks(x, y, NEUTRAL_Z - round(down / 2), yaw, pitch, roll, bits)


def axes_of_channels(channels: Sequence[int], before: np.ndarray) -> np.ndarray | None:
    """Axes, shape (6,), of RC channels 1 to 6 [us] on top of those before; None where a pulse is out of range.

    65535 leaves an axis as it is, 0 gives it back: it is let go.
    """
    axes = np.array(before, dtype=float)
    for channel, (axis, sign) in RC_CHANNELS.items():
        pulse = channels[channel - 1]
        if pulse == 0:
            axes[axis] = 0.0
        elif pulse not in IGNORED:
            if not LOW_PWM <= pulse <= HIGH_PWM:
                return None
            axes[axis] = sign * (pulse - NEUTRAL_PWM) / HALF_PWM
    return axes
