"""From the top of the posterior to its middle: what the maximum misses where the posterior is no normal distribution.

Two things lead the maximum astray. Along the common scale of all forces the readings say nothing, but they say less of
added mass, relative to what it is, the smaller the scale: what is left of the total inertia when the rigid body's is
taken off. With 21 elements of M_A there is more room at small scales than the maximum sees, and it lies 0.8 % too high
where one pull of 2 % sets the scale. And damping of which the readings tell little more than an upper end has a long
tail of small values.

Reference: Tierney and Kadane (1986), JASA 81, 82 (Laplace's method for posterior means).
"""

import numpy as np

from rovtwin.identification.joint.parameters import DIRECTIONS
from rovtwin.identification.joint.problem import Problem

_H = 0.01  # of the scale: step of the difference quotient
_WEAK = 0.1  # standard deviation of a logarithm from which its skewness counts
_LINEAR = ("added_mass", "linear_damping", "quadratic_damping")  # forces grow with these values
_GRID = np.linspace(-6.0, 6.0, 601)  # standard deviations


def moved_to_the_middle(problem: Problem, theta: np.ndarray, readings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of theta.

    Args:
        problem: Its prior and static evidence, and how theta scales.
        theta: At the maximum, shape (n,).
        readings: Information that the readings give of it, shape (n, n).
    """
    theta = _along_the_scale(problem, theta, readings)
    covariance = np.linalg.inv(readings + problem.static_information(theta))
    return _without_skewness(problem, theta, 0.5 * (covariance + covariance.T))


def _along_the_scale(problem: Problem, theta: np.ndarray, readings: np.ndarray) -> np.ndarray:
    """The same motion at the mean of the scale, to first order: off the maximum by -1/2 var(s) d(log det H)/ds."""
    scaled, by_theta = problem.shooting.scaled, problem.shooting.scaled_by_theta
    direction = np.asarray(scaled(theta, _H) - scaled(theta, -_H)) / (2 * _H)
    known = direction @ problem.static_information(theta) @ direction
    if direction @ readings @ direction > known:
        return theta  # not all that should scale is free: the readings tell the scale

    def log_det(s: float) -> float:
        # The motion is the same, so that the readings' information only changes its coordinates.
        back = np.linalg.inv(np.asarray(by_theta(theta, s)))
        H = back.T @ readings @ back + problem.static_information(np.asarray(scaled(theta, s)))
        return float(np.linalg.slogdet(H)[1])

    slope = (log_det(_H) - log_det(-_H)) / (2 * _H)
    return np.asarray(scaled(theta, -0.5 * slope / known))


def _without_skewness(problem: Problem, theta: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each weakly known coefficient at the mean of its logarithm, with its spread; what goes with it follows."""
    std = np.sqrt(np.diag(covariance))
    weak = [
        i
        for i, p in enumerate(problem.shooting.parameters.free)
        if p.name.startswith(_LINEAR) and p.name.partition(".")[2] in DIRECTIONS and std[i] > _WEAK
    ]
    for i in sorted(weak, key=lambda i: -std[i]):
        variance = covariance[i, i]
        along = covariance[:, i] / variance  # the others' best values, as this one moves
        before = along @ problem.information @ along
        slope = along @ problem.information @ (theta - problem.prior.mean)
        mean, new = _moments(np.sqrt(variance), before, slope)
        theta = theta + along * mean
        covariance = covariance + np.outer(along, along) * (new - variance)
    return theta, covariance


def _moments(std: float, before: float, slope: float) -> tuple[float, float]:
    """Mean and variance, about the maximum, of the logarithm of a value of which the readings are a normal variable.

    Args:
        std: By curvature at the maximum.
        before: Information of the prior.
        slope: Of half the prior's squares at the maximum; that of the readings cancels it.
    """
    told = std**-2.0 - before
    if told <= 1e-3 * std**-2.0:
        return 0.0, std**2
    x = min(before**-0.5, 10.0 * std) * _GRID
    best = 1.0 + slope / told  # where the readings alone would have put the value, in units of the maximum's
    log_p = -0.5 * told * (np.exp(x) - best) ** 2 - 0.5 * before * x**2 - slope * x
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    mean = float(p @ x)
    return mean, float(p @ (x - mean) ** 2)
