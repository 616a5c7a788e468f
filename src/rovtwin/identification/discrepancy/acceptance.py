"""Whether a learned wrench is taken: only where it predicts what was not fitted.

The tests are divided as for the ladder of structures (`structure.folds`): one half is fitted, without and with it, and
the blocks of the other are predicted in open loop over HORIZON seconds at a time, then the other way round. Places,
lengths and weights come from the fitted half alone. It is taken where the error falls by more than MARGIN and by more
than chance may make of the differences between blocks (Student's t, one-sided, `structure.SURE`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.stats import t

from rovtwin.identification.diagnostics.validation import Prediction, Predictor, judged
from rovtwin.identification.discrepancy.regression import regressed, windows_of
from rovtwin.identification.discrepancy.training import considered, refitted
from rovtwin.identification.joint.build import offsets_of, problem_of
from rovtwin.identification.joint.estimate import Solution, estimate
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.parameters import Parameters
from rovtwin.identification.joint.solver.options import Options
from rovtwin.identification.joint.solver.problem import Problem
from rovtwin.identification.logs.record import Record
from rovtwin.identification.structure import SURE, change_between, errors_of, folds
from rovtwin.vehicle.description.schema import LearnedDiscrepancy

HORIZON = 5.0  # after which a prediction starts from the readings again [s]
MARGIN = 0.05  # least decrease of the logarithm of the prediction error: a model without is simpler

Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Acceptance:
    """The comparison.

    Attributes:
        change: Of the logarithm of the rms prediction error with it, mean over blocks; negative is better, NaN where
            there was nothing to compare.
        std: Standard error of that.
        blocks: How many there were.
        errors: By component, rms error without and with it, root mean square over the blocks.
        taken: Whether it predicts better by the margin.
        block: What was learned; None where it was not taken.
        words: All that in a sentence.
    """

    change: float
    std: float
    blocks: int
    errors: dict[str, tuple[float, float]]
    taken: bool
    words: str
    block: LearnedDiscrepancy | None = field(default=None, repr=False)


def nothing_to_learn(words: str) -> Acceptance:
    """Where no comparison was made."""
    return Acceptance(float("nan"), float("nan"), 0, {}, False, f"learned wrench: {words}: left out")


def learned(
    problem: Problem, solution: Solution, anchors: Sequence[Mapping[str, Any]], settings: Options, progress: Progress
) -> tuple[Problem, Solution, Acceptance]:
    """The estimate with a learned wrench where that predicts better, else the one that was there, and the comparison.

    Args:
        problem: Of all parameters, without a learned wrench.
        solution: Of it.
        anchors: As of `identify`.
        settings: As of the estimate.
        progress: Called with words and a share from 0 to 1.

    Raises:
        IdentificationError: The tests are too short to be divided.
    """
    progress("learned wrench: what is missing", 0.0)
    block = regressed(windows_of(problem, solution.unknowns.theta))
    if block is None:
        why = "the forces that are missing follow neither velocity nor thrust by more than chance"
        return problem, solution, nothing_to_learn(why)
    parameters, records = problem.shooting.parameters, problem.segments.records
    found = compared(
        parameters, problem.prior, records, anchors, settings, lambda words, share: progress(words, 0.7 * share)
    )
    if not found.taken:
        return problem, solution, found
    progress("learned wrench, with all parameters", 0.7)
    problem, solution = refitted(problem, solution, block, anchors, settings)
    solution = considered(problem, solution, block, anchors, settings)
    return problem, solution, replace(found, block=block.model_copy(update={"reason": found.words}))


def compared(
    parameters: Parameters,
    start: Gaussian,
    records: Sequence[Record],
    anchors: Sequence[Mapping[str, Any]],
    settings: Options,
    progress: Progress,
) -> Acceptance:
    """The decision; arguments are those of `identify`, `progress` gets words and a share from 0 to 1.

    Raises:
        IdentificationError: The tests are too short to be divided.
    """
    without: list[Prediction] = []
    having: list[Prediction] = []
    halves, found = folds(records, "discrepancy", "off"), 0
    for k, (fit, held_out) in enumerate(halves):
        words = f"learned wrench, half {k + 1} of {len(halves)}"
        progress(f"{words}: without", k / len(halves))
        problem = problem_of(parameters, start, fit, anchors, settings)
        solution = estimate(problem, max_steps=settings.max_steps)
        theta = solution.unknowns.theta
        plain = Predictor(parameters, held_out, HORIZON, settings.step)(theta, offsets_of(problem, solution))
        without += plain
        progress(f"{words}: with", (k + 0.5) / len(halves))
        block = regressed(windows_of(problem, theta))
        if block is None:
            having += plain
            continue
        found += 1
        problem, solution = refitted(problem, solution, block, anchors, settings)
        predictor = Predictor(problem.shooting.parameters, held_out, HORIZON, settings.step)
        having += predictor(solution.unknowns.theta, offsets_of(problem, solution))
    if not found:
        return nothing_to_learn("neither half of the tests by itself says enough of what is missing to learn it")
    return decided(without, having)


def decided(without: Sequence[Prediction], having: Sequence[Prediction]) -> Acceptance:
    """The decision from predictions of the same blocks without and with it."""
    before, now = errors_of(without), errors_of(having)
    change, std = change_between(now, before)
    blocks = len({block for block, _ in before})
    chance = float(t.ppf(SURE, max(blocks - 1, 1))) * std
    taken = bool(change < -max(chance, MARGIN))
    if np.isfinite(change):
        times = float(np.exp(change))
        figures = f"{100.0 * (times - 1.0):+.1f} % +- {100.0 * std * times:.1f}"
        words = (
            f"learned wrench changes the error of predictions over {HORIZON:g} s by {figures} ({blocks} blocks that "
        )
        words += f"were not fitted, {100.0 * MARGIN:g} % asked for): {'taken' if taken else 'left out'}"
    else:
        words = "learned wrench makes predictions "
        words += "follow the motion where they ran away: taken" if taken else "run away: left out"
    return Acceptance(change, std, blocks, _by_component(without, having), taken, words)


def _by_component(without: Sequence[Prediction], having: Sequence[Prediction]) -> dict[str, tuple[float, float]]:
    squares: dict[str, list[tuple[float, float]]] = {}
    for a, b in zip(without, having, strict=True):
        for component in judged(a):
            squares.setdefault(component, []).append((a.scores[component].rms ** 2, b.scores[component].rms ** 2))
    means = {name: np.sqrt(np.mean(pairs, axis=0)) for name, pairs in sorted(squares.items())}
    return {name: (float(pair[0]), float(pair[1])) for name, pair in means.items()}
