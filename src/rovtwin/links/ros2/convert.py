"""Between our frames and those of ROS, and between readings and messages: the only place where one becomes the other.

Ours: n is north-east-down, b forward-right-down, SI, zyx Euler angles. ROS (REP 103, REP 105): `map` and `odom` are
east-north-up, `base_link` forward-left-up, quaternions scalar last. So a dive is a negative z and a turn to starboard a
negative rate about z; heading east is a yaw of zero.

Every conversion of `core.frames` used here is linear, so it is applied as a matrix made from it once: a message costs
microseconds, and many rows go at once.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core import frames
from rovtwin.core.arrays.rotations import quaternion_from_euler
from rovtwin.core.errors import LinkError
from rovtwin.links.ros2 import messages as msg

MAP, ODOM, BASE = "map", "odom", "base_link"
STANDARD_GRAVITY = 9.80665  # m/s2
ATMOSPHERE = 101_325.0  # Pa, the standard's
FRESH_WATER = 1000.0  # kg/m3
UNKNOWN = 1e6  # variance of what a message has room for and nobody measured
_NANO = 1_000_000_000


@dataclass(frozen=True)
class Water:
    """How depth becomes pressure: p = atmosphere + density gravity depth.

    Attributes:
        density: Of the water [kg/m3].
        gravity: [m/s2].
        atmosphere: Pressure at the surface [Pa].
    """

    density: float = FRESH_WATER
    gravity: float = STANDARD_GRAVITY
    atmosphere: float = ATMOSPHERE


# ---------------------------------------------------------------------------------------------------------- frames


def _matrix(linear: Any, size: int) -> Float[np.ndarray, "size size"]:
    """The matrix of a linear function of a vector of `size`."""
    return np.stack([np.asarray(linear(row), dtype=float) for row in np.eye(size)], axis=1)


@cache
def _n() -> Float[np.ndarray, "3 3"]:
    return _matrix(frames.ned_to_enu, 3)


@cache
def _b() -> Float[np.ndarray, "3 3"]:
    return _matrix(frames.frd_to_flu, 3)


@cache
def _q() -> tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "4 4"]]:
    """Attitudes to ROS and back: [w, x, y, z] to [w, x, y, z]."""
    return _matrix(frames.attitude_ned_frd_to_enu_flu, 4), _matrix(frames.attitude_enu_flu_to_ned_frd, 4)


def prepare() -> None:
    """Make the matrices now: a server must not compute for long later."""
    for made in (_n, _b, _q):
        made()


def enu(vector: Any) -> Float[np.ndarray, "*axes 3"]:
    """A vector or place in n as ROS has it in `map` or `odom`, shape (..., 3)."""
    return np.asarray(vector, dtype=float) @ _n().T


def ned(vector: Any) -> Float[np.ndarray, "*axes 3"]:
    """The way back of `enu`: the exchange is its own inverse."""
    return enu(vector)


def flu(vector: Any) -> Float[np.ndarray, "*axes 3"]:
    """A vector in b as ROS has it in `base_link`, shape (..., 3)."""
    return np.asarray(vector, dtype=float) @ _b().T


def frd(vector: Any) -> Float[np.ndarray, "*axes 3"]:
    """The way back of `flu`: the exchange is its own inverse."""
    return flu(vector)


def orientation(euler: Any) -> Float[np.ndarray, "*axes 4"]:
    """What ROS calls it: quaternions FLU to ENU [x, y, z, w], shape (..., 4), of our Euler angles, shape (..., 3)."""
    q = quaternion_from_euler(euler) @ _q()[0].T
    return np.roll(np.where(q[..., :1] < 0, -q, q), -1, axis=-1)


def euler(xyzw: Sequence[float]) -> Float[np.ndarray, "3"]:
    """Our Euler angles [rad] of a quaternion of ROS.

    Raises:
        LinkError: It is none: not finite, or its length is not 1 within 1 %.
    """
    length = math.sqrt(sum(x * x for x in xyzw)) if all(abs(x) < 2 for x in xyzw) else math.nan
    if not abs(length - 1.0) < 0.01:
        raise LinkError(f"orientation {tuple(xyzw)}: not a unit quaternion (x, y, z, w); expected a length of 1")
    x, y, z, w = xyzw
    w, x, y, z = _q()[1] @ np.array([w, x, y, z]) / length
    sine = min(1.0, max(-1.0, 2 * (w * y - x * z)))
    phi = math.atan2(2 * (y * z + w * x), 1 - 2 * (x * x + y * y))
    return np.array([phi, math.asin(sine), math.atan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))])


def euler_to_turn(angles: Any) -> Float[np.ndarray, "*axes 3 3"]:
    """d(small rotation about the axes of n) / d(zyx Euler angles), shape (..., 3, 3); Fossen (2021), 2.28 seen in n."""
    _, theta, psi = np.moveaxis(np.asarray(angles, dtype=float), -1, 0)
    ct, st, cp, sp, one, zero = np.cos(theta), np.sin(theta), np.cos(psi), np.sin(psi), np.ones_like(psi), 0 * psi
    rows = [[cp * ct, -sp, zero], [sp * ct, cp, zero], [-st, zero, one]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def pose_covariance(covariance: Any, angles: Any) -> Float[np.ndarray, "*axes 6 6"]:
    """Covariance of eta, shape (..., 6, 6), as ROS wants it: of x, y, z and turns about these fixed axes (ENU)."""
    jacobian = np.zeros((*np.shape(angles)[:-1], 6, 6))
    jacobian[..., :3, :3] = _n()
    jacobian[..., 3:, 3:] = _n() @ euler_to_turn(angles)
    return jacobian @ np.asarray(covariance, dtype=float) @ np.swapaxes(jacobian, -1, -2)


def twist_covariance(covariance: Any) -> Float[np.ndarray, "*axes 6 6"]:
    """Covariance of nu, shape (..., 6, 6), in FLU."""
    turn = np.kron(np.eye(2), _b())
    return turn @ np.asarray(covariance, dtype=float) @ turn.T


# ------------------------------------------------------------------------------------------------- pieces of messages


def stamp(t: float) -> msg.Time:
    """A time [s] as ROS has it; what it cannot hold becomes the nearest that it can."""
    total = min(max(round(t * _NANO), 0), (2**31 - 1) * _NANO)
    return msg.Time(*divmod(total, _NANO))


def seconds(time: msg.Time) -> float:
    """A stamp as seconds."""
    return time.sec + time.nanosec / _NANO


def header(t: float, frame: str) -> msg.Header:
    """When [s] and in which frame."""
    return msg.Header(stamp(t), frame)


def vector3(values: Any) -> msg.Vector3:
    """Of three numbers in a frame of ROS."""
    return msg.Vector3(*map(float, values))


def _pose(place: Any, angles: Any) -> msg.Pose:
    return msg.Pose(msg.Point(*enu(place).tolist()), msg.Quaternion(*orientation(angles).tolist()))


def _flat(matrix: Any) -> tuple[float, ...]:
    return tuple(np.asarray(matrix, dtype=float).ravel().tolist())


def diagonal(std: Sequence[float] | None) -> Float[np.ndarray, "n n"] | None:
    """Covariance of independent errors, or None."""
    return None if std is None else np.diag(np.square(np.asarray(std, dtype=float)))


# --------------------------------------------------------------------------------------------- readings to messages


def odometry(t: float, eta: Any, nu: Any, covariance: Any = None, frame: str = ODOM, child: str = BASE) -> msg.Odometry:
    """Pose in `odom` and velocity in `base_link` of eta and nu; zeros for a covariance that nobody knows.

    Args:
        t: Stamp [s].
        eta: Pose in n, shape (6,).
        nu: Velocity in b, shape (6,).
        covariance: Of [eta, nu], shape (12, 12), or None.
        frame: Of the pose.
        child: Of the twist.
    """
    eta, nu = np.asarray(eta, dtype=float), np.asarray(nu, dtype=float)
    twist = msg.Twist(vector3(flu(nu[:3])), vector3(flu(nu[3:])))
    known = np.zeros((12, 12)) if covariance is None else np.asarray(covariance, dtype=float)
    return msg.Odometry(
        header(t, frame),
        child,
        msg.PoseWithCovariance(_pose(eta[:3], eta[3:]), _flat(pose_covariance(known[:6, :6], eta[3:]))),
        msg.TwistWithCovariance(twist, _flat(twist_covariance(known[6:, 6:]))),
    )


def transforms(odometry: msg.Odometry, parent: str = MAP) -> msg.TFMessage:
    """`map` to `odom`, which is one for us, and `odom` to `base_link`."""
    pose, at = odometry.pose.pose, odometry.header
    place = msg.Vector3(pose.position.x, pose.position.y, pose.position.z)
    same = msg.TransformStamped(msg.Header(at.stamp, parent), at.frame_id)
    moved = msg.TransformStamped(at, odometry.child_frame_id, msg.Transform(place, pose.orientation))
    return msg.TFMessage([same, moved])


def imu(
    t: float,
    attitude: Any = None,
    gyro: Any = None,
    accelerometer: Any = None,
    std: dict[str, Sequence[float]] | None = None,
    frame: str = BASE,
) -> msg.Imu:
    """What an IMU read at one instant; a first covariance of -1 says that a part was not measured then.

    Args:
        t: Stamp [s].
        attitude: zyx Euler angles [rad], shape (3,), or None.
        gyro: Angular rate in b [rad/s], shape (3,), or None.
        accelerometer: Specific force in b [m/s2], shape (3,), or None: at rest it points up, in ROS as well.
        std: Standard deviations by the names of the sensors, each of shape (3,); zeros, unknown, where left out.
        frame: Of the readings.
    """
    found = msg.Imu(header(t, frame))
    known, absent = std or {}, (-1.0, *(0.0,) * 8)
    if attitude is not None:
        found.orientation = msg.Quaternion(*orientation(attitude).tolist())
    for name, value in (("angular_velocity", gyro), ("linear_acceleration", accelerometer)):
        if value is not None:
            setattr(found, name, vector3(flu(value)))
    turn = _n() @ euler_to_turn(attitude) if attitude is not None else _b()
    parts = (("orientation", "attitude", attitude, turn),)
    parts += (("angular_velocity", "gyro", gyro, _b()), ("linear_acceleration", "accelerometer", accelerometer, _b()))
    for name, sensor, value, change in parts:
        own = diagonal(known.get(sensor))
        flat = (0.0,) * 9 if own is None else _flat(change @ own @ change.T)
        setattr(found, f"{name}_covariance", absent if value is None else flat)
    return found


def pressure(t: float, depth: float, water: Water, std: Sequence[float] | None = None, frame: str = BASE):
    """Absolute pressure [Pa] at a depth [m]; std of the depth [m], shape (1,)."""
    per_metre = water.density * water.gravity
    variance = 0.0 if std is None else float(std[0] * per_metre) ** 2
    return msg.FluidPressure(header(t, frame), water.atmosphere + per_metre * float(depth), variance)


def pose(t: float, place: Any, angles: Any, frame: str = MAP) -> msg.PoseStamped:
    """A pose, of n and zyx Euler angles."""
    return msg.PoseStamped(header(t, frame), _pose(place, angles))


def position(t: float, place: Any, std: Sequence[float] | None = None, frame: str = MAP):
    """A horizontal position, north and east [m]: height and attitude, unknown to it, have a variance of 1e6."""
    north, east = (float(x) for x in place)
    own = np.diag([0.0, 0.0, UNKNOWN, UNKNOWN, UNKNOWN, UNKNOWN])
    if std is not None:
        own[:2, :2] = _n()[:2, :2] @ np.diag(np.square(np.asarray(std, dtype=float))) @ _n()[:2, :2].T
    there = msg.Pose(msg.Point(*enu([north, east, 0.0]).tolist()))
    return msg.PoseWithCovarianceStamped(header(t, frame), msg.PoseWithCovariance(there, _flat(own)))


def velocity(t: float, value: Any, std: Sequence[float] | None = None, frame: str = BASE):
    """Velocity over ground in b [m/s], as of a DVL; the angular part has a variance of 1e6."""
    own = np.diag([0.0, 0.0, 0.0, UNKNOWN, UNKNOWN, UNKNOWN])
    if std is not None:
        own[:3, :3] = np.diag(np.square(np.asarray(std, dtype=float)))
    twist = msg.Twist(vector3(flu(value)))
    return msg.TwistWithCovarianceStamped(header(t, frame), msg.TwistWithCovariance(twist, _flat(own)))


def floor(t: float, distance: float, frame: str = BASE) -> msg.PointStamped:
    """The place on the floor that an altimeter sees straight below: `sensor_msgs/Range` differs between releases."""
    return msg.PointStamped(header(t, frame), msg.Point(*flu([0.0, 0.0, float(distance)]).tolist()))


def battery(t: float, charge: float, power: float, voltage: float | None = None) -> msg.BatteryState:
    """Charge (0 to 1); the current [A] only where the voltage [V] is known, negative as it discharges."""
    found = msg.BatteryState(header(t, ""), percentage=float(charge), present=True)
    if voltage is not None:
        found.voltage, found.current = float(voltage), -float(power) / voltage
    found.power_supply_status = 2  # discharging
    return found


def numbers(values: Any) -> msg.Float64MultiArray:
    """A plain list."""
    return msg.Float64MultiArray(data=tuple(float(x) for x in values))
