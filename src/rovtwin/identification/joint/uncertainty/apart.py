"""What each log says of the parameters by itself, to first order: one step from the maximum with the others left out.

With A the information of everything at the maximum, A_k and g_k a log's part in it and in the slope (starts of segments
and their disturbances eliminated, see `agreement`), the log alone, with the same prior, would be fitted by

    theta_k = theta - (A - sum_(j != k) A_j)^-1 sum_(j != k) g_j

Its width is that of the curvature, times what stretches within the logs disagree by about their own log's estimate.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import norm

from rovtwin.identification.joint.solver.arrow import Arrow
from rovtwin.identification.joint.solver.problem import Noise, Problem
from rovtwin.identification.joint.solver.shooting import Blocks
from rovtwin.identification.joint.uncertainty.agreement import parts, spread

_FARTHEST = 3.0  # standard deviations of the prior; beyond that one step says nothing
_CHANCE = 0.0027  # that logs which agree differ by more, by any two of them: three standard deviations of two


@dataclass(frozen=True, eq=False)
class Apart:
    """Estimates of K logs, each by itself.

    Attributes:
        names: Of the logs.
        theta: The estimates.
        std: Standard deviation of each with the prior.
        difference_std: Of the difference of two.
        difference_covariance: Of that; None where only the widths are known.
    """

    names: tuple[str, ...]
    theta: Float[np.ndarray, "K n"]
    std: Float[np.ndarray, "K n"]
    difference_std: Float[np.ndarray, "K K n"]
    difference_covariance: Float[np.ndarray, "K K n n"] | None = None

    def gaps(self) -> Float[np.ndarray, "K K n"]:
        """Differences of two over their widths."""
        return np.abs(self.theta[:, None] - self.theta[None]) / np.maximum(self.difference_std, 1e-12)

    def disagreeing(self) -> dict[int, tuple[int, int]]:
        """Parameters on which two logs disagree beyond their widths, and the two that do most."""
        K, found = len(self.names), {}
        limit = float(norm.isf(0.5 * _CHANCE / max(K * (K - 1) / 2, 1)))
        gap = self.gaps()
        for i in range(self.theta.shape[1]):
            a, b = np.unravel_index(int(np.argmax(gap[:, :, i])), (K, K))
            if gap[a, b, i] > limit:
                found[i] = (int(min(a, b)), int(max(a, b)))
        return found


def logs_apart(
    problem: Problem,
    theta: Float[np.ndarray, " n"],
    blocks: Blocks,
    noise: Noise,
    arrow: Arrow,
    divisions: Sequence[Int[np.ndarray, " S"]],
) -> Apart | None:
    """Of every log by itself; None where there is one log. Arguments as for `agreement.widening`."""
    counts = np.diff([*problem.segments.first, problem.segments.count])
    if len(counts) < 2:
        return None
    names = tuple(record.name for record in problem.segments.records)
    log = np.repeat(np.arange(len(counts)), counts)
    return _each_alone(names, log, problem, theta, blocks, noise, arrow, divisions[1:])


def halves_apart(
    problem: Problem,
    theta: Float[np.ndarray, " n"],
    blocks: Blocks,
    noise: Noise,
    arrow: Arrow,
    divisions: Sequence[Int[np.ndarray, " S"]],
) -> Apart | None:
    """Of the first and the second half of a single log; None where there are several, or it is too short."""
    count = problem.segments.count
    if len(problem.segments.first) > 1 or not divisions:
        return None
    half = np.arange(count) * 2 // count
    return _each_alone(("first half", "second half"), half, problem, theta, blocks, noise, arrow, divisions)


def _each_alone(
    names: tuple[str, ...],
    log: Int[np.ndarray, " S"],
    problem: Problem,
    theta: Float[np.ndarray, " n"],
    blocks: Blocks,
    noise: Noise,
    arrow: Arrow,
    divisions: Sequence[Int[np.ndarray, " S"]],
) -> Apart:
    """Of each part of the tests by itself; `log` says to which one a segment belongs."""
    n, K = len(theta), len(names)
    slopes, information = parts(blocks, noise, arrow)
    A = arrow.factor().corner
    own = np.array([information[log == k].sum(axis=0) for k in range(K)])
    slope = np.array([slopes[log == k].sum(axis=0) for k in range(K)])
    prior = A - own.sum(axis=0)
    C = np.linalg.inv(prior + own)
    steps = -np.einsum("kab,kb->ka", C, slope.sum(axis=0) - slope)
    about_own = slopes - np.einsum("sab,sb->sa", information, steps[log])
    wider = spread(about_own, information, A, divisions)[:n]
    noise_only = (C @ own @ C)[:, :n, :n]
    lent = C[:, None] - C[None]  # how differently two logs lean on the prior that they share
    leaning = (lent @ prior @ np.swapaxes(lent, -1, -2))[:, :, :n, :n]
    covariance = (noise_only[:, None] + noise_only[None] + leaning) * np.sqrt(np.outer(wider, wider))
    reach = _FARTHEST * problem.width
    std = np.sqrt(np.minimum(np.diagonal(C, axis1=1, axis2=2)[:, :n] * wider, problem.width**2))
    difference_std = np.sqrt(np.maximum(np.diagonal(covariance, axis1=2, axis2=3), 0.0))
    return Apart(names, theta + np.clip(steps[:, :n], -reach, reach), std, difference_std, covariance)
