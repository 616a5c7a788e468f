"""Guidance along a path: a point that moves along it as fast as thrusters, corners and the vehicle allow.

    dive ──> go ──> (corner) ──> go ... ──> hold ──> dive or go ... ──> finished

The point's way s has a speed bounded by the leg's and by what thrusters can keep up, at that heading and in that
current, here and behind the corner ahead; an acceleration bounded by a share of what thrusters can push (braking may
take twice as much), and a jerk that lets it change no faster than thrusters do. It waits for a vehicle that is not
there. The set-point is this point: unlike with a way-point as set-point, being late along the path pulls nothing
sideways.

Reference: Fossen (2021), sec. 12.5 (path following with a speed assignment); Skjetne, Fossen and Kokotovic (2004).
"""

import dataclasses

import equinox as eqx
import numpy as np

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import ABORTED, DIVE, FINISHED, GO, HOLD, IDLE, PAUSED, Estimate, Setpoint
from rovtwin.core.frames import euler_from_quaternion, wrap
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.gnc.guidance import GuidanceInput
from rovtwin.gnc.path import Piece, piece_of
from rovtwin.gnc.steering import Steering, SteeringInput
from rovtwin.gnc.supervisor import MODE_ABORTED, MODE_IDLE, MODE_PAUSED, MODE_RUNNING, Mode
from rovtwin.gnc.sustained import SustainedSpeed
from rovtwin.vehicle.model import Model
from rovtwin.vehicle.reach import wrench_limits

SLOWEST = 0.1  # share of the leg's speed that is always tried: a wrong estimate must not strand the vehicle


class PathMemory(eqx.Module):
    """What guidance remembers.

    Attributes:
        phase: IDLE, DIVE, GO, HOLD or FINISHED, int.
        ticks: Ticks in this phase, int.
        waypoint: Index of the way-point aimed at, int.
        leg_start: Where the current leg starts [m], shape (2,).
        s: Way along the leg, or along the arc behind it [m].
        speed: Of s [m/s].
        rate: Of the speed [m/s2].
        on_arc: Whether s counts along the arc, bool.
        eta: Last set-point, shape (6,).
        learnt: Memory of the steering; None where the vehicle goes sideways as it likes.
    """

    phase: Array
    ticks: Array
    waypoint: Array
    leg_start: Array
    s: Array
    speed: Array
    rate: Array
    on_arc: Array
    eta: Array
    learnt: Array | None = None


class PathGuidance(Block):
    """A point on the path, as far as the vehicle can follow.

    Attributes:
        acceleration: Largest along the path [m/s2].
        sideways: Largest in a corner [m/s2].
        lag: Of the speed behind the wanted one [s].
        onset: Twice the acceleration over it is the largest jerk [s].
        patience: How far off the vehicle may be before the point waits, and over how much more it comes to rest [m].
        depth_tolerance: Depth error at which a dive is complete [m].
        heading_tolerance: Heading error at which a leg may begin [rad].
        steering: Line of sight for a vehicle that cannot push sideways; None for one that can, and crabs.
        sustained: How fast thrusters can go; None does not ask.
    """

    acceleration: Array = eqx.field(converter=as_array, default=0.05)
    sideways: Array = eqx.field(converter=as_array, default=0.06)
    lag: Array = eqx.field(converter=as_array, default=0.6)
    onset: Array = eqx.field(converter=as_array, default=0.4)
    patience: Array = eqx.field(converter=as_array, default=0.5)
    depth_tolerance: Array = eqx.field(converter=as_array, default=0.05)
    heading_tolerance: Array = eqx.field(converter=as_array, default=0.1)
    steering: Steering | None = None
    sustained: SustainedSpeed | None = None

    @classmethod
    def of(cls, model: Model, steering: Steering | None = None) -> "PathGuidance":
        """Accelerations that leave thrust for drag and disturbances: a quarter of it goes ahead, half sideways."""
        lower, upper = (np.asarray(limit) for limit in wrench_limits(model.thrusters))
        push = np.minimum(-lower, upper)[:2] / np.diagonal(np.asarray(model.mass))[:2]
        ahead, sideways = np.clip(push * [0.25, 0.5], 0.01, 0.1)
        return cls(acceleration=ahead, sideways=sideways, steering=steering, sustained=SustainedSpeed.of(model))

    def init(self, key: Array, start: Start) -> PathMemory:
        zero, no = jnp.zeros((), dtype=int), jnp.asarray(False)
        eta = _level(start.position, euler_from_quaternion(start.attitude)[2])
        learnt = None if self.steering is None else self.steering.init(key, start)
        still = jnp.zeros(())
        return PathMemory(zero + IDLE, zero, zero, start.position[:2], still, still, still, no, eta, learnt)

    def step(self, memory: PathMemory, input: GuidanceInput, dt: float) -> tuple[PathMemory, Setpoint]:
        mode = input.mode.mode
        running = (mode == MODE_RUNNING) & (input.mission.count > 0)
        memory = _begin(memory, input.estimate, running)
        piece = piece_of(input.mission, memory.waypoint, memory.leg_start, memory.eta[5], self.sideways)
        place, direction, _ = piece.at(memory.s, memory.on_arc)
        going = memory.phase == GO
        memory, steered = self._steered(memory, input.estimate, place, direction, running & going, dt)
        heading = jnp.where(piece.fixed_heading, piece.heading, steered)
        level = jnp.concatenate([place, piece.end[2:]])
        eta = jnp.where(memory.phase == IDLE, memory.eta, _level(level, heading))
        # A way-point at which the vehicle stays asks for no heading of its own.
        eta = eta.at[5].set(jnp.where((memory.phase == HOLD) & ~piece.fixed_heading, memory.eta[5], eta[5]))
        eta = jnp.where(mode == MODE_IDLE, _level(input.estimate.eta[:3], input.estimate.eta[5]), eta)

        setpoint = _setpoint(memory, piece, input.mode, eta, direction)
        moved = self._along(memory, piece, input.estimate, eta, direction, running & going, dt)
        after = self._advance(moved, piece, input, eta, dt)
        after = jax.tree.map(lambda new, old: jnp.where(running, new, old), after, moved)
        return dataclasses.replace(after, eta=eta), setpoint

    def _steered(
        self, memory: PathMemory, estimate: Estimate, place: Array, direction: Array, going: Array, dt: float
    ) -> tuple[PathMemory, Array]:
        """Heading along the path [rad]: its own direction, or that of the line of sight."""
        if self.steering is None or memory.learnt is None:
            return memory, direction
        off = slow_place(estimate)[:2] - place
        error = off[1] * jnp.cos(direction) - off[0] * jnp.sin(direction)
        learnt, heading = self.steering.step(memory.learnt, SteeringInput(error, direction, going), dt)
        return dataclasses.replace(memory, learnt=learnt), heading

    def _along(
        self,
        memory: PathMemory,
        piece: Piece,
        estimate: Estimate,
        eta: Array,
        direction: Array,
        going: Array,
        dt: float,
    ) -> PathMemory:
        """The point a tick further."""
        away = eta[:2] - slow_place(estimate)[:2]
        if self.steering is None:
            behind = jnp.sqrt(away @ away + 1e-12)
        else:  # beside the path it comes back by going on
            behind = jnp.abs(away[0] * jnp.cos(direction) + away[1] * jnp.sin(direction))
        # Over a floor that rises the point waits for a vehicle that is still too deep.
        behind = jnp.maximum(behind, slow_place(estimate)[2] - eta[2])
        waits = jnp.clip(2.0 - behind / self.patience, 0.0, 1.0)
        left = jnp.maximum(piece.length - memory.s, 0.0)
        here, after = self._sustained(piece, estimate, eta, direction)
        # What can still be braked, the way of lag and onset included: v^2 / 2a + v (lag + onset) = left.
        brake = self.acceleration * (self.lag + self.onset)
        slower = jnp.sqrt(brake**2 + after**2 + 2.0 * self.acceleration * left) - brake
        wanted = jnp.where(memory.on_arc, after, jnp.minimum(piece.speed, jnp.maximum(slower, after)))
        wanted = jnp.where(going, jnp.minimum(wanted, here) * waits, 0.0)
        asked = jnp.clip((wanted - memory.speed) / self.lag, -2.0 * self.acceleration, self.acceleration)
        change = 2.0 * self.acceleration / self.onset * dt
        rate = memory.rate + jnp.clip(asked - memory.rate, -change, change)
        speed = jnp.maximum(memory.speed + rate * dt, 0.0)
        s = memory.s + 0.5 * dt * (memory.speed + speed)
        ends = ~memory.on_arc & (piece.after <= 0.0)
        s = jnp.where(ends, jnp.minimum(s, piece.length), s)
        return dataclasses.replace(memory, s=s, speed=speed, rate=jnp.where(speed > 0.0, rate, 0.0))

    def _sustained(self, piece: Piece, estimate: Estimate, eta: Array, direction: Array) -> tuple[Array, Array]:
        """Largest speeds that thrusters keep up here, and in and behind the corner within what it allows."""
        if self.sustained is None:
            return jnp.asarray(jnp.inf), piece.after
        current, least = self.sustained.current(estimate), SLOWEST * piece.speed
        following = piece.direction + piece.turn
        heading = following if self.steering is None else following + eta[5] - direction
        heading = jnp.where(piece.fixed_heading, piece.heading, heading)
        here = jnp.maximum(self.sustained.along(direction, eta[5], current), least)
        behind = self.sustained.along(following, heading, current)
        # In the corner the vehicle is pushed to its inner side, beside holding against the current.
        left = [self.sustained.aside(psi, piece.turn, current) for psi in (piece.direction, following)]
        inwards = jnp.maximum(jnp.minimum(*left), 0.0) * piece.radius
        bent = (piece.turn != 0.0) & ~piece.fixed_heading
        corner = jnp.where(bent, jnp.sqrt(jnp.where(bent, inwards, 1.0) + 1e-12), jnp.inf)
        return here, jnp.minimum(piece.after, jnp.maximum(jnp.minimum(behind, corner), least))

    def _advance(self, memory: PathMemory, piece: Piece, input: GuidanceInput, eta: Array, dt: float) -> PathMemory:
        """What follows: from the leg to its corner, from the corner to the next leg, from one phase to the next."""
        at, phase = slow_place(input.estimate), memory.phase
        rests = jnp.abs(input.estimate.nu[2] - input.estimate.wave[5]) < 0.05
        ready = (jnp.abs(at[2] - piece.end[2]) < self.depth_tolerance) & rests
        ready = ready & (jnp.abs(wrap(eta[5] - input.estimate.eta[5])) < self.heading_tolerance)
        deep = (phase == DIVE) & ready
        arrived = (phase == GO) & ~memory.on_arc & (piece.after <= 0.0) & (memory.s > piece.length - 0.02)
        away = at[:2] - piece.end[:2]
        reached = arrived & (away @ away < piece.acceptance**2)
        over = (phase == HOLD) & ((memory.ticks + 1) * dt >= piece.hold_time)
        following = jnp.where(deep, GO, phase)
        following = jnp.where(reached, HOLD, following)
        following = jnp.where(over, jnp.where(piece.last, FINISHED, DIVE), following)

        into = (phase == GO) & ~memory.on_arc & (piece.after > 0.0) & (memory.s >= piece.length)
        rounds = into & (piece.turn != 0.0)
        out = (phase == GO) & memory.on_arc & (memory.s >= piece.arc_length)
        passes = out | (into & ~rounds)
        end, _, _ = piece.at(piece.arc_length, jnp.asarray(True))
        corner = jnp.where(piece.turn != 0.0, end, piece.end[:2])
        stops = over & ~piece.last
        s = jnp.where(rounds, memory.s - piece.length, memory.s)
        s = jnp.where(passes, s - jnp.where(out, piece.arc_length, piece.length), s)
        return dataclasses.replace(
            memory,
            phase=following,
            ticks=jnp.where(following == phase, memory.ticks + 1, 0),
            waypoint=memory.waypoint + jnp.where(passes | stops, 1, 0),
            leg_start=jnp.where(passes, corner, jnp.where(stops, piece.end[:2], memory.leg_start)),
            s=jnp.where(stops, 0.0, s),
            speed=jnp.where(stops, 0.0, memory.speed),
            rate=jnp.where(stops, 0.0, memory.rate),
            on_arc=(memory.on_arc | rounds) & ~passes,
        )


def slow_place(estimate: Estimate) -> Array:
    """Where the vehicle is but for the waves, n [m], shape (3,)."""
    return estimate.eta[:3] - estimate.wave[:3]


def _begin(memory: PathMemory, estimate: Estimate, running: Array) -> PathMemory:
    """The first running tick starts the first dive from where the vehicle is."""
    begin = running & (memory.phase == IDLE)
    return dataclasses.replace(
        memory,
        phase=jnp.where(begin, DIVE, memory.phase),
        leg_start=jnp.where(begin, slow_place(estimate)[:2], memory.leg_start),
    )


def _setpoint(memory: PathMemory, piece: Piece, mode: Mode, eta: Array, direction: Array) -> Setpoint:
    phase = jnp.where(mode.mode == MODE_PAUSED, PAUSED, jnp.where(mode.mode == MODE_IDLE, IDLE, memory.phase))
    # A finished mission stays finished, whatever the operator asks for but an abort.
    phase = jnp.where(memory.phase == FINISHED, FINISHED, phase)
    phase = jnp.where(mode.mode == MODE_ABORTED, ABORTED, phase)
    crab = direction - eta[5]
    way = memory.speed * jnp.stack([jnp.cos(crab), jnp.sin(crab), jnp.zeros(())])
    nu = jnp.concatenate([way, jnp.zeros(3)])
    start = jnp.concatenate([memory.leg_start, piece.end[2:]])
    on_leg = (phase == GO) & ~memory.on_arc
    return Setpoint(eta, nu, start, piece.end, on_leg, memory.waypoint, phase, mode.reason)


def _level(position: Array, heading: Array) -> Array:
    """eta, shape (6,), level at a position (3,) and heading."""
    zero = jnp.zeros_like(heading)
    return jnp.concatenate([position, jnp.stack([zero, zero, heading])])
