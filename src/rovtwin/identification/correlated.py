"""Residuals that are not white: how many of them are worth one."""

import numpy as np


def correlated(residual: np.ndarray) -> float:
    """How many neighbouring residuals count as one: 1 + 2 sum of the autocorrelation up to its first small value."""
    n = len(residual)
    x = residual - residual.mean()
    power = float(x @ x)
    if n < 10 or power == 0:
        return 1.0
    total = 1.0
    for lag in range(1, n // 4):
        r = float(x[lag:] @ x[:-lag]) / power
        if r < 2 / np.sqrt(n):
            break
        total += 2 * r
    return total
