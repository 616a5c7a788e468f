"""How far beyond the speed that should keep it level a vehicle may go, because it stays level all the same.

The velocity through the water is read off a disturbance force, and the speed that keeps the vehicle level off its
model. A dead or reversed thruster, a tether or drag that the file lacks looks like a current, and a vehicle that gives
way to it drifts though no water flows. Water that does flow past turns the vehicle by Munk's moment, and roll and pitch
are measured. So a vehicle that is asked for more than its level speed and stays level is allowed it little by little;
as soon as it tilts it is not, for a while.
"""

import equinox as eqx

from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.gnc.scales import VehicleScales
from rovtwin.vehicle.model import Model

QUIET, TILTED = 0.1, 0.2  # roll and pitch together below which it is level, and beyond which it is not [rad]
MOST = 2.0  # of the level speed
LEARNS, YIELDS, WAITS = 5.0, 1.0, 15.0  # time constants and the wait, in 1 / bandwidth


class Allowance(eqx.Module):
    """What is remembered.

    Attributes:
        factor: On the level speed, 1 to MOST.
        wait: Until it may grow again [s].
    """

    factor: Array
    wait: Array

    @classmethod
    def none(cls) -> "Allowance":
        return cls(jnp.ones(()), jnp.zeros(()))


class LevelAllowance(eqx.Module):
    """Lets the factor follow what is asked for.

    Attributes:
        bandwidth: Of surge and sway [rad/s].
    """

    bandwidth: Array = eqx.field(converter=as_array)

    @classmethod
    def of(cls, model: Model) -> "LevelAllowance":
        """In the vehicle's own time."""
        return cls(VehicleScales.of(model).level_bandwidth)

    def step(self, memory: Allowance, asked: Array, euler: Array, dt: float) -> Allowance:
        """A tick later.

        Args:
            memory: Before.
            asked: Speed through the water that is asked for, as a share of the level speed.
            euler: Roll, pitch and yaw [rad], shape (3,).
            dt: Tick [s].
        """
        tilt = jnp.sqrt(euler[0] ** 2 + euler[1] ** 2 + 1e-12)
        yields = tilt > TILTED
        wait = jnp.where(yields, WAITS / self.bandwidth, jnp.maximum(memory.wait - dt, 0.0))
        grows = (tilt < QUIET) & (memory.wait <= 0.0)
        wanted = jnp.clip(asked, 1.0, MOST)
        goal = jnp.where(grows, wanted, jnp.minimum(wanted, memory.factor))
        goal = jnp.where(yields, 1.0, goal)
        rate = self.bandwidth / jnp.where(yields, YIELDS, LEARNS)
        return Allowance(memory.factor + (1.0 - jnp.exp(-rate * dt)) * (goal - memory.factor), wait)
