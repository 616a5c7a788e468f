"""A check of the estimate's widths: the posterior sampled by NUTS instead of taken as Gaussian at its top.

All unknowns are sampled, parameters, offsets and nodes, in coordinates in which the Gaussian of the estimate is round;
the noise stays as estimated. The common scale of all forces, along which the posterior is long and bent, is a
coordinate of its own. Reference: Hoffman and Gelman (2014), J. Mach. Learn. Res. 15. Needs numpyro.

Slow: every draw runs the whole test forward and back many times.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import IdentificationError
from rovtwin.core.extras import require
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Scalar
from rovtwin.identification.joint.estimate import Solution
from rovtwin.identification.joint.model.nodes import NODE, Nodes, difference, moved
from rovtwin.identification.joint.solver.problem import Problem
from rovtwin.identification.joint.solver.readings import HUBER

_DEPTH = 6  # of the trees: at most 63 steps a draw
_LARGEST = 1500  # unknowns; beyond, a dense factor and the sampler take too long


@dataclass(frozen=True, eq=False)
class Samples:
    """Draws from the posterior.

    Attributes:
        theta: The draws.
        ratio: Standard deviation of the draws over that of the estimate, per parameter.
        shift: Mean of the draws less the estimate, in standard deviations of the estimate.
        effective: Effective number of draws, per parameter.
        divergences: Of the sampler; more than a few mean that the draws are not to be trusted either.
    """

    theta: Float[np.ndarray, "count n"]
    ratio: Float[np.ndarray, " n"]
    shift: Float[np.ndarray, " n"]
    effective: Float[np.ndarray, " n"]
    divergences: int


def sample(problem: Problem, solution: Solution, count: int = 500, warm_up: int = 200, seed: int = 0) -> Samples:
    """Draws from the posterior of a solved problem.

    Raises:
        IdentificationError: numpyro is missing, or the tests are too long to be sampled.
    """
    require("numpyro", "bayes", "sampling", IdentificationError)
    from numpyro.diagnostics import effective_sample_size
    from numpyro.infer import MCMC, NUTS

    n, G, S = len(problem.prior.mean), len(problem.groups), problem.segments.count
    size = n + G + NODE * S
    if size > _LARGEST:
        raise IdentificationError(f"sampling: found {size} unknowns, expected at most {_LARGEST}; give a shorter test")
    spread = _spread(problem, solution)
    potential = _potential(problem, solution, spread)
    kernel = NUTS(potential_fn=potential, adapt_mass_matrix=False, step_size=0.3, max_tree_depth=_DEPTH)
    chain = MCMC(kernel, num_warmup=warm_up, num_samples=count, progress_bar=False)
    chain.run(jax.random.key(seed), init_params=jnp.zeros(size), extra_fields=("diverging",))
    draws = np.asarray(chain.get_samples()) @ spread.T
    theta = np.asarray(jax.vmap(_bent(problem, solution))(draws[:, :n]))
    std = np.sqrt(np.diag(solution.covariance))
    return Samples(
        theta=theta,
        ratio=theta.std(axis=0) / std,
        shift=(theta.mean(axis=0) - solution.unknowns.theta) / std,
        effective=np.array([effective_sample_size(theta[None, :, i]) for i in range(n)]),
        divergences=int(np.sum(np.asarray(chain.get_extra_fields()["diverging"]))),
    )


def _spread(problem: Problem, solution: Solution) -> Float[np.ndarray, "m m"]:
    """L with L L' the covariance of [theta, offsets, nodes] in the Gaussian of the estimate."""
    blocks = problem.blocks(solution.unknowns, solution.noise)
    arrow = problem.assembled(blocks, solution.unknowns, solution.noise)
    S, corner = problem.segments.count, arrow.corner.shape[0]
    H = np.zeros((corner + NODE * S,) * 2)
    H[:corner, :corner] = arrow.corner
    for s in range(S):
        here = slice(corner + NODE * s, corner + NODE * (s + 1))
        H[here, here] = arrow.own[s]
        H[:corner, here], H[here, :corner] = arrow.border[s].T, arrow.border[s]
        if s + 1 < S:
            there = slice(here.stop, here.stop + NODE)
            H[here, there], H[there, here] = arrow.next[s], arrow.next[s].T
    return np.linalg.inv(np.linalg.cholesky(H)).T


def _bent(problem: Problem, solution: Solution) -> Callable[[Any], Float[Array, " n"]]:
    """theta (n,) of a step (n,) from the estimate: its part along the common scale of forces follows that curve."""
    parameters, theta = problem.shooting.parameters, jnp.asarray(solution.unknowns.theta)
    along = jax.jacfwd(lambda s: parameters.scaled(theta, s))(0.0)
    weight = jnp.linalg.solve(jnp.asarray(solution.covariance), along)
    weight = weight / (weight @ along)

    def bent(step: Any) -> Float[Array, " n"]:
        s = weight @ step
        return parameters.scaled(theta + step - s * along, s)

    return bent


def _potential(problem: Problem, solution: Solution, spread: Float[np.ndarray, "m m"]) -> Any:
    """Half the sum of squares, as a function of round coordinates."""
    here, noise = solution.unknowns, solution.noise
    n, G = len(problem.prior.mean), len(problem.groups)
    sigma, defect = jnp.asarray(noise.sigma), jnp.asarray(noise.defect)
    nodes = Nodes(*(jnp.asarray(x) for x in here.nodes))
    guess = Nodes(*(jnp.asarray(x) for x in problem.guess))
    information, bent = jnp.asarray(problem.prior.information), _bent(problem, solution)
    start_information = jnp.asarray(problem.start_information(noise))

    def potential(z: Float[Array, " m"]) -> Scalar:
        x = jnp.asarray(spread) @ z
        theta, offsets = bent(x[:n]), here.offsets + x[n : n + G]
        at = jax.vmap(moved)(nodes, x[n + G :].reshape(-1, NODE))
        gaps, defects = problem.shooting.residuals(theta, offsets, at, problem.segments.arrays)
        total, group = jnp.sum((defects / defect) ** 2), 0
        for name in problem.segments.levers:  # compiled functions return dictionaries in another order
            gap = gaps[name]
            k = gap.shape[-1]
            used = problem.segments.arrays[name]["used"][..., None]
            total += jnp.sum(used * _huber(gap / sigma[group : group + k]))
            group += k
        off = theta - problem.prior.mean
        total += off @ information @ off + jnp.asarray(problem.offset_information) @ offsets**2
        starts = jax.vmap(difference)(at, guess)
        total += jnp.sum(start_information * starts**2)
        if problem.static is not None:
            total += jnp.sum(problem.static(jnp.asarray(theta)) ** 2)
        return 0.5 * total - jnp.linalg.slogdet(jax.jacfwd(bent)(x[:n]))[1]

    return potential


def _huber(r: Float[Array, "*axes"], edge: float = HUBER) -> Float[Array, "*axes"]:
    far = jnp.abs(r)
    return jnp.where(far > edge, 2.0 * edge * far - edge**2, r * r)
