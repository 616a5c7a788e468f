"""What heave, roll and pitch may ask for where the same thrusters make them.

Vertical thrusters that give all of their force to heave have none left against a roll. The allocation would then make
that moment with thrusters that sit a little above or below, and throw the vehicle sideways. So roll and pitch may ask
for the share of their thrust that heave leaves. Heave comes first, as in the allocation: the depth of a vehicle that
lists is safe, and with a vertical thruster lost the moment is one that nobody can balance.

Shares add up exactly for thrusters of equal force at the corners of a rectangle; for others it is an estimate, and the
allocation, which knows them all, has the last word.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Bool

from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.core.programs.values import once_and_for_all
from rovtwin.core.types import Vector6
from rovtwin.gnc.scales import HEAVE
from rovtwin.vehicle.physics.actuation import axis_limits, pushed_axes
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import force_limits

APART = 0.5  # share of a moment that is left beside full heave, from which on other thrusters make it
ANGLES = (3, 4)


class SharedThrust(eqx.Module):
    """Limits of heave, roll and pitch.

    Attributes:
        lower, upper: Lowest and highest wrench along each axis alone [N, N m]; roll and pitch are moments
            without a force in surge and sway.
        shared: Whether roll and pitch have the thrusters of heave.
    """

    lower: Vector6 = eqx.field(converter=as_array)
    upper: Vector6 = eqx.field(converter=as_array)
    shared: Bool[Array, "2"]

    @classmethod
    def of(cls, model: Model) -> "SharedThrust":
        """Of a vehicle with sound thrusters."""
        lower, upper = axis_limits(model)
        pushed = pushed_axes(model)
        shared = np.zeros(2, dtype=bool)
        for i, axis in enumerate(ANGLES):
            if not pushed[axis]:
                continue
            alone = [_moment(model, axis, sign) for sign in (-1.0, 1.0)]
            beside = [abs(_moment(model, axis, s, z)) for s in (-1.0, 1.0) for z in (lower[HEAVE], upper[HEAVE]) if z]
            lower[axis], upper[axis] = alone
            shared[i] = min(beside, default=np.inf) < APART * min(-alone[0], alone[1])
        return cls(lower, upper, jnp.asarray(shared))

    @property
    def largest(self) -> Vector6:
        """Of each axis, the larger way [N, N m]."""
        return jnp.maximum(self.upper, -self.lower)

    def cut(self, desired: Vector6) -> Vector6:
        """The wrench that may be asked for, b at CO: within the limits, and roll and pitch beside heave."""
        tau = jnp.clip(desired, self.lower, self.upper)
        limit = jnp.where(tau >= 0.0, self.upper, -self.lower)
        share = jnp.abs(tau) / jnp.where(limit > 0.0, limit, 1.0)
        angles = jnp.sum(jnp.where(self.shared, share[3:5], 0.0))
        left = jnp.maximum(1.0 - share[HEAVE], 0.0)
        kept = jnp.where(angles > left, left / jnp.where(angles > left, angles, 1.0), 1.0)
        return tau.at[3:5].multiply(jnp.where(self.shared, kept, 1.0))


@once_and_for_all
def _moment(model: Model, axis: int, sign: float, heave: float | None = None) -> float:
    """Largest moment that way that thrusters make without surge and sway, and beside a heave force if one is given."""
    from scipy.optimize import linprog  # SciPy takes long to import: see `once_and_for_all`

    T = np.asarray(model.thrusters.configuration)
    bounds = np.stack([np.asarray(limit) for limit in force_limits(model.thrusters)], axis=1)
    rows, forces = (T[:2], np.zeros(2)) if heave is None else (T[:3], np.array([0.0, 0.0, 0.999 * heave]))
    found = linprog(-sign * T[axis], A_eq=rows, b_eq=forces, bounds=bounds)
    return -sign * float(found.fun) if found.success else 0.0
