"""Velocity from noisy, gappy positions: a smoothing spline whose noise and stiffness are estimated by likelihood.

    position ~ quintic spline with white jerk (a constant acceleration that wanders) + white noise

The spline with a penalty on the third derivative is the smoother of that process (Wahba 1978, J. R. Stat. Soc. B 40,
364; as B-splines with a penalty Eilers and Marx 1996, Statistical Science 11, 89); the ratio of penalty to noise
maximises the restricted likelihood (Wood 2011, J. R. Stat. Soc. B 73, 3). A plain difference of noisy positions has no
such uncertainty, and its noise grows with the rate of the sensor. Gaps longer than `gap` split the record: nothing is
said inside them.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy import linalg, sparse
from scipy.interpolate import BSpline

from rovtwin.core.errors import IdentificationError

DEGREE, ORDER = 5, 3  # of the spline; of the derivative that is penalised
FEWEST = 12  # readings of a stretch that is worth smoothing
SHORTEST_STEP = 0.15  # between knots [s]: an ROV does nothing faster
OUTLIER = 6.0  # robust standard deviations; Gaussian noise reaches that once in 500 million readings
STIFFNESS = (-8.0, 12.0)  # log10 of the dimensionless penalty that is searched


@dataclass(frozen=True, eq=False)
class Piece:
    """One stretch of readings without a long gap: its knots and the normal equations."""

    t: Float[np.ndarray, " n"]
    value: Float[np.ndarray, " n"]
    knots: Float[np.ndarray, " knots"]
    design: sparse.csr_array
    gram: sparse.csr_array
    penalty: sparse.csr_array
    root: sparse.csr_array

    @classmethod
    def of(cls, t: Float[np.ndarray, " n"], value: Float[np.ndarray, " n"], step: float) -> "Piece":
        cells = int((t[-1] - t[0]) / step + 1e-6) + 1
        knots = t[0] + step * (np.arange(-DEGREE, cells + DEGREE + 1) - 1e-9)  # all readings within
        design, difference = _basis(t, knots, DEGREE), _differences(cells + DEGREE, ORDER)
        # Gram matrix of the quadratic B-splines that the third derivative is made of, exact with 3 points a cell.
        at, weight = np.polynomial.legendre.leggauss(3)
        points = (np.arange(cells)[:, None] + 0.5 + at / 2).ravel()
        lower = np.arange(-(DEGREE - ORDER), cells + DEGREE - ORDER + 1.0)
        inner = _basis(points, lower, DEGREE - ORDER)
        root = _diagonals(np.sqrt(np.tile(weight / 2, cells))) @ inner @ difference
        return cls(t, value, knots, design, _product(design), _product(root), root)

    @property
    def step(self) -> float:
        return float(self.knots[1] - self.knots[0])

    def holds(self, t: Float[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
        """Which of the times lie inside."""
        return (t >= self.t[0]) & (t <= self.t[-1])

    def factor(self, stiffness: float) -> Float[np.ndarray, "bands size"]:
        """Banded Cholesky factor of the normal equations."""
        return linalg.cholesky_banded(_banded(self.gram + stiffness * self.penalty), lower=True)

    def solve(self, factor: Float[np.ndarray, "bands size"]) -> Float[np.ndarray, " size"]:
        return linalg.cho_solve_banded((factor, True), self.design.T @ self.value)

    def rows(self, t: Float[np.ndarray, " m"], derivative: int) -> sparse.csr_array:
        """What takes coefficients to the derivative at times t."""
        knots = self.knots[derivative : len(self.knots) - derivative]
        differences = _differences(len(self.knots) - DEGREE - 1, derivative)
        return _basis(t, knots, DEGREE - derivative) @ (differences * self.step**-derivative)


@dataclass(frozen=True, eq=False)
class Track:
    """A smoothed record of one component.

    Attributes:
        pieces: Stretches without long gaps.
        coefficients: Of the splines, one array each.
        factors: Banded Cholesky factors of their normal equations.
        sigma: Standard deviation of the noise, estimated [unit of the readings].
        left_out: Readings taken for outliers, or in stretches too short to smooth.
        offset: Of the values, kept apart for precision.
    """

    pieces: tuple[Piece, ...]
    coefficients: tuple[Float[np.ndarray, " _"], ...]
    factors: tuple[Float[np.ndarray, "bands _"], ...]
    sigma: float
    left_out: int
    offset: float

    @property
    def spans(self) -> list[tuple[float, float]]:
        """Start and end of each stretch in which something is said [s]."""
        return [(float(p.t[0]), float(p.t[-1])) for p in self.pieces]

    def trusted(self, t: Float[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
        """Which times lie outside of gaps, shape of t."""
        return np.any([p.holds(t) for p in self.pieces], axis=0)

    def position(self, t: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Smoothed readings at t; NaN in gaps."""
        return self._derivative(t, 0) + self.offset

    def velocity(self, t: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Rate at t; NaN in gaps."""
        return self._derivative(t, 1)

    def velocity_std(self, t: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Standard deviation of `velocity`; NaN in gaps."""
        return self._std(t, 1)

    def position_std(self, t: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Standard deviation of `position`; NaN in gaps."""
        return self._std(t, 0)

    def _std(self, t: Float[np.ndarray, " m"], order: int) -> Float[np.ndarray, " m"]:
        out = np.full(len(t), np.nan)
        for piece, factor in zip(self.pieces, self.factors, strict=True):
            inside = piece.holds(t)
            if inside.any():
                # It changes fast at the ends only, slowly between.
                edge = np.arange(min(40, len(piece.knots))) * piece.step
                grid = np.concatenate(
                    [piece.t[0] + edge, piece.t[-1] - edge, np.linspace(piece.t[0], piece.t[-1], 200)]
                )
                grid = np.unique(grid[piece.holds(grid)])
                rows = piece.rows(grid, order).toarray()
                variance = np.einsum("ij,ji->i", rows, linalg.cho_solve_banded((factor, True), rows.T))
                out[inside] = np.interp(t[inside], grid, self.sigma * np.sqrt(variance))
        return out

    def weighted_velocity(self, t: Float[np.ndarray, " m"], weight: Float[np.ndarray, " m"]) -> tuple[float, float]:
        """Sum of weight times velocity and its variance, errors at different times taken as the smoother has them.

        Args:
            t: Times outside of gaps [s].
            weight: Of each; 1/m for the mean.
        """
        total, variance = 0.0, 0.0
        for piece, c, factor in zip(self.pieces, self.coefficients, self.factors, strict=True):
            inside = piece.holds(t)
            if inside.any():
                row = piece.rows(t[inside], 1).T @ weight[inside]
                total += float(row @ c)
                variance += self.sigma**2 * float(row @ linalg.cho_solve_banded((factor, True), row))
        return total, variance

    def _derivative(self, t: Float[np.ndarray, " m"], order: int) -> Float[np.ndarray, " m"]:
        out = np.full(len(t), np.nan)
        for piece, c in zip(self.pieces, self.coefficients, strict=True):
            inside = piece.holds(t)
            if inside.any():
                out[inside] = piece.rows(t[inside], order) @ c
        return out


def smooth(
    t: Float[np.ndarray, " n"],
    value: Float[np.ndarray, " n"],
    *,
    angle: bool = False,
    gap: float | None = None,
    name: str = "record",
) -> Track:
    """Smooth one component.

    Args:
        t: Times [s], increasing.
        value: Readings.
        angle: Readings are angles [rad] that may wrap; they are unwrapped stretch by stretch.
        gap: Time between readings above which nothing is used [s]; None takes 8 median steps, at least 0.5 s.
        name: For messages.

    Raises:
        IdentificationError: Times that do not increase, values that are not finite, or too few readings.
    """
    t, value = np.asarray(t, float), np.asarray(value, float)
    if t.shape != value.shape or t.ndim != 1:
        raise IdentificationError(f"{name}: times {t.shape} and values {value.shape}; expected one value at each time")
    if len(t) < FEWEST:
        raise IdentificationError(f"{name}: found {len(t)} readings, expected at least {FEWEST} to smooth")
    if not (np.all(np.isfinite(t)) and np.all(np.isfinite(value)) and np.all(np.diff(t) > 0)):
        raise IdentificationError(f"{name}: times must increase and values be finite; leave out what is missing")
    median = float(np.median(np.diff(t)))
    longest = max(8 * median, 0.5) if gap is None else gap
    offset = float(np.median(value))
    stretches = _stretches(t, value - offset, longest, angle)
    if not stretches:
        raise IdentificationError(f"{name}: no {FEWEST} readings in a row without a gap over {longest:.2g} s")
    step = max(2 * median, SHORTEST_STEP, (t[-1] - t[0]) / 4000)
    for _ in range(4):
        pieces = [Piece.of(*one, step) for one in stretches]
        track = _fit(pieces, len(t) - sum(len(p.t) for p in pieces), offset)
        residuals = [p.value - p.design @ c for p, c in zip(track.pieces, track.coefficients, strict=True)]
        scale = 1.4826 * float(np.median(np.abs(np.concatenate(residuals))))
        # The floor: readings without noise leave only the spline's own error, which is no outlier.
        keep = [np.abs(r) <= max(OUTLIER * scale, 1e-5 * float(np.ptp(value))) for r in residuals]
        if all(k.all() for k in keep):
            break
        kept = [(s[0][k], s[1][k]) for s, k in zip(stretches, keep, strict=True)]
        stretches = [s for s in kept if len(s[0]) >= FEWEST] or stretches
    return track


def _stretches(
    t: Float[np.ndarray, " n"], value: Float[np.ndarray, " n"], gap: float, angle: bool
) -> list[tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]]:
    cuts = np.flatnonzero(np.diff(t) > gap) + 1
    parts = zip(np.split(t, cuts), np.split(value, cuts), strict=True)
    return [(a, np.unwrap(b) if angle else b) for a, b in parts if len(a) >= FEWEST]


def _fit(pieces: list[Piece], left_out: int, offset: float) -> Track:
    """Stiffness and noise of highest restricted likelihood, common to all pieces."""
    freedom = sum(len(p.t) - ORDER for p in pieces)
    floor = 1e-18 * max(1.0, max(float(np.max(np.abs(p.value))) for p in pieces)) ** 2

    def solved(log_stiffness: float) -> tuple[float, float, list[np.ndarray], list[np.ndarray]]:
        stiffness, spread, bulk = 10.0**log_stiffness, 0.0, 0.0
        factors = [p.factor(stiffness) for p in pieces]
        coefficients = [p.solve(f) for p, f in zip(pieces, factors, strict=True)]
        for p, f, c in zip(pieces, factors, coefficients, strict=True):
            spread += float(np.sum((p.value - p.design @ c) ** 2) + stiffness * np.sum((p.root @ c) ** 2))
            bulk += 2 * float(np.sum(np.log(f[0]))) - (len(c) - ORDER) * np.log(stiffness)
        variance = spread / freedom + floor
        return freedom * np.log(variance) + bulk, variance, coefficients, factors

    grid = np.linspace(*STIFFNESS, 21)
    best = grid[int(np.argmin([solved(x)[0] for x in grid]))]
    width = grid[1] - grid[0]
    low, high = max(best - width, STIFFNESS[0]), min(best + width, STIFFNESS[1])
    fine = np.linspace(low, high, 9)
    _, variance, coefficients, factors = solved(float(fine[int(np.argmin([solved(x)[0] for x in fine]))]))
    return Track(tuple(pieces), tuple(coefficients), tuple(factors), float(np.sqrt(variance)), left_out, offset)


def _basis(t: Float[np.ndarray, " m"], knots: Float[np.ndarray, " knots"], degree: int) -> sparse.csr_array:
    """B-splines at times t, shape (len(t), number of splines)."""
    return sparse.csr_array(BSpline.design_matrix(t, knots, degree))


def _differences(size: int, order: int) -> sparse.csr_array:
    """Matrix of repeated forward differences, shape (size - order, size)."""
    out = _diagonals(np.ones(size))
    for _ in range(order):
        out = out[1:] - out[:-1]
    return out


def _diagonals(values: Float[np.ndarray, " size"]) -> sparse.csr_array:
    index = np.arange(len(values))
    return sparse.csr_array((values, (index, index)))


def _product(matrix: sparse.csr_array) -> sparse.csr_array:
    """A'A."""
    return sparse.csr_array(matrix.T @ matrix)


def _banded(matrix: sparse.csr_array) -> Float[np.ndarray, "bands size"]:
    """Lower bands of a symmetric matrix as scipy.linalg keeps them."""
    entries = matrix.tocoo()
    out = np.zeros((DEGREE + 1, len(matrix.indptr) - 1))
    lower = entries.row >= entries.col
    out[(entries.row - entries.col)[lower], entries.col[lower]] = entries.data[lower]
    return out
