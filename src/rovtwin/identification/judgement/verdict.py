"""What the evidence told, and what it could not: parameters and combinations of them, in words.

The information of the readings is held against the prior: a direction in which they add less than the prior knew
already is one they cannot tell. Widths come from the sum of both.
"""

from dataclasses import dataclass

import numpy as np

from rovtwin.identification.joint.estimate import Solution
from rovtwin.identification.joint.gaussian import Gaussian
from rovtwin.identification.joint.parameters import Parameters

# Standard deviation after over before: below the first a parameter was learnt, above the second only the prior speaks.
LEARNT, PRIOR_ONLY = 0.5, 0.9
_TELLING = 1.0  # information over the prior's, below which a direction is not told by the readings
_LOADING = 0.3  # share of the largest component from which a parameter is named


@dataclass(frozen=True)
class Blind:
    """A direction that the readings cannot tell.

    Attributes:
        names: Parameters in it, the strongest first.
        weights: Their share, sign included.
        information: Of the readings over that of the prior; 0 is nothing at all.
        text: In words.
    """

    names: tuple[str, ...]
    weights: tuple[float, ...]
    information: float
    text: str


def verdicts(prior: Gaussian, solution: Solution) -> list[str]:
    """`learnt`, `partly` or `prior only`, per parameter."""
    ratio = np.sqrt(np.diag(solution.covariance) / np.diag(prior.covariance))
    return ["learnt" if r < LEARNT else "partly" if r < PRIOR_ONLY else "prior only" for r in ratio]


def blind_directions(parameters: Parameters, prior: Gaussian, solution: Solution) -> list[Blind]:
    """Combinations of parameters about which the readings say less than the prior, the blindest first."""
    L = np.linalg.cholesky(prior.covariance)
    values, vectors = np.linalg.eigh(L.T @ solution.information @ L)
    found = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value > _TELLING:
            break
        # Back to theta, in prior standard deviations: how far each parameter moves along this direction.
        moved = (L @ vector) / np.sqrt(np.diag(prior.covariance))
        found.append(_blind(parameters, moved, max(float(value), 0.0)))
    return found


def _blind(parameters: Parameters, moved: np.ndarray, information: float) -> Blind:
    order = np.argsort(-np.abs(moved))
    largest = np.abs(moved[order[0]])
    rows = [i for i in order if np.abs(moved[i]) > _LOADING * largest]
    weights = moved[rows] * np.sign(moved[rows[0]]) / largest
    names = tuple(parameters.names[i] for i in rows)
    return Blind(names, tuple(float(w) for w in weights), information, _in_words(names, weights))


def _in_words(names: tuple[str, ...], weights: np.ndarray) -> str:
    if len(names) == 1:
        return f"{said(names[0])}: the tests say nothing of it, the value is the prior's"
    scaled = {n.split(".")[0] for n in names}
    if len(names) >= 4 and np.all(weights > 0) and "thrusters" in scaled and len(scaled) >= 2:
        return (
            "the scale of all forces (thrust, added mass, damping and restoring times a common factor): motion alone "
            "cannot tell it; a bollard pull, a towing test or a known ballast can"
        )
    if len(names) == 2 and np.prod(weights) < 0 and _same_direction(names):
        kinds = " and ".join(sorted(n.split(".")[0].replace("_", " ") for n in names))
        return f"{names[0].split('.')[1]} {kinds}: only their sum at the speeds flown is known"
    signs = ", ".join(f"{said(n)} {'up' if w > 0 else 'down'}" for n, w in zip(names[:6], weights, strict=False))
    more = f" and {len(names) - 6} more" if len(names) > 6 else ""
    return f"together: {signs}{more}: only other combinations of them are known"


def _same_direction(names: tuple[str, ...]) -> bool:
    return len({n.split(".")[1] for n in names}) == 1


def said(name: str) -> str:
    """A parameter's name for a sentence: `quadratic damping, surge`."""
    first, *rest = name.split(".")
    return f"{first.replace('_', ' ')}, {' '.join(rest).replace('_', ' ')}"


def scale_width(parameters: Parameters, solution: Solution) -> float:
    """Relative standard deviation of the common scale of all forces: the mean thrust, known no better than this."""
    rows = [i for i, n in enumerate(parameters.names) if n.startswith("thrusters.") and ".force_" in n]
    if not rows:
        return 0.0
    mean = np.zeros(len(parameters))
    mean[rows] = 1.0 / len(rows)
    return float(np.sqrt(mean @ solution.covariance @ mean))
