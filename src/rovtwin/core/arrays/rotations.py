"""Rotations on the host, in NumPy, any number at once: what needs no gradient, and must not compile first.

The conventions are those of `core.frames`, against which the tests hold these.
"""

from typing import Any

import numpy as np
from jaxtyping import Float


def skew(a: Float[np.ndarray, "*axes 3"]) -> Float[np.ndarray, "*axes 3 3"]:
    """S(a), with S(a) b = a x b."""
    x, y, z = np.moveaxis(np.asarray(a), -1, 0)
    zero = np.zeros_like(x)
    return np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), (0, 1), (-2, -1))


def vector_of_skew(S: Float[np.ndarray, "*axes 3 3"]) -> Float[np.ndarray, "*axes 3"]:
    """a of the antisymmetric part S(a) of matrices."""
    x, y, z = (S[..., i, j] - S[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0)))
    return 0.5 * np.stack([x, y, z], axis=-1)


def angle_between(a: Float[np.ndarray, "*axes 3 3"], b: Float[np.ndarray, "*axes 3 3"]) -> Float[np.ndarray, "*axes"]:
    """Angle of the rotation from one attitude to another [rad]."""
    return np.arccos(np.clip((np.einsum("...ij,...ij", a, b) - 1.0) / 2.0, -1.0, 1.0))


def wrapped(angle: Any) -> Any:
    """The same angle in [-pi, pi) [rad], any shape."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def rotation_from_euler(euler: Any) -> Float[np.ndarray, "*axes 3 3"]:
    """R_nb of zyx Euler angles [phi, theta, psi] [rad]. Fossen (2021), eq. 2.31."""
    (cf, ct, cp), (sf, st, sp) = _cosines_and_sines(euler)
    rows = [
        [cp * ct, -sp * cf + cp * st * sf, sp * sf + cp * cf * st],
        [sp * ct, cp * cf + sf * st * sp, -cp * sf + st * sp * cf],
        [-st, ct * sf, ct * cf],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def euler_from_rotation(R: Float[np.ndarray, "*axes 3 3"]) -> Float[np.ndarray, "*axes 3"]:
    """zyx Euler angles [phi, theta, psi] [rad] of R_nb; singular at theta = +-pi/2."""
    theta = -np.arcsin(np.clip(R[..., 2, 0], -1.0, 1.0))
    return np.stack([np.arctan2(R[..., 2, 1], R[..., 2, 2]), theta, np.arctan2(R[..., 1, 0], R[..., 0, 0])], axis=-1)


def euler_from_quaternion(q: Any) -> Float[np.ndarray, "*axes 3"]:
    """zyx Euler angles [phi, theta, psi] [rad] of unit quaternions; singular as above."""
    w, x, y, z = np.moveaxis(np.asarray(q), -1, 0)
    phi = np.arctan2(2 * (y * z + w * x), 1 - 2 * (x * x + y * y))
    theta = np.arcsin(np.clip(2 * (w * y - x * z), -1.0, 1.0))
    return np.stack([phi, theta, np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))], axis=-1)


def heading_of(q: Any) -> Float[np.ndarray, "*axes"]:
    """Heading of unit quaternions [rad]: that of the nearest turn about the vertical, not psi."""
    w, _, _, z = np.moveaxis(np.asarray(q), -1, 0)
    return np.arctan2(2.0 * w * z, w * w - z * z)


def tilt_of(q: Any) -> Float[np.ndarray, "*axes 2"]:
    """The rest of unit quaternions: the rotation about x and y of b that tilts [rad]; its length is the tilt."""
    w, x, y, z = np.moveaxis(np.asarray(q), -1, 0)
    level, sine = np.hypot(w, z), np.hypot(x, y)  # cos and sin of half the tilt
    share = 2.0 * np.arctan2(sine, level) / np.maximum(level * sine, np.finfo(float).tiny)
    return share[..., None] * np.stack([w * x + z * y, w * y - z * x], axis=-1)


def pose(position: Any, attitude: Any) -> Float[np.ndarray, "*axes 6"]:
    """eta of places in n and unit quaternions: for files and screens."""
    return np.concatenate([position, euler_from_quaternion(attitude)], axis=-1)


def euler_rate_matrix(euler: Any) -> Float[np.ndarray, "*axes 3 3"]:
    """T(Theta), with Theta_dot = T omega, of zyx Euler angles [rad]. Fossen (2021), eq. 2.41."""
    (cf, ct, _), (sf, st, _) = _cosines_and_sines(euler)
    zero, one = np.zeros_like(cf), np.ones_like(cf)
    rows = [[one, sf * st / ct, cf * st / ct], [zero, cf, -sf], [zero, sf / ct, cf / ct]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def pose_rate(velocity: Any, angular_velocity: Any, attitude: Any) -> Float[np.ndarray, "*axes 6"]:
    """Rate of `pose`, of velocities in n [m/s], angular velocities in b [rad/s] and unit quaternions."""
    T = euler_rate_matrix(euler_from_quaternion(attitude))
    return np.concatenate([velocity, (T @ np.asarray(angular_velocity)[..., None])[..., 0]], axis=-1)


def pose_covariance(covariance: Any, attitude: Any) -> Float[np.ndarray, "*axes 12 12"]:
    """Covariance of [eta, nu], of that of an `Estimate`.

    Args:
        covariance: Of the errors of position, attitude (a rotation in b) and nu.
        attitude: Unit quaternions.
    """
    T = euler_rate_matrix(euler_from_quaternion(attitude))
    J = np.zeros(np.shape(covariance)) + np.eye(12)
    J[..., 3:6, 3:6] = T
    with np.errstate(invalid="ignore"):  # of an estimate that is no number
        return J @ covariance @ np.swapaxes(J, -1, -2)


def quaternion_from_euler(euler: Any) -> Float[np.ndarray, "*axes 4"]:
    """Unit quaternion [w, x, y, z] of zyx Euler angles [phi, theta, psi] [rad]."""
    (cf, ct, cp), (sf, st, sp) = _cosines_and_sines(np.asarray(euler, dtype=float) / 2)
    w, x = cf * ct * cp + sf * st * sp, sf * ct * cp - cf * st * sp
    y, z = cf * st * cp + sf * ct * sp, cf * ct * sp - sf * st * cp
    return np.stack([w, x, y, z], axis=-1)


def heading_rotation(heading: Any) -> Float[np.ndarray, "*axes 2 2"]:
    """From ahead and starboard to north and east, of headings [rad]."""
    c, s = np.cos(heading), np.sin(heading)
    return np.moveaxis(np.array([[c, -s], [s, c]]), (0, 1), (-2, -1))


def turn_about_z(angle: float) -> Float[np.ndarray, "3 3"]:
    """Rotation about z [rad]: clockwise seen from above, where z is down."""
    turn = np.eye(3)
    turn[:2, :2] = heading_rotation(angle)
    return turn


def _cosines_and_sines(angles: Any) -> tuple[Float[np.ndarray, " 3 *axes"], Float[np.ndarray, " 3 *axes"]]:
    """Of angles, by angle."""
    by_angle = np.moveaxis(np.asarray(angles, dtype=float), -1, 0)
    return np.cos(by_angle), np.sin(by_angle)
