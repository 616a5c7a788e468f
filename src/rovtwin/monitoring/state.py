"""The motion as the monitor follows it, with the vehicle's factors held: state, its error, and a step of both.

    p_dot = R v,   q_dot = q * omega / 2,   M nu_dot = tau + b - C(nu_r) nu_r - D(nu_r) nu_r - g - M [omega x v_c; 0]

with a disturbance b that wanders: a force in n and a moment in b. The thrusters' forces are known but for their
factors. The derivative by the factors comes along, and M(theta) is never inverted: at the factors that are held

    nu_dot = a + M^-1 (f(theta) - M(theta) a),    a = M^-1 f

has the same value and the right derivative.

Reference: Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, ch. 6 and 8; Sola (2017),
Quaternion Kinematics for the Error-State Kalman Filter, sec. 5.
"""

import equinox as eqx
from jaxtyping import Float

from rovtwin.core.frames import (
    cross,
    quaternion_turned,
    rotation_between,
    rotation_from_quaternion,
)
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Matrix6, PerThruster, Quaternion, Vector2, Vector3, Vector6
from rovtwin.monitoring.factors import changed
from rovtwin.vehicle.physics.dynamics import coriolis_wrench, damping_wrench, learned_wrench, restoring_wrench
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import inflow_damping, inflow_wrench

POSITION, ATTITUDE, VELOCITY, RATE = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
FORCE, MOMENT, CURRENT, GYRO_BIAS = slice(12, 15), slice(15, 18), slice(18, 20), slice(20, 23)
ERRORS = 23


class Motion(eqx.Module):
    """What is estimated beside the factors.

    Attributes:
        position: CO in n [m].
        attitude: Quaternion R_nb.
        nu: Over ground, b at CO.
        force: Disturbance in n [N].
        moment: Disturbance in b [N m].
        current: Of the water, north and east [m/s].
        gyro_bias: b [rad/s].
    """

    position: Vector3
    attitude: Quaternion
    nu: Vector6
    force: Vector3
    moment: Vector3
    current: Vector2
    gyro_bias: Vector3

    @classmethod
    def at(cls, position: Vector3, attitude: Quaternion) -> "Motion":
        """At a place and attitude, at rest as far as is known."""
        three = jnp.zeros(3)
        return cls(position, attitude, jnp.zeros(6), three, three, jnp.zeros(2), three)

    def moved(self, error: Float[Array, "23"]) -> "Motion":
        """The state with an error added; that of the attitude is a small rotation seen from b."""
        return Motion(
            self.position + error[POSITION],
            quaternion_turned(self.attitude, 0.5 * error[ATTITUDE]),
            self.nu + error[VELOCITY.start : RATE.stop],
            self.force + error[FORCE],
            self.moment + error[MOMENT],
            self.current + error[CURRENT],
            self.gyro_bias + error[GYRO_BIAS],
        )

    def away(self, other: "Motion") -> Float[Array, "23"]:
        """The error that takes `other` to this state."""
        turn = rotation_between(self.attitude, other.attitude)
        parts = [self.position - other.position, turn, self.nu - other.nu]
        parts += [getattr(self, name) - getattr(other, name) for name in ("force", "moment", "current", "gyro_bias")]
        return jnp.concatenate(parts)


def acceleration(model: Model, inverse: Matrix6, x: Motion, thrust: Float[Array, " n"]) -> Vector6:
    """nu_dot, with the right derivative with respect to a model that is not the one of `inverse`.

    Args:
        model: The vehicle at some factors.
        inverse: M^-1 at the factors that are held.
        x: State.
        thrust: Force of each thruster before its factor [N].
    """
    R_nb = rotation_from_quaternion(x.attitude)
    omega, flow = x.nu[3:], R_nb.T[:, :2] @ x.current
    nu_r = x.nu - jnp.concatenate([flow, jnp.zeros(3)])
    tau, drag = model.thrusters.configuration @ thrust, damping_wrench(model, nu_r)
    pushed = tau + jnp.concatenate([R_nb.T @ x.force, x.moment])
    if model.thrusters.inflow_loss is not None:
        lost = inflow_damping(model.thrusters, thrust)
        pushed = pushed + inflow_wrench(model.thrusters.configuration, lost, nu_r)
    water = coriolis_wrench(model.inertia, nu_r) + drag - learned_wrench(model, nu_r, tau, drag)
    f = pushed - water - restoring_wrench(model, R_nb[2])
    held = jax.lax.stop_gradient(inverse @ f)
    relative = held + inverse @ (f - model.inertia @ held)
    return relative - jnp.concatenate([cross(omega, flow), jnp.zeros(3)])


def stepped(model: Model, inverse: Matrix6, x: Motion, thrust: PerThruster, h: float) -> tuple[Motion, Vector6]:
    """The state h later by the midpoint rule, and nu_dot in the middle."""

    def onward(rates: Motion, nu_dot: Vector6, h: float) -> Motion:
        R_nb = rotation_from_quaternion(rates.attitude)
        attitude = quaternion_turned(x.attitude, 0.5 * h * rates.nu[3:])
        place = x.position + h * (R_nb @ rates.nu[:3])
        return eqx.tree_at(lambda s: (s.position, s.attitude, s.nu), x, (place, attitude, x.nu + h * nu_dot))

    middle = onward(x, acceleration(model, inverse, x, thrust), 0.5 * h)
    nu_dot = acceleration(model, inverse, middle, thrust)
    return onward(middle, nu_dot, h), nu_dot


def linearised(
    model: Model, theta: Float[Array, " p"], inverse: Matrix6, x: Motion, thrust: PerThruster, h: float
) -> tuple[Motion, Vector6, Float[Array, "23 23"], Float[Array, "23 p"]]:
    """A step, nu_dot, and the derivatives of the error after it: by the error, (23, 23), and by theta, (23, p)."""
    after, nu_dot = stepped(changed(model, theta), inverse, x, thrust, h)

    def error_after(both: Float[Array, " _"]) -> Float[Array, "23"]:
        there, _ = stepped(changed(model, theta + both[ERRORS:]), inverse, x.moved(both[:ERRORS]), thrust, h)
        return there.away(after)

    slopes = jax.jacfwd(error_after)(jnp.zeros(ERRORS + theta.shape[0]))
    return after, nu_dot, slopes[:, :ERRORS], slopes[:, ERRORS:]
