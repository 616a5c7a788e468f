"""The joint estimate: maximum a posteriori by multiple shooting, with the noise estimated along the way."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize_scalar

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.joint.solver.arrow import Arrow, Factored
from rovtwin.identification.joint.solver.noise import Variances
from rovtwin.identification.joint.solver.problem import Noise, Problem, Unknowns
from rovtwin.identification.joint.solver.shooting import Blocks
from rovtwin.identification.joint.uncertainty.agreement import stretches, widened, widening
from rovtwin.identification.joint.uncertainty.apart import Apart, halves_apart, logs_apart
from rovtwin.identification.joint.uncertainty.posterior_mean import moved_to_the_middle
from rovtwin.identification.joint.uncertainty.unmodelled import Effects, effects

_NEAR = 0.02  # relative decrease of the cost below which the noise is looked at
_REACH = 1.0  # standard deviations of the prior by which a parameter moves at most in one step
_SHARES = (1.0, 0.2, 0.04)  # of a step that are tried: nodes of a fast vehicle soon leave where it is straight
# m, rad, m/s, rad/s, m/s2, rad/s2 by which a node moves at most in one step; a push is linear in what it does.
_STRAY = np.array([0.5] * 3 + [0.2] * 9 + [5.0] * 3 + [50.0] * 3)
_SMALL = 0.01  # change in standard deviations at which the estimate is done
_GAIN = 0.01  # of the cost by two steps in a row, below which it is done too: a standard deviation costs 1


@dataclass(frozen=True, eq=False)
class Solution:
    """The estimate.

    Attributes:
        unknowns: In the middle of the posterior, see `posterior_mean`; the nodes at its maximum.
        noise: As estimated.
        covariance: Of theta, with the widening and the effects.
        information: Of theta from the readings and static evidence alone, without the prior, at the maximum, (n, n).
        offset_std: Standard deviation of the offsets.
        widening: By how much the widths are larger than the curvature's, since stretches of the tests disagree, (n,).
        stretches: The most into which the tests were divided for that; 0 where they are too short.
        converged: Whether the last step was below a hundredth of a standard deviation, or none gained anything.
        steps: Gauss-Newton steps taken.
        cost: Sum of squares at the end.
        apart: What each log says by itself; None where there is one log, or nothing has settled.
        halves: The same of the halves of a single log.
        effects: What the model leaves out, as far as the tests speak of it; none where nothing has settled.
    """

    unknowns: Unknowns
    noise: Noise
    covariance: Float[np.ndarray, "n n"]
    information: Float[np.ndarray, "n n"]
    offset_std: Float[np.ndarray, " G"]
    widening: Float[np.ndarray, " n"]
    stretches: int
    converged: bool
    steps: int
    cost: float
    apart: Apart | None = None
    halves: Apart | None = None
    effects: Effects | None = None


def estimate(
    problem: Problem,
    max_steps: int = 120,
    progress: Callable[[int, float], None] | None = None,
    begin: Unknowns | None = None,
    noise: Noise | None = None,
) -> Solution:
    """Levenberg-Marquardt steps; after each accepted one the noise is estimated anew.

    Args:
        problem: Readings, prior and static evidence.
        max_steps: Of Gauss-Newton.
        progress: Called with the number of steps and the largest change in standard deviations.
        begin: Where to begin; None: where forces balance.
        noise: To begin with, beside `begin`; None: as usual, at the wide end of the valley.

    Raises:
        IdentificationError: The readings are not numbers, or the model cannot be integrated at the start.
    """
    if begin is None or noise is None:
        start, noise = problem.start()
        begin = begin or start
    here = begin
    damping, change, steps, settled, idle = 1.0, np.inf, 0, False, 0
    variances = Variances(problem)
    fresh, going = True, None
    blocks = problem.blocks(here, noise)
    arrow = problem.assembled(blocks, here, noise)
    cost = problem.cost(here, noise)
    if not np.isfinite(cost):
        raise IdentificationError("the model cannot follow these readings at all: check units, frames and commands")
    while steps < max_steps and not (settled and (change < _SMALL or idle >= 2)):
        steps += 1
        found = _better(problem, here, noise, arrow, cost, damping, going)
        if found is None:
            if fresh:
                # No step lowers the sum of squares: at the edge of a dead band there is no slope to follow. That is an
                # end only where an undamped step promised less than a standard deviation.
                idle = 2 if arrow.gain() < 1.0 else 0
                break
            # What counts as an outlier was still that of the noise before.
            blocks, fresh = problem.blocks(here, noise), True
            arrow = problem.assembled(blocks, here, noise)
            damping = 1.0
            continue
        before, (here, cost, damping, change, going) = cost, found
        here, cost = _rescaled(problem, here, noise, cost)
        idle = idle + 1 if before - cost < _GAIN else 0
        blocks = problem.blocks(here, noise)
        arrow = problem.assembled(blocks, here, noise)
        fresh = False
        noise, settled = variances.step(blocks, arrow, noise, cost > (1.0 - _NEAR) * before)
        arrow = problem.assembled(blocks, here, noise)
        cost = problem.cost(here, noise)
        if progress:
            progress(steps, change)
    done = settled and (change < _SMALL or idle >= 2)
    return _solution(problem, here, noise, blocks, arrow, done, steps, cost)


def _better(
    problem: Problem,
    here: Unknowns,
    noise: Noise,
    arrow: Arrow,
    cost: float,
    damping: float,
    before: Float[np.ndarray, " n"] | None,
) -> tuple[Unknowns, float, float, float, Float[np.ndarray, " n"] | None] | None:
    """Unknowns of lower cost, that cost, damping to go on with, largest change in standard deviations, and the step.

    Steps are damped in the measure of the prior: what the readings hardly see stays where it is. Undamped ones that
    follow each other in a row of like ratio, or to and fro, say where they are going (Aitken): every second one is
    taken that far, where that is better. Where the whole step is worse, a share of it is tried. Nodes that go astray
    are held back one by one in the whole step only, as that tears the chain. `before` is the last step, None where it
    was damped or taken so far.
    """
    factored = arrow.factor()
    std = factored.border_std()
    while damping < 1e9:
        corner, held_back = _within_reach(problem, factored, damping)
        change = float(np.max(np.abs(corner) / std))
        tries = [(share, corner) for share in _SHARES]
        free = not held_back and damping <= 0.1  # small against the prior, which readings outweigh
        if free and before is not None:
            tries.insert(0, (1.0, _going(corner, before)))
        for k, (share, step) in enumerate(tries):
            nodes = factored.nodes(step)
            trial = here.moved(share * nodes if share < 1.0 else _not_astray(nodes), share * step)
            new = problem.cost(trial, noise)
            if np.isfinite(new) and new <= cost * (1 + 1e-9):
                change = np.inf if held_back or damping > 1e-2 or share < 1.0 else change
                plain = corner if free and share == 1.0 and (before is None or k > 0) else None
                return trial, new, damping / 10 if damping > 1e-3 else 0.0, change, plain
        if damping == 0.0 and change < _SMALL:
            return here, cost, 0.0, change, None  # nothing is left but rounding
        damping = max(10 * damping, 0.1)
    return None


def _not_astray(x: Float[np.ndarray, "S 18"]) -> Float[np.ndarray, "S 18"]:
    """Steps of nodes, each as far as readings can be wrong about a state.

    Where theta is held back, what it leaves is pushed onto the nodes, those most that nothing holds from behind.
    """
    return x / np.maximum(np.abs(x / _STRAY).max(axis=1, keepdims=True), 1.0)


def _going(step: Float[np.ndarray, " n"], before: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Where a row of steps is going: the sum of a geometric series, each component by its own ratio."""
    rate = np.where(before != 0.0, step / np.where(before != 0.0, before, 1.0), 0.0)
    return step / (1.0 - np.clip(rate, -1.0, 0.8))


def _within_reach(problem: Problem, factored: Factored, damping: float) -> tuple[np.ndarray, bool]:
    """Step of theta and offsets, and whether one of them had to be held back more than the others."""
    n = len(problem.width)
    more = np.concatenate([damping * problem.width**-2.0, np.zeros(len(problem.groups))])
    corner, held_back = factored.border(more), False
    while (far := np.abs(corner[:n]) > _REACH * problem.width).any():
        more[:n][far] = np.maximum(3.0 * more[:n][far], 0.1 * problem.width[far] ** -2.0)
        corner, held_back = factored.border(more), True
    return corner, held_back


def _rescaled(problem: Problem, here: Unknowns, noise: Noise, cost: float) -> tuple[Unknowns, float]:
    """The same motion at the common scale of all forces that prior and static evidence like best.

    Along that scale the readings say nothing, and it is a curve in theta: steps along its tangent leave the narrow
    valley and would be refused one after the other.
    """

    def scaled(s: float) -> Float[np.ndarray, " n"]:
        return np.asarray(problem.shooting.scaled(here.theta, s))

    best: Any = minimize_scalar(lambda s: problem.static_cost(scaled(s)), bounds=(-0.7, 0.7), method="bounded")
    trial = replace(here, theta=scaled(float(best.x)))
    new = problem.cost(trial, noise)
    return (trial, new) if new < cost else (here, cost)


def _solution(
    problem: Problem,
    here: Unknowns,
    noise: Noise,
    blocks: Blocks,
    arrow: Arrow,
    converged: bool,
    steps: int,
    cost: float,
) -> Solution:
    n = len(here.theta)
    factored = arrow.factor()
    # What is known of theta without its prior, the offsets eliminated too.
    reduced = factored.corner
    rest = np.linalg.solve(reduced[n:, n:], reduced[n:, :n])
    measured = reduced[:n, :n] - reduced[:n, n:] @ rest - problem.information
    measured = 0.5 * (measured + measured.T)
    static = problem.static_information(here.theta) - problem.information
    theta, covariance = moved_to_the_middle(problem, here.theta, measured - static)
    divisions = stretches(problem, here.nodes)
    wider = widening(problem, here.theta, blocks, noise, arrow, divisions)
    bound = np.diag(problem.prior.covariance) + (here.theta - problem.prior.mean) ** 2
    left_out = effects(problem, here, noise, arrow, float(np.median(wider))) if converged else Effects.none(n)
    covariance = widened(covariance, wider)
    room = np.maximum(bound - np.diag(covariance), 0.0)
    covariance = covariance + left_out.of_theta(room, np.array([p.positive for p in problem.shooting.parameters.free]))
    offset_std = factored.border_std()[n:]
    most = max((len(set(one)) for one in divisions), default=0)
    given = problem, here.theta, blocks, noise, arrow, divisions
    apart, halves = (logs_apart(*given), halves_apart(*given)) if converged else (None, None)
    return Solution(
        replace(here, theta=theta), noise, covariance, measured, offset_std, wider, most, converged, steps, cost, apart,
        halves, left_out,
    )  # fmt: skip
