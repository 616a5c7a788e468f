"""Forces on a vehicle under test: of its thrusters at known commands, of known ballast and of the tether."""

from functools import partial
from typing import Any

from rovtwin.core.frames import cross, rotation_from_quaternion
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.identification.joint.nodes import Nodes
from rovtwin.identification.joint.parameters import Extras
from rovtwin.vehicle.thrusters import Thrusters, force_just_after, lag, static_force


def thrust_history(
    thrusters: Thrusters, command: Array, held: Array, fresh: Array, step: float, delay: Array | None = None
) -> Array:
    """Wrench of the thrusters at the start, middle and end of every step, shape (S, K, 3, 6).

    Args:
        thrusters: With their lag.
        command: Those of each step, one after the other, shape (S, K, m, n).
        held: Share of the step that each is held, shape (S, K, m).
        fresh: 1 at steps where a record begins, with thrusters settled at its first command, shape (S, K).
        step: [s].
        delay: By which commands arrive late, or early where it is negative [s], shape ().
    """
    targets = jax.vmap(jax.vmap(jax.vmap(lambda u: static_force(thrusters, u))))(command)
    flat, shares = (x.reshape(-1, *x.shape[2:]) for x in (targets, held))
    begin = fresh.reshape(-1)

    def one(force: Array, now: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        goals, share, begins = now
        return _through_step(thrusters, jnp.where(begins > 0, goals[0], force), goals, share, step)

    _, history = jax.lax.scan(one, flat[0, 0], (flat, shares, begin))
    if delay is not None:
        history = _delayed(history, begin, 2.0 * delay / step)
    return (history @ thrusters.configuration.T).reshape(*command.shape[:2], 3, 6)


def _through_step(thrusters: Thrusters, force: Array, goals: Array, held: Array, step: float) -> tuple[Array, Array]:
    """Forces at the end of a step, shape (n,), and at its start, middle and end, shape (3, n).

    Each command acts for as long as it is held: with the lag of their mean a thruster would seem late by half of the
    step squared over its time constant. With a change in the step the middle is what Simpson's rule, as of RK4, needs
    for the impulse of the step.

    Args:
        thrusters: With their lag.
        force: Before [N], shape (n,).
        goals: Forces that they settle at, one after the other [N], shape (m, n).
        held: Share of the step that each is held, shape (m,).
        step: [s].
    """
    begins, middle, impulse = force, force, jnp.zeros_like(force)
    for number, (goal, share) in enumerate(zip(goals, held, strict=True)):
        # What is made up is held for no time: any other time is finite, and not used.
        some, time = share > 0.0, jnp.where(share > 0.0, share, 1.0) * step
        before = force_just_after(thrusters, force, goal)
        half = lag(thrusters, before, goal, 0.5 * time)
        after = lag(thrusters, half, goal, 0.5 * time)
        begins, middle = (before, half) if number == 0 else (begins, middle)
        impulse = impulse + share * (before + 4.0 * half + after)
        force = jnp.where(some, after, force)
    if len(goals) > 1:
        middle = 0.25 * (impulse - begins - force)
    return force, jnp.stack([begins, middle, force])


def _delayed(history: Array, begin: Array, halves: Array) -> Array:
    """Forces (N, 3, n) at the start, middle and end of steps, so many half steps later, linear between these instants.

    At the ends of a record, whose steps begin where `begin` (N,) is 1, its first or last force goes on.
    """
    count = len(history)
    # Each half step by its own ends: a thruster without a lag jumps between two of them.
    first, last = history[:, :2].reshape(2 * count, -1), history[:, 1:].reshape(2 * count, -1)
    number = jnp.arange(count)
    starts = jax.lax.cummax(jnp.where(begin > 0, number, 0))
    following = jnp.concatenate([begin[1:], jnp.ones(1)]) > 0
    ends = jax.lax.cummin(jnp.where(following, number, count - 1), reverse=True)

    def at(instant: Array, low: Array, high: Array, from_left: bool) -> Array:
        place = jnp.clip(instant - halves, 2.0 * low, 2.0 * high + 2.0)
        cell = jnp.ceil(place) - 1 if from_left else jnp.floor(place)
        cell = jnp.clip(cell, 2 * low, 2 * high + 1).astype(int)
        return first[cell] + (place - cell) * (last[cell] - first[cell])

    sides = ((0.0, False), (1.0, False), (2.0, True))
    return jnp.stack(
        [jax.vmap(partial(at, from_left=left))(2.0 * number + k, starts, ends) for k, left in sides], axis=1
    )


def load_wrench(x: Nodes, own: dict[str, Any], extras: Extras) -> Array:
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
