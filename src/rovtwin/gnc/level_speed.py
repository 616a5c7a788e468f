"""The velocity through the water at which a vehicle stays level, and the heading at which it may go faster.

A velocity (u, v) through the water turns a vehicle by Munk's moment. With its depth held, small angles of roll and
pitch grow where

    (u / U)^2 + (v / V)^2 > 1,      U^2 = k_theta / (A_zz - A_xx),      V^2 = k_phi / (A_zz - A_yy),

k being what rights the vehicle per angle, control included. A dive at a speed w on top of it tilts it by

    w / (1 - (u / U)^2 - (v / V)^2) |(u / U^2, v / V^2)|.

Reference: Fossen (2021), sec. 6.3.3 (Munk's moment); the coupled criterion is the determinant of the stiffness of roll
and pitch at small angles.
"""

import equinox as eqx

from rovtwin.core.frames import wrap
from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.gnc.scales import ANY, MARGIN, VehicleScales
from rovtwin.vehicle.model import Model

SPARE = 0.5  # share of the level speed in surge with which it is to get on against a current
TILT = 0.35  # largest angle to which a dive may tilt the vehicle [rad]
NEVER = 1e-12  # for roots that have a gradient at zero


class LevelSpeed(eqx.Module):
    """Limits of the velocity through the water.

    Attributes:
        axes: Largest in surge and in sway alone, MARGIN of U and V [m/s], shape (2,); together they lie in an ellipse.
    """

    axes: Array = eqx.field(converter=as_array)

    @classmethod
    def of(cls, model: Model) -> "LevelSpeed":
        """For a vehicle with sound thrusters."""
        return cls(VehicleScales.of(model).level_speed)

    def nearest(self, w: Array) -> Array:
        """A velocity through the water, b [m/s], shape (2,), reduced to what keeps the vehicle level."""
        share = jnp.sqrt(_square(w / self.axes) + NEVER)
        return jnp.where(share > 1.0, w / share, w)

    def along(self, part: Array, flow: Array) -> Array:
        """Largest speed over ground in a direction that keeps it level [m/s]; negative where none does.

        Args:
            part: Unit vector of the direction, b, shape (2,).
            flow: Current, b [m/s], shape (2,).
        """
        p, f = part / self.axes, flow / self.axes
        a, b, c = p @ p, p @ f, f @ f - 1.0
        left = b**2 - a * c
        return jnp.where(left > 0.0, (b + jnp.sqrt(jnp.maximum(left, NEVER))) / a, -jnp.sqrt(flow @ flow + NEVER))

    def dive(self, w: Array) -> Array:
        """Largest speed up or down at a velocity through the water, b [m/s], shape (2,), that tilts it by TILT."""
        stands = MARGIN**2 * jnp.minimum(_square(w / self.axes), 1.0)
        turns = MARGIN**2 * jnp.sqrt(_square(w / self.axes**2) + NEVER)
        return jnp.minimum(TILT * (1.0 - stands) / turns, ANY)

    def heading(self, preferred: Array, current: Array, heading: Array, aside: Array) -> Array:
        """Heading nearest to a preferred one at which the vehicle makes way against the current and stays level [rad].

        Where sway is level for longer than surge it turns its side into the current, as far as it has to, and the side
        with which it looks there already.

        Args:
            preferred: Heading [rad].
            current: In n [m/s], shape (2,).
            heading: That it has [rad].
            aside: Largest speed through the water that thrusters push it sideways [m/s].
        """
        size2 = (jnp.sqrt(current @ current + NEVER) + SPARE * self.axes[0]) ** 2
        course = jnp.arctan2(-current[1], -current[0] + NEVER)
        ahead, beside = 1.0 / self.axes**2
        better = ahead > beside
        least = (size2 * ahead - 1.0) / (size2 * jnp.where(better, ahead - beside, 1.0))
        least = jnp.clip(least, 0.0, jnp.minimum(aside**2 / size2, 1.0))
        off, now = wrap(preferred - course), wrap(heading - course)
        sideways = jnp.where(now >= 0.0, 1.0, -1.0) * jnp.sqrt(least + NEVER)
        lengthways = jnp.where(jnp.cos(off) >= 0.0, 1.0, -1.0) * jnp.sqrt(1.0 - least + NEVER)
        turned = wrap(course + jnp.arctan2(sideways, lengthways))
        return jnp.where(better & (least > jnp.sin(off) ** 2), turned, preferred)


def _square(x: Array) -> Array:
    return x @ x
