"""Where a vehicle goes that does not follow its mission: nowhere, home, up, or where its pilot wants it.

A point moves from where the vehicle is, with bounded speed and acceleration, as the supervisor says:

    holding    it comes to rest                        until the operator arms again
    returning  level, to where the mission began       returned, once the vehicle is there
    surfacing  up, at the place where it was           surfaced, once the vehicle is there
    piloted    with the velocity that the pilot wants  along an axis of which he wants none it stays

After that, and until the mission goes on, it stays there. A pilot who commands nothing thus keeps the station, one who
wants surge keeps depth and heading. The point never leaves a vehicle behind that cannot follow. A heading is kept as
far as the current lets the vehicle stay with it (`guidance.crab_heading`); one that the pilot is turning goes where he
turns it.
"""

import equinox as eqx
from jaxtyping import Float

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import HELD, PILOTED, RETURNED, RETURNING, SURFACED, SURFACING, Estimate, Setpoint
from rovtwin.core.frames import heading_of, wrap, yaw_rotation
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.types import Flag, PRNGKey, Scalar, Vector2, Vector3
from rovtwin.gnc.guidance.crab_heading import Bow, BowInput, BowMemory
from rovtwin.gnc.interfaces import (
    MODE_ABORTED,
    MODE_HOLDING,
    MODE_PAUSED,
    MODE_PILOTED,
    MODE_RETURNING,
    MODE_SURFACING,
    Mode,
)
from rovtwin.gnc.scales import HEAVE, VehicleScales
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.physics.model import Model


class ContingencyInput(eqx.Module):
    """What guidance asks for, the estimate, what the supervisor decided, and the pilot's command."""

    setpoint: Setpoint
    estimate: Estimate
    mode: Mode
    pilot: Float[Array, "4"] = eqx.field(default_factory=lambda: jnp.zeros(4))


class ContingencyMemory(eqx.Module):
    """What is remembered.

    Attributes:
        home: Where the mission began, n [m].
        position: Of the last set-point, n [m].
        heading: Of the last set-point [rad].
        kept: Heading that is to be kept, but for a current [rad].
        bow: What the current makes of it.
        velocity: Of it, n [m/s].
        away: Whether the vehicle was taken off its mission and has not gone on with it yet.
        follows: Whether it was asked to go where this block says in the last tick.
        there: Whether it has arrived.
    """

    home: Vector3
    position: Vector3
    heading: Scalar
    kept: Scalar
    bow: BowMemory | None
    velocity: Vector3
    away: Flag
    follows: Flag
    there: Flag


class Contingency(Block):
    """Passes guidance's set-point on, unless the supervisor wants something else.

    Attributes:
        speed: Largest, level and upwards [m/s].
        acceleration: Largest; half of it is planned with for coming to rest [m/s2].
        settling: Time constant with which the point comes to rest at the end [s].
        surface: Depth of CO afloat, or as far up as the vehicle is to come [m].
        near: How close to home is there [m].
        afloat: How close to the surface is there [m].
        fastest: Largest velocity that a pilot gets, surge, sway, heave [m/s], and turn rate [rad/s].
        leash: How far the point goes ahead of a piloted vehicle [m].
        lead: How far its heading goes ahead of the vehicle's [rad].
        bow: Turns a vehicle into a current that it does not stem sideways; None: the heading is kept all the same.
    """

    speed: Scalar = eqx.field(converter=as_array)
    acceleration: Scalar = eqx.field(converter=as_array)
    settling: Scalar = eqx.field(converter=as_array)
    surface: Scalar = eqx.field(converter=as_array)
    near: Scalar = eqx.field(converter=as_array)
    afloat: Scalar = eqx.field(converter=as_array)
    fastest: Float[Array, "4"] = eqx.field(converter=as_array)
    leash: Scalar = eqx.field(converter=as_array)
    lead: Scalar = eqx.field(converter=as_array, default=0.8)
    bow: Bow | None = None

    @classmethod
    def of(
        cls,
        model: Model,
        surface: float | None = None,
        dive: float | None = None,
        turn: float | None = None,
        bow: Bow | None = None,
    ) -> "Contingency":
        """For a vehicle.

        Args:
            model: The vehicle.
            surface: As far up as it is to come [m]; None: two thirds of its length, which keeps it below.
            dive: Largest speed up and down [m/s]; None: from the vehicle.
            turn: Largest turn rate [rad/s]; None: from the vehicle.
            bow: Of a vehicle that crabs; None: every heading is kept.
        """
        scales = VehicleScales.of(model)
        length, dive = scales.length, scales.dive_speed if dive is None else dive
        pushed = [i for i in (0, HEAVE) if scales.force[i] > 0.0]
        speeds = {0: scales.surge_speed, HEAVE: dive}
        return cls(
            speed=min((speeds[i] for i in pushed), default=dive),
            acceleration=0.33 * min((scales.acceleration[i] for i in pushed), default=GRAVITY),
            settling=0.25 / scales.level_bandwidth,
            surface=0.64 * length if surface is None else surface,
            near=1.6 * length,
            afloat=0.48 * length,
            fastest=[*scales.piloted_speed, dive, scales.turn_rate if turn is None else turn],
            leash=2.25 * length,
            bow=bow,
        )

    def init(self, key: PRNGKey, start: Start) -> ContingencyMemory:
        heading, place = heading_of(start.attitude), start.position
        no, bow = jnp.asarray(False), None if self.bow is None else self.bow.init(key, start)
        return ContingencyMemory(place, place, heading, heading, bow, jnp.zeros(3), no, no, no)

    def step(self, memory: ContingencyMemory, input: ContingencyInput, dt: float) -> tuple[ContingencyMemory, Setpoint]:
        mode, asked = input.mode.mode, input.setpoint
        holding, returning, surfacing = (mode == m for m in (MODE_HOLDING, MODE_RETURNING, MODE_SURFACING))
        piloted = mode == MODE_PILOTED
        takes = holding | returning | surfacing | piloted
        follows = takes | (memory.away & (mode == MODE_PAUSED))
        # After an abort, too, the vehicle stays where it has drifted to until the operator resumes.
        away = follows | (mode == MODE_ABORTED)

        began = self._beside(memory, input.estimate)
        base = jax.tree.map(lambda old, new: jnp.where(memory.follows, old, new), memory, began)
        command = jnp.where(piloted & jnp.isfinite(input.pilot), input.pilot, 0.0)
        command = jnp.clip(command, -self.fastest, self.fastest)
        # Along the heading that the vehicle has, not is to have.
        desired = yaw_rotation(input.estimate.heading) @ command[:3]
        velocity = self._velocity(base, returning, surfacing, desired, dt)
        # What he turns goes on from where it looks, not from what a current had turned it away from.
        turns = command[3] != 0.0
        kept = jnp.where(turns, wrap(base.heading + dt * command[3]), base.kept)
        kept = jnp.where(returning, self._homeward(base, input.estimate), kept)
        bow, heading = self._bow(memory.bow, kept, jnp.where(returning, velocity[:2], 0.0), input.estimate, dt)
        position, heading = base.position + dt * velocity, jnp.where(turns, kept, heading)
        leashed = self._leashed(position, heading, input.estimate)
        position, heading = (jnp.where(piloted, a, b) for a, b in zip(leashed, (position, heading), strict=True))
        kept = jnp.where(turns, heading, kept)
        there = self._there(base, input.estimate, returning, surfacing)
        after = ContingencyMemory(memory.home, position, heading, kept, bow, velocity, away, follows, there & takes)

        phase = jnp.where(surfacing, jnp.where(there, SURFACED, SURFACING), HELD)
        phase = jnp.where(returning, jnp.where(there, RETURNED, RETURNING), phase)
        phase = jnp.where(piloted, PILOTED, phase)
        own = Setpoint.level(
            position,
            heading,
            nu=jnp.concatenate([yaw_rotation(heading).T @ velocity, jnp.zeros(2), command[3:]]),
            leg_start=asked.leg_start,
            leg_end=asked.leg_end,
            on_leg=jnp.asarray(False),
            waypoint=asked.waypoint,
            phase=jnp.where(takes, phase, asked.phase),
            reason=input.mode.reason,
        )
        return after, jax.tree.map(lambda new, old: jnp.where(follows, new, old), own, asked)

    def _bow(
        self, memory: BowMemory | None, kept: Scalar, way: Vector2, estimate: Estimate, dt: float
    ) -> tuple[BowMemory | None, Scalar]:
        """Memory and heading, for one that is to be kept and a way over ground, n [m/s]."""
        if self.bow is None or memory is None:
            return memory, kept
        return self.bow.step(memory, BowInput(kept, way, estimate), dt)

    def _beside(self, memory: ContingencyMemory, estimate: Estimate) -> ContingencyMemory:
        """Where a contingency would begin: with the vehicle, as fast as it moves but for the waves.

        Not with guidance's set-point, which may be a way-point far off, or at the bottom of a dive.
        """
        place = estimate.slow_position
        velocity = estimate.slow_velocity_n(estimate.R_nb)
        speed = jnp.sqrt(velocity @ velocity + 1e-12)
        velocity = velocity * jnp.minimum(1.0, self.speed / speed)
        no, heading = jnp.asarray(False), estimate.heading
        return ContingencyMemory(memory.home, place, heading, heading, memory.bow, velocity, no, no, no)

    def _velocity(
        self, memory: ContingencyMemory, returning: Flag, surfacing: Flag, desired: Vector3, dt: float
    ) -> Vector3:
        """Of the point, n [m/s]: as the pilot commands, or to the goal, so that it can be stopped there."""
        level = jnp.where(returning, memory.home[:2] - memory.position[:2], 0.0)
        up = jnp.where(surfacing, jnp.minimum(self.surface - memory.position[2], 0.0), 0.0)
        goal = jnp.append(level, up)
        distance = jnp.sqrt(goal @ goal + 1e-12)
        # The square root alone would ask for a jerk at the end.
        slow = jnp.minimum(jnp.sqrt(self.acceleration * distance), distance / self.settling)
        speed = jnp.minimum(self.speed, slow)
        change = goal / distance * speed + desired - memory.velocity
        size = jnp.sqrt(change @ change + 1e-12)
        return memory.velocity + change * jnp.minimum(1.0, self.acceleration * dt / size)

    def _leashed(self, position: Vector3, heading: Scalar, estimate: Estimate) -> tuple[Vector3, Scalar]:
        """The point and its heading, no further ahead of the vehicle than the leash, and not above the surface."""
        place = estimate.slow_position
        away = position - place
        near = place + away * jnp.minimum(1.0, self.leash / jnp.sqrt(away @ away + 1e-12))
        turn = jnp.clip(wrap(heading - estimate.heading), -self.lead, self.lead)
        return near.at[2].max(jnp.minimum(self.surface, place[2])), estimate.heading + turn

    def _homeward(self, memory: ContingencyMemory, estimate: Estimate) -> Scalar:
        """Heading from the vehicle towards home, or as it is once home is near.

        From the vehicle, not from the point: one that cannot push sideways gets home by heading there.
        """
        level = memory.home[:2] - estimate.position[:2]
        far = level @ level > (2.0 * self.near) ** 2
        return jnp.where(far, jnp.arctan2(level[1], jnp.where(far, level[0], 1.0)), memory.kept)

    def _there(self, memory: ContingencyMemory, estimate: Estimate, returning: Flag, surfacing: Flag) -> Flag:
        place = estimate.slow_position
        level = place[:2] - memory.home[:2]
        home = returning & (level @ level < self.near**2)
        return (memory.there & (returning | surfacing)) | home | (surfacing & (place[2] < self.surface + self.afloat))
