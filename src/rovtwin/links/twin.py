"""The twin behind a Link: simulated time follows a clock, commands expire as on a real vehicle."""

from collections.abc import Callable
from typing import Any

import numpy as np

from rovtwin.core.flow import Command, Measurement, Measurements
from rovtwin.core.numerics import jnp
from rovtwin.links.local_link import LocalLink

Advance = Callable[[Any, Command, int], tuple[Any, Measurements]]


class TwinLink(LocalLink):
    """A simulated vehicle that moves on by up to one control period whenever it is read.

    Args:
        advance: `(memory, command, k) -> (memory, readings)`: the twin over control period k.
        memory: The twin's memory at time 0.
        thrusters: Number of thrusters.
        period: Control period [s].
        clock: Time since the start [s]: wall clock for real time, a counter for tests.
        prompt: Commands count from when they come: what has passed is computed under the one before, as a vehicle
            has it. Not for a host that is late and plays tick by tick.
    """

    def __init__(
        self,
        advance: Advance,
        memory: Any,
        thrusters: int,
        period: float,
        clock: Callable[[], float],
        prompt: bool = False,
    ):
        super().__init__(thrusters)
        self._advance = advance
        self._period = period
        self._clock = clock
        self.memory = memory
        self._tick = 0
        self._prompt, self._unread = prompt, list[Measurement]()

    @property
    def tick(self) -> int:
        """Control periods simulated so far."""
        return self._tick

    @property
    def is_due(self) -> bool:
        """Whether a whole period has passed that is not computed yet."""
        # Half a microsecond of grace: k * period and the clock round differently.
        return not self._closed and (self._tick + 1) * self._period <= self._clock() + 5e-7

    def go_on_from_here(self) -> None:
        """Give up the time that passed while nobody looked, where the clock lets it: it need not be computed.

        A twin that has minutes to catch up while its host waits for it stamps readings minutes before the commands.
        """
        slip = getattr(self._clock, "slip", None)
        if slip is not None and (late := self._clock() - self._now()) > self._period:
            slip(late)

    def send(self, command: Command) -> None:
        while self._prompt and self.is_due:
            self._unread = self.read()
        super().send(command)

    def read(self) -> list[Measurement]:
        readings, self._unread = self._unread, []
        # One period a call at most: a host that comes late reads the missed periods one by one, and loses nothing.
        if self.is_due:
            self.memory, slots = self._advance(self.memory, Command(jnp.asarray(self.command)), self._tick)
            self._tick += 1
            readings += _listed(slots)
        return readings

    def _now(self) -> float:
        return self._tick * self._period


def _listed(slots: Measurements) -> list[Measurement]:
    """The valid rows of the slots, sensor by sensor, each in order of arrival."""
    return [
        Measurement(name, np.asarray(slot.value)[i], float(np.asarray(slot.t_valid)[i]))
        for name, slot in slots.items()
        for i in np.flatnonzero(np.asarray(slot.valid))
    ]
