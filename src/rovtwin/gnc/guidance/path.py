"""The path through way-points: straight legs joined by circular arcs, and how fast it may be followed.

An arc of radius R touches both legs at R tan(gamma/2) from their way-point, gamma being the turn, and passes it at
R (1 / cos(gamma/2) - 1). R is as large as the way-point's acceptance and half of the shorter leg allow. A way-point at
which the vehicle stops, dives or turns back has none, nor has one that asks for a tighter turn than it can make.

Reference: Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, sec. 12.3 (straight lines and
inscribed circles).
"""

import equinox as eqx

from rovtwin.core.flow import Mission
from rovtwin.core.frames import wrap
from rovtwin.core.numerics import jnp
from rovtwin.core.types import Flag, Index, Scalar, ScalarLike, Vector2, Vector3

SHARPEST = 2.6  # turns beyond this are no corner but a way back [rad]
SHORT = 1e-6  # legs below this have no direction [m]


class Piece(eqx.Module):
    """The leg towards a way-point and the corner behind it.

    Attributes:
        start: Where the leg starts, horizontally [m].
        end: The way-point.
        direction: Of the leg [rad].
        length: Up to the arc, or to the way-point where there is none [m].
        turn: Angle of the corner, to starboard positive [rad]; 0 without an arc.
        radius: Of the arc [m].
        speed: Desired on the leg [m/s].
        after: Largest speed at its end [m/s]: that of the corner, or 0.
        acceptance, hold_time, heading, fixed_heading: As in the mission.
        last: Whether no way-point follows.
    """

    start: Vector2
    end: Vector3
    direction: Scalar
    length: Scalar
    turn: Scalar
    radius: Scalar
    speed: Scalar
    after: Scalar
    acceptance: Scalar
    hold_time: Scalar
    heading: Scalar
    fixed_heading: Flag
    last: Flag

    @property
    def arc_length(self) -> Scalar:
        """[m]; 0 without an arc."""
        return self.radius * jnp.abs(self.turn)

    @property
    def arc_start(self) -> Vector2:
        """Where the leg ends and the arc begins [m]."""
        return self.start + self.length * _towards(self.direction)

    def at(self, s: Scalar, on_arc: Flag) -> tuple[Vector2, Scalar, Scalar]:
        """Place [m], direction [rad] and curvature [1/m] at a way s from the start of the leg or arc."""
        side = jnp.sign(self.turn)
        curvature = side / jnp.where(self.radius > 0, self.radius, 1.0)
        turned = self.direction + curvature * s
        centre = self.arc_start + side * self.radius * _towards(self.direction + 0.5 * jnp.pi)
        on_circle = centre - side * self.radius * _towards(turned + 0.5 * jnp.pi)
        straight = self.start + s * _towards(self.direction)
        place = jnp.where(on_arc, on_circle, straight)
        return place, wrap(jnp.where(on_arc, turned, self.direction)), jnp.where(on_arc, curvature, 0.0)


def piece_of(
    mission: Mission,
    waypoint: Index,
    start: Vector2,
    heading: Scalar,
    sideways: Scalar,
    depth_step: Scalar,
    tightest: ScalarLike = 0.0,
) -> Piece:
    """The leg from `start` to a way-point and the corner there.

    Args:
        mission: Way-points.
        waypoint: Index of the one aimed at.
        start: Where the leg starts [m].
        heading: Direction of a leg too short to have one [rad].
        sideways: Largest acceleration in a corner [m/s2].
        depth_step: Way-points whose depths differ by more are dived to on the spot [m].
        tightest: Radius below which a corner is none: the vehicle stops there and turns [m].
    """
    to, then = mission.at(waypoint), mission.at(jnp.minimum(waypoint + 1, mission.count - 1))
    end, following = to.position, then.position
    last = waypoint + 1 >= mission.count
    way, direction = _leg(end[:2] - start, heading)
    onwards, next_direction = _leg(following[:2] - end[:2], direction)
    turn = wrap(next_direction - direction)
    stops = (to.hold_time > 0) | last | (jnp.abs(following[2] - end[2]) > depth_step)
    smooth = ~stops & (jnp.abs(turn) < SHARPEST) & (way > SHORT) & (onwards > SHORT)
    bends = jnp.abs(turn) > 1e-3
    half = jnp.where(smooth & bends, 0.5 * jnp.abs(turn), 0.5)
    radius = jnp.minimum(to.acceptance / (1.0 / jnp.cos(half) - 1.0), 0.5 * jnp.minimum(way, onwards) / jnp.tan(half))
    smooth = smooth & ~(bends & (radius < tightest))
    bent = smooth & bends
    radius = jnp.where(bent, radius, 0.0)
    # Beyond the corner the next leg's speed holds.
    ahead = jnp.minimum(to.speed, then.speed)
    after = jnp.where(bent, jnp.minimum(ahead, jnp.sqrt(sideways * radius)), jnp.where(smooth, ahead, 0.0))
    return Piece(
        start=start,
        end=end,
        direction=direction,
        length=way - radius * jnp.tan(half),
        turn=jnp.where(bent, turn, 0.0),
        radius=radius,
        speed=to.speed,
        after=after,
        acceptance=to.acceptance,
        hold_time=to.hold_time,
        heading=to.heading,
        fixed_heading=to.fixed_heading,
        last=last,
    )


def _leg(along: Vector2, heading: Scalar) -> tuple[Scalar, Scalar]:
    """Length [m] and direction [rad] of a way; of none, the heading."""
    length2 = along @ along
    none = length2 < SHORT**2
    north, east = jnp.where(none, 1.0, along[0]), jnp.where(none, 0.0, along[1])
    return jnp.where(none, 0.0, jnp.sqrt(jnp.where(none, 1.0, length2))), jnp.where(
        none, heading, jnp.arctan2(east, north)
    )


def _towards(angle: Scalar) -> Vector2:
    return jnp.stack([jnp.cos(angle), jnp.sin(angle)])
