"""Rotations and frame conversions: the only module that knows how one frame becomes another.

Frames: `n` north-east-down (NED), `b` forward-right-down (FRD) at CO. `R_nb` maps b to n.
Quaternions are Hamilton, scalar first, `q = [w, x, y, z]`, and rotate b to n. Euler angles are zyx (yaw, pitch,
roll), stored as `[phi, theta, psi]`. All functions take and return JAX arrays of one item; use `jax.vmap` for many.

Reference: Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, ch. 2.
"""

import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import Array, jax, jnp, traced_once
from rovtwin.core.types import Matrix3, Quaternion, Scalar, Vector2, Vector3


@traced_once
def skew(a: Vector3) -> Matrix3:
    """Skew-symmetric S(a), with S(a) b = a x b. Fossen (2021), eq. 2.10."""
    x, y, z = a[0], a[1], a[2]
    zero = jnp.zeros_like(x)
    return jnp.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]])


@traced_once
def cross(a: Vector3, b: Vector3) -> Vector3:
    """Cross product a x b of two (3,) vectors; faster to compile and run than jnp.cross."""
    return jnp.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def wrap(angle: Float[Array, " *axes"]) -> Float[Array, " *axes"]:
    """The same angle in [-pi, pi) [rad], any shape."""
    return jnp.mod(angle + jnp.pi, 2.0 * jnp.pi) - jnp.pi


@traced_once
def rotation_from_quaternion(q: Quaternion) -> Matrix3:
    """R_nb of a unit quaternion. Fossen (2021), eq. 2.73."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return jnp.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotation_from_euler(euler: Vector3) -> Matrix3:
    """R_nb of zyx Euler angles [phi, theta, psi] [rad]. Fossen (2021), eq. 2.31 (thesis 2.4, mended)."""
    (cf, ct, cp), (sf, st, sp) = jnp.cos(euler), jnp.sin(euler)
    return jnp.array(
        [
            [cp * ct, -sp * cf + cp * st * sf, sp * sf + cp * cf * st],
            [sp * ct, cp * cf + sf * st * sp, -cp * sf + st * sp * cf],
            [-st, ct * sf, ct * cf],
        ]
    )


def rotation_from_vector(rotation: Vector3) -> Matrix3:
    """exp of a rotation vector [rad]. Rodrigues; smooth at zero, as its derivatives are."""
    square = rotation @ rotation
    small = square < 1e-8
    angle = jnp.sqrt(jnp.where(small, 1.0, square))
    a = jnp.where(small, 1.0 - square / 6.0, jnp.sin(angle) / angle)
    b = jnp.where(small, 0.5 - square / 24.0, (1.0 - jnp.cos(angle)) / angle**2)
    S = skew(rotation)
    return jnp.eye(3) + a * S + b * (S @ S)


@traced_once
def heading_rotation(heading: Scalar) -> Float[Array, "2 2"]:
    """From ahead and starboard to north and east, level, of a heading [rad]."""
    c, s = jnp.cos(heading), jnp.sin(heading)
    return jnp.stack([jnp.stack([c, -s]), jnp.stack([s, c])])


def yaw_rotation(heading: Scalar) -> Matrix3:
    """R_nb of a level vehicle with a heading [rad]."""
    c, s = jnp.cos(heading), jnp.sin(heading)
    zero, one = jnp.zeros_like(c), jnp.ones_like(c)
    return jnp.array([[c, -s, zero], [s, c, zero], [zero, zero, one]])


def euler_rate_matrix(euler: Vector3) -> Matrix3:
    """T(Theta), with Theta_dot = T omega; singular at theta = +-pi/2. Fossen (2021), eq. 2.41."""
    cf, sf = jnp.cos(euler[0]), jnp.sin(euler[0])
    ct, tt = jnp.cos(euler[1]), jnp.tan(euler[1])
    one, zero = jnp.ones_like(cf), jnp.zeros_like(cf)
    return jnp.array([[one, sf * tt, cf * tt], [zero, cf, -sf], [zero, sf / ct, cf / ct]])


@traced_once
def quaternion_multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton product a b: the rotation b first, then a."""
    aw, ax, ay, az = a[0], a[1], a[2], a[3]
    bw, bx, by, bz = b[0], b[1], b[2], b[3]
    return jnp.array(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ]
    )


def quaternion_conjugate(q: Quaternion) -> Quaternion:
    """The inverse rotation of a unit quaternion."""
    return q * jnp.array([1.0, -1.0, -1.0, -1.0])


def quaternion_rate(q: Quaternion, omega: Vector3) -> Quaternion:
    """q_dot for body angular velocity omega [rad/s]. Fossen (2021), eq. 2.78."""
    return 0.5 * quaternion_multiply(q, jnp.concatenate([jnp.zeros_like(omega[:1]), omega]))


def quaternion_normalise(q: Quaternion) -> Quaternion:
    """The unit quaternion along q."""
    return q / jnp.sqrt(jnp.sum(q * q))


@traced_once
def quaternion_exp(rotation: Vector3) -> Quaternion:
    """Unit quaternion of a rotation vector [rad]; smooth at zero. Sola (2017), sec. 2.4."""
    square = rotation @ rotation
    near = square < 1e-6
    angle = jnp.sqrt(jnp.where(near, 1.0, square))
    # Below a thousandth of a radian two terms of the series are exact, and have a gradient at zero.
    real = jnp.where(near, 1.0 - square / 8.0, jnp.cos(0.5 * angle))
    share = jnp.where(near, 0.5 - square / 48.0, jnp.sin(0.5 * angle) / angle)
    return jnp.concatenate([real[None], share * rotation])


def quaternion_log(q: Quaternion) -> Vector3:
    """The rotation vector of a unit quaternion [rad], the short way round: at most pi long.

    Smooth at zero; at half a turn it jumps to the other way round, for both are as long. Sola (2017), sec. 2.4.
    """
    return _rotation_vector(q[0], q[1:])


def rotation_error(desired: Quaternion, q: Quaternion) -> Vector3:
    """The rotation vector that turns attitude q into the desired one, seen from b [rad].

    Log(q^-1 q_d): the local error of Sola (2017), sec. 4. Its direction is the axis to turn about, its length the
    angle, so that for a level vehicle it is the heading's error; see `quaternion_log` for half a turn.
    """
    u, v = q[1:], desired[1:]
    return _rotation_vector(q[0] * desired[0] + u @ v, q[0] * v - desired[0] * u - cross(u, v))


@traced_once
def _rotation_vector(real: Scalar, vector: Vector3) -> Vector3:
    """Of the real part and the vector of a unit quaternion."""
    vector, real = jnp.where(real < 0.0, -vector, vector), jnp.abs(real)
    square = vector @ vector
    near = square < 1e-6
    sine = jnp.sqrt(jnp.where(near, 1.0, square))
    # arctan2 takes what is not near alone: where both its arguments are zero it has no gradient.
    angle = 2.0 * jnp.arctan2(sine, jnp.where(near, 1.0, real))
    return jnp.where(near, 2.0 + square / 3.0, angle / sine) * vector


@traced_once
def heading_of(q: Float[Array, "*axes 4"]) -> Float[Array, "*axes"]:
    """Heading of attitudes [rad]: of the turn about the vertical that is nearest.

    Of a vehicle that rolls or pitches only, it is psi; of one that does both it differs by about half of phi theta, and
    it is the heading that is left when the vehicle comes level the short way. Other than psi it goes on through a pitch
    of 90 degrees; without meaning is it only upside down. The vertical part of a swing-twist decomposition: Dobrowolski
    (2015), Swing-twist decomposition in Clifford algebra.
    """
    w, _, _, z = jnp.moveaxis(q, -1, 0)
    return jnp.arctan2(2.0 * w * z, w * w - z * z)


def level_attitude(heading: Float[Array, "*axes"] | float) -> Float[Array, "*axes 4"]:
    """Quaternions of level vehicles, of headings [rad]."""
    half = 0.5 * jnp.asarray(heading)
    zero = jnp.zeros_like(half)
    return jnp.stack([jnp.cos(half), zero, zero, jnp.sin(half)], axis=-1)


def tilt_of(q: Quaternion) -> Vector2:
    """The rest of an attitude beside `heading_of`: the rotation about x and y of b that tilts it [rad].

    Of a vehicle that rolls or pitches only, it is that angle.
    """
    w, x, y, z = q[0], q[1], q[2], q[3]
    level = w * w + z * z  # (1 + cos tilt) / 2
    half = jnp.stack([w * x + z * y, w * y - z * x])  # of its sine, along its axis
    square = half @ half
    near = (square < 1e-6) & (level > 0.5)
    sine = jnp.sqrt(jnp.where(near, 1.0, jnp.maximum(square, 1e-24)))
    angle = 2.0 * jnp.arctan2(sine, jnp.where(near, 1.0, level))
    return jnp.where(near, (2.0 - square / level**2 / 1.5) / level, angle / sine) * half


def quaternion_turned(q: Quaternion, half: Vector3) -> Quaternion:
    """q after a small rotation in b, half of it given [rad]: exact to second order."""
    return quaternion_normalise(quaternion_multiply(q, jnp.concatenate([jnp.ones(1), half])))


def rotation_between(a: Quaternion, b: Quaternion) -> Vector3:
    """The small rotation in b that turns quaternion b into a [rad]: exact to second order."""
    q = quaternion_multiply(quaternion_conjugate(b), a)
    return 2.0 * q[1:] * jnp.where(q[0] < 0, -1.0, 1.0)


@traced_once
def quaternion_from_euler(euler: Vector3) -> Quaternion:
    """Unit quaternion of zyx Euler angles [phi, theta, psi] [rad]."""
    (cf, ct, cp), (sf, st, sp) = jnp.cos(euler / 2), jnp.sin(euler / 2)
    return jnp.array(
        [
            cf * ct * cp + sf * st * sp,
            sf * ct * cp - cf * st * sp,
            cf * st * cp + sf * ct * sp,
            cf * ct * sp - sf * st * cp,
        ]
    )


def euler_from_quaternion(q: Float[Array, "*axes 4"]) -> Float[Array, "*axes 3"]:
    """zyx Euler angles [phi, theta, psi] [rad] of unit quaternions; singular at theta = +-pi/2."""
    w, x, y, z = jnp.moveaxis(q, -1, 0)
    sine = jnp.clip(2 * (w * y - x * z), -1.0, 1.0)
    return jnp.stack(
        [
            jnp.arctan2(2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
            jnp.arcsin(sine),
            jnp.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z)),
        ],
        axis=-1,
    )


def quaternion_from_rotation(R_nb: Matrix3) -> Quaternion:
    """Unit quaternion, scalar part >= 0, of a rotation matrix. Shepperd (1978)."""
    (a, b, c), (d, e, f), (g, h, i) = R_nb
    candidates = jnp.array(
        [
            [1 + a + e + i, h - f, c - g, d - b],
            [h - f, 1 + a - e - i, b + d, c + g],
            [c - g, b + d, 1 - a + e - i, f + h],
            [d - b, c + g, f + h, 1 - a - e + i],
        ]
    )
    # The row with the largest diagonal is the best conditioned of four equal answers.
    q = candidates[jnp.argmax(jnp.diagonal(candidates))]
    q = q / jnp.linalg.norm(q)
    return jnp.where(q[0] < 0, -q, q)


def rotate_to_body(q: Quaternion, vector_n: Vector3) -> Vector3:
    """A vector seen in n as seen in b: R_nb^T v."""
    return rotation_from_quaternion(q).T @ vector_n


_NED_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_FRD_FLU = np.array([1.0, -1.0, -1.0])


def readings_in_body(value: Float[Array, "m 3"], kind: str, rotation: Matrix3) -> Float[Array, "m 3"]:
    """Readings of an accelerometer, gyro or compass along the axes of b, from those along its own.

    Args:
        value: Readings: specific force [m/s2], rates [rad/s], or zyx Euler angles of the sensor's axes [rad].
        kind: "accelerometer", "gyro" or "attitude"; the velocity of a "dvl" as well [m/s].
        rotation: R_bs, maps its axes to b.
    """
    if kind != "attitude":
        return value @ rotation.T
    q_sb = quaternion_conjugate(quaternion_from_rotation(rotation))
    return jax.vmap(lambda e: euler_from_quaternion(quaternion_multiply(quaternion_from_euler(e), q_sb)))(value)


def ned_to_enu(vector: Vector3) -> Vector3:
    """North-east-down (3,) to east-north-up (3,)."""
    return jnp.asarray(_NED_ENU) @ vector


def enu_to_ned(vector: Vector3) -> Vector3:
    """East-north-up (3,) to north-east-down (3,)."""
    return jnp.asarray(_NED_ENU) @ vector


def frd_to_flu(vector: Vector3) -> Vector3:
    """Forward-right-down (3,) to forward-left-up (3,)."""
    return jnp.asarray(_FRD_FLU) * vector


def flu_to_frd(vector: Vector3) -> Vector3:
    """Forward-left-up (3,) to forward-right-down (3,)."""
    return jnp.asarray(_FRD_FLU) * vector


def attitude_ned_frd_to_enu_flu(q: Quaternion) -> Quaternion:
    """Quaternion mapping FRD to NED -> quaternion mapping FLU to ENU (ROS REP 103)."""
    half = jnp.sqrt(0.5)
    enu_from_ned = jnp.array([0.0, half, half, 0.0])
    frd_from_flu = jnp.array([0.0, 1.0, 0.0, 0.0])
    return quaternion_multiply(quaternion_multiply(enu_from_ned, q), frd_from_flu)


def attitude_enu_flu_to_ned_frd(q: Quaternion) -> Quaternion:
    """Quaternion mapping FLU to ENU -> quaternion mapping FRD to NED."""
    half = jnp.sqrt(0.5)
    ned_from_enu = jnp.array([0.0, half, half, 0.0])
    flu_from_frd = jnp.array([0.0, 1.0, 0.0, 0.0])
    return quaternion_multiply(quaternion_multiply(ned_from_enu, q), flu_from_frd)


def body_rates_from_euler_rates(euler: Vector3) -> Matrix3:
    """T(Theta)^-1; regular at every attitude. Fossen (2021), eq. 2.40."""
    cf, sf = jnp.cos(euler[0]), jnp.sin(euler[0])
    ct, st = jnp.cos(euler[1]), jnp.sin(euler[1])
    one, zero = jnp.ones_like(cf), jnp.zeros_like(cf)
    return jnp.array([[one, zero, -st], [zero, cf, ct * sf], [zero, -sf, ct * cf]])
