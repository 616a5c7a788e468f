"""Horizontal positions: late, sometimes missing, sometimes wrong, and the only thing that says where the vehicle is.

A reading is compared with where the vehicle was when it was taken, found by going back along the dead-reckoned trail.
Beyond the gate it is rejected. Rejected readings that agree with each other say that the filter errs, not they: after a
few of them the filter's own position is opened again, so that it cannot lock itself out.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.small_matrices import product, squared_norm
from rovtwin.core.flow import Slot
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Index, Scalar, Vector2, Vector3
from rovtwin.gnc.mounting import Mount
from rovtwin.gnc.navigation import measurements as readings
from rovtwin.gnc.navigation.measurements import Innovation
from rovtwin.gnc.navigation.state import ERRORS, HORIZONTAL, NavigationState
from rovtwin.gnc.navigation.tuning import Tuning

TRAIL = 128  # ticks
REOPENED_VELOCITY = 0.05  # standard deviation given back to the velocity [m/s]
# North and east of the place, and of the velocity, among the errors. As masks, for a tick with a scatter by indices is
# not compiled in one piece (`in_one_piece`).
PLACE, VELOCITY = (np.isin(np.arange(ERRORS), pair) for pair in ((0, 1), (3, 4)))


class Trail(eqx.Module):
    """North and east by dead reckoning, without the jumps of corrections: a ring of ticks [m]."""

    ring: Float[Array, "128 2"]

    @classmethod
    def at(cls, position: Vector3) -> "Trail":
        return cls(jnp.zeros((TRAIL, 2)) + position[HORIZONTAL])

    def after(self, moved: Vector3, tick: Index) -> "Trail":
        """With the way of one more tick, n [m]."""
        last = jax.lax.dynamic_index_in_dim(self.ring, (tick - 1) % TRAIL, keepdims=False)
        now = last + moved[HORIZONTAL]
        return Trail(jax.lax.dynamic_update_index_in_dim(self.ring, now, tick % TRAIL, 0))

    def since(self, age: Scalar, tick: Index, dt: float) -> Vector2:
        """Way since `age` seconds ago [m]."""
        back = jnp.clip(age / dt, 0.0, TRAIL - 2.0)
        whole = jnp.floor(back).astype(jnp.int32)
        share = back - whole
        now, later, earlier = (
            jax.lax.dynamic_index_in_dim(self.ring, (tick - i) % TRAIL, keepdims=False)
            for i in (jnp.zeros_like(whole), whole, whole + 1)
        )
        return now - ((1.0 - share) * later + share * earlier)


class Rejected(eqx.Module):
    """Readings beyond the gate, in a row.

    Attributes:
        count: Of those that agree with each other.
        total: Of all.
        residual: The last [m].
    """

    count: Index
    total: Index
    residual: Vector2

    @classmethod
    def none(cls) -> "Rejected":
        none = jnp.zeros((), dtype=jnp.int32)
        return cls(none, none, jnp.zeros(2))


def positions(
    x: NavigationState,
    P: Float[Array, "31 31"],
    slot: Slot,
    trail: Trail,
    rejected: Rejected,
    tuning: Tuning,
    mount: Mount,
    now: Scalar,
    tick: Index,
    dt: float,
) -> tuple[Innovation, Rejected, Float[Array, "31 31"]]:
    """Innovations of all readings of a tick, what was rejected, and P, opened where the filter must be wrong.

    Args:
        x: State.
        P: Its covariance.
        slot: Readings of north and east.
        trail: Up to this tick.
        rejected: Before this tick.
        tuning: Gate, patience.
        mount: Of the sensor.
        now: Time [s].
        tick: Its number.
        dt: Its length [s].
    """
    found = []
    for row in range(slot.valid.shape[0]):
        age = readings.age_of(slot.t_valid[row], now, jnp.minimum(tuning.max_age, (TRAIL - 2) * dt))
        one = readings.position(x, slot.value[row], age, trail.since(age, tick, dt), mount)
        S = product(product(one.slope, P), one.slope.T) + jnp.diag(one.variance)
        there = slot.valid[row]
        far = there & (squared_norm(one.residual, S) > tuning.gate["position"])
        # Two readings of the same place differ by both their noises.
        alike = squared_norm(one.residual - rejected.residual, 2.0 * jnp.diag(one.variance)) < tuning.gate["position"]
        count = jnp.where(far, jnp.where(alike & (rejected.count > 0), rejected.count + 1, 1), rejected.count * ~there)
        total = jnp.where(there, jnp.where(far, rejected.total + 1, 0), rejected.total)
        # A filter that is wrong about its speed sees readings that do not even agree.
        lost = far & ((count >= tuning.patience) | (total >= 2 * tuning.patience))
        covariance_inflation = jnp.where(PLACE, one.residual @ one.residual, VELOCITY * REOPENED_VELOCITY**2)
        P = P + jnp.where(lost, 1.0, 0.0) * jnp.diag(covariance_inflation)
        last = jnp.where(far, one.residual, rejected.residual)
        rejected = Rejected(jnp.where(lost, 0, count), jnp.where(lost, 0, total), last)
        found.append(eqx.tree_at(lambda i: i.used, one, one.used & there & (~far | lost)))
    joined = jax.tree.map(lambda *parts: jnp.concatenate(parts), *found)
    return joined, rejected, P
