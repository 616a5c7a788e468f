"""Serving: the vehicle in step with the wall clock, its protocols in another process."""

import math
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol

import numpy as np

from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Measurement
from rovtwin.core.log import Channel, LogWriter
from rovtwin.core.urgent import settle, urgent
from rovtwin.links.apart import Protocols
from rovtwin.links.server import Server
from rovtwin.links.wish import Wish
from rovtwin.scenario.channels import ETA, ETA_UNITS, NU, NU_UNITS
from rovtwin.scenario.interrupt import Interrupt
from rovtwin.scenario.pace import SLIP, Pace

PROGRESS = 1.0  # between two looks from outside [s]


class Advancing(Protocol):
    """A vehicle that can be served, simulated or replayed; see `host.ServedVehicle`."""

    dt: float
    drones: tuple[str, ...]

    @property
    def now(self) -> float: ...

    def advance(self, wishes: dict[str, Wish]) -> list[Measurement]: ...


def serve(
    vehicle: Advancing,
    servers: Sequence[Server],
    *,
    speed: float = 1.0,
    duration: float = math.inf,
    log: Path | None = None,
    say: Callable[[str], None] = print,
    progress: Callable[[float, Pace], None] | None = None,
    over: Callable[[], bool] = lambda: False,
) -> Pace:
    """Serve a vehicle until Ctrl-C, `over()`, or so many simulated seconds.

    Args:
        vehicle: What moves and measures.
        servers: Protocols to speak.
        speed: Simulated seconds a second.
        duration: [s], simulated.
        log: New MCAP file for the truth, at the control rate; None writes none.
        say: Takes what servers have to say.
        progress: Called about once a second with the vehicle's time [s].
        over: Looked at once a period.

    Returns:
        How well it kept time.

    Raises:
        LinkError: A server cannot run, or its process is gone; thrusters are off then.
    """
    pace = Pace()
    with ExitStack() as stack:
        interrupt = stack.enter_context(Interrupt())
        write = stack.enter_context(_truth_log(log, vehicle)) if log else None
        protocols = stack.enter_context(Protocols(servers, vehicle.drones, speed))
        stack.enter_context(urgent(speed <= 1.0))
        settle()
        due, shown = time.monotonic(), 0.0
        while not (interrupt.asked or over()) and vehicle.now < duration:
            due += vehicle.dt / speed
            if (late := pace.wait(due)) > SLIP:
                pace.slipped += late
                due += late
            readings = vehicle.advance(protocols.wishes())
            protocols.feed(vehicle.now, readings)
            if write:
                write.take(vehicle)
            for text in protocols.said():
                say(text)
            if progress and due - shown > PROGRESS:
                shown = due
                progress(vehicle.now, pace)
    return pace


class _TruthLog:
    """The truth of a served twin, period by period."""

    def __init__(self, writer: LogWriter):
        self._writer = writer
        self._rows: dict[str, list[np.ndarray]] = {}
        self._times: list[float] = []

    def take(self, vehicle: Advancing) -> None:
        self._times.append(vehicle.now)
        for name, values in vehicle.truth.items():  # type: ignore[attr-defined]  (only twins are logged)
            self._rows.setdefault(name, []).append(np.array(values))
        if len(self._times) >= 50:
            self.flush()

    def flush(self) -> None:
        for name, rows in self._rows.items():
            self._writer.write_many(f"truth/{name}", np.array(self._times), np.stack(rows))
        self._rows, self._times = {}, []

    def __enter__(self) -> "_TruthLog":
        self._writer.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        if self._times:
            self.flush()
        self._writer.__exit__(*error)  # type: ignore[arg-type]  (handed on as they came)


def _truth_log(path: Path, vehicle: Advancing) -> _TruthLog:
    thrusters = tuple(getattr(vehicle, "thrusters", ()))
    if not thrusters:
        raise LinkError(f"{path}: a replayed vehicle has no truth to log")
    rate = 1.0 / vehicle.dt
    channels = [
        Channel("truth/eta", ETA, ETA_UNITS, "n", description="true pose of CO", rate=rate),
        Channel("truth/nu", NU, NU_UNITS, "b", description="true velocity over ground", rate=rate),
        Channel("truth/thrust", thrusters, "N", "b", description="true force of each thruster", rate=rate),
        Channel("truth/command", thrusters, "1", "", description="normalised command of each thruster", rate=rate),
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    return _TruthLog(LogWriter(path, channels, {"name": "served"}))
