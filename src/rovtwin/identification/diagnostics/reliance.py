"""Whether an identification as a whole can be relied on, whatever its widths say."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rovtwin.identification.diagnostics.validation import Prediction, judged
from rovtwin.identification.diagnostics.whiteness import Residuals
from rovtwin.identification.joint.estimate import Solution
from rovtwin.identification.joint.solver.problem import Problem
from rovtwin.vehicle import Vehicle

# Noise found over declared, and over how far the signal moved, beyond which the model does not describe the tests. A
# gyro of 0.002 deg/s finds an error of any model; what counts then is how much of the motion is missed.
_TOO_NOISY, _TOO_MUCH = 5.0, 0.05
_SHORTEST = 10.0  # [s] of all tests together, below which their starts explain what the parameters should

_PREDICTS = 0.7  # error of held-out predictions over that of the better reference, below which a model is worth having


@dataclass(frozen=True)
class Standing:
    """What a result is worth, in figures that tell a good one from a weak one.

    Attributes:
        learnt: Parameters whose verdict is learnt.
        contradicted: Those whose verdict is that.
        count: All of them.
        error: Of held-out predictions over that of the better of two that need no model (hold the first reading,
            expect no motion), rms, in the median of the components by which a model is judged; NaN where there is none.
        better: Of these components, in how many it is smaller.
        judged: How many there are.
        doubted: Whether something speaks against using the result.
        settled: Whether the estimate has.
    """

    learnt: int
    contradicted: int
    count: int
    error: float
    better: int
    judged: int
    doubted: bool
    settled: bool

    @property
    def predicts(self) -> bool:
        """Whether held-out tests are predicted clearly better than without a model, in most components."""
        return self.settled and self.error < _PREDICTS and 2 * self.better > self.judged

    @property
    def grade(self) -> str:
        """`sound`; `not validated`; `predicts, with reservations`; or `not to be relied on`."""
        if not self.doubted:
            return "sound" if self.predicts else "not validated"
        return "predicts, with reservations" if self.predicts else "not to be relied on"

    @property
    def prediction(self) -> str:
        """Held-out prediction against the references, in words."""
        if not self.judged:
            return "nothing was held out that moved"
        return (
            f"held-out error {self.error:.2g} times that of the better of 'held' and 'none' (median), smaller in "
            f"{self.better} of {self.judged} components"
        )

    def heading(self, learnt: str, doubts: Sequence[str]) -> str:
        """One line for the top of a report: grade, what was learnt (in the caller's words), prediction, reasons."""
        against = f", {self.contradicted} contradicted" if self.contradicted else ""
        text = f"{learnt}{against}; {self.prediction}"
        if not self.doubted:
            return text if self.predicts else f"Not validated: {text}"
        grade = "Predicts, but not to be relied on beyond that" if self.predicts else "Not to be relied on"
        return f"{grade}: {text}. Against it: {'; '.join(doubts)}"


def standing(verdicts: Sequence[str], held_out: Sequence[Prediction], doubts: Sequence[str], settled: bool) -> Standing:
    """Of a result, from its verdicts and its predictions of whole held-out tests from their first state."""
    scores = [p.scores[c] for p in held_out if p.window is None for c in judged(p)]
    ratios = [s.rms / max(float(np.nanmin([s.hold, s.still])), 1e-12) for s in scores]
    return Standing(
        learnt=list(verdicts).count("learnt"),
        contradicted=list(verdicts).count("contradicted"),
        count=len(verdicts),
        error=float(np.median(ratios)) if ratios else float("nan"),
        better=sum(r < 1.0 for r in ratios),
        judged=len(ratios),
        doubted=bool(doubts),
        settled=settled,
    )


def doubts_about(
    solution: Solution, problem: Problem, residuals: Mapping[str, Residuals], held_out: Sequence[Prediction]
) -> list[str]:
    """Why an estimate should not be used, one reason each; empty where nothing speaks against it."""
    reasons = []
    lasted = sum(record.duration for record in problem.segments.records)
    if lasted < _SHORTEST:
        reasons.append(
            f"the fitted tests last {lasted:.1f} s in all, expected at least {_SHORTEST:.0f} s: if a flight ended "
            "early, see why in its summary, and fly it again"
        )
    if not solution.converged:
        reasons.append("the estimate has not settled, so no width means anything")
    noisy = [
        name
        for name, (found, declared, moved) in _noise(solution, problem, residuals).items()
        if found > max(_TOO_NOISY * declared, _TOO_MUCH * moved)
    ]
    if noisy:
        missed = f"the model misses {', '.join(noisy)} by more than {_TOO_NOISY:g} times the declared noise"
        reasons.append(f"{missed}, and by more than {100 * _TOO_MUCH:g} % of how far the signal moved")
    # Rates and velocities where there are any: positions and headings drift in open loop, however good the model.
    fits = [p.scores[c].fit for p in held_out if p.window is None for c in judged(p)]
    if fits and np.median(fits) < 0:
        reasons.append(
            "it predicts held-out tests worse than their mean does (where the end of a log is a test of its own, hold "
            "out another run: --validate LOG)"
        )
    return reasons


def doubts_of_prior(old: Vehicle | None) -> list[str]:
    """What was said against an earlier identification: it holds of all that starts from it."""
    return [] if old is None else [f"its prior {old.where}: {doubt}" for doubt in old.doubts]


def _noise(
    solution: Solution, problem: Problem, residuals: Mapping[str, Residuals]
) -> dict[str, tuple[float, float, float]]:
    """Noise found and declared, and standard deviation of the readings, by component, where noise was declared."""
    found, segments = solution.noise.sigma, problem.segments
    out = {}
    for g, (signal, i) in enumerate(segments.groups):
        name = [n for n in residuals if n.startswith(f"{signal}.")][i]
        if np.isfinite(segments.sigma[signal][i]):
            values = [r.signals[signal].value[:, i] for r in segments.records if signal in r.signals]
            moved = float(np.std(np.concatenate(values))) if values else 0.0
            out[name] = (float(found[g]), float(segments.sigma[signal][i]), moved)
    return out
