"""Whether an identification as a whole can be relied on, whatever its widths say."""

from collections.abc import Mapping, Sequence

import numpy as np

from rovtwin.identification.joint.estimate import Solution
from rovtwin.identification.joint.problem import Problem
from rovtwin.identification.judgement.validation import Prediction, judged
from rovtwin.identification.judgement.whiteness import Residuals
from rovtwin.vehicle import Vehicle

# Noise found over declared, and over how far the signal moved, beyond which the model does not describe the tests. A
# gyro of 0.002 deg/s finds an error of any model; what counts then is how much of the motion is missed.
_TOO_NOISY, _TOO_MUCH = 5.0, 0.05


def doubts_about(
    solution: Solution, problem: Problem, residuals: Mapping[str, Residuals], held_out: Sequence[Prediction]
) -> list[str]:
    """Why an estimate should not be used, one reason each; empty where nothing speaks against it."""
    reasons = []
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
