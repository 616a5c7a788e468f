"""Clocks of several recordings of one test: offset and drift, from the motion that both saw.

Cross-correlation of what both know (body rates, speed, depth rate) finds the offset to a few samples, least squares
refines offset and drift to a fraction of one:

    a(t) ~ b((t - offset) / (1 + drift)),    t on the clock of a

Reference: Knapp and Carter (1976), The generalized correlation method for estimation of time delay, IEEE Trans. ASSP
24:320, for the first step; the covariance of the second is inflated by the correlation of its residuals.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.signal import correlate

from rovtwin.core.arrays.correlation import inflation
from rovtwin.core.errors import IdentificationError
from rovtwin.identification.logs.motion import body_rates, on_grid, rotation_on_grid
from rovtwin.identification.logs.record import Signal

STEP = 0.02
OVERLAP = 0.3  # of the shorter recording: the least that must be common
AGREE = 0.6  # correlation below which two recordings are not of the same motion


@dataclass(frozen=True)
class ClockFit:
    """t_reference = t (1 + drift) + offset.

    Attributes:
        offset: [s].
        drift: Relative; zero where it is not three of its standard deviations.
        offset_std: In the middle of the recording [s].
        drift_std: Relative.
        correlation: Of what both saw, once aligned.
        by: What was compared: body rates, speed, depth rate.
    """

    offset: float
    drift: float
    offset_std: float
    drift_std: float
    correlation: float
    by: str

    def __str__(self) -> str:
        return (
            f"clock: offset {self.offset:.4f} s, known to {1e3 * self.offset_std:.1f} ms, drift "
            f"{1e6 * self.drift:.0f} ppm (known to {1e6 * self.drift_std:.0f} ppm), by {self.by}, "
            f"correlation {self.correlation:.2f}"
        )


def signatures(signals: dict[str, Signal]) -> dict[str, tuple[Float[np.ndarray, " _"], Float[np.ndarray, "_ _"]]]:
    """What a recording knows of the motion that another may know too: times and values, by what it is."""
    found = {}
    if "gyro" in signals:
        found["body rates"] = (signals["gyro"].t, signals["gyro"].value)
    elif "attitude" in signals:
        found["body rates"] = _rates_of(signals["attitude"])
    if "velocity" in signals:
        s = signals["velocity"]
        found["speed"] = (s.t, np.linalg.norm(s.value, axis=1, keepdims=True))
    elif "position" in signals:
        t, rate = _rate(signals["position"].t, signals["position"].value)
        found["speed"] = (t, np.linalg.norm(rate, axis=1, keepdims=True))
    if "depth" in signals:
        found["depth rate"] = _rate(signals["depth"].t, signals["depth"].value)
    elif "position" in signals:
        found["depth rate"] = _rate(signals["position"].t, signals["position"].value[:, 2:])
    return {name: (t, value) for name, (t, value) in found.items() if len(t) > 20}


def _rate(
    t: Float[np.ndarray, " n"], value: Float[np.ndarray, "n k"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m k"]]:
    grid = np.arange(t[0], t[-1], STEP)
    rate = on_grid(t, value, grid)[1]
    good = np.isfinite(rate).all(axis=1)
    return grid[good], rate[good]


def _rates_of(attitude: Signal) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m 3"]]:
    grid = np.arange(attitude.t[0], attitude.t[-1], STEP)
    rate = body_rates(*rotation_on_grid(attitude, grid))
    good = np.isfinite(rate).all(axis=1)
    return grid[good], rate[good]


def align(reference: dict[str, Signal], other: dict[str, Signal], where: str, agree: float = AGREE) -> ClockFit:
    """The clock of `other` on that of `reference`; they must correlate by `agree` at the best offset.

    Raises:
        IdentificationError: They have nothing in common, or what they have does not agree.
    """
    ours, theirs = signatures(reference), signatures(other)
    common = [name for name in ("body rates", "speed", "depth rate") if name in ours and name in theirs]
    if not common:
        raise IdentificationError(
            f"{where}: clock: estimate: nothing in common: the first file has {', '.join(ours) or 'nothing'}, this one "
            f"{', '.join(theirs) or 'nothing'}. Give clock: {{offset: .., drift: ..}}"
        )
    fits = [align_series(*ours[name], *theirs[name], name) for name in common]
    best = max(fits, key=lambda fit: fit.correlation)
    if best.correlation < agree:
        raise IdentificationError(
            f"{where}: clock: estimate: the files do not agree on {best.by} at any offset (correlation "
            f"{best.correlation:.2f}, expected {agree} or more). Are they of the same test, and are the frames right?"
        )
    return best


def align_series(
    t_a: Float[np.ndarray, " n"],
    a: Float[np.ndarray, "n k"],
    t_b: Float[np.ndarray, " m"],
    b: Float[np.ndarray, "m k"],
    by: str = "",
) -> ClockFit:
    """The clock of b on that of a, from the same k quantities seen by both."""
    grid_a, grid_b = np.arange(t_a[0], t_a[-1], STEP), np.arange(t_b[0], t_b[-1], STEP)
    smooth_a, smooth_b = on_grid(t_a, a, grid_a)[0], on_grid(t_b, b, grid_b)[0]
    offset = float(grid_a[0] - grid_b[0]) + _coarse(_centred(smooth_a), _centred(smooth_b))
    return _refined(grid_a, smooth_a, grid_b, smooth_b, offset, by)


def _centred(x: Float[np.ndarray, "*axes"]) -> Float[np.ndarray, "*axes"]:
    x = x - np.nanmean(x, axis=0)
    return np.where(np.isfinite(x), x, 0.0)


def _coarse(a: Float[np.ndarray, "n k"], b: Float[np.ndarray, "m k"]) -> float:
    """Lag of b behind the start of a at the largest correlation [s], among lags that leave enough in common."""
    product = sum(correlate(a[:, k], b[:, k], "full", "fft") for k in range(a.shape[1]))
    common = correlate(np.ones(len(a)), np.ones(len(b)), "full", "fft")
    energy_a = correlate((a**2).sum(axis=1), np.ones(len(b)), "full", "fft")
    energy_b = correlate(np.ones(len(a)), (b**2).sum(axis=1), "full", "fft")
    energy = np.sqrt(np.maximum(energy_a, 0) * np.maximum(energy_b, 0))
    # A short overlap agrees by chance: it must hold a fair share of the motion, too.
    enough = (common > OVERLAP * min(len(a), len(b))) & (energy > 0.1 * energy.max())
    return float(np.argmax(np.where(enough, product / np.maximum(energy, 1e-12), -1.0)) - (len(b) - 1)) * STEP


def _refined(
    t_a: Float[np.ndarray, " n"],
    a: Float[np.ndarray, "n k"],
    t_b: Float[np.ndarray, " m"],
    b: Float[np.ndarray, "m k"],
    offset: float,
    by: str,
) -> ClockFit:
    """Gauss-Newton on offset and drift, both about the middle of b."""
    rate_b = np.gradient(b, STEP, axis=0)
    middle, shift, drift = 0.5 * (t_b[0] + t_b[-1]), offset, 0.0
    scale = np.nanstd(a, axis=0) + 1e-12
    J, e, seen = np.empty((0, 2)), np.empty(0), np.empty((0, 0))
    for with_drift in (False, False, True, True, True, True):
        # Where on b's clock each sample of a lies.
        at = middle + (t_a - middle - shift) / (1.0 + drift)
        inside = (at > t_b[0]) & (at < t_b[-1])
        there = np.stack([np.interp(at[inside], t_b, column) for column in b.T], axis=1)
        slope = np.stack([np.interp(at[inside], t_b, column) for column in rate_b.T], axis=1)
        difference = (a[inside] - there) / scale
        good = np.isfinite(difference).all(axis=1) & np.isfinite(slope).all(axis=1)
        e = difference[good].ravel()
        weight = 1.0 / (1.0 + (e / (3.0 * np.median(np.abs(e)) + 1e-9)) ** 2)
        d_shift = (slope[good] / scale).ravel()
        d_drift = d_shift * np.repeat(at[inside][good] - middle, a.shape[1])
        J, seen = np.stack([d_shift, d_drift], axis=1), there[good]
        free = J if with_drift else J[:, :1]
        step = -np.linalg.solve(
            free.T @ (weight[:, None] * free) + 1e-12 * np.eye(free.shape[1]), free.T @ (weight * e)
        )
        shift += float(np.clip(step[0], -0.2, 0.2))
        drift += float(np.clip(step[1], -1e-3, 1e-3)) if with_drift else 0.0
    return _summed_up(J, e, seen, a, (shift, drift, middle), by)


def _summed_up(
    J: Float[np.ndarray, "rows 2"],
    e: Float[np.ndarray, " rows"],
    seen: Float[np.ndarray, "m k"],
    a: Float[np.ndarray, "n k"],
    found: tuple[float, float, float],
    by: str,
) -> ClockFit:
    shift, drift, middle = found
    k = a.shape[1]
    rows = e.reshape(-1, k)
    # Smoothing correlates the residuals: fewer of them count.
    lags = range(min(200, len(rows) // 4))
    power = float((rows**2).sum())
    rho = np.array([float((rows[lag:] * rows[: len(rows) - lag]).sum()) / power for lag in lags])
    covariance = np.linalg.inv(J.T @ J + 1e-12 * np.eye(2)) * power / max(len(e) - 2, 1) * inflation(rho)
    drift_std = float(np.sqrt(covariance[1, 1]))
    if abs(drift) < 3.0 * drift_std:
        drift = 0.0
    scale = np.nanstd(a, axis=0) + 1e-12
    there, here = (seen / scale).ravel(), (seen / scale + rows).ravel()
    correlation = float(np.corrcoef(there, here)[0, 1])
    # t_a = middle + shift + (t_b - middle)(1 + drift)
    offset = shift - middle * drift
    return ClockFit(offset, drift, float(np.sqrt(covariance[0, 0])), drift_std, correlation, by)
