"""The filter's state as others use it: pose, velocity, disturbance, covariance, motion of the waves."""

from jaxtyping import Float

from rovtwin.core.arrays.small_matrices import product
from rovtwin.core.flow import Estimate
from rovtwin.core.frames import cross, rotation_from_quaternion
from rovtwin.core.numerics import Array, jnp
from rovtwin.core.types import Matrix3, Scalar, Vector3
from rovtwin.gnc.navigation.corrections import InnovationTest
from rovtwin.gnc.navigation.state import (
    ATTITUDE,
    CURRENT,
    FORCE_B,
    FORCE_N,
    GYRO_BIAS,
    POSITION,
    VELOCITY,
    WAVE_PLACE,
    WAVE_VELOCITY,
    NavigationState,
)
from rovtwin.gnc.navigation.tuning import Tuning
from rovtwin.vehicle.physics.dynamics import damping_force
from rovtwin.vehicle.physics.linearisation import damping_jacobian
from rovtwin.vehicle.physics.model import Model


def estimate_of(
    model: Model,
    tuning: Tuning,
    x: NavigationState,
    P: Float[Array, "31 31"],
    omega: Vector3,
    received: dict[str, InnovationTest],
    names: list[str],
) -> Estimate:
    """What an observer gives.

    Args:
        model: The vehicle, in still water without disturbance.
        tuning: Of the filter.
        x: Nominal state.
        P: Covariance of its error.
        omega: Angular velocity, b [rad/s].
        received: Tests of the innovations, by sensor.
        names: Of all sensors, sorted.
    """
    R_nb = rotation_from_quaternion(x.attitude)
    tests = [received.get(name, InnovationTest.none()) for name in names]
    force = disturbance(model, x, omega)
    return Estimate(
        position=x.position + x.wave_place,
        attitude=x.attitude,
        nu=jnp.concatenate([x.velocity + R_nb.T @ x.wave_velocity, omega]),
        bias=jnp.concatenate([R_nb @ force, jnp.zeros(3)]),
        covariance=_covariance(P, R_nb, tuning.rate_variance),
        nis=jnp.stack([test.squares for test in tests]),
        nis_dof=jnp.stack([test.number for test in tests]),
        wave=jnp.concatenate([x.wave_place, x.wave_velocity]),
        bias_std=_disturbance_std(model, x, P, omega),
    )


def _disturbance_std(model: Model, x: NavigationState, P: Float[Array, "31 31"], omega: Vector3) -> Scalar:
    """Of the horizontal disturbance force, both directions together [N].

    Force in n, force in b, and the current by the slope of the drag; what they have in common is left out.
    """
    slope = damping_jacobian(model, jnp.concatenate([x.velocity, omega]), 3)[:2, :2]
    level = jnp.concatenate([jnp.diagonal(P)[FORCE_N][:2], jnp.diagonal(P)[FORCE_B]])
    return jnp.sqrt(jnp.sum(level) + jnp.sum(slope**2) * 0.5 * jnp.trace(P[CURRENT, CURRENT]))


def disturbance(model: Model, x: NavigationState, omega: Vector3) -> Vector3:
    """Force that acts besides what the model has in still water, without that of the waves, b [N]."""
    R_bn = rotation_from_quaternion(x.attitude).T
    current = R_bn[:, 0] * x.current[0] + R_bn[:, 1] * x.current[1]
    nu, mass = jnp.concatenate([x.velocity, omega]), model.inertia[:3]
    nu_r = jnp.concatenate([x.velocity - current, omega])
    still = damping_force(model, nu) + cross(omega, mass @ nu)
    flowing = jnp.exp(x.drag) * damping_force(model, nu_r) + cross(omega, mass @ nu_r)
    carried = mass[:, :3] @ cross(omega, current)
    return R_bn @ x.force_n + jnp.append(x.force_b, 0.0) + still - flowing - carried


def _covariance(P: Float[Array, "31 31"], R_nb: Matrix3, gyro_variance: Vector3) -> Float[Array, "12 12"]:
    """Of position, attitude and nu, slow motion and waves together."""

    def seen(rows: Float[Array, "31 k"]) -> Float[Array, "12 k"]:
        """Errors of the estimate of those of the state, leading axis 31 -> 12."""
        return jnp.concatenate(
            [
                rows[POSITION] + rows[WAVE_PLACE],
                rows[ATTITUDE],
                rows[VELOCITY] + product(R_nb.T, rows[WAVE_VELOCITY]),
                -rows[GYRO_BIAS],
            ]
        )

    C = seen(seen(P).T)
    return C + jnp.diag(jnp.concatenate([jnp.zeros(9), gyro_variance]))
