"""How the state moves: two independent opinions of the acceleration, and one prediction from both.

The model says     v_dot = a_m(x, tau) + w_m,     w_m white, of density S_m
and the sensor     v_dot = a_i(x, y) - n,         n white, of density S_n = sigma^2 / rate.

With K = S_m / (S_m + S_n) the mixture (1 - K) a_m + K a_i has the least noise, S_m S_n / (S_m + S_n), and this noise is
independent of the difference a_i - a_m. The filter predicts with the mixture and then takes the difference in as a
measurement of zero: nothing is counted twice. Without an accelerometer K is 0, without faith in the model 1.

Of the model only the force balance is used, with the angular velocity and acceleration that the gyro measures: the
moments of a real vehicle are badly known, and the filter would read the horizontal velocity off them (Munk's moment).

Reference: Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, ch. 6, 14.2; Bar-Shalom, Li and
Kirubarajan (2001), sec. 8.3.1 (decorrelation of process and measurement noise).
"""

import equinox as eqx

from rovtwin.core.frames import (
    cross,
    quaternion_multiply,
    quaternion_normalise,
    rotation_from_quaternion,
    skew,
)
from rovtwin.core.numerics import Array, jnp
from rovtwin.gnc.ekf_model import product
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
    WAVE_FORCE,
    WAVE_IMPULSE,
    NavigationState,
)
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.model import Model


class Turning(eqx.Module):
    """What the gyro says over a tick: angular velocity [rad/s] and acceleration [rad/s2], b, shapes (3,)."""

    omega: Array
    omega_dot: Array


class Opinion(eqx.Module):
    """v_dot in b [m/s2], shape (3,), and its derivative by the error of the state, shape (3, 31)."""

    value: Array
    slope: Array


def by_model(model: Model, x: NavigationState, tau: Array, turning: Turning) -> Opinion:
    """v_dot from the force balance, rows 1 to 3 of the equations of motion.

    Args:
        model: The vehicle.
        x: Nominal state.
        tau: Wrench of the thrusters, b at CO [N, N m], shape (6,).
        turning: Of the vehicle; taken as known.
    """
    R_nb = rotation_from_quaternion(x.attitude)
    R_bn, omega = R_nb.T, turning.omega
    current_b = R_bn[:, 0] * x.current[0] + R_bn[:, 1] * x.current[1]
    nu_r = jnp.concatenate([x.velocity - current_b, omega])
    net = jnp.array([0.0, 0.0, 1.0]) * (model.weight - model.buoyancy)
    steady_n = R_bn @ (x.force_n + x.wave_force + net)
    scale = jnp.exp(x.drag)
    drag = scale * damping_force(model, nu_r)
    momentum = model.mass[:3] @ nu_r
    force = tau[:3] + steady_n + jnp.append(x.force_b, 0.0) - drag - cross(omega, momentum)
    inverse = force_inverse(model)
    along = cross(omega, current_b)
    value = inverse @ (force - model.mass[:3, 3:] @ turning.omega_dot) - along

    S_c, S_w = skew(current_b), skew(omega)
    dforce_dv = -scale[:, None] * damping_force_slope(model, nu_r) - product(S_w, model.mass[:3, :3])
    dv = product(inverse, dforce_dv)
    dattitude = product(inverse, skew(steady_n)) - product(dv, S_c) - product(S_w, S_c)
    dcurrent = -product(dv + S_w, R_bn)[:, :2]
    by_force_n = product(inverse, R_bn)
    slope = side_by_side(
        3,
        (VELOCITY, dv),
        (ATTITUDE, dattitude),
        (WAVE_FORCE, by_force_n),
        (FORCE_N, by_force_n),
        (FORCE_B, inverse[:, :2]),
        (CURRENT, dcurrent),
        (DRAG, -inverse * drag),
    )
    return Opinion(value, slope)


def by_accelerometer(x: NavigationState, reading: Array, lever: Array, turning: Turning) -> Opinion:
    """v_dot from the specific force read at `lever` [m], turned to b [m/s2], shape (3,)."""
    omega, omega_dot = turning.omega, turning.omega_dot
    down_b = rotation_from_quaternion(x.attitude)[2]
    swing = cross(omega_dot, lever) + cross(omega, cross(omega, lever))
    value = reading - x.accelerometer_bias - cross(omega, x.velocity) - swing + GRAVITY * down_b
    own = (VELOCITY, -skew(omega)), (ATTITUDE, GRAVITY * skew(down_b)), (ACCELEROMETER_BIAS, -jnp.eye(3))
    return Opinion(value, side_by_side(3, *own))


def mixture(model: Opinion, sensor: Opinion, share: Array) -> Opinion:
    """(1 - K) of the model and K of the sensor, K the share in each axis, shape (3,)."""
    value = model.value + share * (sensor.value - model.value)
    return Opinion(value, model.slope + share[:, None] * (sensor.slope - model.slope))


class Waves(eqx.Module):
    """Second-order wave force in each axis of n: frequency [rad/s] and damping ratio. Fossen (2021), eq. 13.86."""

    frequency: Array
    damping: Array


def step(
    x: NavigationState, P: Array, v_dot: Opinion, turning: Turning, noise: Array, waves: Waves, dt: float
) -> tuple[NavigationState, Array]:
    """State and covariance a tick later.

    Args:
        x: Nominal state.
        P: Covariance of its error, shape (31, 31).
        v_dot: Acceleration over the tick.
        turning: Angular velocity over the tick.
        noise: Intensity of the white noise on each error [unit^2/s], shape (31,).
        waves: Of the wave force.
        dt: Tick [s].
    """
    R_nb = rotation_from_quaternion(x.attitude)
    w2, decay = waves.frequency**2, 2.0 * waves.damping * waves.frequency
    A = _rates(R_nb, x.velocity, v_dot.slope, turning.omega, w2, decay)
    # The noise comes in the middle of the tick: what shakes the velocity has moved the position by its end.
    B = 0.5 * dt * A
    B = B + 0.5 * product(B[:, :MOVING], B)
    P = _through(B, P) + dt * jnp.diag(noise)
    P = _through(B, P)

    middle = x.velocity + 0.5 * dt * v_dot.value
    half = 0.5 * dt * turning.omega
    turn = quaternion_normalise(jnp.concatenate([jnp.ones(1), half]))
    R_middle = rotation_from_quaternion(
        quaternion_normalise(quaternion_multiply(x.attitude, jnp.concatenate([jnp.ones(1), 0.5 * half])))
    )
    impulse_middle = x.wave_impulse + 0.5 * dt * x.wave_force
    force_middle = x.wave_force - 0.5 * dt * (w2 * x.wave_impulse + decay * x.wave_force)
    after = eqx.tree_at(
        lambda s: (s.position, s.velocity, s.attitude, s.wave_impulse, s.wave_force),
        x,
        (
            x.position + dt * (R_middle @ middle),
            x.velocity + dt * v_dot.value,
            quaternion_normalise(quaternion_multiply(x.attitude, turn)),
            x.wave_impulse + dt * force_middle,
            x.wave_force - dt * (w2 * impulse_middle + decay * force_middle),
        ),
    )
    return after, 0.5 * (P + P.T)


def _rates(R_nb: Array, velocity: Array, slope: Array, omega: Array, w2: Array, decay: Array) -> Array:
    """Rate of the first 15 errors by all, shape (15, 31)."""
    I = jnp.eye(3)
    rows = [
        side_by_side(3, (VELOCITY, R_nb), (ATTITUDE, -product(R_nb, skew(velocity)))),
        slope,
        side_by_side(3, (ATTITUDE, -skew(omega)), (GYRO_BIAS, -I)),
        side_by_side(3, (WAVE_FORCE, I)),
        side_by_side(3, (WAVE_IMPULSE, -w2 * I), (WAVE_FORCE, -decay * I)),
    ]
    return jnp.concatenate(rows)


def _through(B: Array, P: Array) -> Array:
    """(I + B) P (I + B)', B's rows beyond the first 15 being zero."""
    moved = P[:MOVING] + product(B, P)
    corner = moved[:, :MOVING] + product(moved, B.T)
    side = moved[:, MOVING:]
    return jnp.concatenate(
        [jnp.concatenate([corner, side], axis=1), jnp.concatenate([side.T, P[MOVING:, MOVING:]], axis=1)]
    )


def side_by_side(rows: int, *blocks: tuple[slice, Array]) -> Array:
    """A matrix of 31 columns from blocks in their places, in order; zero elsewhere. In a scan a join beats a scatter."""
    parts, at = [], 0
    for place, block in blocks:
        parts += [jnp.zeros((rows, place.start - at)), block]
        at = place.stop
    return jnp.concatenate([*parts, jnp.zeros((rows, ERRORS - at))], axis=1)


def force_inverse(model: Model) -> Array:
    """Inverse of the linear part of M, shape (3, 3), by cofactors: no library call inside a scan."""
    a, b, c = model.mass[0, :3], model.mass[1, :3], model.mass[2, :3]
    bc = cross(b, c)
    return jnp.stack([bc, cross(c, a), cross(a, b)], axis=1) / (a @ bc)


def damping_force(model: Model, nu_r: Array) -> Array:
    """Rows 1 to 3 of D(nu_r) nu_r [N], shape (3,)."""
    ahead, astern = jnp.maximum(nu_r, 0.0), jnp.maximum(-nu_r, 0.0)
    return model.damping[:3] @ jnp.concatenate([ahead, astern, ahead * ahead, astern * astern])


def damping_force_slope(model: Model, nu_r: Array) -> Array:
    """d(damping_force)/d(v_r), shape (3, 3); at zero velocity the mean of ahead and astern."""
    v = nu_r[:3]
    ahead = jnp.where(v > 0, 1.0, jnp.where(v < 0, 0.0, 0.5))
    linear = model.linear_damping_ahead[:3, :3] * ahead + model.linear_damping_astern[:3, :3] * (1.0 - ahead)
    quadratic = jnp.where(v >= 0, model.quadratic_damping_ahead[:3, :3], model.quadratic_damping_astern[:3, :3])
    return linear + 2.0 * quadratic * jnp.abs(v)
