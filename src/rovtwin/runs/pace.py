"""How well a loop keeps time: a histogram of lateness that stays as small however long the loop runs."""

import math
import time
from collections.abc import Callable

import numpy as np

# Steps of lateness that are counted [s]: fine to 100 ms, coarse to 10 s; later than that counts in the last.
EDGES = np.concatenate([np.arange(0.0, 0.1, 1e-4), np.arange(0.1, 10.0, 0.01)])
SLIP = 0.25  # a loop that may let time go does so when it is later than this [s]


class Clock:
    """Time since it was made [s], `speed` times as fast as the wall's; the same in other processes of this machine.

    Attributes:
        speed: 0 stands still.
    """

    def __init__(self, speed: float = 1.0):
        self.speed = speed
        self._began, self._before = time.monotonic(), 0.0

    def __call__(self) -> float:
        return self._before + (time.monotonic() - self._began) * self.speed

    def next(self, period: float) -> float:
        """Its next multiple of a period [s]: a computed vehicle takes commands at those."""
        return math.ceil(self() / period) * period

    def run(self, speed: float) -> tuple[float, float, float]:
        """Go on at another speed from now on; what a clock elsewhere has to `follow`."""
        now = time.monotonic()
        self._before += (now - self._began) * self.speed
        self._began, self.speed = now, speed
        return self._began, self._before, self.speed

    def slip(self, seconds: float) -> tuple[float, float, float]:
        """Give up so much of its time; what a clock elsewhere has to `follow`."""
        self._before -= seconds
        return self._began, self._before, self.speed

    def follow(self, pace: tuple[float, float, float]) -> None:
        """Be the clock whose `run` gave this."""
        self._began, self._before, self.speed = pace


class Pace:
    """Waits for the periods of a loop, and counts how late each began.

    Attributes:
        counts: Periods by lateness, in the steps that begin at EDGES.
        latest: Largest lateness [s].
        slipped: Time that was given up in all [s].
    """

    def __init__(self, sleep: Callable[[float], None] = time.sleep):
        self._sleep = sleep
        self.counts = np.zeros(len(EDGES), dtype=np.int64)
        self.latest = 0.0
        self.slipped = 0.0

    def wait(self, due: float, now: Callable[[], float] = time.monotonic, speed: float = 1.0) -> float:
        """Wait until `now()` is `due` [s of that clock, which runs `speed` times as fast]; how late it is [real s]."""
        while (rest := due - now()) > 0.0:
            self._sleep(rest / speed)
        late = -rest / speed
        self.counts[int(np.searchsorted(EDGES, late, side="right")) - 1] += 1
        self.latest = max(self.latest, late)
        return late

    def figures(self) -> dict[str, float]:
        """Median, 99th percentile (to the step's end) and largest lateness [ms], and time given up [s].

        Lateness is 0 where no period has begun.
        """
        ends = np.append(EDGES[1:], 10.0) if self.counts.any() else np.zeros(len(EDGES))
        share = np.cumsum(self.counts) / max(self.counts.sum(), 1) if self.counts.any() else np.ones(len(EDGES))
        half, most = (1e3 * float(ends[np.searchsorted(share, p)]) for p in (0.5, 0.99))
        return {
            "late_ms_p50": half,
            "late_ms_p99": most,
            "late_ms_max": 1e3 * self.latest,
            "slipped_s": self.slipped,
        }
