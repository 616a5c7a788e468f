"""What so many missions show of the share that succeeds: exact, by Clopper and Pearson (1934), for few missions too."""

import math

from scipy.stats import beta, binomtest

LEVEL = 0.95


def share_interval(hits: int, of: int) -> tuple[float, float]:
    """95 % interval of a share by Clopper and Pearson (1934): never too narrow, also when none or all were hits."""
    interval = binomtest(hits, of).proportion_ci(LEVEL, method="exact")
    return float(interval.low), float(interval.high)


def at_least(hits: int, of: int) -> float:
    """The share that is exceeded with 95 % confidence, one-sided: 0.861 with 20 hits of 20, 0.05 ** (1 / 20)."""
    return 0.0 if hits == 0 else float(beta.ppf(1.0 - LEVEL, hits, of - hits + 1))


def needed(share: float) -> int:
    """How many missions, all of them hits, show a share below 1 with 95 % confidence: 299 for 0.99."""
    return math.ceil(math.log(1.0 - LEVEL) / math.log(share))
