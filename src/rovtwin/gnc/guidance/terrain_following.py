"""Terrain following: way-points that ask for a distance to the floor get the depth that keeps it.

Readings of the altimeter, with depth and attitude of the estimate, say how deep the floor is; an alpha-beta filter
follows it and its rate, and looks as far ahead as the reference of the depth lags behind. What an altimeter says is
accepted once a few echoes agree, and no longer when its range stays the same to the last bit while the vehicle sinks or
rises. While it is silent the floor is taken to go on for a second, then to be level, and after `patience` the
way-point's own depth holds: it has to be one that is safe. However wrong an altimeter is, the vehicle goes no deeper
than `band` below that depth.

The filter is `core.arrays.filters.alpha_beta`, critically damped.
"""

import equinox as eqx

from rovtwin.core.arrays.filters import alpha_beta
from rovtwin.core.block import Block, Start
from rovtwin.core.flow import Estimate, Measurements, Mission
from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.core.types import Index, PRNGKey, Scalar, Vector3

NEVER = 1e6  # since the last echo, where there was none [s]
AGREE, ENOUGH = 1.0, 5  # echoes that differ by less than so much [m], and so many of them, begin to be accepted
STUCK = 0.3  # sinking or rising while the range stays the very same [m]
STEEPEST = 0.5  # rate of the floor [m/s]


class TerrainInput(eqx.Module):
    """What was measured, the estimate, and the mission as it was given."""

    measurements: Measurements
    estimate: Estimate
    mission: Mission


class TerrainMemory(eqx.Module):
    """What is known of the floor.

    Attributes:
        floor: Its depth below the vehicle [m].
        rate: Of that [m/s].
        silence: Since the last echo [s].
        readings: Echoes that agreed so far, up to ENOUGH.
        reading: The last range [m].
        depth: Of the vehicle when the range was first that [m].
    """

    floor: Scalar
    rate: Scalar
    silence: Scalar
    readings: Index
    reading: Scalar
    depth: Scalar


class TerrainFollowing(Block):
    """Gives the mission with depths in place of altitudes.

    Attributes:
        lever: Of the altimeter, seen from CO, b [m].
        beam: Its direction in b.
        shallowest: Depth of CO afloat, or as far up as the vehicle is to come [m].
        band: How far below a way-point's own depth it may go [m].
        time_constant: Of the floor's filter [s].
        jump: Largest step that one echo may ask for: a fish is no floor [m].
        lead: How far ahead the rate is used [s].
        patience: How long a silent altimeter's last floor holds [s].
        name: Of the altimeter that is read.
    """

    lever: Vector3 = eqx.field(converter=as_array)
    beam: Vector3 = eqx.field(converter=as_array)
    shallowest: Scalar = eqx.field(converter=as_array, default=0.2)
    band: Scalar = eqx.field(converter=as_array, default=5.0)
    time_constant: Scalar = eqx.field(converter=as_array, default=0.5)
    jump: Scalar = eqx.field(converter=as_array, default=0.15)
    lead: Scalar = eqx.field(converter=as_array, default=2.0)
    patience: Scalar = eqx.field(converter=as_array, default=5.0)
    name: str = eqx.field(static=True, default="altimeter")

    def init(self, key: PRNGKey, start: Start) -> TerrainMemory:
        zero = jnp.zeros(())
        return TerrainMemory(zero, zero, zero + NEVER, jnp.zeros((), dtype=int), zero, start.position[2])

    def step(self, memory: TerrainMemory, input: TerrainInput, dt: float) -> tuple[TerrainMemory, Mission]:
        after = self._received(memory, input, dt)
        mission = input.mission
        if mission.altitude is None:
            return after, mission
        own = mission.position[:, 2]
        below = jnp.clip(after.floor + self.lead * after.rate - mission.altitude, self.shallowest, own + self.band)
        stuck = jnp.abs(input.estimate.position[2] - after.depth) > STUCK
        known = (after.readings >= ENOUGH) & (after.silence < self.patience) & ~stuck
        depth = jnp.where((mission.altitude > 0.0) & known, below, own)
        position = jnp.concatenate([mission.position[:, :2], depth[:, None]], axis=1)
        return after, eqx.tree_at(lambda m: m.position, mission, position)

    def _received(self, memory: TerrainMemory, input: TerrainInput, dt: float) -> TerrainMemory:
        """A tick later, with the echoes that came."""
        here, slot = input.estimate.position[2], input.measurements[self.name]
        R_nb = input.estimate.R_nb
        silence = memory.silence + dt
        # A rate that nobody confirms any more fades.
        rate = jnp.where(silence > 1.0, 0.0, memory.rate)
        now = TerrainMemory(memory.floor + dt * rate, rate, silence, memory.readings, memory.reading, memory.depth)
        for row in range(slot.valid.shape[0]):
            length = slot.value[row, 0]
            seen = here + (R_nb @ (self.lever + length * self.beam))[2]
            there = slot.valid[row] & jnp.isfinite(seen)
            updated = self._with(now, jnp.where(there, seen, 0.0), length, here, dt)
            now = jax.tree.map(lambda new, old, there=there: jnp.where(there, new, old), updated, now)
        return now

    def _with(self, now: TerrainMemory, seen: Scalar, length: Scalar, depth: Scalar, dt: float) -> TerrainMemory:
        """With one more echo, which sees the floor at a depth [m]."""
        away = seen - now.floor
        anew = (now.silence > self.patience) | ((now.readings < ENOUGH) & (jnp.abs(away) > AGREE))
        since = jnp.minimum(now.silence, self.time_constant)
        theta = jnp.exp(-since / self.time_constant)
        step = jnp.clip(away, -self.jump, self.jump)
        beta = (1.0 - theta) ** 2 / jnp.maximum(since, dt)
        floor, rate = alpha_beta(now.floor, now.rate, step, 1.0 - theta**2, beta)
        return TerrainMemory(
            floor=jnp.where(anew, seen, floor),
            rate=jnp.where(anew, 0.0, jnp.clip(rate, -STEEPEST, STEEPEST)),
            silence=jnp.zeros(()),
            readings=jnp.where(anew, 1, jnp.minimum(now.readings + 1, ENOUGH)),
            reading=length,
            depth=jnp.where(length == now.reading, now.depth, depth),
        )
