"""What the thrusters that are left can still do: the largest wrench along a direction, and of each axis.

For the limits of the reference, and for the supervisor, which has to know whether a mission can go on after a thruster,
or one vehicle of a pair, is lost.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.numerics import Array, jax, jnp, module_for
from rovtwin.core.types import PerThruster, Scalar, Vector6
from rovtwin.gnc.allocation.box_least_squares import box_least_squares
from rovtwin.gnc.allocation.prioritised import largest_force, row_weights
from rovtwin.vehicle.physics.actuation import wrench_limits
from rovtwin.vehicle.physics.thrusters import Thrusters, force_limits

# Surge, sway, heave and yaw; small moments in roll and pitch are carried by the restoring moment.
HELD = (True, True, True, False, False, True)
BEARINGS = 16
# How hard s pulls compared with the effort of thrusters; the product is the pull compared with a misfit of the wrench.
_PULL, _DAMPING = 1e4, 1e-10
_PASSES = 3


def attainable(
    thrusters: Thrusters,
    direction: Vector6,
    health: PerThruster,
    held: Bool[Array, "6"] | None = None,
    spent: Vector6 | None = None,
) -> Scalar:
    """Largest factor s for which the thrusters can make `spent + s direction`.

    A linear programme, solved as one more least-squares allocation: s is a thruster that pushes against the direction
    and prefers far more than it can have. Exact to about 1e-4 of the result.

    Args:
        thrusters: Their own health is not used.
        direction: Wrench, b at CO [N, N m]; along held axes only.
        health: Share of its force that each thruster still gives.
        held: Axes along which the wrench must be just this; the others may be anything. None is all.
        spent: Wrench that is needed besides, as for buoyancy or drag; None is none.

    Returns:
        s >= 0; 0 also where `spent` alone is too much, and where nothing is asked for.
    """
    sound = eqx.tree_at(lambda t: t.health, thrusters, jnp.ones_like(health))
    lowest, highest = force_limits(sound)
    lower, upper = wrench_limits(sound)
    weight = row_weights(lower, upper) * (1.0 if held is None else held)
    spent = jnp.zeros(6) if spent is None else spent

    bound = _bound(direction * (1.0 if held is None else held), lower - spent, upper - spent)
    largest = largest_force(lowest, highest)
    T = thrusters.configuration * health * largest
    A = weight[:, None] * jnp.concatenate([T, -(bound * direction)[:, None]], axis=1)
    b = weight * spent
    lower_x, upper_x = jnp.append(lowest / largest, 0.0), jnp.append(highest / largest, 1.0)
    preferred = jnp.zeros_like(lower_x).at[-1].set(_PULL)

    def ask_back(
        before: tuple[Float[Array, " x"], Vector6], _: None
    ) -> tuple[tuple[Float[Array, " x"], Vector6], None]:
        """Method of multipliers: what s gained by a misfit is asked back."""
        misfit = before[1]
        x = box_least_squares(A, b + misfit, lower_x, upper_x, preferred, _DAMPING)
        return (x, misfit + b - A @ x), None

    (x, _), _ = jax.lax.scan(ask_back, (preferred, jnp.zeros(6)), length=_PASSES)
    enough = jnp.all(jnp.abs(A @ x - b) < 1e-4)
    return jnp.where(enough, bound * x[-1], 0.0)


def _bound(direction: Vector6, lower: Vector6, upper: Vector6) -> Scalar:
    """What each axis by itself allows; 0 for no direction at all."""
    some = direction != 0.0
    room = jnp.where(direction > 0.0, upper, lower) / jnp.where(some, direction, 1.0)
    return jnp.where(jnp.any(some), jnp.maximum(jnp.min(jnp.where(some, room, jnp.inf)), 0.0), 0.0)


class RemainingWrench(eqx.Module):
    """What thrusters can do along each axis while the others that are held stay at zero.

    Attributes:
        negative: Largest force or moment astern, to port, up, ... [N, N m], positive numbers.
        positive: The same ahead, to starboard, down, ...
        horizontal: Least over all horizontal directions of the largest force [N].
    """

    negative: Vector6
    positive: Vector6
    horizontal: Scalar

    @property
    def either(self) -> Float[Array, "*axes 6"]:
        """What is there both ways."""
        return module_for(self).minimum(self.negative, self.positive)


def remaining(thrusters: Thrusters, health: PerThruster, held: tuple[bool, ...] = HELD) -> RemainingWrench:
    """What is left with this health, for a supervisor to compare with what it needs.

    Args:
        thrusters: Their own health is not used.
        health: Share of its force that each thruster still gives.
        held: Axes that have to stay at zero beside the one asked for, X to N. Without yaw, for example, it tells what
            is left of surge for a vehicle that may turn.
    """
    axes = np.eye(6)
    angle = 2.0 * np.pi * np.arange(BEARINGS) / BEARINGS
    level = np.cos(angle)[:, None] * axes[0] + np.sin(angle)[:, None] * axes[1]
    directions = np.concatenate([-axes, axes, level])
    masks = np.asarray(held) | (directions != 0.0)
    masks[12:, :2] = True

    def along(direction: Vector6, mask: Bool[Array, "6"]) -> Scalar:
        return attainable(thrusters, direction, health, mask)

    found = jax.vmap(along)(jnp.asarray(directions), jnp.asarray(masks))
    return RemainingWrench(found[:6], found[6:12], jnp.min(found[12:]))


def lost_axes(now: RemainingWrench, sound: RemainingWrench, least: float = 0.1) -> Bool[Array, "6"]:
    """Axes of which less than this share of a sound vehicle's wrench is left, either way."""
    return now.either < least * sound.either
