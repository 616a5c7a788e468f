"""Packets of ArduPilot's JSON backend: servo outputs in, the state of the physics out.

Source: the project's verified wire facts; ArduPilot, libraries/SITL/SIM_JSON.h (16 and 32 channels, order of the
quaternion) and SIM_JSON.cpp (its parser: keys without a space after the colon, the last line between two newlines).
"""

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import LinkError

FORMATS = {18458: struct.Struct("<HHI16H"), 29569: struct.Struct("<HHI32H")}  # by magic
SLOWEST = 50  # frames a second below which no firmware can steer [Hz]


@dataclass(frozen=True)
class Servos:
    """One packet of the firmware.

    Attributes:
        rate: Frames a second that it wants the physics to take, [Hz].
        count: Number of the frame; the same one again asks for the same answer.
        pwm: Pulse widths [us], 16 or 32 of them; 0 is no output.
    """

    rate: int
    count: int
    pwm: tuple[int, ...]


@dataclass(frozen=True)
class State:
    """What the firmware's sensors are made from.

    Attributes:
        timestamp: Time of the physics, going forward [s].
        gyro: Angular velocity in b [rad/s].
        specific_force: In b, at the IMU: (0, 0, -9.81) at rest and level [m/s2].
        position: North, east, down of the place the firmware was started at [m].
        velocity: Over ground in n [m/s].
        quaternion: Scalar first, b to n.
    """

    timestamp: float
    gyro: Float[np.ndarray, "3"]
    specific_force: Float[np.ndarray, "3"]
    position: Float[np.ndarray, "3"]
    velocity: Float[np.ndarray, "3"]
    quaternion: Float[np.ndarray, "4"]


def decode_servos(data: bytes) -> Servos:
    """A datagram as servo outputs.

    Raises:
        LinkError: It is none.
    """
    magic = int.from_bytes(data[:2], "little") if len(data) >= 2 else -1
    found = FORMATS.get(magic)
    if found is None or len(data) != found.size:
        raise LinkError(
            f"ardusub-json: a packet of {len(data)} bytes with magic {magic}: expected 40 bytes with 18458 or 72 with "
            "29569. Is it ArduSub with --model JSON that sends here?"
        )
    _, rate, count, *pwm = found.unpack(data)
    if rate < SLOWEST:
        raise LinkError(f"ardusub-json: a frame rate of {rate} Hz: expected at least {SLOWEST}")
    return Servos(rate, count, tuple(pwm))


def encode_servos(servos: Servos) -> bytes:
    """The datagram that the firmware sends: for tests."""
    magic = 18458 if len(servos.pwm) == 16 else 29569
    return FORMATS[magic].pack(magic, servos.rate, servos.count, *servos.pwm)


def encode_state(state: State) -> bytes:
    """The answer: one line of JSON between newlines.

    Raises:
        LinkError: A value is no number, or has the wrong shape: the firmware would take 0 for it.
    """
    body = {
        "timestamp": _listed("timestamp", [state.timestamp], 1)[0],
        "imu": {
            "gyro": _listed("gyro", state.gyro, 3),
            "accel_body": _listed("specific_force", state.specific_force, 3),
        },
        "position": _listed("position", state.position, 3),
        "velocity": _listed("velocity", state.velocity, 3),
        "quaternion": _listed("quaternion", state.quaternion, 4),
    }
    return b"\n" + json.dumps(body, separators=(",", ":")).encode() + b"\n"


def _listed(name: str, values: Sequence[float] | np.ndarray, size: int) -> list[float]:
    array = np.asarray(values, dtype=float)
    if array.shape != (size,) or not np.all(np.isfinite(array)):
        raise LinkError(f"ardusub-json: {name} is {array.tolist()}: expected {size} finite numbers from the physics")
    return array.tolist()
