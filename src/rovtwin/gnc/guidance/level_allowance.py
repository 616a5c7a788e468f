"""How far beyond the speed that should keep it level a vehicle may go, because it stays level all the same.

The velocity through the water is read off a disturbance force, and the speed that keeps the vehicle level off its
model. A dead or reversed thruster, a tether or drag that the file lacks looks like a current, and a vehicle that gives
way to it drifts though no water flows. Too much water that does flow past turns the vehicle by Munk's moment, and roll
and pitch are measured. So a vehicle that is asked for more than its level speed and stays at its trim is allowed it
little by little. Beyond QUIET it has to be quiet again for a while first; beyond TILTED all is taken back at once, for
the moment grows with the square of the speed and the angle with its exponential. A dive that tilts it counts, too.
"""

import equinox as eqx
import numpy as np

from rovtwin.core.numerics import as_array, jnp
from rovtwin.core.types import Scalar, Vector2
from rovtwin.gnc.guidance.level_speed import NEVER
from rovtwin.gnc.scales import VehicleScales
from rovtwin.vehicle.analysis.stability import hang
from rovtwin.vehicle.physics.model import Model

QUIET, TILTED = 0.1, 0.2  # off the trim, roll and pitch together: level, and not level [rad]
MOST = 2.0  # of the level speed
LEARNS, SETTLES, WAITS = 5.0, 2.0, 10.0  # time constant; waits beyond QUIET and beyond TILTED; in 1 / bandwidth


class Allowance(eqx.Module):
    """What is remembered.

    Attributes:
        factor: On the level speed, 1 to MOST.
        wait: Until it may grow again [s].
    """

    factor: Scalar
    wait: Scalar

    @classmethod
    def none(cls) -> "Allowance":
        return cls(jnp.ones(()), jnp.zeros(()))


class LevelAllowance(eqx.Module):
    """Lets the factor follow what is asked for.

    Attributes:
        bandwidth: Of surge and sway [rad/s].
        trim: Roll and pitch at rest [rad].
    """

    bandwidth: Scalar = eqx.field(converter=as_array)
    trim: Vector2 = eqx.field(converter=as_array)

    @classmethod
    def of(cls, model: Model) -> "LevelAllowance":
        """In the vehicle's own time."""
        return cls(VehicleScales.of(model).level_bandwidth, np.nan_to_num(hang(model).trim))

    def step(self, memory: Allowance, asked: Scalar, tilt: Vector2, dt: float) -> Allowance:
        """A tick later.

        Args:
            memory: Before.
            asked: Speed through the water that is asked for, as a share of the level speed.
            tilt: Roll and pitch, `frames.tilt_of` [rad].
            dt: Tick [s].
        """
        off = tilt - self.trim
        away = jnp.sqrt(off @ off + NEVER)
        wait = jnp.maximum(memory.wait - dt, 0.0)
        wait = jnp.where(away > QUIET, jnp.maximum(wait, SETTLES / self.bandwidth), wait)
        wait = jnp.where(away > TILTED, WAITS / self.bandwidth, wait)
        bounded = jnp.clip(asked, 1.0, MOST)
        goal = jnp.where(wait > 0.0, jnp.minimum(bounded, memory.factor), bounded)
        learns = 1.0 - jnp.exp(-self.bandwidth / LEARNS * dt)
        return Allowance(jnp.where(away > TILTED, 1.0, memory.factor + learns * (goal - memory.factor)), wait)
