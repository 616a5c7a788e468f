"""Where evidence contradicts itself: tests against what was known before, and logs against each other.

A narrow interval far from the prior's is no success. Either what was known before is wrong, or the log, or the form of
the model, which then bends its parameters.
"""

from collections.abc import Collection, Sequence

import numpy as np
from jaxtyping import Float

from rovtwin.identification.diagnostics.verdict import LEARNT
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.parameters import Parameter, Parameters
from rovtwin.identification.joint.uncertainty.apart import Apart

_Z = 1.96
_SHOWN = 6  # parameters that are named with their values


def outside_prior(prior: Gaussian, theta: Float[np.ndarray, " n"]) -> list[int]:
    """Parameters whose estimate lies outside the prior's own 95 % interval, the farthest first."""
    far = np.abs(theta - prior.mean) / np.sqrt(np.diag(prior.covariance))
    return [int(i) for i in np.argsort(-far) if far[i] > _Z]


def no_dead_band(parameters: Parameters, prior: Gaussian, theta: Float[np.ndarray, " n"]) -> list[int]:
    """Dead bands that the vehicle file does not state and of which the tests saw none.

    What is assumed of such a one is a positive number, whose prior cannot hold zero: below it is no contradiction.
    """
    stated, found = np.asarray(parameters.model.thrusters.dead_band), []
    for i in outside_prior(prior, theta):
        kind, _, rest = parameters.names[i].partition(".")
        group, _, what = rest.rpartition(".")
        if kind == "thrusters" and what == "dead_band" and theta[i] < prior.mean[i]:
            found += [] if stated[list(parameters.groups[group])].any() else [i]
    return found


def about_dead_bands(
    parameters: Parameters, prior: Gaussian, theta: Float[np.ndarray, " n"], covariance: Float[np.ndarray, "n n"]
) -> list[str]:
    """What the tests say of dead bands that nobody stated: less than the end of the 95 % interval."""
    ends = theta + _Z * np.sqrt(np.diag(covariance))
    rows = no_dead_band(parameters, prior, theta)
    named = [f"{parameters.names[i]} below {float(parameters.free[i].value(float(ends[i]))):.2g}" for i in rows]
    return [f"no dead band was seen (95 %; the vehicle file states none): {'; '.join(named)}"] if named else []


def contradicted(
    prior: Gaussian,
    theta: Float[np.ndarray, " n"],
    covariance: Float[np.ndarray, "n n"],
    apart: Apart | None,
    allowed: Collection[int] = (),
) -> set[int]:
    """Parameters that evidence contradicts itself about.

    Args:
        prior: What was known before.
        theta: The estimate.
        covariance: Of it.
        apart: What each log says by itself, or None.
        allowed: Those that may lie outside their prior (`no_dead_band`).

    Returns:
        Those whose estimate lies outside the prior's 95 % interval and is known to half of its width or better, and
        those of which two logs say by themselves what differs by more than their widths.
    """
    ratio = np.sqrt(np.diag(covariance) / np.diag(prior.covariance))
    narrow = {i for i in outside_prior(prior, theta) if ratio[i] < LEARNT and i not in allowed}
    return narrow | (set() if apart is None else set(apart.disagreeing()))


def about_prior(
    parameters: Parameters, prior: Gaussian, theta: Float[np.ndarray, " n"], covariance: Float[np.ndarray, "n n"]
) -> list[str]:
    """What came out beyond what was known before, both values with their 95 % intervals.

    One whose own interval reaches back to the value of before contradicts nothing.
    """
    allowed = no_dead_band(parameters, prior, theta)
    std, before = np.sqrt(np.diag(covariance)), np.sqrt(np.diag(prior.covariance))
    apart = np.abs(theta - prior.mean) > _Z * std
    rows = [i for i in outside_prior(prior, theta) if i not in allowed and apart[i]]
    if not rows:
        return []
    named = [
        f"{parameters.names[i]} {_valued(parameters.free[i], theta[i], std[i])} against "
        f"{_valued(parameters.free[i], prior.mean[i], before[i])}"
        for i in rows[:_SHOWN]
    ]
    return [
        f"outside what was known before (95 %): {'; '.join(named)}{_more(rows)}. Either the prior is wrong (say what "
        "is known with 'prior' in the evidence file), or a log is (rovtwin evidence check), or the model has no place "
        "for what the vehicle does and bends these instead"
    ]


def about_logs_apart(parameters: Parameters, apart: Apart | None) -> list[str]:
    """What two logs, each by itself, say differently."""
    found = {} if apart is None else apart.disagreeing()
    if not found or apart is None:
        return []
    named = []
    for i, pair in list(found.items())[:_SHOWN]:
        of = [f"{_valued(parameters.free[i], apart.theta[k, i], apart.std[k, i])} by {apart.names[k]}" for k in pair]
        named.append(f"{parameters.names[i]} {' and '.join(of)}")
    return [
        f"logs disagree beyond their widths (each by itself, to first order): {'; '.join(named)}{_more(list(found))}. "
        "What differed between them: clock, payload, battery, tether, water? Fit each alone to see which it is"
    ]


def _valued(p: Parameter, theta: float, std: float) -> str:
    """`17.8 N (16.1 to 19.7)`."""
    value, low, high = (float(p.value(float(theta + k * std))) for k in (0.0, -_Z, _Z))
    unit = "" if p.unit == "1" else f" {p.unit}"
    return f"{value:.3g}{unit} ({low:.3g} to {high:.3g})"


def _more(rows: Sequence[int]) -> str:
    return f"; and {len(rows) - _SHOWN} more" if len(rows) > _SHOWN else ""
