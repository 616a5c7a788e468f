"""The problem of a joint estimate from records and options."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.identification.joint.estimate import Solution
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.parameters import Parameters
from rovtwin.identification.joint.solver.anchors import static_evidence
from rovtwin.identification.joint.solver.options import Options
from rovtwin.identification.joint.solver.problem import Problem
from rovtwin.identification.joint.solver.segments import cut
from rovtwin.identification.joint.solver.shooting import Shooting
from rovtwin.identification.logs.record import SIGNALS, Record
from rovtwin.vehicle import Model

LAGS = 5.0  # of a first-order lag, after which less than a hundredth of the start is left
SETTLING = (0.5, 3.0)  # [s]: a file may not know of a lag, and none is as slow as a test is long


def problem_of(
    parameters: Parameters,
    start: Gaussian,
    records: Sequence[Record],
    anchors: Sequence[Mapping[str, Any]],
    settings: Options,
) -> Problem:
    """Readings of the records, prior and static evidence; arguments are those of `identify`."""
    grid = settings.grid(sum(record.duration for record in records))
    grid = replace(grid, settling=settling(parameters.model))
    shooting = Shooting(parameters, cut(records, grid))
    return Problem(shooting, start, static_evidence(parameters, anchors), measured_starts=settings.starts == "measured")


def settling(model: Model) -> float:
    """How long thrusters may take from anything to their first command [s]."""
    return float(np.clip(LAGS * np.max(np.asarray(model.thrusters.time_constant), initial=0.0), *SETTLING))


def offsets_of(problem: Problem, solution: Solution) -> dict[str, Float[np.ndarray, " _"]]:
    """Constant errors of the sensors as estimated, by signal."""
    out, start = {}, 0
    for name in problem.segments.levers:
        size = len(SIGNALS[name][0])
        out[name] = solution.unknowns.offsets[start : start + size]
        start += size
    return out
