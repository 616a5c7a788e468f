"""What an error of scale, common to all positions of a test, does to the estimate.

Positions from printed markers are as long as the prints are assumed to be. No reading shows it: everything fits as
well, at speeds and accelerations that are 1 % off. It is no noise, and more readings do not make it smaller, so that it
is left out of the sum of squares, and what it moves is added to the covariance (a consider parameter).

Reference: Schmidt (1966), Application of state-space methods to navigation problems, Advances in Control Systems 3.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from rovtwin.identification.joint.estimate import Solution
from rovtwin.identification.joint.solver.problem import Problem
from rovtwin.identification.joint.solver.segments import Segments

SIGNALS = ("position", "horizontal")  # what has the scale; depth comes from a pressure
_TINY = 1e-3  # of a standard deviation: no reading becomes an outlier by it


def scaled(segments: Segments, share: float) -> Segments:
    """Segments whose positions are longer by `share` times the standard deviation of their test's scale."""
    counts = np.diff([*segments.first, segments.count])
    factor = 1.0 + share * np.repeat([record.scale_std for record in segments.records], counts)[:, None, None]
    arrays = dict(segments.arrays)
    for name in set(SIGNALS) & set(arrays):
        arrays[name] = arrays[name] | {"value": arrays[name]["value"] * factor}
    return replace(segments, arrays=arrays)


def scale_response(problem: Problem, solution: Solution) -> Float[np.ndarray, " n"]:
    """Change of theta by one standard deviation of the scale; zero where no test has one.

    One scale for all tests: whoever printed the markers of several did so with one printer.
    """
    n = len(solution.unknowns.theta)
    if not any(record.scale_std for record in problem.segments.records):
        return np.zeros(n)

    def step(segments: Segments) -> Float[np.ndarray, " n"]:
        blocks = problem.blocks(solution.unknowns, solution.noise, segments)
        return problem.assembled(blocks, solution.unknowns, solution.noise).factor().border()[:n]

    return (step(scaled(problem.segments, _TINY)) - step(problem.segments)) / _TINY


def with_scale(solution: Solution, response: Float[np.ndarray, " n"]) -> Solution:
    """The solution with what the scale moves in its covariance."""
    return replace(solution, covariance=solution.covariance + np.outer(response, response))
