"""What blocks of time say of the factors together: estimate, and a width that their disagreement may widen.

Each block gives normal equations, A_j and s_j. With a prior of covariance C the estimate is

    theta = (C^-1 + sum A_j)^-1 sum s_j

Its covariance would be the inverse if the model were exact but for white noise. Whether it is the blocks tell: the
estimate is made again without each (the delete-one jackknife), and where the spread is wider, it is reported.

Reference: Efron and Stein (1981), The jackknife estimate of variance; Liang and Zeger (1986) on correlated residuals.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

FEW = 6  # blocks below which their spread says nothing


@dataclass(frozen=True, eq=False)
class Block:
    """Normal equations of a span of time.

    Attributes:
        end: When it ended [s].
        A: Information.
        s: Right-hand side, A theta = s.
    """

    end: float
    A: Float[np.ndarray, "p p"]
    s: Float[np.ndarray, " p"]


@dataclass(frozen=True, eq=False)
class Estimated:
    """Factors from some blocks.

    Attributes:
        theta: The factors.
        covariance: Theirs, widened.
        widened: By how much the blocks' disagreement widened each standard deviation, at least 1.
        blocks: How many there were.
    """

    theta: Float[np.ndarray, " p"]
    covariance: Float[np.ndarray, "p p"]
    widened: Float[np.ndarray, " p"]
    blocks: int

    @property
    def std(self) -> Float[np.ndarray, " p"]:
        return np.sqrt(np.diag(self.covariance))


def estimated(blocks: Sequence[Block], prior: Float[np.ndarray, "p p"], fading: float = np.inf) -> Estimated:
    """The factors.

    Args:
        blocks: In order of time.
        prior: Covariance before them.
        fading: Time in which what a block says loses half of its weight, against the newest [s].
    """
    precision = np.linalg.inv(prior)
    if not blocks:
        return Estimated(np.zeros(len(prior)), prior, np.ones(len(prior)), 0)
    weight = 0.5 ** ((blocks[-1].end - np.array([block.end for block in blocks])) / fading)
    A = weight[:, None, None] * np.stack([block.A for block in blocks])
    s = weight[:, None] * np.stack([block.s for block in blocks])
    whole = precision + A.sum(axis=0)
    inverse = np.linalg.inv(whole)
    theta = inverse @ s.sum(axis=0)
    n = len(blocks)
    covariance = inverse
    if n >= FEW:
        without = np.linalg.solve(whole - A, (s.sum(axis=0) - s)[:, :, None])[:, :, 0]
        away = without - without.mean(axis=0)
        # The part of the width that is the prior's is nothing that blocks could disagree about.
        beyond = (n - 1) / n * away.T @ away - inverse @ A.sum(axis=0) @ inverse
        # As a whole, so that a difference of factors is widened, too, where each of them has the prior's width.
        size = np.sqrt(np.diag(inverse))
        values, axes = np.linalg.eigh(beyond / np.outer(size, size))
        covariance = inverse + np.outer(size, size) * ((axes * np.maximum(values, 0.0)) @ axes.T)
    return Estimated(theta, covariance, np.sqrt(np.diag(covariance) / np.diag(inverse)), n)


def marginal(
    fit: float,
    A: Float[np.ndarray, "p p"],
    s: Float[np.ndarray, " p"],
    held: Float[np.ndarray, " p"],
    prior: Float[np.ndarray, "p p"],
) -> float:
    """Logarithm of the likelihood of a record, whatever the factors are.

    Args:
        fit: The same at the factors that were held.
        A: Sum of the normal equations.
        s: The same about theta = 0.
        held: Factors at which they were linearised.
        prior: Covariance of the factors before.
    """
    precision = np.linalg.inv(prior)
    theta = np.linalg.solve(precision + A, s)
    away = theta - held
    at_best = fit + away @ (s - A @ held) - 0.5 * away @ A @ away - 0.5 * theta @ precision @ theta
    return float(at_best - 0.5 * np.linalg.slogdet(np.eye(len(A)) + prior @ A)[1])
