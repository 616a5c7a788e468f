"""A cable in water as a chain of nodes: its forces, and the shape in which they balance.

N segments of equal unstretched length join N + 1 nodes; the first is held at the anchor, the last at the vehicle.
Weight, buoyancy and drag act at the nodes, tension along the segments. There is no inertia, so every node is where its
forces balance: tension against weight and the drag of its own motion through the water,

    sum of forces(r, (r - r_before) / dt) = 0

which is one implicit step of an overdamped chain. It is solved by Newton's method with the Jacobian of tension and
drag, a block-tridiagonal matrix of symmetric 3x3 blocks that is positive definite whatever the shape, since slack
segments push nothing. Eliminating from the anchor on leaves, at the vehicle, the force of the whole cable there and its
rate of change with the place of that end.

References: Walton and Polachek (1960), Mathematics of Computation 14 (chains of nodes in water); Hall and Goupee
(2015), Ocean Engineering 104:590-603 (lumped loads, drag across and along, contact with the floor); Hoerner (1965),
ch. 3 (drag of inclined cylinders).
"""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.types import Matrix3, Scalar, ScalarLike, Vector3
from rovtwin.vehicle.constants import FRESH_WATER, FRICTION, GRAVITY, SLIDING_SPEED

SLOWEST = 0.01  # below this speed drag is linear: a 5 mm cylinder at 1 cm/s has a Reynolds number of 50 [m/s]
TOE = 1e-3  # strain up to which a cable is pulled straight rather than stretched: its tension grows with the square
SLACK_SHARE = 1e-6  # stiffness of a slack segment, of that of a taut one: keeps the equations solvable
FLOOR_STIFFNESS = 200.0  # of the floor, per metre of cable: 0.2 N/m lies 1 mm deep [N/m2]
LEAST_NORMAL, LEAST_TANGENTIAL = 1e-2, 1e-4  # drag coefficients that a cable never falls below
FADE = 0.05  # height over which a cable leaves the water [m]
DRY_DRAG = 0.05  # share of the drag that is left in air, so that a slack loop there falls at a finite speed
LARGEST_MOVE = 0.5  # of a node in one iteration, in segments
ENOUGH = 0.05  # [N]
TINY = 1e-12  # [m2]


class Cable(eqx.Module):
    """What a cable is made of, and what is around it.

    Attributes:
        diameter: [m].
        wet_weight: Weight less buoyancy, negative floats [N/m].
        normal_drag: C_D across, on the diameter; 0.01 at least: a slack cable without any would be anywhere.
        tangential_drag: C_f along, on the circumference; 1e-4 at least.
        stiffness: EA, once pulled straight (`TOE`) [N].
        density: Of the water [kg/m3].
        surface: Depth z in n of the surface [m], or None: water without end upwards.
        floor: Depth z in n of the floor [m], or None.
    """

    diameter: Scalar = eqx.field(converter=as_array)
    wet_weight: Scalar = eqx.field(converter=as_array, default=0.0)
    normal_drag: Scalar = eqx.field(converter=as_array, default=1.2)
    tangential_drag: Scalar = eqx.field(converter=as_array, default=0.015)
    stiffness: Scalar = eqx.field(converter=as_array, default=2e4)
    density: Scalar = eqx.field(converter=as_array, default=FRESH_WATER)
    surface: Scalar | None = None
    floor: Scalar | None = None


class Pin(eqx.Module):
    """What holds a node from outside: `stiffness` per node [N/m], towards `place` in n."""

    stiffness: Float[Array, " nodes"]
    place: Vector3


class Balance(eqx.Module):
    """Forces on the nodes, and minus their rate of change with the nodes' places.

    Attributes:
        force: In n [N].
        own: Of a node with its own place [N/m].
        links: Of the two ends of a segment with each other's place [N/m].
    """

    force: Float[Array, "nodes 3"]
    own: Float[Array, "nodes 3 3"]
    links: Float[Array, "segments 3 3"]


def balance(
    cable: Cable,
    nodes: Float[Array, "nodes 3"],
    before: Float[Array, "nodes 3"],
    water: Float[Array, "nodes 3"],
    length: Scalar,
    dt: ScalarLike,
    pin: Pin | None = None,
) -> Balance:
    """Forces on all nodes of a cable that got from `before` to `nodes` within dt.

    Args:
        cable: Its properties.
        nodes: In n [m].
        before: Where they were dt earlier [m].
        water: Velocity of the water at the nodes, n [m/s].
        length: Unstretched, of the whole cable [m].
        dt: [s].
        pin: What else holds it.
    """
    count = nodes.shape[0] - 1
    segment = length / count
    share = np.ones(count + 1)
    share[0] = share[-1] = 0.5
    span = segment * share  # of the cable that a node stands for
    edges = nodes[1:] - nodes[:-1]

    pull, links = _tension(cable, edges, segment)
    drag, resistance = _drag(cable, edges, water - (nodes - before) / dt, span)
    down, hold, wet = _vertical(cable, nodes[:, 2], span)
    force = wet[:, None] * drag + _at_ends(pull, -1.0) + jnp.concatenate([jnp.zeros_like(nodes[:, :2]), down], axis=1)
    own = (wet / dt)[:, None, None] * resistance + _at_ends(links, 1.0) + hold[:, None, None] * _DOWN_DOWN
    if cable.floor is not None:
        force, own = _on_floor(cable.floor, nodes, before, span, dt, force, own)
    if pin is not None:
        force = force + pin.stiffness[:, None] * (pin.place - nodes)
        own = own + pin.stiffness[:, None, None] * np.eye(3)
    return Balance(force, own, links)


_DOWN_DOWN = np.diag([0.0, 0.0, 1.0])
_LEVEL = np.diag([1.0, 1.0, 0.0])


def _at_ends(of_segments: Float[Array, " segments *axes"], sign: float) -> Float[Array, " nodes *axes"]:
    """What each segment does to its two ends, summed per node; `sign` is that of the end further from the anchor."""
    none = jnp.zeros_like(of_segments[:1])
    return jnp.concatenate([of_segments, none]) + sign * jnp.concatenate([none, of_segments])


def _tension(
    cable: Cable, edges: Float[Array, "segments 3"], segment: Scalar
) -> tuple[Float[Array, "segments 3"], Float[Array, "segments 3 3"]]:
    """Pull of each segment on its end towards the anchor, and its stiffness."""
    long = jnp.sqrt(jnp.sum(edges * edges, axis=1) + TINY)
    along = edges / long[:, None]
    tension, rate = _stretched(cable, long, segment)
    axial = jnp.maximum(rate, SLACK_SHARE * cable.stiffness / segment)
    across = tension / long
    links = across[:, None, None] * np.eye(3) + (axial - across)[:, None, None] * _outer(along)
    return tension[:, None] * along, links


def _stretched(
    cable: Cable, long: Float[Array, " segments"], segment: Scalar
) -> tuple[Float[Array, " segments"], Float[Array, " segments"]]:
    """Tension of segments so long [N], and its rate with their length [N/m]; none where they are slack."""
    strain = jnp.maximum(long / segment - 1.0, 0.0)
    bent = jnp.minimum(strain, TOE)
    return cable.stiffness * (strain - bent + 0.5 * bent * bent / TOE), cable.stiffness / segment * bent / TOE


def _drag(
    cable: Cable, edges: Float[Array, "segments 3"], flow: Float[Array, "nodes 3"], span: Float[Array, " nodes"]
) -> tuple[Float[Array, "nodes 3"], Float[Array, "nodes 3 3"]]:
    """Drag at the nodes, across and along the cable each on its own; and its rate with the flow.

    Args:
        cable: Its properties.
        edges: From node to node [m].
        flow: Of the water past the nodes [m/s].
        span: Length that each node stands for [m].
    """
    through = jnp.concatenate([edges[:1], edges[1:] + edges[:-1], edges[-1:]])
    tangent = through / jnp.sqrt(jnp.sum(through * through, axis=1, keepdims=True) + TINY)
    along = jnp.sum(flow * tangent, axis=1)
    across = flow - along[:, None] * tangent
    fast = jnp.sqrt(jnp.sum(across * across, axis=1) + SLOWEST**2)
    fast_along = jnp.sqrt(along * along + SLOWEST**2)
    # Nothing else holds a slack cable: without drag the equations would have no solution.
    C_D = jnp.maximum(cable.normal_drag, LEAST_NORMAL)
    C_f = jnp.maximum(cable.tangential_drag, LEAST_TANGENTIAL)
    normal = 0.5 * cable.density * cable.diameter * C_D * span
    tangential = 0.5 * cable.density * jnp.pi * cable.diameter * C_f * span
    force = (normal * fast)[:, None] * across + (tangential * fast_along * along)[:, None] * tangent
    slope_along = tangential * (fast_along + along * along / fast_along) - normal * fast
    rate = (
        (normal * fast)[:, None, None] * np.eye(3)
        + (normal / fast)[:, None, None] * _outer(across)
        + slope_along[:, None, None] * _outer(tangent)
    )
    return force, rate


def _vertical(
    cable: Cable, z: Float[Array, " nodes"], span: Float[Array, " nodes"]
) -> tuple[Float[Array, "nodes 1"], Float[Array, " nodes"], Float[Array, " nodes"]]:
    """Weight less buoyancy; how it holds a floating cable, and how wet it is."""
    if cable.surface is None:
        return (cable.wet_weight * span)[:, None], jnp.zeros_like(z), jnp.ones_like(z)
    displaced = cable.density * GRAVITY * 0.25 * jnp.pi * cable.diameter**2
    height = 0.5 + (z - cable.surface) / FADE
    wet = jnp.clip(height, 0.0, 1.0)
    down = (cable.wet_weight + (1.0 - wet) * displaced) * span
    hold = jnp.where((height > 0.0) & (height < 1.0), displaced / FADE * span, 0.0)
    return down[:, None], hold, jnp.maximum(wet, DRY_DRAG)


def _on_floor(
    floor: Scalar,
    nodes: Float[Array, "nodes 3"],
    before: Float[Array, "nodes 3"],
    span: Float[Array, " nodes"],
    dt: ScalarLike,
    force: Float[Array, "nodes 3"],
    own: Float[Array, "nodes 3 3"],
) -> tuple[Float[Array, "nodes 3"], Float[Array, "nodes 3 3"]]:
    """Adds the floor's push and friction; friction is smooth through zero speed, so that a cable creeps."""
    deep = nodes[:, 2] - floor
    push = FLOOR_STIFFNESS * span * jnp.maximum(deep, 0.0)
    velocity = (nodes - before) / dt * jnp.array([1.0, 1.0, 0.0])
    brake = FRICTION * push / jnp.sqrt(jnp.sum(velocity * velocity, axis=1) + SLIDING_SPEED**2)
    force = force - brake[:, None] * velocity - push[:, None] * jnp.array([0.0, 0.0, 1.0])
    hold = jnp.where(deep > 0.0, FLOOR_STIFFNESS * span, 0.0)
    return force, own + (brake / dt)[:, None, None] * _LEVEL + hold[:, None, None] * _DOWN_DOWN


def _outer(vectors: Float[Array, "n 3"]) -> Float[Array, "n 3 3"]:
    return vectors[:, :, None] * vectors[:, None, :]


def inverse(matrix: Matrix3) -> Matrix3:
    """Of a symmetric 3x3 matrix, by cofactors: LAPACK would be called out of the compiled loop."""
    (a, b, c), (_, d, e), (_, _, f) = matrix
    aa, ab, ac = d * f - e * e, c * e - b * f, b * e - c * d
    bb, bc, cc = a * f - c * c, b * c - a * e, a * d - b * b
    return jnp.stack([aa, ab, ac, ab, bb, bc, ac, bc, cc]).reshape(3, 3) / (a * aa + b * ab + c * ac)


def solve(forces: Balance) -> tuple[Float[Array, "nodes 3"], Vector3, Matrix3]:
    """One Newton step with both ends held: block elimination from the anchor, then back.

    Returns:
        How the nodes must move, zero at the ends; force of the cable on what holds its last node
        once they have [N]; minus the rate of that force with the place of the last node [N/m].
    """

    def eliminate(
        carry: tuple[Matrix3, Vector3], node: tuple
    ) -> tuple[tuple[Matrix3, Vector3], tuple[Matrix3, Vector3]]:
        (pivot, force), (link, own, push) = carry, node
        freed = inverse(pivot)
        passed = link @ freed
        return (own - passed @ link, push + passed @ force), (freed, force)

    first = forces.own[1], forces.force[1]
    rest = forces.links[1:], forces.own[2:], forces.force[2:]
    (stiffness, end), (freed, pushed) = jax.lax.scan(eliminate, first, rest)

    def back(next_move: Vector3, node: tuple[Matrix3, Vector3, Matrix3]) -> tuple[Vector3, Vector3]:
        inverted, push, link = node
        move = inverted @ (push + link @ next_move)
        return move, move

    held = jnp.zeros((1, 3))
    _, moves = jax.lax.scan(back, held[0], (freed, pushed, forces.links[1:]), reverse=True)
    return jnp.concatenate([held, moves, held]), end, stiffness


def advance(
    cable: Cable,
    guess: Float[Array, "nodes 3"],
    before: Float[Array, "nodes 3"],
    water: Float[Array, "nodes 3"],
    length: Scalar,
    dt: ScalarLike,
    iterations: int,
    pin: Pin | None = None,
) -> tuple[Float[Array, "nodes 3"], Vector3, Matrix3, Scalar]:
    """The shape dt after `before`.

    Iterates until no tension differs by more than `ENOUGH` from what the linear equations took it to be: while nothing
    jerks, that is once.

    Args:
        cable: Its properties.
        guess: Of the shape, with its ends where they are then, n [m].
        before: Nodes dt earlier [m].
        water: Velocity of the water at the nodes, n [m/s].
        length: Unstretched, of the whole cable [m].
        dt: [s].
        iterations: At most.
        pin: What else holds it.

    Returns:
        Nodes; force on what holds the last one [N]; its stiffness there [N/m], as of `solve`; by how much a tension was
        misjudged in the last iteration [N], more than `ENOUGH` where there were too few of them.
    """
    segment = length / (guess.shape[0] - 1)

    def newton(state: tuple) -> tuple:
        nodes, *_ = state
        move, force, stiffness = solve(balance(cable, nodes, before, water, length, dt, pin))
        largest = jnp.sqrt(jnp.max(jnp.sum(move * move, axis=1)) + TINY)
        after = nodes + jnp.minimum(1.0, LARGEST_MOVE * segment / largest) * move
        return after, force, stiffness, _misjudged(cable, nodes, move, segment)

    def again(state: tuple, _: None) -> tuple[tuple, None]:
        return jax.lax.cond(state[3] > ENOUGH, newton, lambda same: same, state), None

    start = guess, jnp.zeros(3), jnp.zeros((3, 3)), jnp.asarray(jnp.inf)
    return jax.lax.scan(again, start, None, length=iterations)[0]


def _misjudged(cable: Cable, nodes: Float[Array, "nodes 3"], move: Float[Array, "nodes 3"], segment: Scalar) -> Scalar:
    """Largest difference between a tension after a move and what the linear equations took it to be [N]."""
    edges, moves = nodes[1:] - nodes[:-1], move[1:] - move[:-1]
    long = jnp.sqrt(jnp.sum(edges * edges, axis=1) + TINY)
    new = jnp.sqrt(jnp.sum((edges + moves) ** 2, axis=1) + TINY)
    tension, rate = _stretched(cable, long, segment)
    taken = jnp.maximum(tension + rate * jnp.sum(edges * moves, axis=1) / long, 0.0)
    return jnp.max(jnp.abs(_stretched(cable, new, segment)[0] - taken))
