"""A hand: what tilts a vehicle and keeps it there until a decay test begins."""

import equinox as eqx
from jaxtyping import Float

from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.core.types import Scalar, ScalarLike, Vector6
from rovtwin.vehicle.physics.dynamics import State, restoring_wrench
from rovtwin.vehicle.physics.model import Model


class AttitudeRestraint(eqx.Module):
    """Springs and dampers that turn the vehicle to an attitude within spans of time; nothing outside of them.

    It carries what gravity asks for at that attitude, so that the springs bring it there and not short of it.

    Attributes:
        spans: From (included) to (excluded) [s].
        R_nb: Attitude to bring it to in each.
        frequency: Of the springs, on the vehicle's own inertia [rad/s]; well damped.
    """

    spans: Float[Array, "n 2"] = eqx.field(converter=as_array)
    R_nb: Float[Array, "n 3 3"] = eqx.field(converter=as_array)
    frequency: Scalar = eqx.field(converter=as_array, default=3.0)

    def wrench(self, model: Model, state: State, t: ScalarLike) -> Vector6:
        """Wrench of the hand at time t [s], b at CO [N, N m]."""
        holding = (self.spans[:, 0] <= t) & (t < self.spans[:, 1])
        desired = jnp.sum(jnp.where(holding[:, None, None], self.R_nb, 0.0), axis=0)
        # Rotation from the desired attitude: the skew part of R_desired' R, exact in direction.
        R = desired.T @ rotation_from_quaternion(state.attitude)
        turned = 0.5 * jnp.stack([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
        w = self.frequency
        pull = -(w**2) * jnp.concatenate([jnp.zeros(3), turned]) - 2.0 * w * state.nu
        carried = restoring_wrench(model, desired[2]) * jnp.asarray([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
        return jnp.where(jnp.any(holding), jnp.diagonal(model.inertia) * pull + carried, 0.0)
