"""Signals of a Record on one grid, with their rates: what comparing them with each other and with a model needs.

Local linear regression with a Gaussian kernel (Fan and Gijbels 1996, Local Polynomial Modelling, ch. 2): it takes
readings at any times, gives value and rate at once, and says nothing where there are no readings. Everything that is
compared goes through the same kernel, so that its delay and damping fall out.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d
from scipy.signal import fftconvolve

from rovtwin.core.arrays.rotations import rotation_from_euler, skew, vector_of_skew
from rovtwin.identification.logs.record import Record, Signal

STEP, WIDTH = 0.02, 0.12  # of the grid, of the kernel [s]
_VANISHED = 0.1  # sum of the smaller singular values of a mean of rotations, below which it is no rotation any more


def widened(t: Float[np.ndarray, " n"], width: float = WIDTH) -> float:
    """Standard deviation of the kernel for readings at times t [s]: wider where they are rare."""
    return max(width, 1.5 * float(np.median(np.diff(t)))) if len(t) > 1 else width


def on_grid(
    t: Float[np.ndarray, " n"], value: Float[np.ndarray, "n k"], grid: Float[np.ndarray, " m"], width: float = WIDTH
) -> tuple[Float[np.ndarray, "m k"], Float[np.ndarray, "m k"]]:
    """Value and rate on an even grid; NaN where readings are missing.

    Args:
        t: Times of the readings [s].
        value: The readings.
        grid: Even times [s].
        width: Standard deviation of the kernel [s]; widened where readings are rarer.
    """
    step = float(grid[1] - grid[0])
    interval = max(float(np.median(np.diff(t))), 1e-6) if len(t) > 1 else step
    width = widened(t, width)
    reach = np.arange(-int(4 * width / step), int(4 * width / step) + 1) * step
    kernel = np.exp(-0.5 * (reach / width) ** 2)
    cell = np.round((t - grid[0]) / step).astype(int)
    inside = (cell >= 0) & (cell < len(grid))
    cell, off = cell[inside], (t - grid[0])[inside] - cell[inside] * step
    centre = value[inside].mean(axis=0) if inside.any() else np.zeros(value.shape[1])
    value = value[inside] - centre

    def spread(weight: Float[np.ndarray, " _"]) -> Float[np.ndarray, " m"]:
        return np.bincount(cell, weight, len(grid))

    one, first, second = spread(np.ones(len(cell))), spread(off), spread(off**2)

    def moments(
        zero: Float[np.ndarray, " m"], one_: Float[np.ndarray, " m"]
    ) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
        """Sums of w and w (t_i - grid point) under the kernel; the convolution flips its sign."""
        return (
            fftconvolve(zero, kernel, "same"),
            fftconvolve(one_, kernel, "same") - fftconvolve(zero, kernel * reach, "same"),
        )

    s0, s1 = moments(one, first)
    s2 = (
        fftconvolve(second, kernel, "same")
        - 2 * fftconvolve(first, kernel * reach, "same")
        + fftconvolve(one, kernel * reach**2, "same")
    )
    smooth, rate = np.full((len(grid), value.shape[1]), np.nan), np.full((len(grid), value.shape[1]), np.nan)
    determinant = s0 * s2 - s1**2
    enough = (s0 > 0.2 * kernel.sum() * min(1.0, step / interval)) & (determinant > 0.05 * s0**2 * width**2)
    for column in range(value.shape[1]):
        y0, y1 = moments(spread(value[:, column]), spread(value[:, column] * off))
        smooth[enough, column] = ((s2 * y0 - s1 * y1)[enough]) / determinant[enough] + centre[column]
        rate[enough, column] = ((s0 * y1 - s1 * y0)[enough]) / determinant[enough]
    return smooth, rate


def held(
    t: Float[np.ndarray, " n"], value: Float[np.ndarray, "n k"], grid: Float[np.ndarray, " m"]
) -> Float[np.ndarray, "m k"]:
    """Values that hold until the next, on the grid."""
    return value[np.clip(np.searchsorted(t, grid + 1e-9, side="right") - 1, 0, len(t) - 1)]


def rotation_on_grid(
    signal: Signal, grid: Float[np.ndarray, " m"], width: float = WIDTH
) -> tuple[Float[np.ndarray, "m 3 3"], Float[np.ndarray, "m 3 3"]]:
    """R_nb of an attitude on an even grid and its rate, (m, 3, 3): smoothed as matrices and made orthogonal again.

    No wrap and no singularity, whatever the angles do. The mean of matrices is R P, P symmetric: a turn at w shrinks
    it by exp(-(w width)^2 / 2). The rate is that of R alone, which does not shrink: of the mean's rate,
    R' (R P)' = S(omega) P + P', the antisymmetric part is that of (tr(P) 1 - P) omega.
    """
    entries = rotation_from_euler(signal.value).reshape(-1, 9)
    smooth, slope = (x.reshape(-1, 3, 3) for x in on_grid(signal.t, entries, grid, width))
    good = np.isfinite(smooth).all(axis=(1, 2))
    R, rate = np.full_like(smooth, np.nan), np.full_like(smooth, np.nan)
    if good.any():
        u, left, vt = np.linalg.svd(smooth[good])
        nearest = u @ vt
        # Angles that cannot be right (degrees, say) average to anything, mirrors included: those say nothing.
        nearest[(np.linalg.det(nearest) < 0) | (left[:, 1:].sum(axis=1) < _VANISHED)] = np.nan
        turned = np.swapaxes(nearest, 1, 2) @ slope[good]
        P = np.swapaxes(vt, 1, 2) @ (left[:, :, None] * vt)
        mean = 2.0 * vector_of_skew(turned)[..., None]
        omega = np.linalg.solve(left.sum(axis=1)[:, None, None] * np.eye(3) - P, mean)[..., 0]
        R[good], rate[good] = nearest, nearest @ skew(omega)
    return R, rate


def body_rates(R: Float[np.ndarray, "m 3 3"], rate: Float[np.ndarray, "m 3 3"]) -> Float[np.ndarray, "m 3"]:
    """omega [rad/s] of R_nb and its rate: S(omega) = R' R_dot."""
    return vector_of_skew(np.einsum("nji,njk->nik", R, rate))


@dataclass(frozen=True, eq=False)
class Motion:
    """A Record's signals on one grid; whatever the record lacks is None, what is missing for a while NaN.

    Attributes:
        record: Where it comes from.
        t: Even grid [s].
        width: Standard deviation of the kernel [s]; wider for a signal whose readings are rare.
    """

    record: Record
    t: Float[np.ndarray, " m"]
    width: float = WIDTH
    _known: dict[str, tuple[Float[np.ndarray, "m _"], Float[np.ndarray, "m _"]] | None] = field(default_factory=dict)

    @classmethod
    def of(cls, record: Record) -> "Motion":
        return cls(record, np.arange(record.start, record.end, STEP))

    def alike(self, *names: str) -> "Motion":
        """The same with one width for these signals, that of the rarest, so that they are smoothed alike."""
        times = [self.record.signals[name].t for name in names if name in self.record.signals]
        width = max([self.width, *(widened(t, self.width) for t in times)])
        return self if width == self.width else replace(self, width=width, _known={})

    def values(self, name: str) -> tuple[Float[np.ndarray, "m k"], Float[np.ndarray, "m k"]] | None:
        """Smoothed readings of a signal and their rates."""
        if name not in self._known:
            signal = self.record.signals.get(name)
            enough = signal is not None and len(signal.t) > 5
            self._known[name] = (
                on_grid(signal.t, signal.value, self.t, self.width) if signal is not None and enough else None
            )
        return self._known[name]

    @cached_property
    def rotation(self) -> Float[np.ndarray, "m 3 3"] | None:
        """R_nb on the grid, smoothed as matrices and made orthogonal again."""
        found = self._rotation_and_rate
        return None if found is None else found[0]

    @cached_property
    def _rotation_and_rate(self) -> tuple[Float[np.ndarray, "m 3 3"], Float[np.ndarray, "m 3 3"]] | None:
        signal = self.record.signals.get("attitude")
        return None if signal is None or len(signal.t) < 5 else rotation_on_grid(signal, self.t, self.width)

    @cached_property
    def rate_of_attitude(self) -> Float[np.ndarray, "m 3"] | None:
        """Body rates that the attitude implies [rad/s]."""
        found = self._rotation_and_rate
        if found is None:
            return None
        return body_rates(*found)

    @cached_property
    def omega(self) -> Float[np.ndarray, "m 3"] | None:
        """Body rates [rad/s]: of the gyro, else of the attitude."""
        gyro = self.values("gyro")
        return self.rate_of_attitude if gyro is None else gyro[0]

    @cached_property
    def rate_of_position(self) -> Float[np.ndarray, "m 3"] | None:
        """Body velocity that position and attitude imply [m/s]."""
        position, R = self.values("position"), self.rotation
        if position is None or R is None:
            return None
        return np.einsum("nji,nj->ni", R, position[1]) + self._lever("position")

    def _lever(self, name: str) -> Float[np.ndarray, "m 3"] | float:
        """What a place away from CO adds to the velocity there, taken off: -omega x lever."""
        lever = self.record.signals[name].lever
        if not lever.any() or self.rate_of_attitude is None:
            return 0.0
        return -np.cross(self.rate_of_attitude, lever)

    @cached_property
    def velocity(self) -> Float[np.ndarray, "m 3"] | None:
        """Body velocity of CO [m/s]: measured, else of position and attitude."""
        measured = self.values("velocity")
        if measured is None:
            return self.rate_of_position
        lever, omega = self.record.signals["velocity"].lever, self.omega
        return measured[0] - (np.cross(omega, lever) if omega is not None and lever.any() else 0.0)

    def slope(self, series: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "m k"]:
        """Rate of a series on the grid, through the same kernel; NaN next to gaps."""
        good = np.isfinite(series).all(axis=1)
        if good.sum() < 5:
            return np.full_like(series, np.nan)
        rate = on_grid(self.t[good], series[good], self.t, self.width)[1]
        rate[~good] = np.nan
        return rate

    def smooth(self, series: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "m k"]:
        """A series on the grid, through the same kernel."""
        return gaussian_filter1d(series, self.width / STEP, axis=0, mode="nearest")

    @property
    def accelerations(self) -> tuple[tuple[int, ...], Float[np.ndarray, "m a"]]:
        """Axes of nu that are measured, and their rates."""
        axes: list[int] = []
        columns = [np.empty((len(self.t), 0))]
        for first, name, series in ((0, "velocity", self.velocity), (3, "gyro", self.omega)):
            if series is None or np.isfinite(series).all(axis=1).sum() < 50:
                continue
            axes += range(first, first + 3)
            measured = self.values(name)
            at_co = measured is not None and not (name == "velocity" and self.record.signals[name].lever.any())
            columns.append(measured[1] if measured is not None and at_co else self.slope(series))
        return tuple(axes), np.concatenate(columns, axis=1)
