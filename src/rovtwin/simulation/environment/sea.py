"""The spectrum of a sea and the wave components that stand for it. NumPy on the host: done once, outside the loop.

References: Hasselmann et al. (1973), Ergänzungsheft zur Deutschen Hydrographischen Zeitschrift A8(12) (JONSWAP);
Fossen (2021), sec. 10.2; DNV-RP-C205 (2021), sec. 3.5 (spectra, spreading).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.vehicle.constants import GRAVITY

HIGHEST = 8.0  # frequency at which the spectrum is cut, in modal frequencies; 0.03 % of the energy lies beyond
_GRID = np.geomspace(0.35, HIGHEST, 20_001)  # below there is less than exp(-80)
# Places of components within their bins are irregular and always the same: a sea differs by its phases only.
_PLACES_SEED = 20


@dataclass(frozen=True)
class SeaState:
    """A sea as its spectrum: JONSWAP, which for gamma = 1 is the modified Pierson-Moskowitz spectrum.

    Attributes:
        height: H_s, significant wave height [m].
        peak_period: T_p, of the spectrum's peak [s].
        gamma: Peak enhancement, 1 to 10.
    """

    height: float
    peak_period: float
    gamma: float = 1.0

    @classmethod
    def of(cls, height: float, *, zero_crossing_period: float | None = None, peak_period: float | None = None,
           gamma: float = 1.0, where: str = "SeaState") -> "SeaState":  # fmt: skip
        """From H_s and one of the two periods, T_z or T_p.

        Args:
            height: H_s [m].
            zero_crossing_period: T_z [s], or
            peak_period: T_p [s].
            gamma: Peak enhancement.
            where: Begins the messages.

        Raises:
            ConfigError: Not exactly one period, or a sea that cannot be.
        """
        period = zero_crossing_period if peak_period is None else peak_period
        if period is None or (zero_crossing_period is not None and peak_period is not None):
            raise ConfigError(f"{where}: expected either a zero-crossing period or a peak period, and not both")
        if not 1.0 <= gamma <= 10.0:
            raise ConfigError(f"{where}: found gamma {gamma:g}, expected 1 (Pierson-Moskowitz) to 10")
        if not LOWEST_HEIGHT <= height <= HIGHEST_HEIGHT:
            raise ConfigError(
                f"{where}: found Hs {height:g} m, expected {LOWEST_HEIGHT:g} to {HIGHEST_HEIGHT:g} m; for a calm leave "
                "the waves out"
            )
        if not (np.isfinite(period) and period > 0):
            raise ConfigError(f"{where}: found a period of {period} s, expected a number above 0")
        sea = cls(height, period / (1.0 if peak_period is not None else period_ratio(gamma)), gamma)
        if not SHORTEST_PERIOD <= sea.zero_crossing_period <= LONGEST_PERIOD:
            raise ConfigError(
                f"{where}: found Tz {sea.zero_crossing_period:.3g} s, expected {SHORTEST_PERIOD:g} to "
                f"{LONGEST_PERIOD:g} s"
            )
        if sea.steepness > STEEPEST:
            raise ConfigError(
                f"{where}: Hs {height:g} m at Tz {sea.zero_crossing_period:.3g} s is {sea.steepness:.2g} steep; no sea "
                f"exceeds {STEEPEST:.2g}, waves break before. Lower the height or lengthen the period"
            )
        return sea

    @property
    def zero_crossing_period(self) -> float:
        """T_z = 2 pi sqrt(m_0 / m_2) [s]."""
        return self.peak_period * period_ratio(self.gamma)

    @property
    def steepness(self) -> float:
        """2 pi H_s / (g T_z^2): height over the length of a deep-water wave of period T_z."""
        return float(2.0 * np.pi * self.height / (GRAVITY * self.zero_crossing_period**2))

    def spectrum(self, omega: Float[np.ndarray, "*axes"]) -> Float[np.ndarray, "*axes"]:
        """S(omega) [m2 s], one-sided, of any shape like omega [rad/s]; its integral is H_s^2 / 16."""
        modal = 2.0 * np.pi / self.peak_period
        x = np.asarray(omega, dtype=float) / modal
        return self.height**2 / 16.0 / modal * _shape(x, self.gamma) / _moments(self.gamma)[0]


LOWEST_HEIGHT, HIGHEST_HEIGHT = 0.001, 30.0  # Hs [m]; some 20 m are the most that was ever measured
SHORTEST_PERIOD, LONGEST_PERIOD = 0.5, 30.0  # Tz [s]; below are ripples that capillarity shapes
STEEPEST = 1.0 / 8.0  # of any sea, by Tz; DNV-RP-C205 sec. 3.5.4 has 1/10 as what is met


def _shape(x: Float[np.ndarray, "*axes"], gamma: float) -> Float[np.ndarray, "*axes"]:
    """JONSWAP over frequency in modal frequencies, not normalised."""
    width = np.where(x <= 1.0, 0.07, 0.09)
    return x**-5.0 * np.exp(-1.25 * x**-4.0) * gamma ** np.exp(-0.5 * ((x - 1.0) / width) ** 2)


def _moments(gamma: float) -> tuple[float, float]:
    """m_0 and m_2 of `_shape` over all frequencies; beyond the grid it is x^-5."""
    shape = _shape(_GRID, gamma)
    m0, m2 = np.trapezoid(shape, _GRID), np.trapezoid(shape * _GRID**2, _GRID)
    return float(m0 + 0.25 * HIGHEST**-4), float(m2 + 0.5 * HIGHEST**-2)


def period_ratio(gamma: float) -> float:
    """T_z / T_p: 0.710 for gamma = 1, 0.777 for 3.3."""
    m0, m2 = _moments(gamma)
    return float(np.sqrt(m0 / m2))


def wavenumber(omega: Float[np.ndarray, " n"], depth: float | None) -> Float[np.ndarray, " n"]:
    """k [1/m] of waves of frequency omega [rad/s] in water of a depth [m] (None: deep): omega^2 = g k tanh(k h)."""
    deep = np.asarray(omega, dtype=float) ** 2 / GRAVITY
    if depth is None:
        return deep
    # Newton on x tanh x = deep h from above, where the function is convex: no step overshoots.
    target = deep * depth
    x = target / np.sqrt(np.tanh(target))
    for _ in range(12):
        t = np.tanh(x)
        x = x - (x * t - target) / (t + x * (1.0 - t * t))
    return x / depth


@dataclass(frozen=True)
class Components:
    """Regular waves that add up to a sea: amplitude [m], omega [rad/s], direction run to [rad]."""

    amplitude: Float[np.ndarray, " n"]
    omega: Float[np.ndarray, " n"]
    direction: Float[np.ndarray, " n"]


def components(sea: SeaState, count: int, direction: float = 0.0, spreading: float | None = None) -> Components:
    """A spectrum cut into bins, a wave of the bin's energy somewhere in each.

    Bins hold equal shares of energy and of the energy of the surface's velocity, half and half: by energy alone one
    wave would stand for the whole tail, which the water's acceleration comes from. As the places are irregular, the
    record does not repeat.

    Args:
        sea: The spectrum.
        count: Number of components.
        direction: Mean direction, run to, from north towards east [rad].
        spreading: s of cos^2s(angle) about it, within a quarter turn; None: all run the same way.
    """
    modal = 2.0 * np.pi / sea.peak_period
    omega = _GRID * modal
    energy = _cumulated(sea.spectrum(omega), omega)
    energy *= sea.height**2 / 16.0 / energy[-1] if energy[-1] > 0 else 1.0
    shape = _shape(_GRID, sea.gamma)
    by_height, by_speed = _cumulated(shape, _GRID), _cumulated(shape * _GRID**2, _GRID)
    share = 0.5 * by_height / by_height[-1] + 0.5 * by_speed / by_speed[-1]
    rng = np.random.default_rng(_PLACES_SEED)
    edges = np.interp(np.linspace(0.0, 1.0, count + 1), share, omega)
    inside = np.diff(np.interp(edges, omega, energy))
    at = np.interp((np.arange(count) + rng.uniform(size=count)) / count, share, omega)
    angle = np.zeros(count)
    if spreading is not None:
        angle = _spread_angles((rng.permutation(count) + 0.5) / count, spreading)
    return Components(np.sqrt(2.0 * inside), at, direction + angle)


def _cumulated(values: Float[np.ndarray, " n"], x: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Integral up to each x, by trapezoids."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(x))])


def _spread_angles(quantiles: Float[np.ndarray, " n"], s: float) -> Float[np.ndarray, " n"]:
    """Angles off the mean direction below which these shares of the energy run."""
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 4001)
    below = _cumulated(np.cos(angle) ** (2.0 * s), angle)
    return np.interp(quantiles, below / below[-1], angle)
