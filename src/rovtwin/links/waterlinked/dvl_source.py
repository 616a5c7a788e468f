"""Listening to a DVL A50, real or served."""

import socket
import time
from collections.abc import Callable

from rovtwin.core.arrays.rotations import heading_rotation
from rovtwin.core.errors import LinkError
from rovtwin.links.background import BackgroundSource
from rovtwin.links.clock import ClockMap
from rovtwin.links.waterlinked.dvl_server import PORT
from rovtwin.links.waterlinked.dvl_wire import VelocityReport, parse_report
from rovtwin.links.waterlinked.fields import LONGEST

PATIENCE = 5.0  # for a connection, and for any line of one that is open [s]: the slowest DVL says something at 2 Hz
LONGEST_AGE = 2.0  # a reading older than this when it is sent is a mistake of its stamps [s]
FASTEST = 20.0  # a velocity beyond it is nonsense [m/s]; the data sheet's range is 3.75 m/s


class DvlSource(BackgroundSource):
    """Readings `dvl` (velocity over ground [m/s], shape (3,)) and, where requested, `altimeter` ([m], shape (1,)).

    Only pings with bottom lock become readings; water tracking never does. Times are those of validity by the DVL's
    clock, mapped to ours.

    Args:
        host: The DVL's address; 192.168.2.95 as it comes from the factory.
        port: Its TCP port.
        clock: Our clock [s].
        rotation: How far the DVL's forward axis is turned clockwise, seen from above, from that of the frame that is
            desired [rad]. For a DVL that knows its mounting offset, or an autopilot that knows the sensor's: 0.
        altimeter: Whether altitudes become readings too.

    Raises:
        LinkError: There is no such port.
    """

    def __init__(
        self,
        host: str,
        port: int = PORT,
        clock: Callable[[], float] = time.monotonic,
        rotation: float = 0.0,
        altimeter: bool = False,
    ):
        self.provides = frozenset({"dvl"})
        super().__init__(f"dvl://{host}:{port}", port, clock)
        self._address = (host, port)
        self._turn = heading_rotation(rotation)
        self._altimeter = altimeter
        self._map = ClockMap.to(clock)
        self._thread.start()

    def _visit(self) -> None:
        with socket.create_connection(self._address, timeout=PATIENCE) as connection:
            self._socket = connection
            waiting = b""
            last_at = time.monotonic()
            while not self._closed.is_set():
                data = connection.recv(16384)
                arrival = self.clock()
                if not data:
                    return
                *lines, waiting = (waiting + data).split(b"\n")
                for line in lines:
                    if line.strip() and self._take(line, arrival):
                        last_at = time.monotonic()
                if len(waiting) > LONGEST or time.monotonic() - last_at > PATIENCE:
                    raise LinkError("talks, but not as a DVL does")

    def _take(self, line: bytes, arrival: float) -> bool:
        """A line's readings; whether it made sense."""
        try:
            report = parse_report(line)
        except LinkError:
            self.dropped += 1
            return False
        self._reached()
        if isinstance(report, VelocityReport) and report.bottom:
            self._measure(report, arrival)
        return True

    def _measure(self, report: VelocityReport, arrival: float) -> None:
        t_valid = self._time(report, arrival)
        if not report.valid:
            return
        vx, vy, vz = report.velocity
        if max(abs(vx), abs(vy), abs(vz)) > FASTEST:
            self.dropped += 1
            return
        self._keep("dvl", (*(self._turn @ (vx, vy)).tolist(), vz), t_valid)
        if self._altimeter and report.altitude > 0:
            self._keep("altimeter", (report.altitude,), t_valid)

    def _time(self, report: VelocityReport, arrival: float) -> float:
        if report.time_of_validity is None:
            return arrival
        valid = 1e-6 * report.time_of_validity
        sent = valid if report.time_of_transmission is None else 1e-6 * report.time_of_transmission
        if not 0.0 <= sent - valid <= LONGEST_AGE:
            sent = valid
        return self._map(valid, arrival, sent)
