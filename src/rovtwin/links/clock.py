"""ClockMap: when, on our clock, was what a device stamped with its own. Due: what comes at a rate of simulated time."""

import math
from collections.abc import Callable


def speed_of(clock: Callable[[], float]) -> float:
    """How fast a clock runs [its seconds a real one]: it says so by an attribute `speed` where that is not 1."""
    return float(getattr(clock, "speed", 1.0))


class ClockMap:
    """Maps a device's clock to ours by the smallest offset seen lately.

    A message stamped `s` when it is sent arrives at `a >= s + offset`: what is on top is the time under way, which
    varies and is never negative. So the smallest `a - s` of the last half to whole `window` is the offset, late by the
    shortest way. A window forgets, so that clocks may run at slightly different rates (100 ppm over 30 s is 3 ms).

    A clock that jumps (set by NTP, a device that restarts) shows as offsets that all differ by more than `jump`; once
    they have done so for `confirm` seconds, they are accepted. One wrong stamp changes nothing, and neither does a
    stall of the network, after which all that was held back comes at once. Until a jump is accepted, no time is later
    than the arrival. Times never go back while our own clock does not.

    Args:
        window: How long an offset counts at most [s]; memory does not grow with it.
        jump: Differences beyond it are no variation of the way [s].
        confirm: How long a jump must last before it is accepted [s of our clock].

    Attributes:
        jumps: How often a jump was accepted.
    """

    def __init__(self, window: float = 30.0, jump: float = 0.25, confirm: float = 1.0):
        self.window, self.jump, self.confirm = window, jump, confirm
        self.jumps = 0
        self._restart()

    @classmethod
    def to(cls, clock: Callable[[], float]) -> "ClockMap":
        """For times on a clock: where that runs faster than real, so does the device, but the way takes real time."""
        speed = speed_of(clock)
        return cls(30.0 * speed, 0.25 * speed, speed)

    def _restart(self) -> None:
        self._least = [math.inf, math.inf]  # of this half window and of the one before
        self._half_start = -math.inf
        self._arrival = self._last = -math.inf
        self._doubted_since = math.nan
        self._forget_strange()

    def _forget_strange(self) -> None:
        self._strange_since = math.nan
        self._strange_least, self._strange_most, self._strange_count = math.inf, -math.inf, 0

    @property
    def offset(self) -> float:
        """Our clock less the device's [s]; infinite before the first message."""
        return min(self._least)

    def __call__(self, valid: float, arrival: float, sent: float | None = None) -> float:
        """When a reading was valid, on our clock [s], never after `arrival`.

        Args:
            valid: The device's stamp of the reading [s].
            arrival: Our clock when it came [s].
            sent: The device's stamp when it was sent [s], where there is one: the time between both is then no part of
                the way. Without it, `valid` counts as sent.
        """
        sent = valid if sent is None or not math.isfinite(sent) else sent
        if not (math.isfinite(valid) and math.isfinite(arrival)):
            return arrival
        if arrival < self._arrival:  # our own clock was set back: nothing of before means anything
            self._restart()
        self._arrival = arrival
        self._learn(arrival - sent, arrival)
        mapped = valid + self.offset
        self._last = max(self._last, min(mapped, arrival))
        return self._last

    def _learn(self, offset: float, arrival: float) -> None:
        if math.isinf(self.offset):
            self._least[0], self._half_start = offset, arrival
        elif abs(offset - self.offset) <= self.jump:
            self._doubted_since = math.nan
            self._forget_strange()
            if arrival - self._half_start > self.window / 2:
                self._least, self._half_start = [offset, self._least[0]], arrival
            self._least[0] = min(self._least[0], offset)
        else:
            self._doubt(offset, arrival)

    def _doubt(self, offset: float, arrival: float) -> None:
        """An offset that does not fit: accepted when enough of them agree for long enough.

        Where they never agree, the clocks run at different speeds: then the newest counts after three times as long.
        """
        if math.isnan(self._doubted_since):
            self._doubted_since = arrival
        agrees = max(self._strange_most, offset) - min(self._strange_least, offset) <= self.jump
        if not agrees:
            self._forget_strange()
        if self._strange_count == 0:
            self._strange_since = arrival
        self._strange_count += 1
        self._strange_least = min(self._strange_least, offset)
        self._strange_most = max(self._strange_most, offset)
        agreed = self._strange_count >= 3 and arrival - self._strange_since >= self.confirm
        if agreed or arrival - self._doubted_since >= 3.0 * self.confirm:
            self._least, self._half_start = [self._strange_least, math.inf], arrival
            self.jumps += 1
            self._doubted_since = math.nan
            self._forget_strange()


class Due:
    """Whether something that comes every `period` is due, on a grid that starts with the first time asked [s]."""

    def __init__(self, period: float):
        self.period = period
        self._next = -math.inf

    def __call__(self, now: float) -> bool:
        """Once a period; after a gap, or when time starts anew, at once."""
        if self._next - self.period <= now < self._next - 1e-9:
            return False
        following = self._next + self.period
        self._next = following if now < following <= now + self.period else now + self.period
        return True
