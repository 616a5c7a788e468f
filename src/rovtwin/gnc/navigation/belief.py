"""The filter's state as others use it: pose in Euler angles, velocity, disturbance, covariance, motion of the waves."""

from rovtwin.core.flow import Estimate
from rovtwin.core.frames import cross, euler_from_quaternion, euler_rate_matrix, rotation_from_quaternion
from rovtwin.core.numerics import Array, jnp
from rovtwin.gnc.ekf_model import product
from rovtwin.gnc.navigation import motion
from rovtwin.gnc.navigation.state import ATTITUDE, GYRO_BIAS, POSITION, VELOCITY, NavigationState
from rovtwin.gnc.navigation.tuning import Tuning
from rovtwin.vehicle.model import Model


def estimate_of(
    model: Model,
    tuning: Tuning,
    x: NavigationState,
    P: Array,
    omega: Array,
    heard: dict[str, tuple[Array, Array]],
    names: list[str],
) -> Estimate:
    """What an observer gives.

    Args:
        model: The vehicle, in still water without disturbance.
        tuning: Of the filter.
        x: Nominal state.
        P: Covariance of its error, shape (31, 31).
        omega: Angular velocity, b [rad/s], shape (3,).
        heard: Squared normalised innovations and their number, by sensor.
        names: Of all sensors, sorted.
    """
    euler = euler_from_quaternion(x.attitude)
    nothing = (jnp.zeros(()), jnp.zeros(()))
    told = [heard.get(name, nothing) for name in names]
    force = disturbance(model, x, omega)
    gyro = tuning.mounts["gyro"].std ** 2 if "gyro" in tuning.mounts else tuning.turn_noise**2
    return Estimate(
        eta=jnp.concatenate([x.position, euler]),
        nu=jnp.concatenate([x.velocity, omega]),
        bias=jnp.concatenate([rotation_from_quaternion(x.attitude) @ force, jnp.zeros(3)]),
        covariance=_covariance(P, euler, gyro),
        nis=jnp.stack([squares for squares, _ in told]),
        nis_dof=jnp.stack([number for _, number in told]),
        wave=wave_motion(tuning, x),
    )


def disturbance(model: Model, x: NavigationState, omega: Array) -> Array:
    """Force that acts besides what the model has in still water, without that of the waves, b [N], shape (3,)."""
    R_bn = rotation_from_quaternion(x.attitude).T
    current = R_bn[:, 0] * x.current[0] + R_bn[:, 1] * x.current[1]
    nu, mass = jnp.concatenate([x.velocity, omega]), model.mass[:3]
    nu_r = jnp.concatenate([x.velocity - current, omega])
    still = motion.damping_force(model, nu) + cross(omega, mass @ nu)
    flowing = jnp.exp(x.drag) * motion.damping_force(model, nu_r) + cross(omega, mass @ nu_r)
    carried = mass[:, :3] @ cross(omega, current)
    return R_bn @ x.force_n + jnp.append(x.force_b, 0.0) + still - flowing - carried


def wave_motion(tuning: Tuning, x: NavigationState) -> Array:
    """Place and velocity of wave frequency, n [m, m/s], shape (6,): the wave force integrated over the mass alone.

    Drag is left out: at wave frequency it is small against inertia. For x1' = x2, x2' = -w^2 x1 - 2 z w x2 the integral
    of x1 is -(x2 + 2 z w x1) / w^2.
    """
    w, z, mass = tuning.wave_frequency, tuning.wave_damping, tuning.wave_mass
    place = -(x.wave_force + 2.0 * z * w * x.wave_impulse) / (w * w * mass)
    return jnp.concatenate([place, x.wave_impulse / mass])


def _covariance(P: Array, euler: Array, gyro_variance: Array) -> Array:
    """Of [eta, nu], shape (12, 12)."""
    order = (POSITION, ATTITUDE, VELOCITY, GYRO_BIAS)
    C = jnp.concatenate([P[rows] for rows in order])
    C = jnp.concatenate([C[:, columns] for columns in order], axis=1)
    T = euler_rate_matrix(euler)
    C = jnp.concatenate([C[:3], product(T, C[3:6]), C[6:9], -C[9:]])
    C = jnp.concatenate([C[:, :3], product(C[:, 3:6], T.T), C[:, 6:9], -C[:, 9:]], axis=1)
    return C + jnp.diag(jnp.concatenate([jnp.zeros(9), jnp.full(3, 1.0) * gyro_variance]))
