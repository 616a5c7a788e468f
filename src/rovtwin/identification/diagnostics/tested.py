"""What the tests covered: speeds in each direction and commands of each group of thrusters.

A force curve is evidence within these ranges and extrapolation beyond them.
"""

import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import as_array
from rovtwin.identification.joint.estimate import Solution
from rovtwin.identification.joint.model.parameters import DIRECTIONS
from rovtwin.identification.joint.solver.problem import Problem

Range = tuple[float, float]
_EDGES = (0.005, 0.995)  # quantiles: a single swing is no test of a speed


def tested_ranges(problem: Problem, solution: Solution) -> dict[str, Range]:
    """Ranges of nu [m/s, rad/s] by direction, and of u by `thrusters.GROUP`, over all fitted tests."""
    unknowns, segments = solution.unknowns, problem.segments
    path = problem.shooting.trajectories(as_array(unknowns.theta), unknowns.nodes, segments.arrays)
    t = segments.starts()[:, None] + segments.grid.step * np.arange(segments.grid.steps + 1)
    counts = np.diff([*segments.first, segments.count])
    ends = np.repeat([record.end for record in segments.records], counts)
    nu = np.asarray(path.nu)[t <= ends[:, None] + 1e-9]  # the last segment of a record runs on beyond its end
    found = {name: _range(nu[:, i]) for i, name in enumerate(DIRECTIONS)}
    command = np.concatenate([record.command for record in segments.records])
    for group, members in problem.shooting.parameters.groups.items():
        own = command[:, list(members)]
        found[f"thrusters.{group}"] = (float(own.min()), float(own.max()))
    return found


def _range(x: Float[np.ndarray, " n"]) -> Range:
    low, high = np.quantile(x, _EDGES)
    return float(low), float(high)
