"""Cross-validation of structures: one half of the tests is fitted, the other predicted, then the other way round.

All parameters are in the program that is compiled, once for each half; those that are not free are held by a prior of
next to no width. An estimate begins where the one of the structure below it ended.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rovtwin.identification.diagnostics.validation import Prediction, Predictor
from rovtwin.identification.joint.build import offsets_of, problem_of
from rovtwin.identification.joint.estimate import Solution, estimate
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.parameters import Parameters
from rovtwin.identification.joint.solver.options import Options
from rovtwin.identification.joint.solver.problem import Problem
from rovtwin.identification.logs.record import Record
from rovtwin.identification.structure import Progress, folds

HELD = 1e-4  # standard deviation of theta of what is not free


class CrossValidation:
    """Fits and predicts with some of the parameters free; arguments are those of `identify`."""

    def __init__(
        self,
        parameters: Parameters,
        start: Gaussian,
        records: Sequence[Record],
        anchors: Sequence[Mapping[str, Any]],
        settings: Options,
        progress: Progress,
    ):
        self.parameters, self.start, self.anchors, self.settings = parameters, start, anchors, settings
        self.progress = progress
        halves = folds(records)
        self.problems = [problem_of(parameters, start, fit, anchors, settings) for fit, _ in halves]
        window = settings.window or None  # a block as a whole, where nobody says shorter ones
        self.predictors = [Predictor(parameters, held_out, window, settings.step) for _, held_out in halves]
        self.solved: list[tuple[int, frozenset[str], Solution]] = []

    def __call__(self, free: Sequence[str], words: str) -> list[Prediction]:
        """Predictions of all blocks, each by what was fitted to the other half; errors of the sensors always are."""
        found = []
        for k, predictor in enumerate(self.predictors):
            self.progress(f"structure '{words}', half {k + 1} of {len(self.predictors)}")
            problem, solution = self._fitted(k, free)
            found += predictor(solution.unknowns.theta, offsets_of(problem, solution))
        return found

    def _fitted(self, k: int, free: Sequence[str]) -> tuple[Problem, Solution]:
        """The estimate of one half, from the solution of the largest structure below this one."""
        problem = self.problems[k].with_prior(self._held(free))
        below = [(len(names), s) for half, names, s in self.solved if half == k and names <= set(free)]
        begin = max(below, key=lambda found: found[0])[1].unknowns if below else None
        solution = estimate(problem, max_steps=self.settings.max_steps, begin=begin)
        self.solved.append((k, frozenset(free), solution))
        return problem, solution

    def _held(self, free: Sequence[str]) -> Gaussian:
        """The prior, with what is not free held at its middle."""
        rows = np.isin(self.parameters.names, list(free))
        covariance = np.where(np.outer(rows, rows), self.start.covariance, 0.0)
        return Gaussian(self.start.mean, covariance + np.diag(np.where(rows, 0.0, HELD**2)))
