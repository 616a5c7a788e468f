"""Do stretches of the tests agree? Widths that need no perfect model.

The curvature at the maximum says how wide an estimate is if the model is exact and the noise white. Where it is not,
what stretches of time want of a parameter differs by more than that. With A the information of everything, A_k and g_k
a stretch's part in it and in the slope (starts of segments and their disturbances eliminated), and P what the prior and
static evidence know, the covariance is that of a sandwich whose middle is not taken from the model:

    V = A^-1 (sum_k h_k h_k' + P) A^-1,    h_k = R (1 - R^-1 A_k R^-T)^(-1/2) R^-1 g_k,    A = R R'

h_k is the slope that the stretch would have had it not been fitted: for an exact model E h_k h_k' = A_k, so that V is
A^-1 again. A width grows where its share of the sum is more than noise makes probable: chi squared with as many degrees
of freedom as stretches tell of the parameter, and then by Student's quantile over the normal one too, since the sum has
no more terms than that. What one stretch alone tells has one, and nothing to disagree with. No width grows beyond the
prior's, and how far the estimate has left it.
Stretches of several lengths are tried, and whole logs: nobody knows beforehand how long an error of the model lasts.

Reference: Huber (1967), White (1982), the sandwich; Liang and Zeger (1986), for clusters; Bell and McCaffrey (2002),
Bias reduction in standard errors for linear regression with multi-stage samples, Survey Methodology 28.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int, Real
from scipy.stats import chi2, norm, t

from rovtwin.identification.joint.model.nodes import NODE, Nodes
from rovtwin.identification.joint.solver.arrow import Arrow
from rovtwin.identification.joint.solver.noise import seen_motions
from rovtwin.identification.joint.solver.problem import Noise, Problem
from rovtwin.identification.joint.solver.shooting import Blocks

STRETCHES = (4, 8, 16, 32)  # so many in all: fewer say little of a spread, more are too short to outlast an error
MOTIONS = (4, 8)  # the same by how the vehicle moves
CERTAIN = 0.99  # probability that white noise spreads less than what widens an interval


def widening(
    problem: Problem,
    theta: Float[np.ndarray, " n"],
    blocks: Blocks,
    noise: Noise,
    arrow: Arrow,
    divisions: Sequence[np.ndarray],
) -> Float[np.ndarray, " n"]:
    """By how much each width is too small, f; 1 where stretches agree as well as white noise lets them.

    Args:
        problem: The readings, by segments of records.
        theta: At the maximum.
        blocks: The readings' normal equations there.
        noise: As estimated.
        arrow: The normal equations of everything there.
        divisions: See `stretches`.
    """
    n = len(problem.prior.mean)
    A = arrow.factor().corner
    slopes, information = parts(blocks, noise, arrow)
    bound = np.diag(problem.prior.covariance) + (theta - problem.prior.mean) ** 2
    widest = np.maximum(bound / np.diag(np.linalg.inv(A))[:n], 1.0)
    return np.sqrt(np.minimum(spread(slopes, information, A, divisions)[:n], widest))


def widened(covariance: Float[np.ndarray, "n n"], wider: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n n"]:
    """Covariance with widths `wider` times as large, of which no combination is known better than before.

    What comes to it is an error of its own, with the same correlations: C + F C F, F^2 = wider^2 - 1. Scaling rows and
    columns would turn what is known least (the scale of all forces, along which all of them change together) away from
    where it was, so that the next identification, with this as its prior, would take the scale as known.

    Args:
        covariance: Of an exact model.
        wider: Not below 1.
    """
    more = np.sqrt(wider**2 - 1.0)
    return covariance * (1.0 + np.outer(more, more))


def spread(
    slopes: Float[np.ndarray, "S m"],
    information: Float[np.ndarray, "S m m"],
    A: Float[np.ndarray, "m m"],
    divisions: Sequence[np.ndarray],
) -> Float[np.ndarray, " m"]:
    """What stretches make of the variances over those of an exact model, 1 where they agree.

    Args:
        slopes: Of each segment, see `parts`.
        information: Of each segment.
        A: Of everything.
        divisions: See `stretches`.
    """
    C = np.linalg.inv(A)
    known = np.einsum("ia,ab,bi->i", C, A - information.sum(axis=0), C)
    most = np.ones(len(A))
    for stretch in divisions:
        squares, expected = _squares(slopes, information, A, C, stretch)
        total = expected.sum(axis=0)
        freedom = total**2 / np.maximum(np.sum(expected**2, axis=0), 1e-300)
        more = squares.sum(axis=0) > total * chi2.ppf(CERTAIN, freedom) / freedom
        few = (t.ppf(0.975, freedom) / norm.ppf(0.975)) ** 2
        variance = few * (squares.sum(axis=0) + known) / np.diag(C)
        most = np.maximum(most, np.where(more, variance, 1.0))
    return most


def stretches(problem: Problem, nodes: Nodes) -> list[np.ndarray]:
    """Which stretch each segment is in, for every division: by logs, by time and by how the vehicle moves.

    An error of the model that comes with a motion is the same each time, whenever it is: a drag that is bent in another
    way at low speed than at high speed. Only stretches of unlike motion disagree about that. A component that nothing
    measures is the model's own and divides nothing.
    """
    counts = np.diff([*problem.segments.first, problem.segments.count])
    nu = np.asarray(nodes.nu)[:, seen_motions(problem.segments.levers)]
    return [*_by_time(counts), *_by_motion(nu, np.asarray(problem.segments.arrays["linked"]))]


def _by_time(counts: Int[np.ndarray, " logs"]) -> list[np.ndarray]:
    """Divisions of records of so many segments; none into more stretches than there are segments."""
    total, found = counts.sum(), []
    if len(counts) > 1:
        found.append(np.repeat(np.arange(len(counts)), counts))
    for count in STRETCHES:
        of_each = np.maximum(np.round(count * counts / total), 1).astype(int)
        if total < count:
            break
        before = np.cumsum([0, *of_each[:-1]])
        found.append(
            np.concatenate([b + np.arange(c) * k // c for b, c, k in zip(before, counts, of_each, strict=True)])
        )
    return found


def _by_motion(nu: Float[np.ndarray, "S k"], linked: Real[np.ndarray, " S"]) -> list[np.ndarray]:
    """Divisions by each of k components of nu (S, k) with its sign, and by its size, into equal numbers of segments."""
    middle = np.where(linked[:, None] > 0, 0.5 * (nu + np.roll(nu, -1, axis=0)), nu)
    rank = np.argsort(np.argsort(np.concatenate([middle, np.abs(middle)], axis=1), axis=0), axis=0)
    return [column * K // len(nu) for K in MOTIONS if len(nu) >= 4 * K for column in rank.T]


def parts(blocks: Blocks, noise: Noise, arrow: Arrow) -> tuple[Float[np.ndarray, "S m"], Float[np.ndarray, "S m m"]]:
    """Each segment's slope and information of [theta, offsets], the nodes eliminated."""
    S, m = arrow.b.shape[0], len(arrow.b_corner)
    n = blocks.defect_jacobian.shape[-1] - 2 * NODE
    follow = arrow.factor().follow()  # nodes as theta moves, with the others at their best
    along = np.concatenate([follow, np.broadcast_to(np.eye(m), (S, m, m))], axis=1)
    weight = noise.sigma**-2.0
    slopes = -np.einsum("g,sga,sam->sm", weight, blocks.slopes, along, optimize=True)
    information = np.swapaxes(along, 1, 2) @ np.einsum("g,sgab->sab", weight, blocks.readings) @ along
    after = np.concatenate([follow[1:], np.zeros((1, NODE, m))])
    J = blocks.defect_jacobian / noise.defect[:, None]
    moved = J[:, :, :NODE] @ follow + J[:, :, NODE + n :] @ after
    moved[:, :, :n] += J[:, :, NODE : NODE + n]
    slopes -= np.einsum("sim,si->sm", moved, blocks.defect / noise.defect)
    return slopes, information + np.swapaxes(moved, 1, 2) @ moved


def _squares(
    slopes: Float[np.ndarray, "S m"],
    information: Float[np.ndarray, "S m m"],
    A: Float[np.ndarray, "m m"],
    C: Float[np.ndarray, "m m"],
    stretch: Int[np.ndarray, " S"],
) -> tuple[Float[np.ndarray, "K m"], Float[np.ndarray, "K m"]]:
    """Squares of what each stretch wants of [theta, offsets], and what an exact model makes of them."""
    R = np.linalg.cholesky(A)
    back = np.linalg.inv(R)
    squares, expected = [], []
    for k in range(stretch.max() + 1):
        own = information[stretch == k].sum(axis=0)
        share, axes = np.linalg.eigh(back @ own @ back.T)
        slope = axes.T @ (back @ slopes[stretch == k].sum(axis=0)) / np.sqrt(np.maximum(1.0 - share, 1e-9))
        squares.append((C @ (R @ (axes @ slope))) ** 2)
        expected.append(np.einsum("ia,ab,bi->i", C, own, C))
    return np.array(squares), np.maximum(expected, 0.0)
