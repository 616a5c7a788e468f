"""Off course: how far a vehicle is from its set-point, and whether it still comes nearer.

The desired place is the set-point's: a point on the path that waits for the vehicle, or the place that is held. Level
and in depth the distance is watched apart. Beyond its limit it has to reach new lows. What the set-point's own motion
adds to a distance is no fault of the vehicle's and is added to the low, so that a dive, a way-point far off and a point
that goes ahead of a slow vehicle are judged by the way that the vehicle makes towards them.

Limits and times follow from the vehicle (`limits_of`), with a speed v, an acceleration a and a turn rate r of its own:

    level   FAR lengths + v^2 / 2a (+ 2 v / r without sway),    HEADWAY lengths / v + v / a (+ 2 pi / r without sway)
    depth   DEEP lengths + w^2 / 2a,                            HEADWAY lengths / w + w / a

Guidance's point stands still for a vehicle that is 3.2 lengths away, so that FAR lengths are no lag behind it. No time
is shorter than SETTLES: a swell, a gust and an estimate that was corrected pass as slowly for a small, quick vehicle.
"""

from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.flow import Estimate
from rovtwin.core.numerics import Array, jnp
from rovtwin.core.types import Flag, Scalar, Vector2, Vector3
from rovtwin.gnc.scales import HEAVE, YAW, VehicleScales
from rovtwin.vehicle.physics.model import Model

FAR, DEEP = 6.4, 3.2  # lengths of the vehicle, level and in depth
HEADWAY = 20.0  # lengths for which its speed has time until a step nearer is missed, as in `runs.scoring.stalls`
STEP = 0.25  # of a length: less is no step nearer
SETTLES = 20.0  # least time without a step nearer [s]
CERTAIN = 3.0  # standard deviations of the estimate that are added to a limit


class OffCourse(eqx.Module):
    """What is remembered.

    Attributes:
        valid: Whether the last tick had a set-point.
        desired: Its place, n [m].
        nearest: Least distances, level and in depth [m].
    """

    valid: Flag
    desired: Vector3
    nearest: Vector2

    @classmethod
    def none(cls) -> "OffCourse":
        return cls(jnp.asarray(False), jnp.zeros(3), jnp.zeros(2))

    def step(
        self, desired: Vector3, estimate: Estimate, limit: Vector2, step: Scalar
    ) -> tuple["OffCourse", Bool[Array, "2"]]:
        """A tick later, and where the vehicle is too far off and no nearer than it was.

        Args:
            desired: Place of the set-point that the vehicle had in the last tick, n [m]; NaN for none.
            estimate: The observer's; waves do not count.
            limit: Level and in depth, to which the estimate's uncertainty is added [m].
            step: That counts as nearer [m].
        """
        place = estimate.slow_position
        variance = jnp.diagonal(estimate.covariance)[:3]
        std = jnp.sqrt(jnp.maximum(jnp.stack([jnp.max(variance[:2]), variance[2]]), 0.0))
        off, before = _apart(place, desired), _apart(place, self.desired)
        known = jnp.all(jnp.isfinite(off))
        far = off > limit + CERTAIN * std
        nearest = jnp.where(self.valid, self.nearest + off - before, off)
        nearer = off < nearest - step
        kept = jnp.where(far & ~nearer, nearest, off)
        kept = jnp.where(known, kept, 0.0)
        return OffCourse(known, jnp.where(known, desired, 0.0), kept), far & ~nearer


def _apart(place: Vector3, desired: Vector3) -> Vector2:
    """Distance, level and in depth [m]."""
    level, depth = place[:2] - desired[:2], place[2] - desired[2]
    return jnp.stack([jnp.sqrt(level @ level + 1e-12), jnp.abs(depth)])


class CourseLimits(NamedTuple):
    """Limits [m], level and in depth, times [s], and the step that counts as nearer [m]."""

    limit: Float[np.ndarray, "2"]
    after: Float[np.ndarray, "2"]
    step: float


def limits_of(model: Model) -> CourseLimits:
    """Of a vehicle as built; infinite where its thrusters cannot bring it back."""
    scales = VehicleScales.of(model)
    length, turn = scales.length, scales.turn_rate
    speeds = np.array([scales.surge_speed, scales.dive_speed])
    pushes = np.array([scales.acceleration[0], scales.acceleration[HEAVE]])
    crabs = scales.crabs
    able = np.array([scales.force[0] > 0.0 and (crabs or scales.force[YAW] > 0.0), scales.force[HEAVE] > 0.0])
    # Whatever cannot push sideways comes back in a curve.
    curve = 1.0 / turn if able[0] and not crabs else 0.0
    v, a = np.where(able, speeds, 1.0), np.where(able, pushes, 1.0)
    limit = np.array([FAR, DEEP]) * length + v**2 / (2.0 * a) + np.array([2.0 * v[0] * curve, 0.0])
    after = HEADWAY * length / v + v / a + np.array([2.0 * np.pi * curve, 0.0])
    return CourseLimits(np.where(able, limit, np.inf), np.maximum(after, SETTLES), STEP * length)
