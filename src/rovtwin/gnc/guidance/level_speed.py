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
from rovtwin.core.numerics import as_array, jnp
from rovtwin.core.types import Flag, Scalar, ScalarLike, Vector2
from rovtwin.gnc.scales import ANY, MARGIN, VehicleScales
from rovtwin.vehicle.physics.model import Model

SPARE = 0.5  # share of the level speed in surge with which it is to get on against a current
EASY = 0.8  # share of the level speed at the heading that is chosen: the rest is the feedback's
TILT = 0.35  # largest angle to which a dive may tilt the vehicle [rad]
NEVER = 1e-12  # for roots that have a gradient at zero


class LevelSpeed(eqx.Module):
    """Limits of the velocity through the water.

    Attributes:
        axes: Largest in surge and in sway alone, MARGIN of U and V [m/s]; together they lie in an ellipse.
    """

    axes: Vector2 = eqx.field(converter=as_array)

    @classmethod
    def of(cls, model: Model) -> "LevelSpeed":
        """For a vehicle with sound thrusters."""
        return cls(VehicleScales.of(model).level_speed)

    def share(self, w: Vector2) -> Scalar:
        """A velocity through the water, b [m/s], over what keeps the vehicle level."""
        return jnp.sqrt(_square(w / self.axes) + NEVER)

    def nearest(self, w: Vector2, allowed: ScalarLike = 1.0) -> Vector2:
        """A velocity through the water, b [m/s], reduced to so many times what keeps the vehicle level."""
        share = self.share(w) / allowed
        return jnp.where(share > 1.0, w / share, w)

    def along(self, part: Vector2, flow: Vector2) -> Scalar:
        """Largest speed over ground in a direction that keeps it level [m/s]; negative where none does.

        Args:
            part: Unit vector of the direction, b.
            flow: Current, b [m/s].
        """
        p, f = part / self.axes, flow / self.axes
        a, b, c = p @ p, p @ f, f @ f - 1.0
        left = b**2 - a * c
        return jnp.where(left > 0.0, (b + jnp.sqrt(jnp.maximum(left, NEVER))) / a, -jnp.sqrt(flow @ flow + NEVER))

    def dive(self, w: Vector2) -> Scalar:
        """Largest speed up or down at a velocity through the water, b [m/s], that tilts it by TILT."""
        stands = MARGIN**2 * jnp.minimum(_square(w / self.axes), 1.0)
        turns = MARGIN**2 * jnp.sqrt(_square(w / self.axes**2) + NEVER)
        return jnp.minimum(TILT * (1.0 - stands) / turns, ANY)

    def heading(
        self, preferred: Scalar, way: Vector2, current: Vector2, heading: Scalar, aside: Scalar, astern: Scalar
    ) -> Scalar:
        """Heading nearest to a preferred one at which the vehicle makes way against the current and stays level [rad].

        Where surge is level for longer than sway, or thrust in sway too weak, it turns its bow as far as it has to into
        the velocity through the water that its way over ground takes; or its stern, if that looks there already and
        thrust astern is enough.
        Where sway is level for longer it turns its side into the current in the same manner.

        Args:
            preferred: Heading [rad].
            way: Velocity over ground that is requested, n [m/s]; SPARE of the level speed counts.
            current: In n [m/s].
            heading: That it has [rad].
            aside: Largest speed through the water that thrusters push it sideways [m/s]; 0: none do.
            astern: The same backwards.
        """
        ahead, beside = 1.0 / (EASY * self.axes) ** 2
        turned, has_to = self._side_first(preferred, current, heading, aside)
        speed = jnp.sqrt(way @ way + NEVER)
        w = way * jnp.minimum(1.0, SPARE * self.axes[0] / speed) - current
        size2 = w @ w + NEVER
        limited = beside > ahead
        # Where the bow into it would tip it, it turns for no speed that thrust in sway lacks anyway: see `_side_first`.
        has = jnp.maximum(jnp.minimum(aside, self.axes[1]), jnp.sqrt(current @ current + NEVER))
        worse = (ahead > beside) & (size2 * ahead > 1.0)
        size2 = jnp.where(worse, jnp.minimum(size2, has**2 + NEVER), size2)
        most = (1.0 - size2 * ahead) / (size2 * jnp.where(limited, beside - ahead, 1.0))
        most = jnp.clip(jnp.where(limited, most, 1.0), 0.0, jnp.where(aside > 0.0, aside**2 / size2, 1.0))
        course = jnp.arctan2(w[1], w[0] + NEVER)
        off, now = wrap(preferred - course), wrap(heading - course)
        sideways = jnp.where(jnp.sin(off) >= 0.0, 1.0, -1.0) * jnp.sqrt(jnp.minimum(most, 1.0) + NEVER)
        lengthways = jnp.sqrt(jnp.maximum(1.0 - most, 0.0) + NEVER)
        bow_first = (jnp.cos(now) >= 0.0) | (lengthways * jnp.sqrt(size2) > astern)
        lengthways = jnp.where(bow_first, 1.0, -1.0) * lengthways
        bow = wrap(course + jnp.arctan2(sideways, lengthways))
        return jnp.where(has_to, turned, jnp.where(jnp.sin(off) ** 2 > most, bow, preferred))

    def _side_first(self, preferred: Scalar, current: Vector2, heading: Scalar, aside: Scalar) -> tuple[Scalar, Flag]:
        """Heading with as much of the side in the current as it takes [rad], and whether it takes it."""
        flow = jnp.sqrt(current @ current + NEVER)
        # Speed to spare beside the current, as far as thrust and levelness have any sideways: turning the bow to where
        # they would have more makes it less level, not faster.
        spare = jnp.clip(jnp.minimum(aside, self.axes[1]) - flow, 0.0, SPARE * self.axes[0])
        size2 = (flow + spare) ** 2
        course = jnp.arctan2(-current[1], -current[0] + NEVER)
        ahead, beside = 1.0 / self.axes**2
        better = ahead > beside
        least = (size2 * ahead - 1.0) / (size2 * jnp.where(better, ahead - beside, 1.0))
        least = jnp.clip(least, 0.0, jnp.minimum(aside**2 / size2, 1.0))
        off, now = wrap(preferred - course), wrap(heading - course)
        sideways = jnp.where(now >= 0.0, 1.0, -1.0) * jnp.sqrt(least + NEVER)
        lengthways = jnp.where(jnp.cos(off) >= 0.0, 1.0, -1.0) * jnp.sqrt(1.0 - least + NEVER)
        return wrap(course + jnp.arctan2(sideways, lengthways)), better & (least > jnp.sin(off) ** 2)


def _square(x: Vector2) -> Scalar:
    return x @ x
