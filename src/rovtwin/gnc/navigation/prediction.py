"""How the state moves: two independent sources of the acceleration, and one prediction from both.

The motion is that of the model, plus one of wave frequency that a second-order filter driven by white noise stands for:

    v_dot = a_m(x, tau) + w_m                                   slow part, b
    x_w_dot = v_w,  v_w_dot = -w0^2 x_w - 2 z w0 v_w + w_w      waves, n
    a_i(y) = v_dot + R_bn v_w_dot + n                           what the accelerometer says of both

with w_m, w_w and n white, of densities S_m, S_w and S_n = sigma^2 / rate. Their sum is seen as the difference between
sensor and prediction; the best guess gives each its share S / (S_m + S_w + S_n) of it, and what is then left of w_m and
w_w is independent of the difference. The filter predicts with these shares and takes the difference in as a measurement
of zero: nothing is counted twice. Without an accelerometer the shares are 0.

Of the model only the force balance is used, with the angular velocity and acceleration that the gyro measures: the
moments of a real vehicle are badly known, and the filter would read the horizontal velocity off them (Munk's moment).

Reference: Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, ch. 6, sec. 10.2 (wave response
models), ch. 13 (wave filtering); Bar-Shalom, Li and Kirubarajan (2001), sec. 8.3.1 (decorrelation of noises).
"""

import equinox as eqx
from jaxtyping import Float

from rovtwin.core.arrays.small_matrices import product
from rovtwin.core.frames import (
    cross,
    quaternion_turned,
    rotation_from_quaternion,
    skew,
)
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Matrix3, Scalar, ScalarLike, Vector3, Vector6
from rovtwin.gnc.navigation.state import (
    ACCELEROMETER_BIAS,
    ATTITUDE,
    CURRENT,
    DRAG,
    ERRORS,
    FORCE_B,
    FORCE_N,
    GYRO_BIAS,
    MOVING,
    VELOCITY,
    WAVE_PLACE,
    WAVE_VELOCITY,
    NavigationState,
)
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.physics.discrepancy import discrepancy_variance
from rovtwin.vehicle.physics.dynamics import damping_force, learned_wrench
from rovtwin.vehicle.physics.linearisation import damping_jacobian
from rovtwin.vehicle.physics.model import Model


class Turning(eqx.Module):
    """What the gyro says over a tick: angular velocity [rad/s] and acceleration [rad/s2], b."""

    omega: Vector3
    omega_dot: Vector3


class Acceleration(eqx.Module):
    """An acceleration [m/s2], and its derivative by the error of the state."""

    value: Vector3
    slope: Float[Array, "3 31"]


def by_model(model: Model, x: NavigationState, tau: Vector6, turning: Turning) -> Acceleration:
    """v_dot from the force balance, rows 1 to 3 of the equations of motion.

    Args:
        model: The vehicle.
        x: Nominal state.
        tau: Wrench of the thrusters, b at CO [N, N m].
        turning: Of the vehicle; taken as known.
    """
    R_nb = rotation_from_quaternion(x.attitude)
    R_bn, omega = R_nb.T, turning.omega
    current_b = R_bn[:, 0] * x.current[0] + R_bn[:, 1] * x.current[1]
    nu_r = jnp.concatenate([x.velocity - current_b, omega])
    net = jnp.array([0.0, 0.0, 1.0]) * (model.weight - model.buoyancy)
    steady = R_bn @ (x.force_n + net)
    scale = jnp.exp(x.drag)
    drag = scale * damping_force(model, nu_r)
    momentum = model.inertia[:3] @ nu_r
    learned, dlearned_dv = learned_force(model, nu_r, tau)
    force = tau[:3] + learned + steady + jnp.append(x.force_b, 0.0) - drag - cross(omega, momentum)
    inverse = force_inverse(model)
    along = cross(omega, current_b)
    value = inverse @ (force - model.inertia[:3, 3:] @ turning.omega_dot) - along

    S_c, S_w = skew(current_b), skew(omega)
    dforce_dv = dlearned_dv - scale[:, None] * damping_jacobian(model, nu_r, 3) - product(S_w, model.inertia[:3, :3])
    dv = product(inverse, dforce_dv)
    dattitude = product(inverse, skew(steady)) - product(dv, S_c) - product(S_w, S_c)
    dcurrent = -product(dv + S_w, R_bn)[:, :2]
    slope = side_by_side(
        3,
        (VELOCITY, dv),
        (ATTITUDE, dattitude),
        (FORCE_N, product(inverse, R_bn)),
        (FORCE_B, inverse[:, :2]),
        (CURRENT, dcurrent),
        (DRAG, -inverse * drag),
    )
    return Acceleration(value, slope)


def learned_force(model: Model, nu_r: Vector6, tau: Vector6) -> tuple[Vector3 | float, Matrix3 | float]:
    """Force that the model was found to lack [N], and its derivative by v_r.

    Args:
        model: Without a learned discrepancy both are 0.0.
        nu_r: Velocity through the water, b at CO.
        tau: Wrench of the thrusters, b at CO.
    """
    if model.discrepancy is None:
        return 0.0, 0.0

    def force(v_r: Vector3) -> Vector3:
        return jnp.asarray(learned_wrench(model, jnp.concatenate([v_r, nu_r[3:]]), tau))[:3]

    value, along = jax.linearize(force, nu_r[:3])
    return value, jnp.stack([along(direction) for direction in jnp.eye(3)], axis=1)


def learned_doubt(model: Model, x: NavigationState, tau: Vector6, omega: Vector3) -> Vector3 | float:
    """Variance of the acceleration that the learned discrepancy leaves open [m^2/s^4]; 0.0 without one.

    Args:
        model: Uses `discrepancy` and the inertia.
        x: Nominal state.
        tau: Wrench of the thrusters, b at CO.
        omega: Angular velocity, b [rad/s].
    """
    if model.discrepancy is None:
        return 0.0
    R_bn = rotation_from_quaternion(x.attitude).T
    nu_r = jnp.concatenate([x.velocity - R_bn[:, 0] * x.current[0] - R_bn[:, 1] * x.current[1], omega])
    variance = discrepancy_variance(model.discrepancy, nu_r, tau)[:3]
    return jnp.sum(force_inverse(model) ** 2 * variance, axis=1)


def by_accelerometer(
    x: NavigationState, reading: Vector3, lever: Vector3, turning: Turning, later: ScalarLike = 0.0
) -> Acceleration:
    """v_dot + R_bn v_w_dot from the specific force [m/s2] of an accelerometer.

    Args:
        x: Nominal state at the start of the tick.
        reading: Turned to b.
        lever: Where it sits, seen from CO, b [m].
        turning: Of the vehicle over the tick.
        later: So long after the start of the tick it was taken [s]: gravity is that of the attitude then, for at
            1 rad/s it turns by 0.15 m/s2 in 15 ms.
    """
    omega, omega_dot = turning.omega, turning.omega_dot
    down_b = rotation_from_quaternion(quaternion_turned(x.attitude, 0.5 * later * omega))[2]
    swing = cross(omega_dot, lever) + cross(omega, cross(omega, lever))
    value = reading - x.accelerometer_bias - cross(omega, x.velocity) - swing + GRAVITY * down_b
    own = (VELOCITY, -skew(omega)), (ATTITUDE, GRAVITY * skew(down_b)), (ACCELEROMETER_BIAS, -jnp.eye(3))
    return Acceleration(value, side_by_side(3, *own))


class Waves(eqx.Module):
    """Second-order motion of wave frequency [rad/s] with a damping ratio, and the density of the noise that drives it.

    `density` is that of w_w along north, east and down [m2/s3].
    """

    frequency: Scalar
    damping: Scalar
    density: Vector3


def by_waves(x: NavigationState, waves: Waves) -> Acceleration:
    """v_w_dot without its noise, n."""
    w2, decay = waves.frequency**2, 2.0 * waves.damping * waves.frequency
    value = -w2 * x.wave_place - decay * x.wave_velocity
    slope = side_by_side(3, (WAVE_PLACE, -w2 * jnp.eye(3)), (WAVE_VELOCITY, -decay * jnp.eye(3)))
    return Acceleration(value, slope)


def sum_of(model: Acceleration, waves: Acceleration, R_nb: Matrix3) -> Acceleration:
    """Of slow motion in b and waves in n, in b."""
    turned = R_nb.T @ waves.value
    slope = product(R_nb.T, waves.slope) + side_by_side(3, (ATTITUDE, skew(turned)))
    return Acceleration(model.value + turned, model.slope + slope)


def less(a: Acceleration, b: Acceleration) -> Acceleration:
    """The difference of two accelerations."""
    return Acceleration(a.value - b.value, a.slope - b.slope)


def mixed(own: Acceleration, difference: Acceleration, gain: Matrix3) -> Acceleration:
    """An acceleration, moved by its share of the difference."""
    return Acceleration(own.value + gain @ difference.value, own.slope + product(gain, difference.slope))


def step(
    x: NavigationState,
    P: Float[Array, "31 31"],
    v_dot: Acceleration,
    wave_dot: Acceleration,
    turning: Turning,
    noise: Float[Array, "31 31"],
    dt: float,
) -> tuple[NavigationState, Float[Array, "31 31"], Float[Array, "15 31"]]:
    """State and covariance a tick later, and half of what takes the error there: Phi = (I + B)^2.

    Args:
        x: Nominal state.
        P: Covariance of its error.
        v_dot: Acceleration over the tick, b.
        wave_dot: Acceleration of the waves over the tick, n.
        turning: Angular velocity over the tick.
        noise: Intensity of the white noise on the error [unit^2/s].
        dt: Tick [s].
    """
    R_nb = rotation_from_quaternion(x.attitude)
    # The noise comes in the middle of the tick: what shakes the velocity has moved the position by its end.
    B = 0.5 * dt * _rates(R_nb, x.velocity, v_dot.slope, wave_dot.slope, turning.omega)
    B = B + 0.5 * product(B[:, :MOVING], B)
    P = _through(B, _through(B, P) + dt * noise)

    half = 0.5 * dt * turning.omega
    R_middle = rotation_from_quaternion(quaternion_turned(x.attitude, 0.5 * half))
    after = eqx.tree_at(
        lambda s: (s.position, s.velocity, s.attitude, s.wave_place, s.wave_velocity),
        x,
        (
            x.position + dt * (R_middle @ (x.velocity + 0.5 * dt * v_dot.value)),
            x.velocity + dt * v_dot.value,
            quaternion_turned(x.attitude, half),
            x.wave_place + dt * (x.wave_velocity + 0.5 * dt * wave_dot.value),
            x.wave_velocity + dt * wave_dot.value,
        ),
    )
    return after, 0.5 * (P + P.T), B


def _rates(
    R_nb: Matrix3, velocity: Vector3, v_dot: Float[Array, "3 31"], wave_dot: Float[Array, "3 31"], omega: Vector3
) -> Float[Array, "15 31"]:
    """Rate of the first 15 errors by all."""
    one = jnp.eye(3)
    rows = [
        side_by_side(3, (VELOCITY, R_nb), (ATTITUDE, -product(R_nb, skew(velocity)))),
        v_dot,
        side_by_side(3, (ATTITUDE, -skew(omega)), (GYRO_BIAS, -one)),
        side_by_side(3, (WAVE_VELOCITY, one)),
        wave_dot,
    ]
    return jnp.concatenate(rows)


def _through(B: Float[Array, "15 31"], P: Float[Array, "31 31"]) -> Float[Array, "31 31"]:
    """(I + B) P (I + B)', B's rows beyond the first 15 being zero."""
    moved = P[:MOVING] + product(B, P)
    corner = moved[:, :MOVING] + product(moved, B.T)
    side = moved[:, MOVING:]
    rest = jnp.concatenate([side.T, P[MOVING:, MOVING:]], axis=1)
    return jnp.concatenate([jnp.concatenate([corner, side], axis=1), rest])


def side_by_side(rows: int, *blocks: tuple[slice, Float[Array, "rows _"]]) -> Float[Array, "rows 31"]:
    """A matrix of 31 columns from blocks in their places, in order. In a scan a join is cheaper than a scatter."""
    parts, at = [], 0
    for place, block in blocks:
        parts += [jnp.zeros((rows, place.start - at)), block]
        at = place.stop
    return jnp.concatenate([*parts, jnp.zeros((rows, ERRORS - at))], axis=1)


def force_inverse(model: Model) -> Matrix3:
    """Inverse of the linear part of M, by cofactors: no library call inside a scan."""
    a, b, c = model.inertia[0, :3], model.inertia[1, :3], model.inertia[2, :3]
    bc = cross(b, c)
    return jnp.stack([bc, cross(c, a), cross(a, b)], axis=1) / (a @ bc)
