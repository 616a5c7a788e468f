"""A log behind a Link: what the vehicle measured then comes again by the clock; commands are taken and move nothing."""

from collections.abc import Callable
from typing import Any

import numpy as np

from rovtwin.core.datum import datum_of
from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Measurement
from rovtwin.core.log import Log
from rovtwin.links.local_link import LocalLink

SENSOR = "sensor/"
PATIENCE = 1.0  # after the last reading [s]


class ReplayLink(LocalLink):
    """The readings of a log, each at the time at which the autopilot of that flight got it.

    Attributes:
        duration: Of the log [s].
        datum: Of the log, if it has one.
    """

    def __init__(self, log: Log, thrusters: int, clock: Callable[[], float]):
        """The log begins now, and again with `rewind`; times of readings are those of the clock.

        Raises:
            LinkError: The log has no readings.
        """
        self._arrivals, self._readings = readings_of(log)
        if not self._readings:
            raise LinkError(
                "the log: found no channel sensor/.., expected readings of sensors. Fly with log.sensors on"
            )
        super().__init__(thrusters)
        self._clock, self.datum = clock, datum_of(log.metadata)
        self.duration = float(self._arrivals[-1])
        self.rewind()

    def rewind(self) -> None:
        """Begin again at the beginning."""
        self._next, self._began = 0, self._clock()

    def read(self) -> list[Measurement]:
        """Readings that are due; LinkError when the log has ended."""
        if self._closed:
            return []
        if (over := self._clock() - self._began - self.duration) > PATIENCE:
            raise LinkError(f"the log has ended, {over:.0f} s ago: it is {self.duration:.0f} s long")
        end = int(np.searchsorted(self._arrivals, self._clock() - self._began + 5e-7, side="right"))
        found, self._next = self._readings[self._next : end], max(end, self._next)
        return [Measurement(r.sensor, r.value, r.t_valid + self._began) for r in found]

    def _now(self) -> float:
        return self._clock()


def readings_of(log: Log) -> tuple[np.ndarray, list[Measurement]]:
    """When the autopilot got each reading of a log [s], shape (n,), in order, and the readings.

    Channels are `sensor/<name>` with the values and, where it is there, `t_valid` as last field.
    """
    arrivals: list[np.ndarray] = []
    readings: list[Measurement] = []
    for name in (n for n in log.channels if n.startswith(SENSOR)):
        series: Any = log[name]
        t, values = np.asarray(series.t), np.asarray(series.values)
        valid = t
        if series.channel.fields[-1] == "t_valid":
            values, valid = values[:, :-1], values[:, -1]
        sensor = name.removeprefix(SENSOR)
        arrivals.append(t)
        readings += [
            Measurement(sensor, np.array(v, dtype=float), float(at)) for v, at in zip(values, valid, strict=True)
        ]
    if not readings:
        return np.zeros(0), []
    when = np.concatenate(arrivals)
    order = np.argsort(when, kind="stable")
    return when[order], [readings[i] for i in order]
