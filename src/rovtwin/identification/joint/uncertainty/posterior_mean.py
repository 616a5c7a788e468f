"""From the top of the posterior to its middle: what the maximum misses where the posterior is no normal distribution.

Two things lead the maximum astray. Along the common scale of all forces the readings say nothing, but they say less of
added mass, relative to what it is, the smaller the scale: what is left of the total inertia when the rigid body's is
taken off. With 21 elements of M_A there is more room at small scales than the maximum sees, and it lies 0.8 % too high
where one pull of 2 % sets the scale. And damping of which the readings tell little more than an upper end has a long
tail of small values.

Reference: Tierney and Kadane (1986), JASA 81, 82 (Laplace's method for posterior means).
"""

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from rovtwin.identification.joint.model.couplings import place_of
from rovtwin.identification.joint.model.parameters import DIRECTIONS
from rovtwin.identification.joint.solver.problem import Problem

_REACH, _STEPS = 5.0, 81  # of the scale that is integrated over, in standard deviations; points
_WEAK = 0.1  # standard deviation of a logarithm from which its skewness counts
_LINEAR = ("added_mass", "linear_damping", "quadratic_damping")  # forces grow with these values
_GRID = np.linspace(-6.0, 6.0, 601)  # standard deviations


def moved_to_the_middle(
    problem: Problem, theta: Float[np.ndarray, " n"], readings: Float[np.ndarray, "n n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"]]:
    """Mean and covariance of theta; the maximum's where they cannot be had.

    Args:
        problem: Its prior and static evidence, and how theta scales.
        theta: At the maximum.
        readings: Information that the readings give of it.
    """
    try:
        theta, readings = _along_the_scale(problem, theta, readings)
    except np.linalg.LinAlgError:
        pass  # an added mass at the end of what it can be does not scale
    covariance = np.linalg.inv(readings + problem.static_information(theta))
    covariance = 0.5 * (covariance + covariance.T)
    shares = _shares_of_unsure_units(problem, theta, covariance)
    theta, covariance = _without_skewness(problem, theta, covariance)
    theta = theta.copy()
    for i, (mean, variance) in shares.items():
        theta[i] = mean
        grown = np.sqrt(variance / covariance[i, i])
        covariance[i] *= grown
        covariance[:, i] *= grown
    return theta, covariance


def _along_the_scale(
    problem: Problem, theta: Float[np.ndarray, " n"], readings: Float[np.ndarray, "n n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"]]:
    """The same motion at the mean of the scale, and what the readings tell of theta there.

    The posterior of the scale s is that along the curve of equal motion, times the room across it, det H^(-1/2).
    """
    tangent = np.asarray(problem.shooting.scale_tangent(theta))
    known = tangent @ problem.static_information(theta) @ tangent
    # Where not all that should scale is free, the readings tell the scale.
    measured = max(float(tangent @ readings @ tangent), 0.0)
    s = np.linspace(-_REACH, _REACH, _STEPS) / np.sqrt(known + measured)
    cost = np.array([problem.static_cost(np.asarray(problem.shooting.scaled(theta, x))) for x in s])
    # At the maximum the slope of prior and static evidence is cancelled by that of the readings.
    cost -= np.gradient(cost, s)[_STEPS // 2] * s
    log_p = -0.5 * (cost + measured * s**2 + [_log_det(problem, theta, readings, x) for x in s])
    p = np.exp(log_p - log_p.max())
    mean = float(p @ s / p.sum())
    return np.asarray(problem.shooting.scaled(theta, mean)), _carried(problem, theta, readings, mean)


def _log_det(problem: Problem, theta: Float[np.ndarray, " n"], readings: Float[np.ndarray, "n n"], s: float) -> float:
    there = np.asarray(problem.shooting.scaled(theta, s))
    return float(np.linalg.slogdet(_carried(problem, theta, readings, s) + problem.static_information(there))[1])


def _carried(
    problem: Problem, theta: Float[np.ndarray, " n"], readings: Float[np.ndarray, "n n"], s: float
) -> Float[np.ndarray, "n n"]:
    """The readings' information at another scale: the motion is the same, only the coordinates change."""
    back = np.linalg.inv(np.asarray(problem.shooting.scaled_by_theta(theta, s)))
    return back.T @ readings @ back


def _without_skewness(
    problem: Problem, theta: Float[np.ndarray, " n"], covariance: Float[np.ndarray, "n n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"]]:
    """Each weakly known coefficient at the mean of its logarithm, with its spread; what goes with it follows.

    One by one, the others giving way: of two that are known by their sum only, part of the way is left.
    """
    top, std = theta, np.sqrt(np.diag(covariance))
    weak = [
        i
        for i, p in enumerate(problem.shooting.parameters.free)
        if p.name.startswith(_LINEAR) and p.name.partition(".")[2] in DIRECTIONS and std[i] > _WEAK
    ]
    # All are judged at the maximum, where the slopes cancel; what one moved of another is not moved again.
    slope = problem.information @ (top - problem.prior.mean)
    moments = {}
    for i in weak:
        along = covariance[:, i] / covariance[i, i]  # the others' best values, as this one moves
        moments[i] = _moments(std[i], along @ problem.information @ along, along @ slope)
    for i in sorted(weak, key=lambda i: -std[i]):
        mean, variance = moments[i]
        along = covariance[:, i] / covariance[i, i]
        theta = theta + along * (top[i] + mean - theta[i])
        covariance = covariance + np.outer(along, along) * (variance - covariance[i, i])
    return theta, covariance


def _shares_of_unsure_units(
    problem: Problem, theta: Float[np.ndarray, " n"], covariance: Float[np.ndarray, "n n"]
) -> dict[int, tuple[float, float]]:
    """Mean and variance of couplings of linear damping of which the damping itself is weakly known, by their index.

    A coupling is a share c of its unit, D_ji = c sqrt(D_ii D_jj), and the readings tell D_ji. Where x = log D_ii is
    this or that, about the maximum, they tell c with the information `measured` e^x and the value e^(-x/2) times that
    at the maximum; what was known of c before is the same for all x. Averaged over x that is skewed: the variance given
    is that of the normal distribution whose 95 % interval reaches as far as the longer side's.
    """
    names = [p.name for p in problem.shooting.parameters.free]
    slope = problem.information @ (theta - problem.prior.mean)
    found = {}
    for i, name in enumerate(names):
        family, _, _ = name.partition(".")
        at = place_of(name)
        if at is None or not family.startswith("linear_damping"):
            continue
        own = f"{family}.{DIRECTIONS[at[0]]}"
        k = names.index(own) if own in names else -1
        if k < 0 or covariance[k, k] < _WEAK**2:
            continue
        along = covariance[:, k] / covariance[k, k]
        x, p = _logarithm(np.sqrt(covariance[k, k]), along @ problem.information @ along, along @ slope)
        before = problem.information[i, i]
        alone = covariance[i, i] - covariance[i, k] ** 2 / covariance[k, k]  # where D_ii is what it is
        measured = max(1.0 / alone - before, 0.0)
        total = before + measured * np.exp(x)
        seen = theta[i] * (before + measured) - before * problem.prior.mean[i]  # measured times what the readings say
        given = (np.exp(0.5 * x) * seen + before * problem.prior.mean[i]) / total
        mean = float(p @ given)
        found[i] = (mean, _longer_side(p, given, total**-0.5, mean) ** 2)
    return found


def _longer_side(
    p: Float[np.ndarray, " k"], centre: Float[np.ndarray, " k"], std: Float[np.ndarray, " k"], mean: float
) -> float:
    """Of a mixture of normal distributions: from the mean to the further end of its 95 % interval, over 1.96."""
    width = np.sqrt(p @ (std**2 + (centre - mean) ** 2))
    value = mean + width * np.linspace(-8.0, 8.0, 321)
    below = ndtr((value[:, None] - centre) / std) @ p
    low, high = np.interp([0.025, 0.975], below, value)
    return float(max(high - mean, mean - low) / 1.96)


def _moments(std: float, before: float, slope: float) -> tuple[float, float]:
    """Mean and variance, about the maximum, of the logarithm of a value; arguments as of `_logarithm`."""
    x, p = _logarithm(std, before, slope)
    mean = float(p @ x)
    return mean, float(p @ (x - mean) ** 2)


def _logarithm(std: float, before: float, slope: float) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Logarithm, about the maximum, of a value of which the readings are a normal variable: its grid and probabilities.

    Args:
        std: By curvature at the maximum.
        before: Information of the prior.
        slope: Of half the prior's squares at the maximum; that of the readings cancels it.
    """
    measured = std**-2.0 - before
    if measured <= 1e-3 * std**-2.0:
        x = std * _GRID
        p = np.exp(-0.5 * _GRID**2)
        return x, p / p.sum()
    x = min(before**-0.5, 10.0 * std) * _GRID
    best = 1.0 + slope / measured  # where the readings alone would have put the value, in units of the maximum's
    log_p = -0.5 * measured * (np.exp(x) - best) ** 2 - 0.5 * before * x**2 - slope * x
    p = np.exp(log_p - log_p.max())
    return x, p / p.sum()
