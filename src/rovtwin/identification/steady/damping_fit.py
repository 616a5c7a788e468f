"""Linear and quadratic damping through pairs of steady speed and force, F = d_l v + d_q |v| v, with its uncertainty.

The two coefficients are strongly anti-correlated over the speeds of a small ROV, so that a coefficient's own interval
says little: the band of the force says what is known. Plain NumPy and SciPy, SI.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import stats
from scipy.optimize import nnls

from rovtwin.core.errors import IdentificationError

Noise = float | np.ndarray | None  # standard deviation: one, one each, or unknown
SIDES = ("ahead", "astern")
ONE_PAIR = (
    "one direction was run at one speed only: one pair of coefficients serves ahead and astern, as if they were alike"
)
ITERATIONS = 4  # of the weights, where the speeds are uncertain too


@dataclass(frozen=True, eq=False)
class DampingFit:
    """What steady speeds and forces say of damping in one direction.

    Attributes:
        coefficients: Linear [N s/m] and quadratic [N s2/m2] (N m s/rad, N m s2/rad2 in rotation), or ahead then astern.
            Positive takes energy.
        covariance: Of `coefficients`.
        rms: Of the residual force [N or N m].
        freedom: Degrees of freedom the noise was estimated with; infinite where it was declared and held.
        speeds: Smallest and largest |v| of the data, ahead then astern.
        notes: What a reader must know: terms that cannot be separated, a coefficient on its bound, noise larger than
            declared.
    """

    coefficients: Float[np.ndarray, " c"]
    covariance: Float[np.ndarray, "c c"]
    rms: float
    freedom: float
    speeds: Float[np.ndarray, "sides 2"]
    notes: tuple[str, ...] = ()

    @property
    def linear(self) -> Float[np.ndarray, "2"]:
        """Ahead and astern."""
        return np.resize(self.coefficients[0::2], 2)

    @property
    def quadratic(self) -> Float[np.ndarray, "2"]:
        """Ahead and astern."""
        return np.resize(self.coefficients[1::2], 2)

    @property
    def std(self) -> Float[np.ndarray, " c"]:
        """Standard deviations of `coefficients`."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Float[np.ndarray, "2"]:
        """Between linear and quadratic, ahead and astern."""
        std = self.std
        if not np.all(np.isfinite(std)):
            return np.full(2, np.nan)
        pairs = [self.covariance[i, i + 1] / (std[i] * std[i + 1]) for i in range(0, len(std), 2)]
        return np.resize(np.array(pairs), 2)

    def force(self, velocity: Float[np.ndarray, "*axes"]) -> Float[np.ndarray, "*axes"]:
        """Force that holds the velocities [m/s or rad/s], same shape, same sign as the velocity."""
        return _design(np.asarray(velocity, float), len(self.coefficients) == 4) @ self.coefficients

    def force_band(
        self, velocity: Float[np.ndarray, "*axes"], level: float = 0.95
    ) -> tuple[Float[np.ndarray, "*axes"], Float[np.ndarray, "*axes"]]:
        """Where the true force lies with probability `level` at each velocity: low and high, each of its shape.

        Not where the next reading lies: that has its own noise on top.
        """
        A = _design(np.asarray(velocity, float), len(self.coefficients) == 4)
        middle = A @ self.coefficients
        if not np.all(np.isfinite(self.covariance)):
            return np.full_like(middle, -np.inf), np.full_like(middle, np.inf)
        half = self.quantile(level) * np.sqrt(np.einsum("ni,ij,nj->n", A, self.covariance, A))
        return middle - half, middle + half

    def interval(self, level: float = 0.95) -> Float[np.ndarray, "c 2"]:
        """Of every coefficient by itself."""
        half = self.quantile(level) * self.std
        return np.stack([self.coefficients - half, self.coefficients + half], axis=1)

    def quantile(self, level: float) -> float:
        """Half width of an interval in standard deviations: Student's t with `freedom`."""
        return float(stats.t.ppf(0.5 + level / 2, self.freedom))


def fit_damping(
    velocity: Float[np.ndarray, " n"],
    force: Float[np.ndarray, " n"],
    *,
    sigma: Noise = None,
    sigma_velocity: Noise = None,
    nonnegative: bool = True,
    astern: bool = False,
) -> DampingFit:
    """Weighted least squares of F = d_l v + d_q |v| v through the origin.

    Errors of the velocity count with the slope of the curve (effective variance, Orear 1982, American Journal of
    Physics 50, 912). With `nonnegative`, the covariance stays that of the unconstrained fit: moving an estimate to the
    nearest point of the allowed cone takes it no further from any truth inside, so the intervals hold at least as
    often as said.

    Args:
        velocity: Steady velocities, through the water [m/s or rad/s].
        force: What held them [N or N m], same sign as the velocity for a passive body.
        sigma: Standard deviation of the forces, one or each; None estimates it from the scatter.
        sigma_velocity: Standard deviation of the velocities, one or each; only with `sigma`.
        nonnegative: Both coefficients at least zero, so that damping takes energy at every speed; False is the plain
            least squares of the thesis.
        astern: Own coefficients for v < 0; the data must have both directions.

    Raises:
        IdentificationError: Different lengths, something not finite, too few runs, or only one speed in a direction.
    """
    v, F = (np.atleast_1d(np.asarray(x, float)) for x in (velocity, force))
    _check(v, F, sigma, sigma_velocity, astern)
    A = _design(v, astern)
    if sigma is None:
        weight = np.ones(len(v))
        theta = _solve(A, F, nonnegative)
    else:
        weight, theta = _weighted(
            A,
            v,
            F,
            np.asarray(sigma, float),
            np.asarray(0.0 if sigma_velocity is None else sigma_velocity),
            nonnegative,
        )
    W = weight[:, None] * A
    # Scatter about the best unconstrained curve, so that a bound does not pass for noise.
    free = _solve(W, weight * F, False)
    left, chi2 = len(v) - A.shape[1], float(np.sum((weight * F - W @ free) ** 2))
    scale, freedom, notes = _noise(chi2, left, sigma is not None)
    covariance = scale * np.linalg.inv(W.T @ W) if np.isfinite(scale) else np.full((A.shape[1],) * 2, np.inf)
    sides = [v >= 0, v < 0] if astern else [np.ones(len(v), bool)]
    names = SIDES if astern else ("",)
    for k, (side, name) in enumerate(zip(sides, names, strict=True)):
        pair = slice(2 * k, 2 * k + 2)
        t = float(stats.t.ppf(0.975, freedom)) if np.isfinite(scale) else np.inf
        notes += _distinguished(free[pair], covariance[pair, pair], t, np.abs(v[side]), name)
        notes += _on_bound(theta[pair], free[pair], name) if nonnegative else ()
    return DampingFit(
        theta,
        covariance,
        float(np.sqrt(np.mean((F - A @ theta) ** 2))),
        freedom,
        np.array([[np.abs(v[s]).min(), np.abs(v[s]).max()] for s in sides]),
        notes,
    )


def _design(v: Float[np.ndarray, "*axes"], astern: bool) -> Float[np.ndarray, "*axes c"]:
    """One row per velocity."""
    v = np.atleast_1d(v)
    both = np.stack([v, np.abs(v) * v], axis=-1)
    if not astern:
        return both
    return np.concatenate([both * (v >= 0)[:, None], both * (v < 0)[:, None]], axis=-1)


def _check(
    v: Float[np.ndarray, " n"], F: Float[np.ndarray, " n"], sigma: Noise, sigma_velocity: Noise, astern: bool
) -> None:
    where = "damping fit"
    if v.ndim != 1 or v.shape != F.shape:
        raise IdentificationError(
            f"{where}: velocities of shape {v.shape}, forces {F.shape}; expected one each per run"
        )
    if not (np.all(np.isfinite(v)) and np.all(np.isfinite(F))):
        raise IdentificationError(f"{where}: a velocity or force is not finite; leave out runs without a steady part")
    for noise in (sigma, sigma_velocity):
        if noise is not None and np.shape(noise) not in ((), v.shape):
            raise IdentificationError(f"{where}: {np.size(noise)} sigmas for {v.size} runs; expected one, or one each")
    if sigma_velocity is not None and sigma is None:
        raise IdentificationError(f"{where}: sigma_velocity without sigma; give the noise of the forces too")
    if sigma is not None and not np.all(np.asarray(sigma) > 0):
        raise IdentificationError(f"{where}: sigma must be positive, found {sigma}")
    for side, name in zip((v > 0, v < 0), SIDES, strict=True) if astern else [(v != 0, "")]:
        speed = np.abs(v[side])
        if speed.size < 2 or np.ptp(speed) < 1e-3 * speed.max():
            raise IdentificationError(
                f"{where}: found {speed.size} run{'s' * (speed.size != 1)} {name + ' ' if name else ''}at one speed or"
                " none; linear and quadratic damping need at least two speeds that differ"
                + ("; without astern=True one pair serves both directions" if astern else "")
            )


def _solve(A: Float[np.ndarray, "n c"], F: Float[np.ndarray, " n"], nonnegative: bool) -> Float[np.ndarray, " c"]:
    return nnls(A, F)[0] if nonnegative else np.linalg.lstsq(A, F, rcond=None)[0]


def _weighted(
    A: Float[np.ndarray, "n c"],
    v: Float[np.ndarray, " n"],
    F: Float[np.ndarray, " n"],
    sigma: Float[np.ndarray, "..."],
    sigma_velocity: Float[np.ndarray, "..."],
    nonnegative: bool,
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " c"]]:
    """Weights 1/sigma of the effective variance and the coefficients, by turns."""
    slope = np.zeros(len(v))
    for _ in range(ITERATIONS):
        weight = np.broadcast_to(1 / np.sqrt(sigma**2 + (slope * sigma_velocity) ** 2), v.shape)
        theta = _solve(weight[:, None] * A, weight * F, nonnegative)
        pairs = theta.reshape(-1, 2)
        linear, quadratic = (np.where(v >= 0, pairs[0, i], pairs[-1, i]) for i in (0, 1))
        slope = linear + 2 * quadratic * np.abs(v)
    return weight, theta


def _noise(chi2: float, left: int, declared: bool) -> tuple[float, float, tuple[str, ...]]:
    """Factor on the covariance, degrees of freedom, notes."""
    if left == 0 and not declared:
        return np.inf, 1.0, ("as many runs as coefficients: the fit is exact and says nothing of its uncertainty",)
    if not declared:
        return chi2 / left, float(left), ()
    if left and stats.chi2.sf(chi2, left) < 0.01:
        ratio = np.sqrt(chi2 / left)
        note = f"residuals {ratio:.1f} times the declared noise: intervals widened by that; the curve or sigma is wrong"
        return chi2 / left, float(left), (note,)
    return 1.0, np.inf, ()


def _distinguished(
    pair: Float[np.ndarray, "2"],
    covariance: Float[np.ndarray, "2 2"],
    t: float,
    speeds: Float[np.ndarray, " n"],
    name: str,
) -> tuple[str, ...]:
    """Whether either term alone would do as well (within 95 %): then the data know only the sum of both."""
    std = np.sqrt(np.diag(covariance))
    idle = np.abs(pair) < t * std if np.all(np.isfinite(std)) else np.array([True, True])
    span = f"at {speeds.min():.3g}-{speeds.max():.3g}" + (f" {name}" if name else "")
    if np.all(idle):
        return (f"linear and quadratic damping cannot be separated: only their sum {span} is known",)
    if np.any(idle):
        term = ("linear", "quadratic")[int(np.argmax(idle))]
        return (f"{term} damping cannot be distinguished from zero {span}",)
    return ()


def _on_bound(theta: Float[np.ndarray, " c"], free: Float[np.ndarray, " c"], name: str) -> tuple[str, ...]:
    names = ("linear", "quadratic")
    return tuple(
        f"{names[i]} damping{' ' + name if name else ''} is on its bound, zero (unconstrained: {free[i]:.3g})"
        for i in (0, 1)
        if theta[i] == 0 and free[i] < 0
    )
