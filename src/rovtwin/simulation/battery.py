"""Batteries: what thrusters and electronics draw, how much is left, and what stops when one is empty.

Electrical power of a thruster from its force, P = c |F|^1.5: by momentum theory the power that a propeller of area A
puts into water at rest is |F|^1.5 / sqrt(2 rho A), and the efficiency of motor and blades changes little with load
(measured, 3 to 98 % of the force of a T200: 1.1 % rms of full power ahead, 2.0 % astern; `vehicle.description.power`).
At speed a propeller needs a little less for the same force; that is left out.
"""

from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.block import Block, Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Command
from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.core.types import PerThruster, PRNGKey, Vector2
from rovtwin.simulation.checks import require_not_negative, require_positive, require_probability, require_shape
from rovtwin.vehicle.physics.thrusters import Thrusters, half_steps, static_force


class BatteryInput(eqx.Module):
    """Forces of n thrusters at begin, middle and end of each step of a control tick [N]."""

    force: Float[Array, "steps 3 n"]


class BatteryState(eqx.Module):
    """What is known of b batteries after a control tick.

    Attributes:
        used: Energy taken out of each since it was full [J].
        charge: Share that is left in each.
        power: Mean power drawn from each over the tick [W].
    """

    used: Float[Array, " b"]
    charge: Float[Array, " b"]
    power: Float[Array, " b"]

    @property
    def telemetry(self) -> Vector2:
        """What a battery gauge shows: charge of the emptiest, power of all [W]."""
        return jnp.stack([self.charge.min(), self.power.sum()])


class Battery(Block):
    """b batteries, each with thrusters and a load of its own. Memory and output are the same `BatteryState`.

    An empty one gives nothing any more; its thrusters stop.

    Attributes:
        capacity: [J].
        hotel_load: Drawn as long as there is charge: computers, camera, lights [W].
        feeds: Which thrusters each one feeds, 1 or 0; a thruster that none feeds never stops.
        ahead: c of each thruster for positive forces [W/N^1.5].
        astern: For negative ones.
        start: Charge at the beginning, 0 to 1.
    """

    capacity: Float[Array, " b"]
    hotel_load: Float[Array, " b"]
    feeds: Float[Array, "b n"]
    ahead: Float[Array, " n"]
    astern: Float[Array, " n"]
    start: Float[Array, " b"]

    def __init__(self, capacity_wh: Any, hotel_load: Any, feeds: Any, specific_power: Any, start: Any = 1.0):
        """From capacities [Wh], loads [W], `feeds` (b, n) and specific powers ahead and astern [W/N^1.5].

        Raises:
            ConfigError: Numbers that no battery can have, or a thruster on two of them.
        """
        count = len(capacity_wh)
        self.capacity = as_array(3600.0 * np.asarray(capacity_wh, dtype=float))
        self.hotel_load = as_array(hotel_load)
        self.feeds = as_array(feeds)
        power = np.reshape(specific_power, (-1, 2))
        self.ahead, self.astern = as_array(power[:, 0]), as_array(power[:, 1])
        self.start = as_array(np.broadcast_to(start, (count,)))
        require_positive("battery.capacity", self.capacity)
        require_not_negative("battery.hotel_load", self.hotel_load)
        require_not_negative("battery.specific_power", as_array(power))
        require_probability("battery.charge", self.start)
        require_shape("battery.hotel_load", self.hotel_load, (count,))
        require_shape("battery.feeds", self.feeds, (count, len(power)))
        if (np.sum(feeds, axis=0) > 1).any():
            raise ConfigError("battery.feeds: a thruster hangs on two batteries, expected one at most")

    def init(self, key: PRNGKey, start: Start) -> BatteryState:
        """At the charge given; `key` and `start` are not used."""
        return BatteryState((1.0 - self.start) * self.capacity, self.start, jnp.zeros_like(self.start))

    def step(self, memory: BatteryState, input: BatteryInput, dt: float) -> tuple[BatteryState, BatteryState]:
        """One control tick; Simpson's rule over each of its steps."""
        each = thruster_power(self.ahead, self.astern, input.force)
        mean = ((each[:, 0] + 4.0 * each[:, 1] + each[:, 2]) / 6.0).mean(0)
        demand = jnp.sum(self.feeds * mean, axis=1) + self.hotel_load
        left = self.capacity - memory.used
        energy = jnp.minimum(demand * dt, left)
        used = memory.used + energy
        # Written so that an empty one is empty to the bit.
        charge = jnp.where(demand * dt < left, 1.0 - used / self.capacity, 0.0)
        after = BatteryState(jnp.where(charge > 0.0, used, self.capacity), charge, energy / dt)
        return after, after

    def alive(self, memory: BatteryState) -> PerThruster:
        """1 for each thruster that has power, 0 for the others."""
        empty = jnp.where(memory.charge > 0.0, 0.0, 1.0)
        return 1.0 - jnp.sum(self.feeds * empty[:, None], axis=0)


def thruster_power(ahead: PerThruster, astern: PerThruster, force: Float[Array, "*axes n"]) -> Float[Array, "*axes n"]:
    """Electrical power of thrusters [W], c |F|^1.5.

    Args:
        ahead: c for positive forces [W/N^1.5].
        astern: c for negative ones.
        force: [N].
    """
    size = jnp.abs(force)
    # The inner `where` keeps the gradient of the root finite at zero.
    root = jnp.where(size > 0.0, jnp.sqrt(jnp.where(size > 0.0, size, 1.0)), 0.0)
    return jnp.where(force >= 0.0, ahead, astern) * size * root


def forces_within(
    thrusters: Thrusters, command: Command, before: PerThruster, ends: Float[Array, "steps n"], dt: float
) -> Float[Array, "steps 3 n"]:
    """Forces as the plant takes them within the steps of a control tick [N].

    Args:
        thrusters: Of the plant in this tick.
        command: Held over the tick.
        before: Forces before it.
        ends: Forces after each step.
        dt: Length of a step [s].
    """
    starts = jnp.concatenate([before[None], ends[:-1]])
    begin, middle, _ = half_steps(thrusters, starts, static_force(thrusters, command.u), dt)
    return jnp.stack([begin, middle, ends], axis=1)
