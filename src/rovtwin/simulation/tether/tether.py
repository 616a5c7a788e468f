"""Tether: the cable from the surface to a vehicle, as a Block that pulls at it.

Once per control tick the cable's shape is solved for the end of the tick, the vehicle taken to move on as it does
(`cable`). Over the physics steps within, the pull follows the vehicle to first order,

    F = F_end - K (p - p_expected)

with K the cable's own stiffness and resistance at that end: the vehicle and a taut cable are then solved together.
What a tick dt cannot resolve is a K, EA / L of all that is taut, too large for the vehicle's mass m. Up to
0.1 m / dt^2 (10 kN/m for 40 kg at 50 Hz) an undamped vehicle never has 1 % more energy than it began with. Above, a
stretched cable that is let go is followed beyond where it turns slack: it gives back a fifth too much at 0.3 m / dt^2
and nine tenths at 1, lost again within seconds; near 3 m / dt^2 a vehicle between two of them keeps swinging.

What it is not: the cable has no mass (2 kg with the water around 50 m of 5 mm), no bending stiffness and no torsion; it
feels the current, not the orbital motion of waves; walls do not hold it.
"""

from collections.abc import Callable

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.block import Block, Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.frames import cross, rotation_from_quaternion
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.types import Flag, Matrix3, PRNGKey, Scalar, ScalarLike, Vector3, Vector6
from rovtwin.simulation.checks import require, require_finite, require_not_negative, require_positive, require_shape
from rovtwin.simulation.tether.cable import Cable, Pin, advance
from rovtwin.vehicle.physics.dynamics import State

# Of whoever tends it: 2 m/s off a free drum lets any small vehicle go; hauled in faster than it falls, it would pull.
PAYING_OUT_SPEED, HAULING_SPEED = 2.0, 0.5  # [m/s]
SHORTEST = 2.0  # a tended tether is never shorter than this [m]
# Before a run the shape settles in implicit steps that grow and shrink: 10 minutes in all, 60 m of drift at 0.1 m/s.
SETTLING_STEPS = np.concatenate([np.geomspace(0.05, 20.0, 120), np.geomspace(20.0, 0.05, 40)])  # [s]
SNAG_STIFFNESS = 1e4  # of what a snagged tether is caught in [N/m]


class TetherInput(eqx.Module):
    """What a tether sees in one tick.

    Attributes:
        state: Of the vehicle, at the start of the tick.
        water: Velocity of the water at the nodes in its memory, n [m/s].
        snagged: Whether it is caught; from when it is, to when it is not, one place along it stays where it was.
    """

    state: State
    water: Float[Array, "nodes 3"]
    snagged: Flag


class Line(eqx.Module):
    """A tether at one instant: what a log shows of it.

    Attributes:
        nodes: From anchor to vehicle, n [m].
        force: On the vehicle, n [N].
        length: Paid out [m].
        misjudged: By how much a tension differs from what balances the others [N]: below 0.05 but in a jerk that the
            iterations of a tick did not see to its end; the next ticks do.
    """

    nodes: Float[Array, "nodes 3"]
    force: Vector3
    length: Scalar
    misjudged: Scalar

    @property
    def tension(self) -> Float[Array, " *axes"]:
        """At the vehicle [N]."""
        return jnp.sqrt(jnp.sum(self.force * self.force, axis=-1))


class TetherMemory(eqx.Module):
    """What a tether remembers.

    Attributes:
        line: As it is.
        moves: Of the nodes in the last tick [m]: the next shape is sought further on.
        snagged: Whether it is caught.
        caught_at: Where it was caught last, n [m].
    """

    line: Line
    moves: Float[Array, "nodes 3"]
    snagged: Flag
    caught_at: Vector3


class Pull(eqx.Module):
    """What a tether does to the vehicle over one tick.

    Attributes:
        line: At the end of the tick, the vehicle at the expected place.
        stiffness: K, minus the rate of the force with that place [N/m].
        place: Of the attachment at the start of the tick, n [m].
        velocity: Of the attachment there, n [m/s].
    """

    line: Line
    stiffness: Matrix3
    place: Vector3
    velocity: Vector3


class Tether(Block):
    """A tether between a fixed place and a vehicle.

    Attributes:
        cable: What it is made of.
        anchor: Where its upper end is held (boat, quay), n [m].
        attachment: Its place on the vehicle from CO, b [m].
        length: Paid out, or, where it is tended, on the drum: the most that can be [m].
        slack: Paid-out length over the distance, 1 or more, where somebody tends it; None: the length stays.
        segments: Of the chain.
        iterations: Of Newton's method in a tick at most; one is enough in most.
        snag: Which node, from 1 to segments - 1, stays where it is when the tether is caught.
    """

    cable: Cable
    anchor: Vector3 = eqx.field(converter=as_array)
    attachment: Vector3 = eqx.field(converter=as_array)
    length: Scalar = eqx.field(converter=as_array)
    slack: Scalar | None = None
    segments: int = eqx.field(static=True, default=19)
    iterations: int = eqx.field(static=True, default=6)
    snag: int = eqx.field(static=True, default=9)

    def __check_init__(self):
        for name in ("anchor", "attachment"):
            require_shape(f"Tether.{name}", getattr(self, name), (3,))
            require_finite(f"Tether.{name}", getattr(self, name))
        require_positive("Tether.length", self.length)
        for name in ("diameter", "stiffness", "density"):
            require_positive(f"Cable.{name}", getattr(self.cable, name))
        for name in ("normal_drag", "tangential_drag"):
            require_not_negative(f"Cable.{name}", getattr(self.cable, name))
        require_finite("Cable.wet_weight", self.cable.wet_weight)
        if self.slack is not None:
            require("Tether.slack", self.slack, lambda x: x >= 1.0, "a ratio of at least 1")
        if not 2 <= self.segments:
            raise ConfigError(f"Tether.segments: found {self.segments}, expected 2 or more (10 to 20 are usual)")
        if not 0 < self.snag < self.segments:
            raise ConfigError(f"Tether.snag: found {self.snag}, expected a node from 1 to {self.segments - 1}")

    def init(self, key: PRNGKey, start: Start) -> TetherMemory:
        """Settled in still water."""
        return self.settled(start, jnp.zeros_like)

    def paid_out_at(self, start: Start) -> Scalar:
        """Length paid out where the vehicle begins [m]."""
        return self._paid_out(start.position + rotation_from_quaternion(start.attitude) @ self.attachment)

    def settled(self, start: Start, water_at: Callable[[Float[Array, "k 3"]], Float[Array, "k 3"]]) -> TetherMemory:
        """Memory before the first tick: the shape to which current and weight bring the cable while the vehicle waits.

        Args:
            start: Where the vehicle is.
            water_at: Velocity of the water at places in n.
        """
        place = start.position + rotation_from_quaternion(start.attitude) @ self.attachment
        length = self._paid_out(place)
        middle = 0.5 * (self.anchor + place)
        nodes = self._tent(place, length, water_at(middle[None])[0])

        def settle(line: Line, dt: Scalar) -> tuple[Line, None]:
            water = water_at(line.nodes)
            nodes, force, _, misjudged = advance(self.cable, line.nodes, line.nodes, water, length, dt, 2)
            return Line(nodes, force, length, misjudged), None

        begin = Line(nodes, jnp.zeros(3), length, jnp.zeros(()))
        line, _ = jax.lax.scan(settle, begin, as_array(SETTLING_STEPS))
        return TetherMemory(line, jnp.zeros_like(nodes), jnp.asarray(False), line.nodes[self.snag])

    def step(self, memory: TetherMemory, input: TetherInput, dt: float) -> tuple[TetherMemory, Pull]:
        """Its shape and its pull over the next dt."""
        place, velocity = self._attachment(input.state)
        last = memory.line.nodes
        length = jnp.where(memory.snagged, memory.line.length, self._tended(memory.line.length, place, dt))
        before = jnp.concatenate([last[:-1], place[None]])
        guess = jnp.concatenate([(before + memory.moves)[:-1], (place + dt * velocity)[None]])
        caught = np.eye(self.segments + 1)[self.snag]
        newly = input.snagged & ~memory.snagged
        caught_at = jnp.where(newly, caught @ last, memory.caught_at)
        pin = Pin(jnp.where(input.snagged, SNAG_STIFFNESS, 0.0) * caught, caught_at)
        nodes, force, stiffness, misjudged = advance(
            self.cable, guess, before, input.water, length, dt, self.iterations, pin
        )
        line = Line(nodes, force, length, misjudged)
        return TetherMemory(line, nodes - before, input.snagged, caught_at), Pull(line, stiffness, place, velocity)

    def wrench(self, pull: Pull, state: State, elapsed: ScalarLike, h: float) -> Vector6:
        """Wrench of the tether on the vehicle over one physics step of h, b at CO [N, N m].

        Args:
            pull: Of the tick.
            state: At the start of the physics step.
            elapsed: Since the start of the tick [s].
            h: Physics step [s].
        """
        place, velocity = self._attachment(state)
        # At the middle of the step: held at its start, the force of a spring would feed energy in.
        off = place + 0.5 * h * velocity - pull.place - (elapsed + 0.5 * h) * pull.velocity
        force = (pull.line.force - pull.stiffness @ off) @ rotation_from_quaternion(state.attitude)
        return jnp.concatenate([force, cross(self.attachment, force)])

    def _attachment(self, state: State) -> tuple[Vector3, Vector3]:
        """Its place and velocity in n."""
        R_nb = rotation_from_quaternion(state.attitude)
        velocity = state.nu[:3] + cross(state.nu[3:], self.attachment)
        return state.position + R_nb @ self.attachment, R_nb @ velocity

    def _tended(self, length: Scalar, place: Vector3, dt: float) -> Scalar:
        """What is paid out a tick later: whoever tends it follows the vehicle no faster than a hand or a drum can."""
        if self.slack is None:
            return length
        change = self._paid_out(place) - length
        return length + jnp.clip(change, -HAULING_SPEED * dt, PAYING_OUT_SPEED * dt)

    def _paid_out(self, place: Vector3) -> Scalar:
        if self.slack is None:
            return self.length
        chord = place - self.anchor
        desired = self.slack * jnp.sqrt(jnp.sum(chord * chord) + 1e-12)
        return jnp.minimum(jnp.maximum(desired, SHORTEST), self.length)

    def _tent(self, place: Vector3, length: Scalar, water: Vector3) -> Float[Array, "nodes 3"]:
        """Two straight halves of the right length, bent to where weight and current would bend them."""
        chord = place - self.anchor
        distance = jnp.sqrt(jnp.sum(chord * chord) + 1e-12)
        cable = self.cable
        drag = (
            0.5 * cable.density * cable.diameter * cable.normal_drag * jnp.sqrt(jnp.sum(water * water) + 1e-12) * water
        )
        # Neither weight nor current along the line may leave it without a side to go to.
        lean = drag + cable.wet_weight * jnp.array([0.0, 0.0, 1.0]) + 1e-4 * jnp.array([0.3, 0.7, 0.2])
        lean = lean + 1e-3 * jnp.sqrt(lean @ lean) * jnp.array([0.3, 0.7, 0.2])
        lean = lean - chord * (chord @ lean) / distance**2
        height = 0.5 * jnp.sqrt(jnp.maximum(length**2 - distance**2, 0.0) + 1e-12)
        share = np.linspace(0.0, 1.0, self.segments + 1)[:, None]
        bend = height * lean / jnp.sqrt(lean @ lean + 1e-24)
        return self.anchor + share * chord + (1.0 - np.abs(2.0 * share - 1.0)) * bend
