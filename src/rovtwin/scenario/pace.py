"""How well a loop keeps time: a histogram of lateness that stays as small however long the loop runs."""

import time
from collections.abc import Callable

import numpy as np

BIN = 1e-4  # [s]
BINS = 1000  # up to 100 ms; later than that counts in the last
SLIP = 0.25  # a loop that may let time go does so when it is later than this [s]


class Clock:
    """Time since it was made [s], `speed` times as fast as the wall's; the same in other processes of this machine."""

    def __init__(self, speed: float = 1.0):
        self.speed = speed
        self._began = time.monotonic()

    def __call__(self) -> float:
        return (time.monotonic() - self._began) * self.speed


class Pace:
    """Waits for the periods of a loop, and counts how late each began.

    Attributes:
        counts: Periods by lateness, in steps of BIN, shape (BINS,).
        latest: Largest lateness [s].
        slipped: Time that was given up in all [s].
    """

    def __init__(self, sleep: Callable[[float], None] = time.sleep):
        self._sleep = sleep
        self.counts = np.zeros(BINS, dtype=np.int64)
        self.latest = 0.0
        self.slipped = 0.0

    def wait(self, due: float, now: Callable[[], float] = time.monotonic, speed: float = 1.0) -> float:
        """Wait until `now()` is `due` [s of that clock, which runs `speed` times as fast]; how late it is [real s]."""
        while (rest := due - now()) > 0.0:
            self._sleep(rest / speed)
        late = -rest / speed
        self.counts[min(int(late / BIN), BINS - 1)] += 1
        self.latest = max(self.latest, late)
        return late

    def figures(self) -> dict[str, float]:
        """Median, 99th percentile (to BIN) and largest lateness [ms], and time given up [s]."""
        share = np.cumsum(self.counts) / max(self.counts.sum(), 1)
        half, most = (1e3 * BIN * float(np.searchsorted(share, p) + 1) for p in (0.5, 0.99))
        return {
            "late_ms_p50": half,
            "late_ms_p99": most,
            "late_ms_max": 1e3 * self.latest,
            "slipped_s": self.slipped,
        }
