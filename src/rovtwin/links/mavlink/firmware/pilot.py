"""A pilot's input as ArduSub takes it, MANUAL_CONTROL and RC_CHANNELS_OVERRIDE, as axes in FRD.

Axes: surge, sway, heave (down), roll, pitch, yaw (clockwise), each -1 to 1. Signs are ArduSub's own (joystick.cpp,
AP_Motors6DOF.cpp): up, right, clockwise and nose up are positive sticks. MAVLink's text calls counter-clockwise a
positive `r`; ArduSub and all its ground stations do the opposite.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

FULL = 1000.0  # of a stick of MANUAL_CONTROL
ABSENT = 0x7FFF  # a stick that is not there
NEUTRAL_Z = 500  # z runs from 0 (down) to 1000 (up)
PITCH_BIT, ROLL_BIT = 1, 2  # of enabled_extensions: that s and t are meant
EXTENDED_SINCE = (4, 5)  # ArduSub that takes s and t; those before leave them unread
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


def pulses_of_sticks(
    sticks: Sticks, gain: float, throttle: float = 1.0, extended: bool = True
) -> Float[np.ndarray, "6"] | None:
    """Pulses of RC channels 1 to 6 [us] that ArduSub makes of sticks; None where a stick is not one.

    x, y, z and r go by the pilot's gain. s and t are microseconds as they are, whatever the gain and
    enabled_extensions say, in versions that take them (`extended`). Channels are whole microseconds, rounded down, of
    numbers of single precision (ArduSub/joystick.cpp; a BlueROV2's telemetry has the same to the microsecond).

    INT16_MAX is MAVLink's way to say that an axis is not there; it counts as let go. Beyond +-1000, and z outside 0
    to 1000, a stick is none. ArduSub knows neither: it takes what comes and cuts the pulse to 1100 to 1900 us.
    """
    raw = np.array([sticks.s, sticks.t, sticks.z, sticks.r, sticks.x, sticks.y], dtype=float)
    absent = raw == ABSENT
    raw[absent] = np.where(np.arange(6) == 2, NEUTRAL_Z, 0.0)[absent]
    if np.any(np.abs(raw) > FULL) or raw[2] < 0.0:
        return None
    single, gain, throttle = np.float32, float(np.float32(gain)), float(np.float32(throttle))
    scale = single(2.0 * HALF_PWM / FULL * gain * throttle)
    up = single(raw[2]) * scale + np.floor(single(NEUTRAL_PWM) - single(NEUTRAL_Z) * scale)
    others = raw[3:].astype(single) * single(HALF_PWM / FULL * gain) + single(NEUTRAL_PWM)
    turns = NEUTRAL_PWM + (raw[:2] if extended else 0.0 * raw[:2])
    return np.clip(np.floor(np.array([*turns, up, *others], dtype=float)), LOW_PWM, HIGH_PWM)


def axes_of_sticks(
    sticks: Sticks, gain: float, throttle: float = 1.0, extended: bool = True
) -> Float[np.ndarray, "6"] | None:
    """Axes, None where a stick is not one, see `pulses_of_sticks`."""
    pulses = pulses_of_sticks(sticks, gain, throttle, extended)
    return None if pulses is None else axes_of_channels([int(pulse) for pulse in pulses], np.zeros(6))


def sticks_of_axes(axes: Float[np.ndarray, "6"], gain: float, throttle: float = 1.0, extended: bool = True) -> Sticks:
    """MANUAL_CONTROL for axes; the inverse of `axes_of_sticks` within a microsecond, clipped to full.

    Args:
        axes: Surge to yaw; without `extended` roll and pitch stay still.
        gain: Of the pilot, JS_GAIN_DEFAULT or PilotGain.
        throttle: JS_THR_GAIN.
        extended: Whether the vehicle takes s and t.
    """
    ahead, right, down, roll, pitch, yaw = np.clip(np.asarray(axes, dtype=float), -1.0, 1.0)
    x, y, r = (round(float(np.clip(axis / gain, -1.0, 1.0)) * FULL) for axis in (ahead, right, yaw))
    z = NEUTRAL_Z - round(float(np.clip(down / (gain * throttle), -1.0, 1.0)) * NEUTRAL_Z)
    s, t = (round(float(axis) * HALF_PWM) if extended else 0 for axis in (pitch, roll))
    return Sticks(x, y, z, r, s, t, (PITCH_BIT if s else 0) | (ROLL_BIT if t else 0))


def pulses_of_axes(axes: Float[np.ndarray, "6"]) -> list[int]:
    """Pulses of RC channels 1 to 6 [us] of axes, shape (6,): the inverse of `axes_of_channels` to a microsecond."""
    turned = np.clip(np.nan_to_num(np.asarray(axes, dtype=float)), -1.0, 1.0)
    return [round(NEUTRAL_PWM + HALF_PWM * sign * float(turned[axis])) for axis, sign in RC_CHANNELS.values()]


def axes_of_channels(channels: Sequence[int], before: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6"] | None:
    """Axes of RC channels 1 to 6 [us] on top of those before; None where a pulse is out of range.

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
