"""Guidance along a path: a point that moves along it as fast as thrusters, corners and the vehicle allow.

    dive ──> go ──> (corner) ──> go ... ──> hold ──> dive or go ... ──> finished

The point's way s has a speed bounded by the leg's and by what thrusters can keep up, at that heading and in that
current, here and behind the corner ahead; an acceleration bounded by a share of what thrusters can push (braking may
take twice as much), and a jerk that lets it change no faster than thrusters do. It waits for a vehicle that is not
there. The set-point is this point: unlike with a way-point as set-point, being late along the path pulls nothing
sideways. How a vehicle gets to it that cannot push sideways is `course_keeping`'s business. Lengths, times and
accelerations are the vehicle's (`scales`).

Reference: Fossen (2021), sec. 12.5 (path following with a speed assignment); Skjetne, Fossen and Kokotovic (2004).
"""

import dataclasses

import equinox as eqx

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import (
    ABORTED,
    AGAIN,
    DIVE,
    FINISHED,
    GO,
    GOING,
    HOLD,
    IDLE,
    LIMITED,
    MISSED,
    NO_PROGRESS,
    PAUSED,
    SWEPT,
    WAITING,
    Estimate,
    Progress,
    Setpoint,
)
from rovtwin.core.frames import heading_of, wrap
from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.core.types import Flag, Index, PRNGKey, Scalar, Vector2, Vector3
from rovtwin.gnc.guidance.crab_heading import Bow, BowInput, BowMemory
from rovtwin.gnc.guidance.path import SHORT, Piece, piece_of
from rovtwin.gnc.guidance.speed_limit import AchievableSpeed
from rovtwin.gnc.interfaces import MODE_ABORTED, MODE_IDLE, MODE_PAUSED, MODE_RUNNING, GuidanceInput, Mode
from rovtwin.gnc.scales import HEAVE, YAW, VehicleScales
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.physics.model import Model

SLOWEST = 0.1  # share of the leg's speed that is always tried: a wrong estimate must not strand the vehicle
CLOSE = 0.1  # share of a way-point's acceptance from which the point counts as there
OFTEN = 5  # passes outside the acceptance after which a way-point counts as missed
SKID = 0.34  # sine of the drift angle in a corner, with which drag alone bends the path of a vehicle
NEVER = 1e9  # near a way-point so far [m]


class PathMemory(eqx.Module):
    """What guidance remembers.

    Attributes:
        phase: IDLE, DIVE, GO, HOLD or FINISHED.
        ticks: Ticks in this phase.
        waypoint: Index of the way-point aimed at.
        leg_start: Where the current leg starts [m].
        s: Way along the leg, or along the arc behind it [m].
        speed: Of s [m/s].
        rate: Of the speed [m/s2].
        on_arc: Whether s counts along the arc.
        position: Of the last set-point, n [m].
        heading: Of the last set-point [rad].
        course: Heading that it preferred, but for a current [rad]: that of a leg too short to have one.
        bow: Of a vehicle that crabs and turns: what the current makes of that heading.
        nearest: How near the vehicle came to the way-point since it last came near it [m].
        misses: How often it passed it outside its acceptance.
    """

    phase: Index
    ticks: Index
    waypoint: Index
    leg_start: Vector2
    s: Scalar
    speed: Scalar
    rate: Scalar
    on_arc: Flag
    position: Vector3
    heading: Scalar
    course: Scalar
    bow: BowMemory | None
    nearest: Scalar
    misses: Index


class Pace(eqx.Module):
    """How fast the point may go here and in the corner ahead [m/s], thrusters asked, and which share of it, `waits`."""

    here: Scalar
    after: Scalar
    possible: Scalar
    waits: Scalar


class PathGuidance(Block):
    """A point on the path, as far as the vehicle can follow.

    Attributes:
        acceleration: Largest along the path [m/s2].
        sideways: Largest in a corner [m/s2].
        turn_rate: Largest in a corner [rad/s].
        lag: Of the speed behind the desired one [s].
        onset: Twice the acceleration over it is the largest jerk [s].
        patience: How far off the vehicle may be before the point waits, and over how much more it comes to rest [m].
        depth_tolerance: Depth error at which a dive is complete [m].
        rest: Rate of the depth at which it is [m/s].
        depth_step: Way-points whose depths differ by more are dived to on the spot [m].
        tightest: Radius of a corner below which the vehicle stops there and turns [m].
        heading_tolerance: Heading error at which a leg may begin [rad].
        sustained: How fast thrusters can go; None does not ask.
        steered: Whether the vehicle turns its bow where it goes (`course_keeping`), instead of crabbing.
        turns: Whether thrusters turn it; where not, its heading is what it is, and nothing waits for another.
        bow: Turns it into a current that it does not stem sideways; None where it does not crab.
    """

    acceleration: Scalar = eqx.field(converter=as_array)
    sideways: Scalar = eqx.field(converter=as_array)
    turn_rate: Scalar = eqx.field(converter=as_array)
    lag: Scalar = eqx.field(converter=as_array)
    onset: Scalar = eqx.field(converter=as_array)
    patience: Scalar = eqx.field(converter=as_array)
    depth_tolerance: Scalar = eqx.field(converter=as_array)
    rest: Scalar = eqx.field(converter=as_array)
    depth_step: Scalar = eqx.field(converter=as_array)
    tightest: Scalar = eqx.field(converter=as_array, default=0.0)
    heading_tolerance: Scalar = eqx.field(converter=as_array, default=0.1)
    sustained: AchievableSpeed | None = None
    steered: bool = eqx.field(static=True, default=False)
    turns: bool = eqx.field(static=True, default=True)
    bow: Bow | None = None

    @classmethod
    def of(cls, model: Model, steered: bool = False) -> "PathGuidance":
        """Accelerations that leave thrust for drag and disturbances: a quarter of it goes ahead, half sideways."""
        scales, sustained = VehicleScales.of(model), AchievableSpeed.of(model)
        w, length = scales.level_bandwidth, scales.length
        ahead, sideways = scales.acceleration[:2] * [0.25, 0.5]
        speed, tightest = scales.surge_speed, 0.0
        if steered:  # drag bends the path of a vehicle whose bow points inwards
            sideways += float(sustained.drag_aside(SKID * speed))
            tightest = speed**2 / max(sideways, 1e-3 * GRAVITY)
        return cls(
            acceleration=max(ahead, 1e-3 * GRAVITY),
            sideways=max(sideways, 1e-3 * GRAVITY),
            turn_rate=scales.turn_rate,
            lag=0.3 / w,
            onset=0.2 / w,
            patience=1.6 * length,
            depth_tolerance=0.16 * length,
            rest=0.25 * scales.cruise[HEAVE] or 0.32 * w * length,
            depth_step=0.32 * length,
            tightest=tightest,
            sustained=sustained,
            steered=steered,
            turns=bool(scales.force[YAW] > 0.0),
            bow=None if steered else Bow.of(model),
        )

    def init(self, key: PRNGKey, start: Start) -> PathMemory:
        zero, no = jnp.zeros((), dtype=int), jnp.asarray(False)
        heading, at = heading_of(start.attitude), start.position
        still, bow = jnp.zeros(()), None if self.bow is None else self.bow.init(key, start)
        begun = zero + IDLE, zero, zero, at[:2], still, still, still, no
        return PathMemory(*begun, at, heading, heading, bow, still + NEVER, zero)

    def step(self, memory: PathMemory, input: GuidanceInput, dt: float) -> tuple[PathMemory, Setpoint]:
        mode = input.mode.mode
        running = (mode == MODE_RUNNING) & (input.mission.count > 0)
        memory = _begin(memory, input.estimate, running)
        start, fallback = memory.leg_start, memory.course
        limits = self.sideways, self.depth_step, self.tightest
        piece = piece_of(input.mission, memory.waypoint, start, fallback, *limits)
        if not self.turns:
            kept = jnp.ones_like(piece.fixed_heading)
            piece = dataclasses.replace(piece, fixed_heading=kept, heading=input.estimate.heading)
        place, direction, _ = piece.at(memory.s, memory.on_arc)
        going = memory.phase == GO
        preferred = jnp.where(piece.fixed_heading, piece.heading, direction)
        memory, heading = self._turned(memory, piece, preferred, direction, going, input.estimate, dt)
        position = jnp.concatenate([place, piece.end[2:]])
        idle, off = memory.phase == IDLE, mode == MODE_IDLE
        position = jnp.where(off, input.estimate.position, jnp.where(idle, memory.position, position))
        heading = jnp.where(off, input.estimate.heading, jnp.where(idle, memory.heading, heading))
        course = jnp.where(off | idle, heading, preferred)
        memory = dataclasses.replace(memory, position=position, heading=heading)

        pace = self._pace(memory, piece, input.estimate, direction)
        progress = self._progress(memory, piece, pace, input.estimate, running & going)
        setpoint = _setpoint(memory, piece, input.mode, direction, progress)
        moved = self._along(memory, piece, pace, running & going, dt)
        after = self._advance(moved, piece, input, dt)
        after = jax.tree.map(lambda new, old: jnp.where(running, new, old), after, moved)
        return dataclasses.replace(after, course=course, bow=moved.bow), setpoint

    def _pace(self, memory: PathMemory, piece: Piece, estimate: Estimate, direction: Scalar) -> Pace:
        """What thrusters and a vehicle that is behind leave of the point's speed."""
        away = memory.position - estimate.slow_position
        behind = jnp.sqrt(away[:2] @ away[:2] + 1e-12)
        # Over a floor that rises the point waits for a vehicle that is still too deep.
        behind = jnp.maximum(behind, -away[2])
        waits = jnp.clip(2.0 - behind / self.patience, 0.0, 1.0)
        possible, after = self._sustained(memory, piece, estimate, direction)
        return Pace(jnp.maximum(possible, SLOWEST * piece.speed), after, possible, waits)

    def _turned(
        self,
        memory: PathMemory,
        piece: Piece,
        preferred: Scalar,
        direction: Scalar,
        going: Flag,
        estimate: Estimate,
        dt: float,
    ) -> tuple[PathMemory, Scalar]:
        """Memory and heading: the preferred one, or what the current makes of it unless the mission asks for it."""
        if self.bow is None or memory.bow is None:
            return memory, preferred
        bow, heading = self.bow.step(memory.bow, BowInput(preferred, _way(piece, direction, going), estimate), dt)
        return dataclasses.replace(memory, bow=bow), jnp.where(piece.fixed_heading, preferred, heading)

    def _progress(self, memory: PathMemory, piece: Piece, pace: Pace, estimate: Estimate, going: Flag) -> Progress:
        """In words that a person understands; what is said last weighs most."""
        state = jnp.where(pace.here < piece.speed, LIMITED, GOING)
        state = jnp.where(pace.waits < 1.0, WAITING, state)
        state = jnp.where(pace.possible <= 0.0, SWEPT, state)
        state = jnp.where(memory.misses > 0, jnp.where(memory.misses < OFTEN, AGAIN, MISSED), state)
        current = jnp.zeros(2) if self.sustained is None else self.sustained.current(estimate)
        return Progress(jnp.where(going, state, NO_PROGRESS), memory.misses, pace.possible, current)

    def _along(self, memory: PathMemory, piece: Piece, pace: Pace, going: Flag, dt: float) -> PathMemory:
        """The point a tick further."""
        left = jnp.maximum(piece.length - memory.s, 0.0)
        # What can still be braked, the way of lag and onset included: v^2 / 2a + v (lag + onset) = left.
        brake = self.acceleration * (self.lag + self.onset)
        slower = jnp.sqrt(brake**2 + pace.after**2 + 2.0 * self.acceleration * left) - brake
        desired = jnp.where(memory.on_arc, pace.after, jnp.minimum(piece.speed, jnp.maximum(slower, pace.after)))
        desired = jnp.where(going, jnp.minimum(desired, pace.here) * pace.waits, 0.0)
        asked = jnp.clip((desired - memory.speed) / self.lag, -2.0 * self.acceleration, self.acceleration)
        change = 2.0 * self.acceleration / self.onset * dt
        rate = memory.rate + jnp.clip(asked - memory.rate, -change, change)
        speed = jnp.maximum(memory.speed + rate * dt, 0.0)
        s = memory.s + 0.5 * dt * (memory.speed + speed)
        ends = ~memory.on_arc & (piece.after <= 0.0)
        s = jnp.where(ends, jnp.minimum(s, piece.length), s)
        return dataclasses.replace(memory, s=s, speed=speed, rate=jnp.where(speed > 0.0, rate, 0.0))

    def _sustained(
        self, memory: PathMemory, piece: Piece, estimate: Estimate, direction: Scalar
    ) -> tuple[Scalar, Scalar]:
        """Largest speed that thrusters keep up here, and in and behind the corner within what it allows."""
        bent = (piece.turn != 0.0) & ~piece.fixed_heading
        corner = jnp.where(bent, self.turn_rate * piece.radius, jnp.inf)
        if self.sustained is None:
            return jnp.asarray(jnp.inf), jnp.minimum(piece.after, corner)
        current, least = self.sustained.current(estimate), SLOWEST * piece.speed
        following = piece.direction + piece.turn
        if self.steered:
            here, behind = (self.sustained.made_good(course, current) for course in (direction, following))
        else:
            heading = following
            if self.bow is not None and memory.bow is not None:
                way = _way(piece, following, jnp.asarray(True))
                heading = self.bow.heading(memory.bow, following, way, estimate)
            heading = jnp.where(piece.fixed_heading, piece.heading, heading)
            here = self.sustained.along(direction, memory.heading, current)
            behind = self.sustained.along(following, heading, current)
            # In the corner the vehicle is pushed to its inner side, beside holding against the current.
            left = [self.sustained.aside(psi, piece.turn, current) for psi in (piece.direction, following)]
            inwards = jnp.maximum(jnp.minimum(*left), 0.0) * piece.radius
            pushed = jnp.where(bent, jnp.sqrt(jnp.where(bent, inwards, 1.0) + 1e-12), jnp.inf)
            corner = jnp.minimum(corner, pushed)
        return here, jnp.minimum(piece.after, jnp.maximum(jnp.minimum(behind, corner), least))

    def _advance(self, memory: PathMemory, piece: Piece, input: GuidanceInput, dt: float) -> PathMemory:
        """What follows: from the leg to its corner, from the corner to the next leg, from one phase to the next."""
        at, phase = input.estimate.slow_position, memory.phase
        rests = jnp.abs(input.estimate.nu[2] - input.estimate.wave[5]) < self.rest
        ready = (jnp.abs(at[2] - piece.end[2]) < self.depth_tolerance) & rests
        if not self.steered:
            ready = ready & (jnp.abs(wrap(memory.heading - input.estimate.heading)) < self.heading_tolerance)
        deep = (phase == DIVE) & ready
        arrived = (
            (phase == GO) & ~memory.on_arc & (piece.after <= 0.0) & (memory.s > piece.length - CLOSE * piece.acceptance)
        )
        away = at[:2] - piece.end[:2]
        reached = arrived & (away @ away < piece.acceptance**2)
        nearest, misses = _missed(memory, piece, arrived, jnp.sqrt(away @ away + 1e-12))
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
        on = passes | stops
        return dataclasses.replace(
            memory,
            phase=following,
            ticks=jnp.where(following == phase, memory.ticks + 1, 0),
            waypoint=memory.waypoint + jnp.where(on, 1, 0),
            leg_start=jnp.where(passes, corner, jnp.where(stops, piece.end[:2], memory.leg_start)),
            s=jnp.where(stops, 0.0, s),
            speed=jnp.where(stops, 0.0, memory.speed),
            rate=jnp.where(stops, 0.0, memory.rate),
            on_arc=(memory.on_arc | rounds) & ~passes,
            nearest=jnp.where(on, NEVER, nearest),
            misses=jnp.where(on, 0, misses),
        )


def _way(piece: Piece, direction: Scalar, going: Flag) -> Vector2:
    """Velocity over ground that a leg asks for along a direction, n [m/s]."""
    speed = jnp.where(going & (piece.length > SHORT), piece.speed, 0.0)
    return speed * jnp.stack([jnp.cos(direction), jnp.sin(direction)])


def _missed(memory: PathMemory, piece: Piece, arrived: Flag, distance: Scalar) -> tuple[Scalar, Index]:
    """How near the way-point the vehicle came, and how often it has gone away from it again by its acceptance."""
    nearest = jnp.where(arrived, jnp.minimum(memory.nearest, distance), memory.nearest)
    passed = arrived & (distance > nearest + piece.acceptance)
    return jnp.where(passed, distance, nearest), memory.misses + jnp.where(passed, 1, 0)


def _begin(memory: PathMemory, estimate: Estimate, running: Flag) -> PathMemory:
    """The first running tick starts the first dive from where the vehicle is."""
    begin = running & (memory.phase == IDLE)
    return dataclasses.replace(
        memory,
        phase=jnp.where(begin, DIVE, memory.phase),
        leg_start=jnp.where(begin, estimate.slow_position[:2], memory.leg_start),
    )


def _setpoint(memory: PathMemory, piece: Piece, mode: Mode, direction: Scalar, progress: Progress) -> Setpoint:
    phase = jnp.where(mode.mode == MODE_PAUSED, PAUSED, jnp.where(mode.mode == MODE_IDLE, IDLE, memory.phase))
    # A finished mission stays finished, whatever the operator asks for but an abort.
    phase = jnp.where(memory.phase == FINISHED, FINISHED, phase)
    phase = jnp.where(mode.mode == MODE_ABORTED, ABORTED, phase)
    crab = direction - memory.heading
    way = memory.speed * jnp.stack([jnp.cos(crab), jnp.sin(crab), jnp.zeros(())])
    nu = jnp.concatenate([way, jnp.zeros(3)])
    start = jnp.concatenate([memory.leg_start, piece.end[2:]])
    on_leg = (phase == GO) & ~memory.on_arc
    fixed = piece.fixed_heading & (memory.phase != IDLE)
    stage = on_leg, memory.waypoint, phase, mode.reason, fixed, progress
    return Setpoint.level(memory.position, memory.heading, nu, start, piece.end, *stage)
