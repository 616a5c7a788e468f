"""Curves that are correlated in time, skewed, and unlike in their scale: what bands have to do with."""

import numpy as np

SAMPLES = 300


def walks(rng: np.random.Generator, count: int, memory: float = 0.98) -> np.ndarray:
    """Shape (count, SAMPLES)."""
    noise = rng.standard_normal((count, SAMPLES))
    curves = np.empty_like(noise)
    curves[:, 0] = noise[:, 0]
    for k in range(1, SAMPLES):
        curves[:, k] = memory * curves[:, k - 1] + np.sqrt(1 - memory**2) * noise[:, k]
    return np.exp(0.5 * curves) * np.exp(0.3 * rng.standard_normal((count, 1)))
