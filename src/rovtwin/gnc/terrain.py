"""Terrain following: way-points that ask for a distance to the floor get the depth that keeps it.

Readings of the altimeter, with depth and attitude of the estimate, say how deep the floor is; an alpha-beta filter
follows it and its rate, and looks as far ahead as the reference of the depth lags behind. While the altimeter is silent
the floor stays where it was, and after `patience` the way-point's own depth holds: it has to be one that is safe.

Reference: Bar-Shalom, Li and Kirubarajan (2001), sec. 6.5 (alpha-beta filter).
"""

import equinox as eqx

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import Estimate, Measurements, Mission
from rovtwin.core.frames import rotation_from_euler
from rovtwin.core.numerics import Array, as_array, jnp

NEVER = 1e6  # since the last echo, where there was none [s]


class TerrainInput(eqx.Module):
    """What was measured, what the observer believes, and the mission as it was given."""

    measurements: Measurements
    estimate: Estimate
    mission: Mission


class TerrainMemory(eqx.Module):
    """Depth of the floor below the vehicle [m], its rate [m/s], and time since the last echo [s]."""

    floor: Array
    rate: Array
    silence: Array


class TerrainFollowing(Block):
    """Gives the mission with depths in place of altitudes.

    Attributes:
        lever: Of the altimeter, seen from CO, b [m], shape (3,).
        beam: Its direction in b, shape (3,).
        time_constant: Of the floor's filter [s].
        jump: Largest step that one echo may ask for: a fish is no floor [m].
        lead: How far ahead the rate is believed [s].
        patience: How long a silent altimeter's last floor holds [s].
    """

    lever: Array = eqx.field(converter=as_array)
    beam: Array = eqx.field(converter=as_array)
    time_constant: Array = eqx.field(converter=as_array, default=0.5)
    jump: Array = eqx.field(converter=as_array, default=0.15)
    lead: Array = eqx.field(converter=as_array, default=2.0)
    patience: Array = eqx.field(converter=as_array, default=5.0)

    def init(self, key: Array, start: Start) -> TerrainMemory:
        return TerrainMemory(jnp.zeros(()), jnp.zeros(()), jnp.asarray(NEVER))

    def step(self, memory: TerrainMemory, input: TerrainInput, dt: float) -> tuple[TerrainMemory, Mission]:
        after = self._heard(memory, input, dt)
        mission = input.mission
        if mission.altitude is None:
            return after, mission
        below = jnp.maximum(after.floor + self.lead * after.rate - mission.altitude, 0.0)
        follows = (mission.altitude > 0.0) & (after.silence < self.patience)
        depth = jnp.where(follows, below, mission.position[:, 2])
        position = jnp.concatenate([mission.position[:, :2], depth[:, None]], axis=1)
        return after, eqx.tree_at(lambda m: m.position, mission, position)

    def _heard(self, memory: TerrainMemory, input: TerrainInput, dt: float) -> TerrainMemory:
        """The floor a tick later, with the echoes that came."""
        eta, slot = input.estimate.eta, input.measurements["altimeter"]
        R_nb = rotation_from_euler(eta[3:])
        floor, rate, silence = memory.floor + dt * memory.rate, memory.rate, memory.silence + dt
        # A rate that nobody confirms any more fades.
        rate = jnp.where(silence > 1.0, 0.0, rate)
        for row in range(slot.valid.shape[0]):
            seen = eta[2] + (R_nb @ (self.lever + slot.value[row, 0] * self.beam))[2]
            there = slot.valid[row] & jnp.isfinite(seen)
            since = jnp.minimum(silence, self.time_constant)
            theta = jnp.exp(-since / self.time_constant)
            away = jnp.clip(jnp.where(there, seen - floor, 0.0), -self.jump, self.jump)
            anew = there & (silence > self.patience)
            near = floor + (1.0 - theta**2) * away
            turned = rate + (1.0 - theta) ** 2 * away / jnp.maximum(since, dt)
            floor = jnp.where(anew, jnp.where(there, seen, floor), jnp.where(there, near, floor))
            rate = jnp.where(anew, 0.0, jnp.where(there, turned, rate))
            silence = jnp.where(there, 0.0, silence)
        return TerrainMemory(floor, rate, silence)
