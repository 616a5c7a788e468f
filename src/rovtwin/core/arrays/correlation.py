"""Correlated samples: how many of them count as one, and how many independent ones carry as much as a series.

The autocorrelation is summed in pairs of lags as long as their sum is positive, so that noise at long lags does not add
up: the initial positive sequence of Geyer (1992), Practical Markov Chain Monte Carlo, Statist. Sci. 7(4).
"""

import numpy as np
from jaxtyping import Float

FEWEST = 10  # samples from which anything is told
ROUNDING = 1e-12  # of a series: one that varies by less is constant


def inflation(correlation: Float[np.ndarray, " lags"]) -> float:
    """How many samples count as one, at least 1: 1 + 2 sum of the autocorrelation from lag 1 on.

    Args:
        correlation: Autocorrelation at lags 0, 1, ...; that at 0 is 1.
    """
    pairs = correlation[: 2 * (len(correlation) // 2)].reshape(-1, 2).sum(axis=1)
    positive = int(np.argmax(pairs <= 0)) if np.any(pairs <= 0) else len(pairs)
    return float(max(2.0 * pairs[: max(positive, 1)].sum() - 1.0, 1.0))


def neighbours(series: Float[np.ndarray, " n"]) -> float:
    """How many neighbours in a series count as one: 1 for white noise, and for a series too short to tell."""
    n = len(series)
    if n < FEWEST or not np.all(np.isfinite(series)):
        return 1.0
    centred = series - series.mean()
    if np.abs(centred).max() <= ROUNDING * np.abs(series).max():
        return 1.0
    spectrum = np.fft.rfft(centred, 2 * n)
    autocovariance = np.fft.irfft(spectrum * np.conj(spectrum))[:n]
    return inflation(autocovariance / autocovariance[0])


def effective_samples(series: Float[np.ndarray, " n"]) -> float:
    """Independent samples that carry as much as a correlated series."""
    return max(len(series), 1) / neighbours(series)
