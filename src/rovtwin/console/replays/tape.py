"""What a log holds of a run, by what the console calls it: samples that hold until the next."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from rovtwin.console.engine.reporting.state import WINDOW, judged
from rovtwin.core.flow import PHASES, REASONS
from rovtwin.core.log import Log

SENSOR = "sensor/"
STEP = 0.1  # of a pose that is put together from readings [s]
SOURCES = {  # what the console shows: the channels that have it, the best first, and how many numbers it has
    "eta": (("autopilot/eta", "truth/eta"), 6),
    "nu": (("autopilot/nu", "truth/nu"), 6),
    "bias": (("autopilot/bias",), 6),
    "std": (("autopilot/std",), 12),
    "setpoint": (("autopilot/setpoint",), 6),
    "reference": (("autopilot/reference",), 6),
    "leg": (("autopilot/leg",), 6),
    "mode": (("autopilot/mode",), 4),
    "tau": (("autopilot/tau",), 6),
    "u": (("autopilot/command",), None),
    "health": (("autopilot/health",), None),
    "truth": (("truth/eta",), 6),
    "current": (("truth/water_velocity",), 3),
    "timing": (("host/timing",), 3),
}


@dataclass(frozen=True)
class Held:
    """Samples that hold until the next: times [s] and values, of a sensor what they are."""

    t: Float[np.ndarray, " n"]
    values: Float[np.ndarray, "n m"]
    fields: tuple[str, ...] = ()
    units: tuple[str, ...] = ()

    def at(self, times: ArrayLike) -> Float[np.ndarray, "*axes m"]:
        """Values at times [s]; before the first sample it is the first."""
        return self.values[np.maximum(self.last(times), 0)]

    def last(self, times: ArrayLike) -> Int[np.ndarray, "*axes"]:
        """Number of the sample that holds at each time; -1 before the first."""
        return np.searchsorted(self.t, times, side="right") - 1


def tape_of(log: Log) -> dict[str, Held]:
    """What there is of SOURCES, and `reference_rate`; channels that are empty or of another shape are left out."""
    found: dict[str, Held] = {}
    for name, (channels, width) in SOURCES.items():
        for channel in channels:
            if name not in found and channel in log and len(log[channel]):
                if width in (None, len(log[channel].channel.fields)):
                    found[name] = Held(log[channel].t, log[channel].values)
    if "mode" in found:  # numbers of another version may be ones that this one does not know
        mode = found["mode"].values.copy()
        mode[:, :2] = np.clip(mode[:, :2], 0, (len(PHASES) - 1, len(REASONS) - 1))
        found["mode"] = Held(found["mode"].t, mode)
    if "reference" in found:
        found["reference_rate"] = rate_of(found["reference"])
    if "eta" not in found and (measured := measured_pose(readings_of(log))) is not None:
        found["eta"] = measured
    return found


def readings_of(log: Log) -> dict[str, Held]:
    """Readings by sensor, at the times at which the autopilot got them."""
    found = {}
    for channel in (name for name in log if name.startswith(SENSOR) and len(log[name])):
        series = log[channel]
        fields, units = series.channel.fields, series.channel.units
        n = len(fields) - (fields[-1] == "t_valid")
        found[channel.removeprefix(SENSOR)] = Held(series.t, series.values[:, :n], fields[:n], units[:n])
    return found


def rate_of(pose: Held) -> Held:
    """How fast a pose changes, by differences between samples; zero of a single one."""
    if len(pose.t) < 2:
        return Held(pose.t, np.zeros_like(pose.values))
    values = np.concatenate([pose.values[:, :3], np.unwrap(pose.values[:, 3:], axis=0)], axis=1)
    rate = np.diff(values, axis=0) / np.maximum(np.diff(pose.t), 1e-6)[:, None]
    return Held(pose.t, np.concatenate([rate, rate[-1:]]))


def measured_pose(readings: dict[str, Held]) -> Held | None:
    """Where a vehicle was that nobody estimated: position, depth and attitude as measured; None without positions."""
    if "position" not in readings or readings["position"].values.shape[1] < 2:
        return None
    t = np.arange(readings["position"].t[0], max(held.t[-1] for held in readings.values()) + STEP, STEP)
    eta = np.zeros((len(t), 6))
    eta[:, :2] = readings["position"].at(t)[:, :2]
    for sensor, columns in (("pressure", slice(2, 3)), ("attitude", slice(3, 6))):
        if sensor in readings:
            eta[:, columns] = readings[sensor].at(t)
    return Held(t, eta)


class Consistency:
    """What the filter of a log said of itself, window by window; nothing where it has none."""

    def __init__(self, log: Log):
        names = ("autopilot/nis", "autopilot/nis_dof")
        self._names: list[str] = []
        if all(name in log and len(log[name]) for name in names):
            self._names = list(log[names[0]].channel.fields)
            zero = np.zeros((1, len(self._names)))
            self._t = log[names[0]].t
            self._sums = [np.concatenate([zero, np.cumsum(log[name].values, axis=0)]) for name in names]
        self._judged = lru_cache(maxsize=8192)(self._judged_at)

    def report(self, t: float) -> dict[str, Any]:
        """As `Consistency` tells it; renewed once a second."""
        return self._judged(int(t)) if self._names else {}

    def _judged_at(self, second: int) -> dict[str, Any]:
        first, last = np.searchsorted(self._t, [second - WINDOW, second + 1e-9])
        nis, dof = (sums[last] - sums[first] for sums in self._sums)
        return judged(self._names, nis, dof)
