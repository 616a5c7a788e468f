"""The monitor beside an autopilot: it takes what the flight takes, and is done with a second before the next one ends.

It runs a little behind the flight, for positions come late and are put where they belong, and in a thread of its own,
for an update may take longer than a tick.
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from rovtwin.core.errors import IdentificationError
from rovtwin.core.flow import Measurements
from rovtwin.core.sensors import SENSORS
from rovtwin.gnc.mounting import Mount
from rovtwin.identification.logs.record import Record, Signal
from rovtwin.monitoring.change import Change, changes
from rovtwin.monitoring.monitor import BLOCK, NEEDED, Monitor
from rovtwin.monitoring.quantities import Quantities, Reading
from rovtwin.monitoring.readings import levers_of, seen
from rovtwin.vehicle.physics.model import Model

PATIENCE = 60.0  # for sensors that are silent at the start [s]
BEHIND = 3.0  # the flight, so that readings that come late are in [s]
FADING = 300.0  # what was seen so long ago counts half [s]
USED = {"position": "horizontal", "pressure": "depth", "attitude": "attitude", "gyro": "gyro", "dvl": "velocity"}


@dataclass(frozen=True, eq=False)
class Found:
    """What a flight says of the vehicle so far.

    Attributes:
        readings: All quantities.
        changes: Those that have changed beyond chance, the surest first; none where there is no reference.
        doubts: Why none of it is to be relied on, in words.
        seconds: That were looked at [s].
    """

    readings: list[Reading]
    changes: list[Change]
    doubts: list[str]
    seconds: float


class FlightMonitor:
    """Takes ticks as they come, and gives the quantities once a second.

    Attributes:
        quantities: What it gives.
        reference: Standard deviation with which each quantity was known before the flight, shape (q,), NaN where it
            was not; None: there is nothing to compare with, and nothing is called a change.
        found: The last that it gave, None before.
        trouble: Why it has stopped, "" while it runs.
    """

    def __init__(self, model: Model, thrusters: Sequence[str], mounts: Mapping[str, Mount], dt: float):
        """For a vehicle as it is assumed to be.

        Args:
            model: The vehicle.
            thrusters: Their names.
            mounts: Of the sensors by name; the first of a kind is used.
            dt: Tick [s].
        """
        self._model, self._dt = model, dt
        self._mounts = {name: mounts[name] for name in USED if name in mounts}
        self._signals = {name: _empty(name, mount) for name, mount in self._mounts.items()}
        self._t, self._command = np.zeros(1), np.zeros((1, len(thrusters)))
        self._monitor = Monitor(model, thrusters, levers_of(self._by_signal()), FADING)
        self._block = -1
        self._second: int | None = None
        self._busy: Future[Found] | None = None
        self.reference: np.ndarray | None = None
        self.found: Found | None = None
        self._beside = ThreadPoolExecutor(1, thread_name_prefix="monitor")
        self.quantities = Quantities(model, thrusters, self._monitor.factors)
        self.trouble = "" if all(name in self._mounts for name in NEEDED) else "no attitude or no gyro on board"

    def warm(self) -> None:
        """Compile what a second takes, before anything flies."""
        if self.trouble:
            return
        self._monitor.begin(np.zeros(3), np.zeros(3))
        self._monitor.second(seen(self._model, self._window(0.0), self._monitor.filter.h))
        self._monitor.hold(np.zeros(len(self._monitor.factors.each)))
        self._monitor.begin(np.zeros(3), np.zeros(3))

    def take(
        self, t: Float[np.ndarray, " ticks"], measurements: Measurements, command: Float[np.ndarray, "ticks n"]
    ) -> Found | None:
        """Ticks in a row; what is found, if a second has been done since.

        Args:
            t: Of the ticks [s], on the clock of the readings.
            measurements: Of each tick, leading axis ticks.
            command: That each tick gave.
        """
        if self.trouble:
            return None
        try:
            self._keep(t, measurements, command)
            done = None
            if self._busy is not None and self._busy.done():
                busy, self._busy = self._busy, None
                done = self.found = busy.result()
            if self._busy is None and (windows := self._next(float(t[-1]))):
                self._busy = self._beside.submit(self._update, windows)
        except Exception as error:  # what watches must not end what flies
            self.trouble = str(error) or type(error).__name__
            return None
        return done

    def close(self) -> None:
        """Let go of the thread; what it is at is not waited for."""
        self._beside.shutdown(wait=False, cancel_futures=True)

    def _update(self, windows: list[Record]) -> Found:
        for window in windows:
            self._monitor.second(seen(self._model, window, self._monitor.filter.h))
        block, before = round(self._monitor.time) // BLOCK, self.found
        if block == self._block and before is not None:  # evidence comes by blocks
            return replace(before, seconds=self._monitor.time)
        self._block = block
        readings = self.quantities.read(self._monitor.found())
        known = self.reference
        beyond = [] if known is None else changes(readings, np.zeros(len(known)), known)
        return Found(readings, beyond, self._monitor.doubts, self._monitor.time)

    def _next(self, now: float) -> list[Record]:
        """Seconds of which all has come; the first one is that in which everything on board has been received."""
        if self._second is None:
            if silent := [name for name in NEEDED if not len(self._signals[name].t)]:
                if now > PATIENCE:
                    raise IdentificationError(f"no {' and no '.join(silent)} within {PATIENCE:.0f} s")
                return []
            first = [signal.t[0] for signal in self._signals.values() if len(signal.t)]
            if now < max(first) + BEHIND:
                return []
            self._second = int(np.ceil(max(first)))
            self._monitor.begin(self._place(), self._signals["attitude"].value[0])
        windows = []
        while now >= self._second + 1.0 + BEHIND:
            windows.append(self._window(float(self._second)))
            self._second += 1
        if windows:
            self._forget(float(self._second))
        return windows

    def _window(self, start: float) -> Record:
        """The second from a time on."""
        t, command = self._since(start)
        inside = t < start + 1.0
        return Record("flight", t[inside], command[inside], self._by_signal(), start + 1.0)

    def _since(self, start: float) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m n"]]:
        """Commands from a time on, with the one that holds then."""
        row = max(int(np.searchsorted(self._t, start + 1e-9, side="right")) - 1, 0)
        return np.concatenate([[start], self._t[row + 1 :]]), self._command[row:]

    def _forget(self, start: float) -> None:
        """What was before a time."""
        self._t, self._command = self._since(start)
        self._signals = {name: signal.cut(start, np.inf) for name, signal in self._signals.items()}

    def _place(self) -> Float[np.ndarray, "3"]:
        """Where it is as far as it is known, n [m]."""
        place = np.zeros(3)
        for name, rows in (("position", slice(0, 2)), ("pressure", slice(2, 3))):
            if name in self._signals and len(self._signals[name].t):
                place[rows] = self._signals[name].value[0]
        return place

    def _keep(self, t: Float[np.ndarray, " m"], measurements: Measurements, command: Float[np.ndarray, "m n"]) -> None:
        for name, signal in self._signals.items():
            if name in measurements:
                slot = measurements[name]
                valid = np.asarray(slot.valid)
                come = replace(
                    signal, t=np.asarray(slot.t_valid)[valid], value=self._in_b(name, np.asarray(slot.value)[valid])
                )
                self._signals[name] = _joined(signal, come)
        self._t, self._command = np.concatenate([self._t, t]), np.concatenate([self._command, command])

    def _in_b(self, name: str, value: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "m k"]:
        """Readings along the axes of b."""
        rotation = np.asarray(self._mounts[name].rotation)
        if name in ("position", "pressure") or np.array_equal(rotation, np.eye(3)):
            return value
        if name != "attitude":
            return value @ rotation.T
        read = Rotation.from_euler("ZYX", value[:, ::-1]) * Rotation.from_matrix(rotation).inv()
        return read.as_euler("ZYX")[:, ::-1]

    def _by_signal(self) -> dict[str, Signal]:
        return {USED[name]: signal for name, signal in self._signals.items()}


def _empty(name: str, mount: Mount) -> Signal:
    size = SENSORS[name].size
    sigma = np.broadcast_to(np.asarray(mount.std, float), size)
    return Signal(np.zeros(0), np.zeros((0, size)), sigma, np.asarray(mount.lever))


def _joined(before: Signal, come: Signal) -> Signal:
    """Both, in the order of time: what is late is put where it belongs."""
    t = np.concatenate([before.t, come.t])
    order = np.argsort(t, kind="stable")
    return replace(before, t=t[order], value=np.concatenate([before.value, come.value])[order])
