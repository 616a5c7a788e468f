"""Times since the vehicle's boot on the host's clock."""

import math

# Where the vehicle's time and ours run faster than real, these are real seconds all the same: the way takes real time.
WINDOW = 10.0  # the shortest delay of so many seconds counts [s]
SLEW = 0.05  # the offset moves by no more than this share of the time that passes: readings keep their order
JUMP = 1.0  # a delay that differs by more is no delay: a clock was set, or the vehicle booted anew [s]


class BootClock:
    """Offset between the two clocks: the smallest arrival time less boot time of late, taken up slowly.

    What arrives at once shows the offset but for the shortest delay of the line (some milliseconds on a tether), by
    which all readings are late. Both clocks run `speed` times as fast as real time.
    """

    def __init__(self, speed: float = 1.0) -> None:
        self._speed = speed
        self._offset = math.nan
        self._last = -math.inf  # boot time received last
        self._before, self._now, self._since = math.inf, math.inf, 0.0  # smallest of two half windows

    def host_time(self, boot: float, arrival: float) -> float:
        """Host time of a reading, from its time since boot and when it arrived [s]; never after its arrival."""
        delay = arrival - boot
        if not abs(delay - self._offset) < JUMP * self._speed:  # also at first, when the offset is no number
            self._offset, self._before, self._now, self._since = delay, delay, delay, arrival
        if arrival - self._since > WINDOW * self._speed / 2.0 or arrival < self._since:
            self._before, self._now, self._since = self._now, delay, arrival
        self._now = min(self._now, delay)
        step = SLEW * min(max(boot - self._last, 0.0), self._speed) if math.isfinite(self._last) else 0.0
        self._last = boot
        target = min(self._before, self._now)
        self._offset += min(max(target - self._offset, -step), step)
        return min(boot + self._offset, arrival)


class Order:
    """Keeps the times of each sensor going forward, also over a jump of a clock."""

    def __init__(self, speed: float = 1.0) -> None:
        self._jump = JUMP * speed
        self._last: dict[str, float] = {}

    def forward(self, sensor: str, t: float, arrival: float) -> bool:
        """Whether a reading is newer than the last of its sensor; one from long after it is accepted again."""
        last = self._last.get(sensor, -math.inf)
        if last >= t > last - self._jump:  # late or twice
            return False
        self._last[sensor] = t
        return True
