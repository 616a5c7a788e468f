"""What an identification says, in words: the verdict on top, what its intervals assume."""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.report.identification.parameter_words import what_teaches
from rovtwin.report.parts.curves import DIRECTIONS, SPEED_UNITS, Curves
from rovtwin.report.parts.verdict import Verdict

TELLING = 1.0  # information over the prior's from which a parameter was excited
_LABELS = {
    "learnt": "Learnt",
    "partly": "Learnt in part",
    "prior only": "Known from the prior only",
    "contradicted": "Contradicted by the prior or by another log",
}
_SHOWN = 4  # findings in the box, all of them are listed below it; parameters that get a line each
PRIOR_ONLY, LEARNT = 0.9, 0.5  # standard deviation after over before, as the verdicts of the estimate


def verdict(result: Any, curves: Curves) -> Verdict:
    """The box on top: what was learnt, what not, what the forces are worth, whether it predicts."""
    count = {kind: result.verdicts.count(kind) for kind in _LABELS}
    n = len(result.verdicts)
    if result.solution is None:
        headline = f"No tests: {n} parameters predicted from what was known before"
        return Verdict(None, headline, [*result.findings], [])
    learnt = f"{count['learnt']} of {n} parameters learnt from {_minutes(result)}{result.up_to_scale}"
    sentences = [f"{label}: {_families(result, kind)}." for kind, label in _LABELS.items() if count[kind]]
    if forces := _forces(result, curves):
        sentences.append(f"Damping force at the fastest speed tested, 95 %: {forces}.")
    sentences += _held_out(result)
    sentences += [f"Finding: {text}." for text in result.findings[:_SHOWN]]
    if len(result.findings) > _SHOWN:
        more = len(result.findings) - _SHOWN
        sentences.append(f"{more} more finding{'s are' if more > 1 else ' is'} listed below.")
    standing = result.standing
    headline = standing.heading(learnt, result.doubts)
    if result.doubts:
        # A model that predicts is worth having, whatever is said against its widths.
        return Verdict(None if standing.predicts else False, headline, sentences, [])
    good = None if result.findings or count["learnt"] < n / 2 else True
    return Verdict(good, headline, sentences, [])


def _minutes(result: Any) -> str:
    fitted = [r for r in result.records if r["use"] == "fit"]
    seconds = sum(r["duration"] for r in fitted)
    text = f"{seconds / 60:.1f} minutes" if seconds >= 90 else f"{seconds:.0f} seconds"
    return f"{text} of {len(fitted)} test{'s' if len(fitted) != 1 else ''}"


def _families(result: Any, kind: str) -> str:
    names = result.parameters.names
    return in_families(names, [n for n, verdict in zip(names, result.verdicts, strict=True) if verdict == kind])


def in_families(every: Sequence[str], chosen: Sequence[str]) -> str:
    """Names of parameters by family, `all` where none is missing: `added mass (surge, sway); tether drag`."""
    whole, own = defaultdict(list), defaultdict(list)
    for name in every:
        family, where = _family(name)
        whole[family].append(where)
        if name in chosen:
            own[family].append(where)
    parts = []
    for family, places in own.items():
        all_of_them = len(places) == len(whole[family]) > 2
        parts.append(f"{family} ({'all' if all_of_them else ', '.join(places)})" if places[0] else family)
    return "; ".join(parts)


def is_coupling(name: str) -> bool:
    """Whether a parameter couples two directions: `added_mass.surge_pitch`."""
    family, _, where = name.partition(".")
    return family.removesuffix("_astern") in ("added_mass", "linear_damping", "quadratic_damping") and "_" in where


def _family(name: str) -> tuple[str, str]:
    if name.startswith("thrusters."):
        _, group, what = name.split(".")
        return f"thrust {what.replace('_', ' ')}", group.replace("_", " ")
    if name.startswith(("restoring.", "tether.", "commands.")):
        return name.replace("restoring.", "").replace(".", " ").replace("_", " "), ""
    first, _, rest = name.partition(".")
    first = f"couplings of {first}" if is_coupling(name) else first
    return first.replace("_", " "), rest.replace("_", " ")


def _forces(result: Any, curves: Curves) -> str:
    parts = []
    for i, name in enumerate(DIRECTIONS):
        if name not in result.tested:
            continue
        curve = curves.damping[name]
        k = int(np.argmax(np.abs(curve.x)))
        wide = curve.half_width[k]
        if np.isfinite(wide):
            parts.append(f"{name} ±{100 * wide:.2g} % at {abs(curve.x[k]):.2g} {SPEED_UNITS[i]}")
    return ", ".join(parts)


def _held_out(result: Any) -> list[str]:
    whole = [p for p in result.held_out if p.window is None]
    if not whole:
        return ["No test was held out, so nothing shows that the model predicts what it was not fitted to."]
    moved = [(p.scores[c], f"{c} of {p.record}") for p in whole for c in p.scores if p.excited[c]]
    if not moved:
        return ["In the held-out tests nothing moved beyond the noise: they validate nothing."]
    fits = np.array([s.fit for s, _ in moved])
    worse = [name for s, name in moved if s.rms >= naive(s)]
    text = (
        f"Held out, predicted open loop from the first state: fit {np.median(fits):.0f} % in the median of "
        f"{len(fits)} moving components ({fits.min():.0f} to {fits.max():.0f} %)"
    )
    if not worse:
        return [f"{text}; every one is better than holding the first reading or predicting rest."]
    which = ", ".join(worse) if len(worse) <= _SHOWN else f"{len(worse)} of {len(fits)} components, see below"
    return [f"{text}; no better than holding the first reading or predicting rest: {which}."]


def naive(score: Any) -> float:
    """The better of the predictors that need no model, rms."""
    return float(np.nanmin([score.hold, score.still]))


def excitation(result: Any) -> list[str]:
    """Per parameter, what the tests did for it: not moved, moved but not separable from others, informed.

    Information of the readings with all other parameters known says whether a parameter was excited at all; what is
    left of it when they are unknown too says whether it was distinguished.
    """
    n = len(result.verdicts)
    if result.solution is None:
        return ["no tests"] * n
    alone = np.diag(result.solution.information) * np.diag(result.prior.covariance)
    std = np.sqrt(np.diag(result.covariance))
    ratio = std / np.sqrt(np.diag(result.prior.covariance))
    correlation = result.covariance / np.outer(std, std) - np.eye(n)
    out = []
    for i in range(n):
        if alone[i] < TELLING:
            out.append("not excited")
        elif ratio[i] > LEARNT:
            out.append(_shared(result, i, correlation[i], float(ratio[i])))
        else:
            out.append("excited")
    return out


def _shared(result: Any, i: int, correlation: Float[np.ndarray, "n n"], ratio: float) -> str:
    """Of a parameter that was excited, but is not learnt: what it is mixed up with."""
    names = result.parameters.names
    for number, blind in enumerate(result.blind, start=1):
        if names[i] in blind.names and len(blind.names) > 1:
            return f"excited, not separable from {len(blind.names) - 1} others (direction {number} below)"
    k = int(np.argmax(np.abs(correlation)))
    if abs(correlation[k]) < 0.5:
        return "weakly excited"
    apart = "not separable" if ratio > PRIOR_ONLY else "partly separable"
    return f"excited, {apart} from {names[k]} ({correlation[k]:+.2f})"


def not_learnt(result: Any) -> list[str]:
    """What is left open, couplings aside: a line each with what teaches it, one line for all where many are alike."""
    names = [name for name in result.parameters.names if not is_coupling(name)]
    verdicts = dict(zip(result.parameters.names, result.verdicts, strict=True))
    why = dict(zip(result.parameters.names, excitation(result), strict=True))
    lines = []
    for kind in ("partly", "prior only"):
        own = [name for name in names if verdicts[name] == kind]
        if len(own) <= _SHOWN:
            lines += [f"{kind}: {name}: {why[name]}; it takes {what_teaches(name)}" for name in own]
            continue
        untested = "" if result.solution else "; no tests"
        lines.append(
            f"{kind}: {len(own)} of {len(names)} parameters: {in_families(names, own)}{untested} (why, and the "
            "test that would teach each: --json)"
        )
    return lines


def assumptions(result: Any) -> list[str]:
    """What the intervals rest on, so that a reader can judge them."""
    forces = "" if any(name.startswith("thrusters.") for name in result.parameters.names) else " and their forces"
    sentences = [
        "They are 95 % intervals of a Gaussian around the most probable values (Gauss and Newton's approximation of "
        "the curvature), in the logarithm of what must be positive: hence not symmetric.",
        "The prior counts as evidence. Where a verdict says 'prior only', the interval is the prior's own width, and "
        "it is as good as that prior.",
        "The model's form is taken as right: linear plus quadratic damping, what is not free in proportion to the "
        "diagonal, thrust curves shared within a group, still water or the stated current. A mistake of form shows as "
        "a push, as parts of the tests that disagree, which widens intervals, and as held-out tests that are predicted "
        "worse.",
        "Parameters that were not free (mass, centre of gravity, moments of inertia of the rigid body, places of the "
        f"thrusters{forces}) are taken as exact.",
        "Noise of each sensor is Gaussian and white; so is a disturbance of each direction, beside a push that fades "
        "in 5 s. Their sizes are estimated from these tests.",
    ]
    if result.residuals:
        name, worst = max(result.residuals.items(), key=lambda item: item[1].inflation)
        sentences.append(
            f"Residuals: at worst {worst.inflation:.2g} readings of {name} count as one. If that were all model error, "
            f"intervals would be {np.sqrt(worst.inflation):.2g} times as wide."
            if worst.inflation > 1.5
            else "Residuals are white enough that every reading counts as one."
        )
    return sentences
