"""Control plant model of the extended Kalman filter: x_dot = f(x, tau), its Jacobian, one discrete step of both.

    x = [eta (6), nu (6), b (6)]
    eta_dot = J(eta) nu
    M nu_dot = tau + [R_nb^T b_1; b_2] - C(nu) nu - D(nu) nu - g(eta)
    b_dot = -b / T_b

This is (2.36) of the thesis. Its state-space form (2.38) drops C(nu) nu and replaces g(eta) by a linear term that is
turned with the yaw alone; here both are whole. b_1 is a force in n, b_2 a moment in b: what a current, a tether or a
wrong weight does stays put when the vehicle turns, and a moment from a shifted payload turns with it.

Euler angles, as in the thesis: singular at theta = +-90 deg. The supervisor's attitude limit, which is at most 85 here,
keeps away from it.

Reference: Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, ch. 2, 6 and 8.
"""

from jaxtyping import Float

from rovtwin.core.arrays.small_matrices import product
from rovtwin.core.frames import cross, euler_rate_matrix, rotation_from_euler
from rovtwin.core.numerics import Array, jnp
from rovtwin.core.types import Matrix3, Vector3, Vector6
from rovtwin.vehicle.physics.dynamics import coriolis_wrench, damping_wrench, learned_wrench, restoring_wrench
from rovtwin.vehicle.physics.linearisation import coriolis_jacobian, damping_jacobian, restoring_jacobian
from rovtwin.vehicle.physics.model import Model

STATES = 18


def state_rate(model: Model, x: Float[Array, "18"], tau: Vector6, bias_decay: Vector6) -> Float[Array, "18"]:
    """f(x, tau).

    Args:
        model: The vehicle.
        x: State [eta, nu, b].
        tau: Wrench of the thrusters, b at CO [N, N m].
        bias_decay: 1 / T_b [1/s]; 0 is a random walk.
    """
    euler, nu, b = x[3:6], x[6:12], x[12:]
    R_nb = rotation_from_euler(euler)
    wrench = (
        tau
        + learned_wrench(model, nu, tau)
        + jnp.concatenate([R_nb.T @ b[:3], b[3:]])
        - coriolis_wrench(model.inertia, nu)
        - damping_wrench(model, nu)
        - restoring_wrench(model, R_nb[2])
    )
    rates = [R_nb @ nu[:3], euler_rate_matrix(euler) @ nu[3:], model.inertia_inverse @ wrench, -bias_decay * b]
    return jnp.concatenate(rates)


def state_jacobian(model: Model, x: Float[Array, "18"], bias_decay: Vector6) -> Float[Array, "18 18"]:
    """F = df/dx; tau enters f linearly and leaves no trace in it.

    The slope of a learned discrepancy is left out here; the error-state filter (`gnc.navigation`) has it.
    """
    euler, nu, b = x[3:6], x[6:12], x[12:]
    R_nb, T = rotation_from_euler(euler), euler_rate_matrix(euler)
    axes = _angle_axes(euler, R_nb)
    zero33, zero36, zero63 = jnp.zeros((3, 3)), jnp.zeros((3, 6)), jnp.zeros((6, 3))

    v_n = R_nb @ nu[:3]
    dv_n = jnp.stack([cross(axis, v_n) for axis in axes], axis=1)
    db_b = jnp.stack([-(R_nb.T @ cross(axis, b[:3])) for axis in axes], axis=1)
    ddown = jnp.stack([_down_rate(axis, R_nb) for axis in axes], axis=1)
    dwrench_deuler = jnp.concatenate([db_b, zero33]) - product(restoring_jacobian(model), ddown)
    dwrench_dnu = -coriolis_jacobian(model.inertia, nu) - damping_jacobian(model, nu)
    dwrench_db = jnp.block([[R_nb.T, zero33], [zero33, jnp.eye(3)]])
    dwrench = jnp.concatenate([dwrench_deuler, dwrench_dnu, dwrench_db], axis=1)
    return jnp.concatenate(
        [
            jnp.concatenate([zero33, dv_n, R_nb, zero33, zero36], axis=1),
            jnp.concatenate([zero33, _euler_rate_slope(euler, nu[3:]), zero33, T, zero36], axis=1),
            jnp.concatenate([zero63, product(model.inertia_inverse, dwrench)], axis=1),
            jnp.concatenate([jnp.zeros((6, 12)), -jnp.diag(bias_decay)], axis=1),
        ]
    )


def _angle_axes(euler: Vector3, R_nb: Matrix3) -> tuple[Vector3, Vector3, Vector3]:
    """Axes in n about which phi, theta and psi turn: dR_nb/dphi = S(axis) R_nb and so on."""
    zero, one = jnp.zeros_like(euler[0]), jnp.ones_like(euler[0])
    return R_nb[:, 0], jnp.array([-jnp.sin(euler[2]), jnp.cos(euler[2]), zero]), jnp.array([zero, zero, one])


def _down_rate(axis: Vector3, R_nb: Matrix3) -> Vector3:
    """Derivative of the direction of gravity seen in b, R_nb^T e_z, as R_nb turns about an axis in n."""
    return R_nb.T @ jnp.array([-axis[1], axis[0], jnp.zeros_like(axis[0])])


def _euler_rate_slope(euler: Vector3, omega: Vector3) -> Matrix3:
    """d(T(Theta) omega)/dTheta."""
    sf, cf, ct, tt = jnp.sin(euler[0]), jnp.cos(euler[0]), jnp.cos(euler[1]), jnp.tan(euler[1])
    zero = jnp.zeros_like(sf)
    along, across = cf * omega[1] - sf * omega[2], sf * omega[1] + cf * omega[2]
    return jnp.array(
        [
            [along * tt, across / (ct * ct), zero],
            [-across, zero, zero],
            [along / ct, across * tt / ct, zero],
        ]
    )


def discrete_step(
    model: Model, x: Float[Array, "18"], tau: Vector6, tau_middle: Vector6, bias_decay: Vector6, dt: float
) -> tuple[Float[Array, "18"], Float[Array, "18 18"]]:
    """f_k(x) by the midpoint rule, and the transition matrix of half the step.

    Phi = df_k/dx is the half step's matrix twice, to second order in dt; the thesis's (2.42) differentiates the already
    discrete f_k inside I + T df_k/dx, which counts the identity twice.

    Args:
        model: The vehicle.
        x: State at the start of the step.
        tau: Wrench at the start of the step.
        tau_middle: Wrench half a step later.
        bias_decay: 1 / T_b [1/s].
        dt: Step [s].
    """
    middle = x + 0.5 * dt * state_rate(model, x, tau, bias_decay)
    after = x + dt * state_rate(model, middle, tau_middle, bias_decay)
    A = 0.5 * dt * state_jacobian(model, middle, bias_decay)
    return after, jnp.eye(STATES) + A + 0.5 * product(A, A)
