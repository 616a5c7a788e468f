"""Cross-validation of structures: one half of the tests is fitted, the other predicted, then the other way round.

All parameters are in the program that is compiled, once for each half; those that are not free are held by a prior of
next to no width. An estimate begins where the one of the structure below it ended.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rovtwin.identification.joint.build import offsets_of, problem_of
from rovtwin.identification.joint.estimate import Solution, estimate
from rovtwin.identification.joint.gaussian import Gaussian
from rovtwin.identification.joint.options import Options
from rovtwin.identification.joint.parameters import Parameters
from rovtwin.identification.judgement.validation import Prediction, Predictor
from rovtwin.identification.logs.record import Record
from rovtwin.identification.structure import Progress, folds

HELD = 1e-4  # standard deviation of theta of what is not free
STEPS = 25  # of Gauss and Newton at most: the rest is worth less than the structures differ by


class CrossValidation:
    """Fits and predicts with some of the parameters free.

    Args are those of `identify`; `told` is called with words for who waits.
    """

    def __init__(
        self,
        parameters: Parameters,
        start: Gaussian,
        records: Sequence[Record],
        anchors: Sequence[Mapping[str, Any]],
        settings: Options,
        told: Progress,
    ):
        self.names, self.start, self.told = parameters.names, start, told
        halves = folds(records)
        self.anchors, self.settings = anchors, settings
        self.parameters, self.fitted = parameters, [fit for fit, _ in halves]
        self.problems = [problem_of(parameters, start, fit, anchors, settings) for fit, _ in halves]
        window = settings.window or None  # a block as a whole, where nobody says shorter ones
        self.predictors = [Predictor(parameters, held_out, window, settings.step) for _, held_out in halves]
        self.solved: list[tuple[int, frozenset[str], Solution]] = []

    def __call__(self, free: Sequence[str], words: str) -> list[Prediction]:
        """Predictions of all blocks, each by what was fitted to the other half; errors of the sensors always are."""
        found = []
        for k, predictor in enumerate(self.predictors):
            self.told(f"structure '{words}', half {k + 1} of {len(self.predictors)}")
            problem, solution = self._fitted(k, free)
            found += predictor(solution.unknowns.theta, offsets_of(problem, solution))
        return found

    def _fitted(self, k: int, free: Sequence[str]) -> tuple[Any, Solution]:
        known = self._held(free)
        problem = problem_of(
            self.parameters, known, self.fitted[k], self.anchors, self.settings, self.problems[k].shooting
        )
        below = [(len(names), s) for half, names, s in self.solved if half == k and names <= set(free)]
        begin = max(below, key=lambda found: found[0])[1] if below else None
        begun = None if begin is None else (begin.unknowns, begin.noise)
        solution = estimate(problem, max_steps=STEPS, begin=begun)
        self.solved.append((k, frozenset(free), solution))
        return problem, solution

    def _held(self, free: Sequence[str]) -> Gaussian:
        """The prior, with what is not free held at its middle."""
        rows = np.isin(self.names, list(free))
        covariance = np.where(np.outer(rows, rows), self.start.covariance, 0.0)
        return Gaussian(self.start.mean, covariance + np.diag(np.where(rows, 0.0, HELD**2)))
