"""Guidance: the thesis's 2-D line of sight between way-points, in four phases.

For each way-point: **dive** to its depth, **turn** to the leg's bearing, **go** along the leg, and **hold** there for
its hold time; then comes the next one. In `go` the position set-point is the way-point itself and the line of
sight gives the heading, so that the reference model and the controller pull the vehicle in (thesis 7.4.3).

Reference: thesis 2.14 and 7.4; Fossen (2021), sec. 12.4.
"""

import dataclasses

import equinox as eqx
from jaxtyping import Shaped

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import (
    ABORTED,
    DIVE,
    FINISHED,
    GO,
    HOLD,
    IDLE,
    PAUSED,
    TURN,
    Estimate,
    Mission,
    Setpoint,
)
from rovtwin.core.frames import euler_from_quaternion, wrap
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.types import Flag, Index, PRNGKey, Scalar, Vector2, Vector3, Vector6
from rovtwin.gnc.interfaces import MODE_ABORTED, MODE_IDLE, MODE_PAUSED, MODE_RUNNING, GuidanceInput, Mode


class GuidanceMemory(eqx.Module):
    """What guidance remembers.

    Attributes:
        phase: IDLE before the start, then DIVE, TURN, GO, HOLD or FINISHED.
        ticks: Ticks in this phase.
        waypoint: Index of the way-point aimed at.
        first: Whether the first dive is still to be completed.
        leg_start: Where the current leg starts, horizontally [m].
        eta: Last set-point.
        paused: Whether the last tick was paused.
    """

    phase: Index
    ticks: Index
    waypoint: Index
    first: Flag
    leg_start: Vector2
    eta: Vector6
    paused: Flag


class Guidance(Block):
    """2-D line of sight with the phases dive, turn, go, hold.

    A way-point is reached when its *horizontal* distance is within its acceptance radius: depth has a loop of its
    own (the thesis's "area" in the plane z = z_i), and the dive has already brought it within `depth_tolerance`.

    Attributes:
        look_ahead: Delta [m]: about three lengths of the vehicle, and long against the noise of the position (0.2 m
            of it turn the heading by 6 degrees).
        depth_tolerance: Depth error at which a dive is complete [m].
        heading_tolerance: Heading error at which a turn is complete [rad].
    """

    look_ahead: Scalar = eqx.field(converter=as_array, default=2.0)
    depth_tolerance: Scalar = eqx.field(converter=as_array, default=0.1)
    heading_tolerance: Scalar = eqx.field(converter=as_array, default=0.1)

    def init(self, key: PRNGKey, start: Start) -> GuidanceMemory:
        zero, no = jnp.zeros((), dtype=int), jnp.asarray(False)
        heading = euler_from_quaternion(start.attitude)[2]
        eta = _level(start.position, heading)
        return GuidanceMemory(zero + IDLE, zero, zero, ~no, start.position[:2], eta, no)

    def step(self, memory: GuidanceMemory, input: GuidanceInput, dt: float) -> tuple[GuidanceMemory, Setpoint]:
        mode = input.mode.mode
        running = (mode == MODE_RUNNING) & (input.mission.count > 0)
        memory = _begin(memory, input.estimate, running)
        leg = _leg(memory, input.mission)

        here = _here(input.estimate)
        # Where the operator paused the vehicle stays; before the start it is asked to be where it is.
        stay = ((mode == MODE_PAUSED) & ~memory.paused) | (mode == MODE_IDLE)
        eta = jnp.where(running, self._pursue(memory, input.estimate, leg), memory.eta)
        eta = jnp.where(stay, here, eta)

        after = self._advance(memory, input, leg, dt)
        after = jax.tree.map(lambda new, old: jnp.where(running, new, old), after, memory)
        return _with(after, eta=eta, paused=mode == MODE_PAUSED), _setpoint(memory, leg, input.mode, eta)

    def _pursue(self, memory: GuidanceMemory, estimate: Estimate, leg: "_Leg") -> Vector6:
        """Set-point of the current phase."""
        phase, behind = memory.phase, estimate.position[:2] - memory.leg_start
        # Cross-track error and the heading that brings it to zero: thesis 2.44, 2.45.
        e = -behind[0] * jnp.sin(leg.alpha) + behind[1] * jnp.cos(leg.alpha)
        chi = wrap(leg.alpha + jnp.arctan(-e / self.look_ahead))

        along = jnp.where(leg.steered, chi, leg.heading)
        heading = jnp.where(phase == TURN, leg.heading, jnp.where(phase == GO, along, memory.eta[5]))
        at_start = (phase == DIVE) | (phase == TURN)
        position = jnp.where(at_start, memory.leg_start, leg.end[:2])
        return _level(jnp.concatenate([position, leg.end[2:]]), heading)

    def _advance(self, memory: GuidanceMemory, input: GuidanceInput, leg: "_Leg", dt: float) -> GuidanceMemory:
        """Memory for the next tick: the phase that follows, and after a hold the next way-point."""
        eta, phase = input.estimate.eta, memory.phase
        away = eta[:2] - leg.end[:2]
        deep = (phase == DIVE) & (jnp.abs(eta[2] - leg.end[2]) < self.depth_tolerance)
        turned = (phase == TURN) & (jnp.abs(wrap(leg.heading - eta[5])) < self.heading_tolerance)
        reached = (phase == GO) & (away @ away < leg.acceptance**2)
        over = (phase == HOLD) & ((memory.ticks + 1) * dt >= leg.hold_time)
        switch = over & (memory.waypoint + 1 < input.mission.count)

        following = jnp.where(deep, TURN, phase)
        following = jnp.where(turned, GO, following)
        following = jnp.where(reached, HOLD, following)
        following = jnp.where(over, jnp.where(switch, DIVE, FINISHED), following)

        # The first leg starts where the first dive ends, every other one at the way-point before.
        leg_start = jnp.where(deep & memory.first, eta[:2], memory.leg_start)
        leg_start = jnp.where(switch, leg.end[:2], leg_start)
        return _with(
            memory,
            phase=following,
            ticks=jnp.where(following == phase, memory.ticks + 1, 0),
            waypoint=jnp.where(switch, memory.waypoint + 1, memory.waypoint),
            first=memory.first & ~deep,
            leg_start=leg_start,
        )


class _Leg(eqx.Module):
    """The way-point aimed at and the way to it.

    Attributes:
        end: Its position [m].
        speed, acceptance, hold_time: As in the mission.
        alpha: Direction of the leg [rad], thesis 2.43; of a leg too short to have one, the last heading.
        heading: To turn to before going [rad].
        steered: Whether the line of sight gives the heading on the way.
    """

    end: Vector3
    speed: Scalar
    acceptance: Scalar
    hold_time: Scalar
    alpha: Scalar
    heading: Scalar
    steered: Flag


def _leg(memory: GuidanceMemory, mission: Mission) -> _Leg:
    to = mission.at(memory.waypoint)
    along = to.position[:2] - memory.leg_start
    # Within the acceptance radius the direction of a leg is chance: the heading stays as it was.
    short = along @ along < to.acceptance**2
    north, east = jnp.where(short, 1.0, along[0]), jnp.where(short, 0.0, along[1])
    alpha = jnp.where(short, memory.eta[5], jnp.arctan2(east, north))
    heading = jnp.where(to.fixed_heading, to.heading, alpha)
    steered = ~to.fixed_heading & ~short
    return _Leg(to.position, to.speed, to.acceptance, to.hold_time, alpha, heading, steered)


def _begin(memory: GuidanceMemory, estimate: Estimate, running: Flag) -> GuidanceMemory:
    """The first running tick starts the first dive from where the vehicle is."""
    begin = running & (memory.phase == IDLE)
    here = _here(estimate)
    return _with(
        memory,
        phase=jnp.where(begin, DIVE, memory.phase),
        leg_start=jnp.where(begin, here[:2], memory.leg_start),
        eta=jnp.where(begin, here, memory.eta),
    )


def _setpoint(memory: GuidanceMemory, leg: _Leg, mode: Mode, eta: Vector6) -> Setpoint:
    phase = jnp.where(mode.mode == MODE_PAUSED, PAUSED, jnp.where(mode.mode == MODE_IDLE, IDLE, memory.phase))
    # A finished mission stays finished, whatever the operator asks for but an abort.
    phase = jnp.where(memory.phase == FINISHED, FINISHED, phase)
    phase = jnp.where(mode.mode == MODE_ABORTED, ABORTED, phase)
    going = phase == GO

    # The way-point's speed, down or along the leg, seen from the desired heading; the thesis's reference ignores it.
    crab = leg.alpha - eta[5]
    way = jnp.stack([going * jnp.cos(crab), going * jnp.sin(crab), 1.0 * (phase == DIVE)])
    nu = jnp.concatenate([leg.speed * way, jnp.zeros(3)])
    start = jnp.concatenate([memory.leg_start, leg.end[2:]])
    return Setpoint.level(eta[:3], eta[5], nu, start, leg.end, going, memory.waypoint, phase, mode.reason)


def _here(estimate: Estimate) -> Vector6:
    """Where the vehicle is, level."""
    return _level(estimate.position, estimate.eta[5])


def _level(position: Vector3, heading: Scalar) -> Vector6:
    """eta, level at a position and heading."""
    zero = jnp.zeros_like(heading)
    return jnp.concatenate([position, jnp.stack([zero, zero, heading])])


def _with(memory: GuidanceMemory, **changes: Shaped[Array, "..."]) -> GuidanceMemory:
    return dataclasses.replace(memory, **changes)
