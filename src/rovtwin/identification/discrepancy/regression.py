"""Where there is something to learn: Gaussian processes of the wrench that is missing along the smoothed path.

The balance of forces (`joint/solver/equation_error.py`) gives the wrench that is missing over windows of a second.
Along each axis two processes may stand for it, of motion and of thrust; how large they are and over which lengths they
change maximises the marginal likelihood, and a process is there only where that grows by more than GAIN. Features are
averaged over a window as the wrench is. It is where the joint estimate starts from, no estimate: smoothing takes
something away.

Reference: Rasmussen and Williams (2006), Gaussian Processes for Machine Learning, ch. 5 and sec. 8.3.1 (subset of
regressors); Fine and Scheinberg (2001), J. Mach. Learn. Res. 2 (places by a pivoted Cholesky decomposition).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Scalar
from rovtwin.identification.joint.solver.problem import Problem
from rovtwin.vehicle.constants import AXES
from rovtwin.vehicle.description.learned import INPUTS, anchored_inputs, kernel_matrix, pushed, whitening
from rovtwin.vehicle.description.schema import DiscrepancyPart, LearnedDiscrepancy

GAIN = 3.0  # of the logarithm of the marginal likelihood for each part, odds of twenty to one
MOST = 12  # kernel functions of a part
FIRST = 24  # of them while lengths are looked for: with few places, inputs that matter are not found
_LEFT = 0.01  # of the prior's variance at the data, below which more places add nothing
_FEWEST = 40  # windows in which an axis was seen, below which nothing is learned along it
_MOVED = np.array([0.01] * 3 + [0.02] * 3)  # rms below which a velocity is no input [m/s, rad/s]
# Each input costs this much over its length in rms of the input: an input that explains little is left at a length over
# which nothing changes (a prior that penalises complexity: Simpson et al. 2017, Statistical Science 32).
_PENALTY = 4.0
_LENGTH = np.log(6.0)  # to begin with
_BOUNDS = (np.log(1.0), np.log(100.0))
_OUTLIER = 6.0  # robust standard deviations
_JITTER = 1e-6
_DIGITS = 6
KINDS = ("motion", "thrust")


@dataclass(frozen=True, eq=False)
class Windows:
    """The tests in W windows of k states each.

    Attributes:
        missing: Wrench that the model lacks, mean over the window [N, N m].
        seen: Whether it was seen.
        nu_r: Velocity through the water.
        tau: Wrench of the thrusters.
        able: Axes along which thrusters push.
    """

    missing: Float[np.ndarray, "W 6"]
    seen: Float[np.ndarray, "W 6"]
    nu_r: Float[np.ndarray, "W k 6"]
    tau: Float[np.ndarray, "W k 6"]
    able: Float[np.ndarray, "6"]

    @property
    def speeds(self) -> Float[np.ndarray, "6"]:
        """Typical of each component of nu_r [m/s, rad/s]."""
        return np.maximum(np.sqrt(np.mean(self.nu_r**2, axis=(0, 1))), _MOVED)

    @property
    def moved(self) -> Float[np.ndarray, "6"]:
        """Which components of nu_r moved; what is not measured stands still along the smoothed path."""
        return self.speeds > _MOVED

    @property
    def inputs(self) -> Float[np.ndarray, "W k 12"]:
        """z of all parts."""
        return np.concatenate([self.nu_r, self.tau], axis=2)

    @property
    def thrust(self) -> Float[np.ndarray, "6"]:
        """Typical of each component of the thrusters' wrench, 0 where none pushes."""
        return self.able * np.sqrt(np.mean(self.tau**2, axis=(0, 1)))


def windows_of(problem: Problem, theta: Float[np.ndarray, " n"]) -> Windows:
    """The tests of a problem, by what the model at theta lacks."""
    balance = problem.shooting.balance
    arrays = balance.arrays_of(problem.segments)
    missing, nu_r, tau = (np.asarray(x) for x in balance.missing(theta, arrays))
    configuration = np.asarray(problem.shooting.parameters.model.thrusters.configuration)
    return Windows(missing, np.asarray(arrays["used"]) > 0, nu_r, tau, pushed(configuration))


def regressed(windows: Windows) -> LearnedDiscrepancy | None:
    """What can be learned of the missing wrench, with the weights of this regression; None: nothing."""
    kinds = _kinds(windows)
    parts = [part for axis in range(6) for part in _along(windows, axis, kinds)]
    if not parts:
        return None
    return LearnedDiscrepancy.model_validate({"parts": parts, "speeds": _short(windows.speeds)})


class _Kind(NamedTuple):
    """A part as it is fitted: what has to vanish, first places, which inputs it has (1 or 0), and their rms."""

    anchored: Any
    centres: Any
    active: Any
    scale: Any

    def inverse_lengths(self, h: Any) -> Any:
        """One over the lengths, shape (12,), of its hyperparameters: logarithms of size and of lengths, (13,)."""
        return self.active * jnp.exp(-h[1:]) / self.scale


def _along(windows: Windows, axis: int, kinds: Mapping[str, _Kind]) -> list[dict[str, Any]]:
    """Parts along one axis as data of DiscrepancyPart; none where too little was seen or nothing is to be learned."""
    y, used = windows.missing[:, axis], windows.seen[:, axis]
    if used.sum() < _FEWEST:
        return []
    middle = float(np.median(y[used]))
    off = np.abs(y - middle)
    used = used & (off <= _OUTLIER * max(1.4826 * float(np.median(off[used])), 1e-9))
    y = np.where(used, y - float(np.median(y[used])), 0.0)
    size = max(float(np.std(y[used])), 1e-9)
    best, chosen = _without(y[used] / size), None
    for some in _subsets(list(kinds)):
        value, h = _fitted(y / size, windows.inputs, used, [kinds[of] for of in some])
        if value > best + GAIN * (len(some) - (0 if chosen is None else len(chosen[0]))):
            best, chosen = value, (some, h)
    if chosen is None:
        return []
    some, h = chosen
    return _parts(axis, {of: kinds[of] for of in some}, h, y[used], windows.inputs[used], size)


def _subsets(kinds: Sequence[str]) -> list[tuple[str, ...]]:
    """Each kind alone, then all of them."""
    return [(kind,) for kind in kinds] + ([tuple(kinds)] if len(kinds) > 1 else [])


def _kinds(windows: Windows) -> dict[str, _Kind]:
    """What parts there may be: none where nothing moved, none of thrust where no thruster pushed."""
    z, found = windows.inputs, {}
    for of in KINDS if windows.moved.any() else ():
        force = windows.thrust * (of == "thrust")
        pushing = force > 1e-3 * max(force.max(), 1e-9)
        if of == "thrust" and not pushing.any():
            continue
        active = np.concatenate([windows.moved, pushing]).astype(float)
        scale = np.concatenate([windows.speeds, np.where(pushing, force, 1.0)])
        anchored = anchored_inputs(of)
        centres = places(anchored, active / (np.exp(_LENGTH) * scale), z[:, z.shape[1] // 2], FIRST, 0.0)
        spare = np.repeat(centres[-1:], FIRST - len(centres), axis=0)
        found[of] = _Kind(anchored, np.concatenate([centres, spare]), active, scale)
    return found


def places(
    anchored: Float[np.ndarray, "p 12"],
    inverse: Float[np.ndarray, "12"],
    z: Float[np.ndarray, "W 12"],
    most: int = MOST,
    left: float = _LEFT,
) -> Float[np.ndarray, "p 12"]:
    """Some of the inputs z, at which kernel functions hold most of the variance at all of them.

    Args:
        anchored: Of the part.
        inverse: One over its lengths.
        z: Candidates.
        most: How many at most.
        left: Share of the variance that may be left.
    """
    rest = kernel_matrix(anchored, inverse, z, z)
    whole, chosen = max(float(np.trace(rest)), 1e-300), []
    while len(chosen) < most and np.trace(rest) > left * whole:
        i = int(np.argmax(np.diagonal(rest)))
        if rest[i, i] < _JITTER:
            break
        chosen.append(i)
        rest = rest - np.outer(rest[:, i], rest[i]) / rest[i, i]
    found = z[chosen or [0]]
    return found * (inverse > 0.0)


def _without(y: Float[np.ndarray, " W"]) -> float:
    """Logarithm of the marginal likelihood of noise alone."""
    return float(-0.5 * len(y) * (np.log(2.0 * np.pi * np.mean(y**2)) + 1.0))


def _fitted(
    y: Float[np.ndarray, " W"], z: Float[np.ndarray, "W k 12"], used: Float[np.ndarray, " W"], kinds: Sequence[_Kind]
) -> tuple[float, Float[np.ndarray, " h"]]:
    """The largest logarithm of the marginal likelihood, the prior of lengths included, and its hyperparameters."""

    def cost(h: Float[np.ndarray, " h"]) -> tuple[float, Float[np.ndarray, " h"]]:
        value, slope = _cost_and_slope(h, y, z, used.astype(float), list(kinds))
        return float(value), np.asarray(slope)

    start, bounds = [np.log(0.7)], [(np.log(0.02), 0.5)]
    for _ in kinds:
        start += [np.log(0.7)] + [_LENGTH] * INPUTS
        bounds += [(np.log(0.05), np.log(10.0))] + [_BOUNDS] * INPUTS
    found = minimize(cost, np.array(start), jac=True, bounds=bounds, method="L-BFGS-B", options={"maxiter": 60})
    return -float(found.fun), np.asarray(found.x)


def _cost(
    h: Float[Array, " h"],
    y: Float[Array, " W"],
    z: Float[Array, "W k 12"],
    used: Float[Array, " W"],
    kinds: Sequence[_Kind],
) -> Scalar:
    """Minus the logarithm of the marginal likelihood, and of the prior of lengths; `used` is 1 or 0 for each window."""
    noise, columns, prior = jnp.exp(h[0]), [], jnp.zeros(())
    for kind, own in zip(kinds, h[1:].reshape(len(kinds), 1 + INPUTS), strict=True):
        columns.append(jnp.exp(own[0]) * _features(kind, kind.inverse_lengths(own), z))
        prior = prior + _PENALTY * jnp.sum(kind.active * jnp.exp(-own[1:]))
    F = used[:, None] * jnp.concatenate(columns, axis=1) / noise
    R = jnp.linalg.cholesky(jnp.eye(F.shape[1]) + F.T @ F)
    seen = jax.scipy.linalg.solve_triangular(R, F.T @ y / noise, lower=True)
    log_det = 2.0 * jnp.sum(jnp.log(jnp.diagonal(R))) + jnp.sum(used) * jnp.log(2.0 * jnp.pi * noise**2)
    return 0.5 * (y @ y / noise**2 - seen @ seen + log_det) + prior


_cost_and_slope = jax.jit(jax.value_and_grad(_cost))


def _features(kind: _Kind, inverse: Float[Array, "12"], z: Float[Array, "W k 12"]) -> Float[Array, "W m"]:
    """Independent features of unit variance, mean over windows, of inputs."""
    anchored, c = kind.anchored, kind.centres * inverse

    def k(a: Float[Array, "_ _ 12"]) -> Float[Array, "_ _ _"]:
        far = jnp.sum((a[..., None, :] - c) ** 2, axis=-1)
        free = jnp.sum((1.0 - anchored) * (a[..., None, :] - c) ** 2, axis=-1)
        out = jnp.sum(anchored * a**2, axis=-1)[..., None] + jnp.sum(anchored * c**2, axis=-1)
        return jnp.exp(-0.5 * far) - jnp.exp(-0.5 * (free + out))

    L = jnp.linalg.cholesky(k(c) + _JITTER * jnp.eye(len(c)))
    return jax.scipy.linalg.solve_triangular(L, jnp.mean(k(z * inverse), axis=1).T, lower=True).T


def _parts(
    axis: int,
    kinds: Mapping[str, _Kind],
    h: Float[np.ndarray, " h"],
    y: Float[np.ndarray, " W"],
    z: Float[np.ndarray, "W k 12"],
    size: float,
) -> list[dict[str, Any]]:
    """Parts at their hyperparameters, with places for these lengths and the weights' distribution."""
    noise, found, features = size * float(np.exp(h[0])), [], []
    for (of, kind), own in zip(kinds.items(), h[1:].reshape(len(kinds), 1 + INPUTS), strict=True):
        anchored = kind.anchored
        inverse = np.asarray(kind.inverse_lengths(own))
        inverse = _short(np.where(own[1:] < _BOUNDS[1] - 0.1, inverse, 0.0))  # over the longest nothing changes
        centres = np.array(_short(places(anchored, np.array(inverse), z[:, z.shape[1] // 2])))
        if not np.any(np.array(inverse) * anchored):
            continue  # it changes with nothing of what has to vanish for it to: it is zero
        lengths = [None if x == 0.0 else _short(1.0 / x) for x in inverse]
        exact = np.array([0.0 if x is None else 1.0 / x for x in lengths])
        std = _short(size * float(np.exp(own[0])))
        white = whitening(anchored, exact, centres)
        k = np.mean([kernel_matrix(anchored, exact, z[:, j], centres) for j in range(z.shape[1])], axis=0)
        features.append(std * k @ white.T)
        found.append({"axis": AXES[axis], "of": of, "std": std, "lengths": lengths, "centres": centres.tolist()})
    if not found:
        return []
    F = np.concatenate(features, axis=1)
    S = np.linalg.inv(np.eye(F.shape[1]) + F.T @ F / noise**2)
    mean, first = S @ F.T @ y / noise**2, 0
    for part in found:
        m = len(part["centres"])
        rows = slice(first, first + m)
        part |= {"weights": mean[rows].tolist(), "covariance": S[rows, rows].tolist()}
        first += m
    return found


def _short(x: Any) -> Any:
    """Rounded as a file keeps it, so that what is estimated is what is read again."""
    if np.ndim(x) == 0:
        return float(f"{float(x):.{_DIGITS}g}")
    return [_short(value) for value in x]


def part_inverse_lengths(part: DiscrepancyPart) -> Float[np.ndarray, "12"]:
    """One over the lengths of a part."""
    return np.array([0.0 if length is None else 1.0 / length for length in part.lengths])
