"""What we hear in messages of ROS, as readings and commands in our frames: pure functions that raise only LinkError.

The middleware has checked the bytes; here are the meanings: what is not finite, not a unit quaternion, of a wrong
length or in an unknown frame is refused. A part that a message says it lacks gives no reading.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import LinkError
from rovtwin.links.ros2 import convert
from rovtwin.links.ros2 import messages as msg

Readings = dict[str, np.ndarray]


def finite(what: str, values: Sequence[float]) -> Float[np.ndarray, " n"]:
    """Numbers of a message.

    Raises:
        LinkError: One is not finite, or too large to compute with.
    """
    found = np.array([float(x) for x in values])
    if not (np.abs(found) < 1e12).all():
        raise LinkError(f"{what}: found {found.tolist()[:6]}, expected finite numbers")
    return found


def _xyz(what: str, vector: Any) -> Float[np.ndarray, "3"]:
    return finite(what, (vector.x, vector.y, vector.z))


def _euler(q: msg.Quaternion) -> Float[np.ndarray, "3"]:
    return convert.euler((q.x, q.y, q.z, q.w))


def stamp_of(time: msg.Time) -> float | None:
    """A stamp [s], or None where it was left at zero: nobody set it.

    Raises:
        LinkError: It is no time.
    """
    if not (0 <= time.sec < 2**31 and 0 <= time.nanosec < 1_000_000_000):
        raise LinkError(f"stamp {time.sec} s, {time.nanosec} ns: expected nanoseconds below 1e9 and no negative time")
    return convert.seconds(time) or None


def imu(message: msg.Imu) -> Readings:
    """Attitude (zyx Euler angles, rad), gyro (b, rad/s) and accelerometer (specific force, b, m/s2), if measured."""
    found: Readings = {}
    if not message.orientation_covariance[0] == -1:
        found["attitude"] = _euler(message.orientation)
    if not message.angular_velocity_covariance[0] == -1:
        found["gyro"] = convert.frd(_xyz("angular_velocity", message.angular_velocity))
    if not message.linear_acceleration_covariance[0] == -1:
        found["accelerometer"] = convert.frd(_xyz("linear_acceleration", message.linear_acceleration))
    return found


def pressure(message: msg.FluidPressure, water: convert.Water) -> Readings:
    """Depth [m]."""
    (absolute,) = finite("fluid_pressure", [message.fluid_pressure])
    return {"pressure": np.array([(absolute - water.atmosphere) / (water.density * water.gravity)])}


def odometry(message: msg.Odometry) -> Readings:
    """Position (north, east), pressure (depth), attitude, dvl (velocity in b) and gyro: all that it knows."""
    place = convert.ned(_xyz("position", message.pose.pose.position))
    return {
        "position": place[:2],
        "pressure": place[2:],
        "attitude": _euler(message.pose.pose.orientation),
        "dvl": convert.frd(_xyz("linear", message.twist.twist.linear)),
        "gyro": convert.frd(_xyz("angular", message.twist.twist.angular)),
    }


def mocap(message: msg.PoseStamped) -> Readings:
    """Position (north, east), pressure (depth) and attitude of a pose."""
    place = convert.ned(_xyz("position", message.pose.position))
    return {"position": place[:2], "pressure": place[2:], "attitude": _euler(message.pose.orientation)}


def position(message: msg.PoseWithCovarianceStamped) -> Readings:
    """Position (north, east) [m]."""
    at = message.pose.pose.position
    return {"position": convert.ned(finite("position", (at.x, at.y, 0.0)))[:2]}


def velocity(message: msg.TwistWithCovarianceStamped) -> Readings:
    """Velocity over ground in b [m/s]."""
    return {"dvl": convert.frd(_xyz("linear", message.twist.twist.linear))}


def altimeter(message: msg.PointStamped) -> Readings:
    """Distance to the floor [m]."""
    return {"altimeter": np.array([np.linalg.norm(_xyz("point", message.point))])}


def battery(message: msg.BatteryState) -> Readings:
    """Charge (0 to 1) and power [W]; a power of 0 where voltage or current are not given."""
    (charge,) = finite("percentage", [message.percentage])
    if not -0.001 <= charge <= 1.001:
        raise LinkError(f"percentage: found {charge}, expected a share from 0 to 1")
    power = -message.voltage * message.current
    return {"battery": np.array([min(1.0, max(0.0, charge)), power if abs(power) < 1e6 else 0.0])}


def leak(message: msg.Bool) -> Readings:
    """1 when water comes in."""
    return {"leak": np.array([float(bool(message.data))])}


def wrench(message: msg.WrenchStamped, frame: str, largest: Sequence[float]) -> tuple[float, ...]:
    """Share of the largest force or moment, FRD, -1 to 1, shape (6,), of a wrench in `base_link`.

    Raises:
        LinkError: A number is not finite, or the frame another than `frame` (or none).
    """
    _frame(message.header.frame_id, (frame,))
    force = convert.frd(_xyz("force", message.wrench.force))
    torque = convert.frd(_xyz("torque", message.wrench.torque))
    tau = np.concatenate([force, torque])
    # What a vehicle cannot give at all has a largest of zero.
    most = np.asarray(largest, dtype=float)
    share = np.divide(tau, most, out=np.zeros(6), where=most > 0)
    return tuple(np.clip(share, -1.0, 1.0).tolist())


def target(message: msg.PoseStamped, allowed: Sequence[str]) -> tuple[float, float, float, float]:
    """Place in n [m] and heading [rad] of a way-point in `map` or `odom`, which are one for us.

    Raises:
        LinkError: A number is not finite, the orientation no unit quaternion, or the frame another.
    """
    _frame(message.header.frame_id, allowed)
    north, east, down = convert.ned(_xyz("position", message.pose.position)).tolist()
    return north, east, down, float(_euler(message.pose.orientation)[2])


def _frame(found: str, allowed: Sequence[str]) -> None:
    if found and found.lstrip("/") not in allowed:
        raise LinkError(f"frame_id: found {found[:80]!r}, expected {' or '.join(allowed)}")


def guarded(function: Callable[..., Any], *arguments: Any) -> Any:
    """The function's result; whatever a strange message makes it stumble over is a LinkError.

    Raises:
        LinkError: See the function.
    """
    try:
        return function(*arguments)
    except LinkError:
        raise
    except (ArithmeticError, AttributeError, IndexError, TypeError, ValueError) as error:
        raise LinkError(f"a message that cannot be used: {error}") from error


def is_near(a: float, b: float, tolerance: float) -> bool:
    """Whether two times are as close as that; not if one is not finite."""
    return math.isfinite(a) and math.isfinite(b) and abs(a - b) <= tolerance
