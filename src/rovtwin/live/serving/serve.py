"""Serving: the vehicle in step with the wall clock, its protocols in another process."""

import math
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol

from rovtwin.core.flow import Measurement
from rovtwin.core.processes.urgent import settle, urgent
from rovtwin.links.servers.pilot_command import PilotCommand
from rovtwin.links.servers.protocol_process import Protocols
from rovtwin.links.servers.server import Server
from rovtwin.live.serving.truth_log import truth_log
from rovtwin.runs.interrupt import Interrupt
from rovtwin.runs.pace import SLIP, Pace

PROGRESS = 1.0  # between two looks from outside [s]


class Advancing(Protocol):
    """A vehicle that can be served, simulated or replayed; see `host.ServedVehicle`."""

    dt: float
    drones: tuple[str, ...]

    @property
    def now(self) -> float: ...

    def advance(self, commands: dict[str, PilotCommand]) -> list[Measurement]: ...


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
        write = stack.enter_context(truth_log(log, vehicle)) if log else None
        protocols = stack.enter_context(Protocols(servers, vehicle.drones, speed))
        stack.enter_context(urgent(speed <= 1.0))
        settle()
        due, shown = time.monotonic(), 0.0
        while not (interrupt.asked or over()) and vehicle.now < duration:
            due += vehicle.dt / speed
            if (late := pace.wait(due)) > SLIP:
                pace.slipped += late
                due += late
            readings = vehicle.advance(protocols.commands())
            protocols.feed(vehicle.now, readings)
            if write:
                write.take(vehicle)
            for text in protocols.messages():
                say(text)
            if progress and due - shown > PROGRESS:
                shown = due
                progress(vehicle.now, pace)
    return pace
