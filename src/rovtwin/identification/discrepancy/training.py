"""The learned wrench beside all parameters: two steps, and what the second owes to the first in its widths.

The weights come from the regression on the missing wrench; then all parameters are estimated again with the weights
held at their mean. How far the weights may be off, and what that moves, is added to the covariance of the parameters as
of a value that is considered but not estimated (Schmidt 1966, Application of state-space methods to navigation
problems): so the widths of drag, added mass and thrust know that part of the force may belong to the learned wrench.
Estimating the weights with everything else was tried: with missing forces as large as those of the tests below the
steps stay damped, the estimate does not settle and predicts worse than without.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from rovtwin.identification.discrepancy.regression import part_inverse_lengths
from rovtwin.identification.joint.build import problem_of
from rovtwin.identification.joint.estimate import Solution, estimate
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.parameters import Parameter, Parameters
from rovtwin.identification.joint.solver.options import Options
from rovtwin.identification.joint.solver.problem import Noise, Problem
from rovtwin.vehicle.description.learned import anchored_inputs, discrepancy_from, whitening
from rovtwin.vehicle.description.schema import LearnedDiscrepancy

_WIDER = 2.0  # noise to begin with, over that of the estimate without weights: the valley is a new one


def extended(parameters: Parameters, block: LearnedDiscrepancy) -> Parameters:
    """Parameters with the weights of a block as the last ones."""
    model = parameters.model
    learned = discrepancy_from(block, np.asarray(model.thrusters.configuration), "learned", 1.0)
    q, shape = sum(len(part.weights) for part in block.parts), np.asarray(learned.coefficients).shape
    basis, names, at = np.zeros((q, *shape)), [], 0
    for i, part in enumerate(block.parts):
        m = len(part.weights)
        white = whitening(anchored_inputs(part.of), part_inverse_lengths(part), np.array(part.centres))
        basis[at : at + m, i, :m] = part.std * white
        names += [f"discrepancy.{part.axis}.{part.of}_{k + 1}" for k in range(m)]
        at += m
    weights = tuple(Parameter(name, "1", 0.0, False) for name in names)
    return Parameters(model.replace(discrepancy=learned), parameters.free + weights, parameters.groups, basis)


def with_block(parameters: Parameters, block: LearnedDiscrepancy) -> Parameters:
    """Parameters of a model that has the learned wrench of a block, at its mean."""
    configuration = np.asarray(parameters.model.thrusters.configuration)
    model = parameters.model.replace(discrepancy=discrepancy_from(block, configuration, "learned", 1.0))
    return Parameters(model, parameters.free, parameters.groups)


def refitted(
    problem: Problem,
    solution: Solution,
    block: LearnedDiscrepancy,
    anchors: Sequence[Mapping[str, Any]],
    settings: Options,
    progress: Callable[[int, float], None] | None = None,
) -> tuple[Problem, Solution]:
    """Problem and solution with the learned wrench held at its mean, from a solution without.

    Args:
        problem: Without the learned wrench.
        solution: Of it.
        block: From `regression.regressed`.
        anchors: As of `identify`.
        settings: As of the estimate without.
        progress: As of `estimate`.
    """
    parameters = with_block(problem.shooting.parameters, block)
    again = problem_of(parameters, problem.prior, problem.segments.records, anchors, settings)
    noise = Noise(_WIDER * solution.noise.sigma, _WIDER * solution.noise.defect)
    found = estimate(again, max_steps=settings.max_steps, begin=solution.unknowns, noise=noise, progress=progress)
    return again, found


def considered(
    problem: Problem,
    solution: Solution,
    block: LearnedDiscrepancy,
    anchors: Sequence[Mapping[str, Any]],
    settings: Options,
) -> Solution:
    """The solution with what the weights' own covariance moves in its covariance.

    With A the information of parameters and weights together, d theta / d w = -A_tt^-1 A_tw (Schmidt 1966).

    Args:
        problem: With the learned wrench held.
        solution: Of it.
        block: The weights' distribution.
        anchors: As of `identify`.
        settings: As of the estimate.
    """
    parameters, n = extended(problem.shooting.parameters, block), len(problem.prior.mean)
    S = np.asarray(block_diag(*(part.covariance for part in block.parts)))
    q = len(S)
    start = Gaussian(np.zeros(n + q), np.eye(n + q))
    larger = problem_of(parameters, start, problem.segments.records, anchors, settings)
    weights = np.concatenate([part.weights for part in block.parts])
    unknowns = replace(solution.unknowns, theta=np.concatenate([solution.unknowns.theta, weights]))
    corner = larger.assembled(larger.blocks(unknowns, solution.noise), unknowns, solution.noise).factor().corner
    keep = np.r_[0:n, n + q : len(corner)]  # parameters and offsets of the sensors
    A = corner[np.ix_(keep, keep)]
    A[:n, :n] += problem.prior.information - np.eye(n)
    moved = -np.linalg.solve(A, corner[np.ix_(keep, np.arange(n, n + q))])[:n]
    more = moved @ S @ moved.T
    bound = np.diag(problem.prior.covariance) + (solution.unknowns.theta - problem.prior.mean) ** 2
    target = np.diag(solution.covariance) + np.diag(more)
    # No width grows beyond the prior's, and how far the estimate has left it, as in `agreement.widening`.
    least = np.minimum(1.0, np.sqrt(np.maximum(bound, np.diag(solution.covariance)) / target))
    covariance = (solution.covariance + more) * np.outer(least, least)
    grown = np.sqrt(np.diag(covariance) / np.diag(solution.covariance))
    return replace(solution, covariance=covariance, widening=solution.widening * grown)
