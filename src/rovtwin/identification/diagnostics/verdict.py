"""What the evidence showed, and what it could not: parameters and combinations of them, in words.

The information of the readings is held against the prior: a direction in which they add less than the prior knew
already is one they cannot tell. Widths come from the sum of both.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.identification.joint.estimate import Solution
from rovtwin.identification.joint.model.couplings import place_of
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.parameters import Parameters

# Standard deviation after over before: below the first a parameter was learnt, above the second only the prior speaks.
LEARNT, PRIOR_ONLY = 0.5, 0.9
COARSE = 0.03  # relative standard deviation of the scale of all forces, beyond which it is reported
_TELLING = 1.0  # information over the prior's, below which a direction is not seen by the readings
_NOTHING = 0.05  # below that they say nothing of it
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


def verdicts(prior: Gaussian, solution: Solution, contradicted: Collection[int] = ()) -> list[str]:
    """`learnt`, `partly`, `prior only` or `contradicted` (see `contradictions`), per parameter."""
    ratio = np.sqrt(np.diag(solution.covariance) / np.diag(prior.covariance))
    words = ["learnt" if r < LEARNT else "partly" if r < PRIOR_ONLY else "prior only" for r in ratio]
    return ["contradicted" if i in contradicted else word for i, word in enumerate(words)]


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


def _blind(parameters: Parameters, moved: Float[np.ndarray, " n"], information: float) -> Blind:
    order = np.argsort(-np.abs(moved))
    largest = np.abs(moved[order[0]])
    rows = [i for i in order if np.abs(moved[i]) > _LOADING * largest]
    weights = moved[rows] * np.sign(moved[rows[0]]) / largest
    names = tuple(parameters.names[i] for i in rows)
    return Blind(names, tuple(float(w) for w in weights), information, _in_words(names, weights, information))


def _in_words(names: tuple[str, ...], weights: Float[np.ndarray, " n"], information: float) -> str:
    nothing = information < _NOTHING
    if len(names) == 1:
        if nothing:
            return f"{name_in_words(names[0])}: the tests say nothing of it, the value is what was known before"
        return f"{name_in_words(names[0])}: the tests say less of it than was known before"
    if _is_scale(names, weights):
        alone = "motion alone cannot tell it; a bollard pull, a towing test or a known ballast can"
        little = "the tests say less of it than was known before"
        return "the scale of all forces (thrust, added mass, damping and restoring times a common factor): " + (
            alone if nothing else little
        )
    if _is_sum(names, weights):
        kinds = " and ".join(sorted(n.split(".")[0].replace("_", " ") for n in names))
        return f"{names[0].split('.')[1]} {kinds}: only their sum at the speeds flown is known"
    signs = ", ".join(
        f"{name_in_words(n)} {'up' if w > 0 else 'down'}" for n, w in zip(names[:6], weights, strict=False)
    )
    more = f" and {len(names) - 6} more" if len(names) > 6 else ""
    return f"together: {signs}{more}: " + (
        "only other combinations of them are known" if nothing else "known less from the tests than before"
    )


def _is_scale(names: tuple[str, ...], weights: Float[np.ndarray, " n"]) -> bool:
    """Forces of thrusters and those of the water, all up together."""
    thrust = any(n.startswith("thrusters.") and ".force_" in n for n in names)
    water = any(n.startswith(("added_mass.", "linear_damping", "quadratic_damping")) for n in names)
    own = np.array([place_of(n) is None for n in names])  # couplings give way with either sign
    return len(names) >= 4 and bool(np.all(np.asarray(weights)[own] > 0)) and thrust and water


def _is_sum(names: tuple[str, ...], weights: Float[np.ndarray, " n"]) -> bool:
    """Linear against quadratic damping of one direction, on one side; shares of couplings have units of their own."""
    kinds = {n.split(".")[0].removesuffix("_astern") for n in names}
    places = {(n.split(".")[0].endswith("_astern"), n.split(".")[1]) for n in names}
    return (
        len(names) == 2
        and not any(place_of(n) for n in names)
        and weights[0] * weights[1] < 0
        and kinds == {"linear_damping", "quadratic_damping"}
        and len(places) == 1
    )


def name_in_words(name: str) -> str:
    """A parameter's name for a sentence: `quadratic damping, surge`."""
    first, *rest = name.split(".")
    return f"{first.replace('_', ' ')}, {' '.join(rest).replace('_', ' ')}"


def scale_width(parameters: Parameters, covariance: Float[np.ndarray, "n n"]) -> float:
    """Relative standard deviation of the common scale of all forces: the mean thrust, known no better than this."""
    rows = [i for i, n in enumerate(parameters.names) if n.startswith("thrusters.") and ".force_" in n]
    if not rows:
        return 0.0
    mean = np.zeros(len(parameters))
    mean[rows] = 1.0 / len(rows)
    return float(np.sqrt(mean @ covariance @ mean))


def up_to_scale(parameters: Parameters, prior: Float[np.ndarray, "n n"], covariance: Float[np.ndarray, "n n"]) -> str:
    """What a count of parameters learnt keeps quiet about, as the end of a phrase; empty where the scale is known.

    Args:
        parameters: The free ones.
        prior: Covariance before the tests.
        covariance: After them.
    """
    before, width = scale_width(parameters, prior), scale_width(parameters, covariance)
    if width <= COARSE:
        return ""
    known = "which only the prior knows:" if width > PRIOR_ONLY * before else "known to"
    return f", up to the common scale of all forces, {known} {100 * width:.0f} %"
