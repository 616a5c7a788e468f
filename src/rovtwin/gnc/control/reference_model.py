"""Reference model: a second-order filter that turns steps of the set-point into a smooth path (thesis 7.8)."""

import equinox as eqx
import numpy as np

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import Reference, Setpoint
from rovtwin.core.frames import (
    quaternion_exp,
    quaternion_multiply,
    quaternion_normalise,
    rotation_error,
    rotation_from_quaternion,
)
from rovtwin.core.numerics import as_array, jnp
from rovtwin.core.types import PRNGKey, Vector6

_AXIS = np.arange(6)


class ReferenceModel(Block):
    """x_ref / x_d = w^2 / (s^2 + 2 delta w s + w^2) for each DOF; memory is the last Reference.

    Position moves along the axes of n. Attitude turns about its own axes d, by the rotation vector that is left to the
    set-point, the short way round: for a turn about one axis, such as that of a level vehicle, that is the same filter
    of its angle. The response to a set-point that holds over a tick is then exact at any dt. A limit on the speed cuts
    the velocities, as in Fossen (2021), sec. 12.1.1; x and y are cut by one factor, so that the path between two
    way-points stays straight.

    Attributes:
        damping_ratio: delta.
        frequency: w [rad/s].
        speed_limit: Largest velocity in n and angular velocity in d [m/s, rad/s]; inf is none.
        obey_speed: Whether horizontal and vertical speed are each kept to the set-point's, where that is not zero.
    """

    damping_ratio: Vector6 = eqx.field(converter=as_array)
    frequency: Vector6 = eqx.field(converter=as_array)
    speed_limit: Vector6 = eqx.field(converter=as_array)
    obey_speed: bool = eqx.field(static=True, default=False)

    @classmethod
    def thesis(cls, obey_speed: bool = False) -> "ReferenceModel":
        """delta = 1, w = 1.5 rad/s; the thesis has no speed limit, so that way-points' speeds count for nothing."""
        return cls(np.full(6, 1.0), np.full(6, 1.5), np.full(6, np.inf), obey_speed)  # type: ignore[arg-type]  (NumPy)

    def init(self, key: PRNGKey, start: Start) -> Reference:
        velocity, still = rotation_from_quaternion(start.attitude) @ start.velocity[:3], jnp.zeros(3)
        return Reference(start.position, start.attitude, velocity, start.velocity[3:], still, still)

    def step(self, memory: Reference, input: Setpoint, dt: float) -> tuple[Reference, Reference]:
        w, damping = self.frequency, self.damping_ratio * self.frequency
        ahead = jnp.concatenate(
            [input.position - memory.position, rotation_error(input.attitude, memory.attitude)],
        )
        before = jnp.concatenate([memory.velocity, memory.angular_velocity])
        c, s, decay = _transition(damping, w, dt)
        # State of the filter relative to the set-point: [-ahead, rate], decaying as exp(A dt).
        travelled = ahead - decay * ((c + damping * s) * ahead - s * before)
        free = decay * ((c - damping * s) * before + w**2 * s * ahead)

        rate = self._limited(free, input.nu)
        cut = rate != free
        travelled = jnp.where(cut, 0.5 * dt * (before + rate), travelled)
        change = jnp.where(cut, 0.0, w**2 * (ahead - travelled) - 2.0 * damping * rate)
        turned = quaternion_multiply(memory.attitude, quaternion_exp(travelled[3:]))
        place = memory.position + travelled[:3], quaternion_normalise(turned)
        reference = Reference(*place, rate[:3], rate[3:], change[:3], change[3:])
        return reference, reference

    def _limited(self, rate: Vector6, nu: Vector6) -> Vector6:
        limit = self.speed_limit
        if self.obey_speed:
            desired = jnp.sum(nu[:3] ** 2)
            level = jnp.sum(rate[:2] ** 2)
            over = (desired > 0.0) & (level > desired)
            share = jnp.sqrt(jnp.where(over, desired, 1.0) / jnp.where(over, level, 1.0))
            rate = rate * jnp.where(_AXIS < 2, share, 1.0)
            dive = jnp.sqrt(jnp.where(desired > 0.0, desired, jnp.inf))
            limit = jnp.where(_AXIS == 2, jnp.minimum(limit, dive), limit)
        return jnp.clip(rate, -limit, limit)


def _transition(damping: Vector6, frequency: Vector6, dt: float) -> tuple[Vector6, Vector6, Vector6]:
    """c, s and decay with exp(A dt) = decay (c I + s (A + damping I)), for any damping ratio.

    With q = damping^2 - w^2: c = cosh(sqrt(q) dt), s = sinh(sqrt(q) dt) / sqrt(q); for q < 0 cosine and sine.
    """
    q = damping**2 - frequency**2
    near = jnp.abs(q) * dt**2 < 1e-4
    root = jnp.sqrt(jnp.where(near, 1.0, jnp.abs(q)))
    x = q * dt**2
    # Around critical damping both are even series in sqrt(q): no division by zero, and a gradient.
    c_near = 1.0 + x / 2.0 * (1.0 + x / 12.0 * (1.0 + x / 30.0))
    s_near = dt * (1.0 + x / 6.0 * (1.0 + x / 20.0 * (1.0 + x / 42.0)))
    c_far = jnp.where(q > 0, jnp.cosh(root * dt), jnp.cos(root * dt))
    s_far = jnp.where(q > 0, jnp.sinh(root * dt), jnp.sin(root * dt)) / root
    return jnp.where(near, c_near, c_far), jnp.where(near, s_near, s_far), jnp.exp(-damping * dt)
