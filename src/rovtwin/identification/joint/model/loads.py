"""Forces on a vehicle under test: of its thrusters at known commands, of known ballast and of the tether."""

from typing import Any, NamedTuple

from jaxtyping import Float

from rovtwin.core.flow import Environment
from rovtwin.core.frames import cross, rotation_from_quaternion
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Index, Scalar, Vector6
from rovtwin.identification.joint.model.nodes import Nodes
from rovtwin.identification.joint.model.parameters import Extras
from rovtwin.vehicle.physics.dynamics import acceleration
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import Thrusters, force_just_after, half_steps, inflow_damping, static_force

WRENCH = 6  # numbers of thrust that are its wrench


def thrust_history(
    thrusters: Thrusters,
    command: Float[Array, "S K m n"],
    held: Float[Array, "S K m"],
    fresh: Float[Array, "S K"],
    step: float,
    delay: Scalar | None = None,
) -> Float[Array, "S K 3 _"]:
    """Thrust at the start, middle and end of every step: 6 numbers, with a loss to inflow 6 + n.

    That is the wrench of the thrusters, and what each loses for each m/s of inflow, see `accelerated`.

    Args:
        thrusters: With their lag.
        command: Those of each step, one after the other.
        held: Share of the step that each is held.
        fresh: 1 at steps where a record begins, with thrusters settled at its first command.
        step: [s].
        delay: By which commands arrive late, or early where it is negative [s].
    """
    targets = jax.vmap(jax.vmap(jax.vmap(lambda u: static_force(thrusters, u))))(command)
    flat, shares = (x.reshape(-1, *x.shape[2:]) for x in (targets, held))
    begin = fresh.reshape(-1)

    def one(
        force: Float[Array, " n"], now: tuple[Float[Array, "m n"], Float[Array, " m"], Scalar]
    ) -> tuple[Float[Array, " n"], _Cell]:
        goals, share, begins = now
        return _through_step(thrusters, jnp.where(begins > 0, goals[0], force), goals, share, step)

    _, cells = jax.lax.scan(one, flat[0, 0], (flat, shares, begin))
    if delay is not None:
        cells = _delayed(cells, begin, delay / step)
    # With a command that changes in the step the middle is what Simpson's rule, as of RK4, needs for the impulse.
    middle = 0.25 * (6.0 * cells.mean - cells.first - cells.last)
    history = jnp.stack([cells.first, middle, cells.last], axis=1)
    thrust = history @ thrusters.configuration.T
    if thrusters.inflow_loss is not None:
        thrust = jnp.concatenate([thrust, inflow_damping(thrusters, history)], axis=-1)
    return thrust.reshape(*command.shape[:2], 3, -1)


class _Cell(NamedTuple):
    """Forces of thrusters in a step [N], or of N steps: at its ends, and their mean."""

    first: Float[Array, "*N n"]
    mean: Float[Array, "*N n"]
    last: Float[Array, "*N n"]


def _through_step(
    thrusters: Thrusters, force: Float[Array, " n"], goals: Float[Array, "m n"], held: Float[Array, " m"], step: float
) -> tuple[Float[Array, " n"], _Cell]:
    """Forces at the end of a step, and in it.

    Each command acts for as long as it is held: with the lag of their mean a thruster is off in time by up to an
    eighth of the step squared over its time constant.

    Args:
        thrusters: With their lag.
        force: Before [N].
        goals: Forces that they settle at, one after the other [N].
        held: Share of the step that each is held.
        step: [s].
    """
    first, mean = force_just_after(thrusters, force, goals[0]), jnp.zeros_like(force)
    for goal, share in zip(goals, held, strict=True):
        # What is made up is held for no time: any other time is finite, and not used.
        some, time = share > 0.0, jnp.where(share > 0.0, share, 1.0) * step
        before, half, after = half_steps(thrusters, force, goal, time)
        mean = mean + share * (before + 4.0 * half + after) / 6.0
        force = jnp.where(some, after, force)
    return force, _Cell(first, mean, force)


def _delayed(cells: _Cell, begin: Float[Array, " N"], shift: Scalar) -> _Cell:
    """The same so many steps later.

    In a step the impulse so far is the cubic with the forces at both ends as its slopes, so that no impulse is lost,
    whatever the shift. At the ends of a record, whose steps begin where `begin` is 1, its first or last force
    goes on.
    """
    count = len(begin)
    number = jnp.arange(count)
    low = jax.lax.cummax(jnp.where(begin > 0, number, 0))
    following = jnp.concatenate([begin[1:], jnp.ones(1)]) > 0
    high = jax.lax.cummin(jnp.where(following, number, count - 1), reverse=True)

    def impulse(cell: _Cell, s: Scalar) -> Float[Array, " n"]:
        return cell.first * s * (1.0 - s) ** 2 + cell.mean * s**2 * (3.0 - 2.0 * s) - cell.last * s**2 * (1.0 - s)

    def force(cell: _Cell, s: Scalar) -> Float[Array, " n"]:
        ends = cell.first * (1.0 - s) * (1.0 - 3.0 * s) - cell.last * s * (2.0 - 3.0 * s)
        return ends + 6.0 * cell.mean * s * (1.0 - s)

    def at(k: Scalar, low: Index, high: Index) -> _Cell:
        begins, ends = (jnp.clip(k + side - shift, low, high + 1.0) for side in (0.0, 1.0))
        a = jnp.clip(jnp.floor(begins), low, high).astype(int)
        b = jnp.clip(jnp.ceil(ends) - 1.0, low, high).astype(int)
        one, other = (jax.tree.map(lambda x, row=row: x[row], cells) for row in (a, b))
        s, t = begins - a, ends - b
        inside = impulse(other, t) - impulse(one, s) + jnp.where(a == b, 0.0, one.mean)
        before = jnp.clip(low - (k - shift), 0.0, 1.0) * cells.first[low]
        after = jnp.clip(k + 1.0 - shift - (high + 1.0), 0.0, 1.0) * cells.last[high]
        return _Cell(force(one, s), inside + before + after, force(other, t))

    return jax.vmap(at)(1.0 * number, low, high)


def accelerated(model: Model, extras: Extras, own: dict[str, Any], x: Nodes, thrust: Float[Array, " _"]) -> Vector6:
    """nu_dot in a segment.

    Args:
        model: With the segment's ballast.
        extras: Of the test.
        own: The segment's, as of `load_wrench`.
        x: State.
        thrust: Wrench, apart from loads, since learned wrenches depend on it; where there is more, what
            each thruster loses for each m/s of inflow [N s/m].
    """
    calm = Environment.calm(velocity=own["current"], wrench=load_wrench(x, own, extras))
    inflow = thrust[WRENCH:] if thrust.shape[0] > WRENCH else None
    return acceleration(model, x.position, x.attitude, x.nu, thrust[:WRENCH], calm, inflow=inflow)


def load_wrench(x: Nodes, own: dict[str, Any], extras: Extras) -> Vector6:
    """Wrench of what belongs to the test: known ballast, and the tether's drag, b at CO."""
    R_bn = rotation_from_quaternion(x.attitude).T
    through = x.nu[:3] - R_bn @ own["current"]
    drag = -extras.tether_drag * own["tether"] * jnp.sqrt(through @ through + 1e-12) * through
    wrench = jnp.concatenate([drag, jnp.zeros(3)])
    if "ballast" in own:
        for piece in own["ballast"]:
            force = R_bn[:, 2] * piece[0]
            wrench = wrench + jnp.concatenate([force, cross(piece[1:], force)])
    return wrench
