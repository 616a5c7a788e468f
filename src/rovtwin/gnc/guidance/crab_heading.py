"""The heading of a vehicle that crabs: the one that is preferred, or turned as far as the current makes it.

    lag current_dot = estimate - current,   heading = level_heading(preferred, way, current),   current / BACK if turned

`LevelSpeed.heading` says where a vehicle has to look that cannot stem, or not stem level, what runs across it. Here is
what it takes to follow that in a sea. Of the estimated force only what is known counts, no stronger than what the
thrusters could stem at all, smoothed over the time in which the vehicle moves a length. A heading that was given up is
taken again when it would do, for some of these times, in a current stronger by 1 / BACK; until then the last turned one
holds. So one wrong estimate turns nothing, and a vehicle at the limit is not turned to and fro. Which end looks into
the current is settled when it begins to turn.
"""

import equinox as eqx
import numpy as np

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import Estimate
from rovtwin.core.frames import heading_of, wrap
from rovtwin.core.numerics import as_array, jnp
from rovtwin.core.types import Flag, PRNGKey, Scalar, Vector2
from rovtwin.gnc.guidance.speed_limit import FREE, AchievableSpeed, significant
from rovtwin.gnc.scales import YAW, VehicleScales
from rovtwin.vehicle.physics.model import Model

SLOW = 3.0  # times of the position loop over which a current is smoothed
EASED = 10.0  # of them for which the preferred heading has to do before it is taken again
BACK = 0.85  # share of the current in which a heading was given up, in which it is taken again
SAME = 1e-6  # headings that are one [rad]


class BowInput(eqx.Module):
    """What is preferred: a heading [rad] and a way over ground, n [m/s]; and the estimate."""

    preferred: Scalar
    way: Vector2
    estimate: Estimate


class BowMemory(eqx.Module):
    """What is remembered.

    Attributes:
        current: Smoothed, n [m/s].
        heading: That was given [rad].
        turned: Whether the current turned it away from the preferred one.
        eased: How long the preferred one would have done since [s].
    """

    current: Vector2
    heading: Scalar
    turned: Flag
    eased: Scalar


class Bow(Block):
    """Gives the heading [rad].

    Attributes:
        sustained: What it stems, level.
        lag: Of the smoothed current [s].
        patience: How long the preferred heading has to do [s].
        strongest: Current beyond which a stronger one is none [m/s].
    """

    sustained: AchievableSpeed
    lag: Scalar = eqx.field(converter=as_array)
    patience: Scalar = eqx.field(converter=as_array)
    strongest: Scalar = eqx.field(converter=as_array)

    @classmethod
    def of(cls, model: Model) -> "Bow | None":
        """For a vehicle with sound thrusters; None where they do not turn it."""
        scales, sustained = VehicleScales.of(model), AchievableSpeed.of(model)
        if scales.force[YAW] <= 0.0:
            return None
        most = np.asarray(sustained.most)
        strongest = most[most < FREE].max(initial=0.0) or scales.wave_speed
        return cls(sustained, SLOW / scales.level_bandwidth, EASED / scales.level_bandwidth, strongest)

    def init(self, key: PRNGKey, start: Start) -> BowMemory:
        zero = jnp.zeros(())
        return BowMemory(jnp.zeros(2), heading_of(start.attitude), jnp.asarray(False), zero)

    def step(self, memory: BowMemory, input: BowInput, dt: float) -> tuple[BowMemory, Scalar]:
        known = self.sustained.current(significant(input.estimate))
        known = known * jnp.minimum(1.0, self.strongest / jnp.sqrt(known @ known + 1e-12))
        current = memory.current + jnp.minimum(dt / self.lag, 1.0) * (known - memory.current)
        desired = self._desired(current, memory, input.preferred, input.way, input.estimate)
        does = jnp.abs(wrap(desired - input.preferred)) < SAME
        eased = jnp.where(does & memory.turned, memory.eased + dt, 0.0)
        turned = ~does | (memory.turned & (eased < self.patience))
        heading = jnp.where(turned & does, memory.heading, desired)
        return BowMemory(current, heading, turned, eased), heading

    def heading(self, memory: BowMemory, preferred: Scalar, way: Vector2, estimate: Estimate) -> Scalar:
        """What it would give for another heading and way, if it had to now [rad]; arguments are those of BowInput."""
        return self._desired(memory.current, memory, preferred, way, estimate)

    def _desired(
        self, current: Vector2, memory: BowMemory, preferred: Scalar, way: Vector2, estimate: Estimate
    ) -> Scalar:
        """Nearest to a preferred one at which it keeps up a way over ground, and stays where it stops [rad]."""
        current = current / jnp.where(memory.turned, BACK, 1.0)
        looks = jnp.where(memory.turned, memory.heading, estimate.heading)
        for over_ground in (way, jnp.zeros(2)):  # it starts, waits and is paused on its way, too
            preferred = self.sustained.level_heading(preferred, over_ground, current, looks)
        return preferred
