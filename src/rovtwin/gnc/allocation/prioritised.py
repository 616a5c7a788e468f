"""Allocation with priorities: the best wrench within the limits of the thrusters that are left, every tick anew.

    minimise  |W (T f - tau)|^2 + damping |f / f_largest - preferred|^2    over the forces f that thrusters can give now

W weighs axes in shares of the largest wrench of each, by rank: depth before attitude and heading, these before
surge and sway. A rank costs 300 times as much as the next: missing all of surge is worth missing some 1/300 of yaw.
Ranks solved one after the other would be exact in that, but take a solve per rank and the outcome of each as equations
of the next, which the rounding of the one before can contradict; feedback sees to 1/300.
"""

from typing import Any

import equinox as eqx
import numpy as np

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import Command
from rovtwin.core.numerics import as_array, in_numpy, jnp, module_for
from rovtwin.core.types import Configuration, PerThruster, PRNGKey, Scalar, Vector6
from rovtwin.gnc.allocation.box_least_squares import box_least_squares
from rovtwin.gnc.interfaces import Allocated, AllocationInput
from rovtwin.vehicle.physics.actuation import RANK_TOLERANCE, pushed_axes, wrench_limits
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import Thrusters, command_for_force, force_limits

# Depth first: a vehicle that lists still comes home, one that cannot keep off the floor does not.
RANKS = (0, 0, 2, 1, 1, 1)
RANK_COST = 300.0
DAMPING = 1e-4
ROUNDING = 1e-6  # of the largest force


class AllocationMemory(eqx.Module):
    """Forces of the last tick before health [N]: as solved, and as sent (zero near standstill)."""

    solved: PerThruster
    sent: PerThruster


class PriorityAllocation(Block):
    """Least squares within limits, ranked axes, thrusters lost or weak at run time.

    Attributes:
        thrusters: As the autopilot's model has them; their health is not used, the input's is.
        lowest: Least force of each sound thruster [N].
        highest: Greatest force of each sound thruster [N].
        least_wrench: Least wrench of each axis alone [N, N m]; tau is cut to it.
        greatest_wrench: Greatest.
        weight: Diagonal of W [1/N, 1/(N m)]; zero along an axis that thrusters cannot
            push: what surge makes in pitch must not keep it from pushing.
        slew: Largest rate of the commanded force [N/s]; inf is none.
        start: Share of its largest force from which a thruster at rest turns.
        stop: Share below which a turning one stops.
        preferred: Shares of the largest forces to which unneeded freedom goes.
    """

    thrusters: Thrusters
    lowest: PerThruster
    highest: PerThruster
    least_wrench: Vector6
    greatest_wrench: Vector6
    weight: Vector6
    slew: PerThruster
    start: Scalar
    stop: Scalar
    preferred: PerThruster

    @classmethod
    def of(
        cls,
        model: Model,
        ranks: Any = RANKS,
        slew: Any = None,
        start: float = 0.01,
        stop: float = 0.005,
        preferred: Any = 0.0,
    ) -> "PriorityAllocation":
        """Allocation for a model.

        Args:
            model: Its thrusters are used.
            ranks: Of X, Y, Z, K, M, N: the greater goes first; neighbours should not differ by more than one, and the
                whole range by no more than two (rounding).
            slew: Largest rate of the commanded force [N/s], one or one for each; None is the thrusters' own limit.
            start: Share of its largest force from which a thruster at rest turns.
            stop: Share below which it stops, at most `start`.
            preferred: Shares of the largest forces to which unneeded freedom goes, one or one for each.
        """
        if not 0.0 <= stop <= start < 1.0:
            raise ValueError(f"stop is {stop!r} and start {start!r}, expected 0 <= stop <= start < 1")
        thrusters = model.thrusters
        sound = eqx.tree_at(lambda t: t.health, thrusters, as_array(np.ones(thrusters.count)))
        pushed = pushed_axes(model.replace(thrusters=sound))
        lower, upper = (as_array(pushed * np.asarray(limit)) for limit in wrench_limits(sound))
        slew = thrusters.rate_limit if slew is None else np.broadcast_to(slew, thrusters.count)
        lowest, highest = force_limits(sound)
        return cls(
            thrusters=thrusters,
            lowest=lowest,
            highest=highest,
            least_wrench=lower,
            greatest_wrench=upper,
            weight=as_array(np.asarray(row_weights(lower, upper)) * np.sqrt(RANK_COST) ** np.asarray(ranks)),
            slew=as_array(slew),
            start=as_array(start),
            stop=as_array(stop),
            preferred=as_array(np.broadcast_to(preferred, thrusters.count)),
        )

    def init(self, key: PRNGKey, start: Start) -> AllocationMemory:
        rest = jnp.zeros(self.thrusters.count)
        return AllocationMemory(rest, rest)

    def step(self, memory: AllocationMemory, input: AllocationInput, dt: float) -> tuple[AllocationMemory, Allocated]:
        working, room = input.health > 0.0, self.slew * dt
        lower = jnp.where(working, jnp.maximum(self.lowest, memory.solved - room), 0.0)
        upper = jnp.where(working, jnp.minimum(self.highest, memory.solved + room), 0.0)
        T, weight = self.thrusters.configuration * input.health, self.weight * input.axes
        solved = self._solve(T, input.tau, weight, lower, upper)
        sent = self._away_from_standstill(solved, memory.sent)
        made = T @ sent
        near = ROUNDING * largest_force(self.lowest, self.highest)
        limited = working & ((solved <= lower + near) | (solved >= upper - near))
        missing = jnp.where(weight > 0.0, input.tau - T @ solved, 0.0)
        command = Command(command_for_force(self.thrusters, sent))
        allocated = Allocated(command, made, input.tau - made, missing, limited)
        return AllocationMemory(solved, sent), allocated

    def _solve(
        self, T: Configuration, tau: Vector6, weight: Vector6, lower: PerThruster, upper: PerThruster
    ) -> PerThruster:
        """The best forces [N]."""
        largest = largest_force(self.lowest, self.highest)
        A = weight[:, None] * T * largest
        # Beyond what an axis can do at all, asking for more must not weigh more against the others.
        b = weight * jnp.clip(tau, self.least_wrench, self.greatest_wrench)
        bounds = lower / largest, upper / largest
        # Damping pulls towards the preferred forces, by 1e-4 or so of the wrench; a second pass, which prefers what
        # the first one found, leaves 1e-8 of that (a proximal step: Rockafellar 1976).
        first = box_least_squares(A, b, *bounds, self.preferred, DAMPING)
        return box_least_squares(A, b, *bounds, first, DAMPING) * largest

    def _away_from_standstill(self, force: PerThruster, sent: PerThruster) -> PerThruster:
        """Forces with those near zero left out, with hysteresis.

        Each change of sign sends the command across the dead band, from -u_0 to u_0 at once: about zero force the
        noise of the estimate would do that every few ticks. So a thruster rests until some force is asked of it, and
        once it turns it goes on until clearly less is asked for.
        """
        turning = force * sent > 0.0
        least = jnp.where(turning, self.stop, self.start) * largest_force(self.lowest, self.highest)
        return jnp.where(jnp.abs(force) >= least, force, 0.0)


def largest_force(lowest: PerThruster, highest: PerThruster) -> PerThruster:
    """Size of the largest force of each thruster [N]; 1 for one without any, which divides safely."""
    largest = jnp.maximum(highest, -lowest)
    return jnp.where(largest > 0.0, largest, 1.0)


def row_weights(lower: Vector6, upper: Vector6) -> Vector6:
    """One over the largest wrench of each axis; zero where there is none but noise of the geometry."""
    lower, upper = in_numpy((lower, upper))
    xp = module_for(lower, upper)
    largest = xp.maximum(upper, -lower)
    some = largest > RANK_TOLERANCE * xp.max(largest)
    return jnp.asarray(xp.where(some, 1.0 / xp.where(some, largest, 1.0), 0.0))
