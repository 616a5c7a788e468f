"""GUIDED: SET_POSITION_TARGET_LOCAL_NED and its global sister, as a place to go to or as a velocity to keep.

SET_ATTITUDE_TARGET becomes a velocity too: a turn to its heading, and up or down by its thrust.
"""

import math
from dataclasses import dataclass
from typing import Any

from rovtwin.core.arrays.rotations import heading_rotation
from rovtwin.core.datum import FARTHEST, Datum
from rovtwin.core.errors import ConfigError

# MAV_FRAME
LOCAL_NED, LOCAL_OFFSET_NED, BODY_NED, BODY_OFFSET_NED, BODY_FRD = 1, 7, 8, 9, 12
RELATIVE = (LOCAL_OFFSET_NED, BODY_NED, BODY_OFFSET_NED, BODY_FRD)  # places are steps from where the vehicle is
ALONG_HEADING = (BODY_NED, BODY_OFFSET_NED, BODY_FRD)  # x ahead, y to the right; level, also BODY_FRD
GLOBAL, GLOBAL_RELATIVE = (0, 5), (3, 6)  # height over the ellipsoid; over the water
# POSITION_TARGET_TYPEMASK: what to ignore
IGNORE_PLACE, IGNORE_VELOCITY = (1, 2, 4), (8, 16, 32)
IGNORE_YAW, IGNORE_YAW_RATE = 1024, 2048
IGNORE_THRUST_OR_ATTITUDE = 64 | 128  # ATTITUDE_TARGET_TYPEMASK
LEVEL = 0.1  # roll or pitch that is level enough to be flown by a vehicle that keeps level by itself [rad]
TURN_GAIN = 1.0  # rate of turn by what is missing of the heading [1/s]

Place = tuple[float, float, float, float]  # north, east, down [m], heading [rad]


@dataclass(frozen=True)
class Order:
    """What a set-point asks for: a place, or a velocity, or, with a refusal, nothing.

    Attributes:
        target: Place in n and heading, or None.
        velocity: Ahead, right, down [m/s] and turn rate [rad/s], or None.
        refusal: Why it cannot be done, in words; empty when it can.
    """

    target: Place | None = None
    velocity: tuple[float, float, float, float] | None = None
    refusal: str = ""


def order_of_local(message: Any, here: Place | None, before: Place | None) -> Order:
    """Order of a SET_POSITION_TARGET_LOCAL_NED.

    Args:
        message: With its fields; they may be no numbers.
        here: Where the vehicle is, or None while it does not know.
        before: The place it was last sent to, for what the message leaves out.
    """
    frame, mask = message.coordinate_frame, message.type_mask
    if frame != LOCAL_NED and frame not in RELATIVE:
        return Order(refusal=f"frame {frame} is not known")
    asked = [not mask & bit for bit in IGNORE_PLACE]
    if any(asked):
        if here is None:
            return Order(refusal="the vehicle does not know where it is")
        return _place(message, asked, here, before)
    return _velocity(message, here)


def order_of_global(message: Any, here: Place | None, before: Place | None, datum: Datum, ground: float) -> Order:
    """Order of a SET_POSITION_TARGET_GLOBAL_INT: places only; `ground` as of `order_to`."""
    if any(message.type_mask & bit for bit in IGNORE_PLACE):
        return Order(refusal="of global set-points only whole places are taken")
    heading = _heading(message, False, here, before)
    return order_to(message.lat_int, message.lon_int, message.alt, message.coordinate_frame, heading, datum, ground)


def order_to(
    latitude: int, longitude: int, altitude: float, frame: int, heading: float, datum: Datum, ground: float
) -> Order:
    """Order to go to a place on the map.

    Args:
        latitude: [1e-7 deg].
        longitude: [1e-7 deg].
        altitude: Over the ellipsoid or over home, by the frame [m]; it may be no number.
        frame: MAV_FRAME.
        heading: [rad].
        datum: Origin of n.
        ground: Height of home over the ellipsoid [m].
    """
    if frame not in GLOBAL + GLOBAL_RELATIVE:
        return Order(refusal="of global set-points only heights over the ellipsoid or over home are taken")
    depth = datum.height - altitude - (ground if frame in GLOBAL_RELATIVE else 0.0)
    if not abs(depth) <= FARTHEST:  # also what is no number
        return Order(refusal=f"a height of {altitude:g} m is none of a vehicle's")
    try:
        north, east, down = (float(v) for v in datum.position(latitude * 1e-7, longitude * 1e-7, depth))
    except ConfigError as error:
        return Order(refusal=str(error))
    return _checked((north, east, down, heading))


def order_of_attitude(message: Any, here: Place | None, climb: float) -> Order:
    """Order of a SET_ATTITUDE_TARGET, as ArduSub takes it: attitude and thrust together, 0.5 keeps the depth.

    Args:
        message: With its fields; they may be no numbers.
        here: Where the vehicle is, or None while it does not know.
        climb: Rate up or down of all thrust [m/s].
    """
    if message.type_mask & IGNORE_THRUST_OR_ATTITUDE:
        return Order(refusal="attitude and thrust are taken together only")
    if here is None:
        return Order(refusal="the vehicle does not know where it is")
    w, x, y, z = message.q
    size = math.hypot(w, x, y, z)
    if not 0.5 < size < 2.0 or not math.isfinite(message.thrust):  # also what is no number
        return Order(refusal="the set-point is no attitude")
    roll = math.atan2(2.0 * (w * x + y * z), w * w - x * x - y * y + z * z)
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - x * z) / size**2)))
    if max(abs(roll), abs(pitch)) > LEVEL:
        return Order(refusal="it keeps level: no roll or pitch is flown")
    heading = math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
    up = (max(0.0, min(1.0, message.thrust)) - 0.5) * 2.0 * climb
    return Order(velocity=(0.0, 0.0, -up, TURN_GAIN * math.remainder(heading - here[3], math.tau)))


def _place(message: Any, asked: list[bool], here: Place, before: Place | None) -> Order:
    frame = message.coordinate_frame
    # A coordinate that is ignored is neither a step nor a place: leave it out before turning.
    step = [value if is_set else 0.0 for value, is_set in zip((message.x, message.y, message.z), asked, strict=True)]
    if frame in ALONG_HEADING:
        step[:2] = _turned(step[0], step[1], here[3])
        asked = [True, True, asked[2]] if asked[0] or asked[1] else asked
    kept = before or here
    base = here[:3] if frame in RELATIVE else (0.0, 0.0, 0.0)
    place = [base[i] + step[i] if asked[i] else kept[i] for i in range(3)]
    return _checked((place[0], place[1], place[2], _heading(message, frame in ALONG_HEADING, here, before)))


def _velocity(message: Any, here: Place | None) -> Order:
    mask = message.type_mask
    parts = [
        (message.vx, message.vy, message.vz)[i] if not mask & bit else 0.0 for i, bit in enumerate(IGNORE_VELOCITY)
    ]
    turn = message.yaw_rate if not mask & IGNORE_YAW_RATE else 0.0
    if all(mask & bit for bit in IGNORE_VELOCITY) and mask & IGNORE_YAW_RATE:
        return Order(refusal="it asks neither for a place nor for a velocity")
    if message.coordinate_frame not in ALONG_HEADING:
        if here is None:
            return Order(refusal="the vehicle does not know its heading")
        parts[:2] = _turned(parts[0], parts[1], -here[3])
    velocity = (parts[0], parts[1], parts[2], turn)
    if not all(math.isfinite(v) for v in velocity):
        return Order(refusal="the set-point is no number")
    return Order(velocity=velocity)


def _heading(message: Any, relative: bool, here: Place | None, before: Place | None) -> float:
    if message.type_mask & IGNORE_YAW:
        kept = before or here
        return kept[3] if kept else 0.0
    return message.yaw + (here[3] if relative and here else 0.0)


def _turned(x: float, y: float, angle: float) -> list[float]:
    return (heading_rotation(angle) @ (x, y)).tolist()


def _checked(target: Place) -> Order:
    if not all(math.isfinite(value) for value in target):
        return Order(refusal="the set-point is no number")
    if math.dist((0.0, 0.0, 0.0), target[:3]) > FARTHEST:
        return Order(refusal=f"the place is further than {FARTHEST / 1000:g} km from the origin")
    down = max(0.0, target[2])  # a height above the water is its surface
    return Order(target=(target[0], target[1], down, math.remainder(target[3], math.tau)))
