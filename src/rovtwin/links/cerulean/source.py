"""Listening to a Cerulean DVL, which sends its sentences to us."""

import socket
import time
from collections.abc import Callable

from rovtwin.core.errors import LinkError
from rovtwin.links.background import BackgroundSource
from rovtwin.links.cerulean.wire import Deltas, parse
from rovtwin.links.clock import ClockMap

PORT = 27000  # that the DVL-75 and Cerulean's own programs send to
SILENT = 5.0  # a DVL that says nothing for longer is gone, and another one is listened to [s]
LONGEST_INTERVAL = 1.0  # deltas over more than this are no velocity of now [s]: messages come at 5 to 20 Hz
FASTEST = 20.0  # a velocity beyond it is nonsense [m/s]
LOOK = 0.1  # between two looks whether to end [s]


class CeruleanSource(BackgroundSource):
    """Readings `dvl` (velocity over ground [m/s], shape (3,)), and `altimeter` ([m], shape (1,)) of a Tracker 650.

    The velocity is the mean over the interval that a message reports, valid in its middle by the DVL's clock, mapped to
    ours. Without confidence there is no reading.

    Args:
        host: Our own address, to which the DVL sends.
        port: Likewise.
        clock: Our clock [s].
        flu: Whether the DVL's axes are forward, port, up; else forward, starboard, down.

    Raises:
        LinkError: There is no such port.
    """

    def __init__(self, host: str, port: int = PORT, clock: Callable[[], float] = time.monotonic, flu: bool = False):
        super().__init__(f"cerulean://{host}:{port}", port, clock)
        self.provides = frozenset({"dvl"})
        self._address, self._sign = (host, port), -1.0 if flu else 1.0
        self._map = ClockMap.to(clock)
        self._sender: object = None
        self._received_at = 0.0
        self._thread.start()

    def _visit(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
            listener.bind(self._address)
            listener.settimeout(LOOK)
            while not self._closed.is_set():
                if self._connected and time.monotonic() - self._received_at > SILENT:
                    raise LinkError(f"nothing received for {SILENT:g} s")
                try:
                    data, sender = listener.recvfrom(65536)
                except TimeoutError:
                    continue
                self._take(data, sender, self.clock())

    def _take(self, data: bytes, sender: object, arrival: float) -> None:
        """A datagram's readings; of two DVLs the first one is listened to."""
        now = time.monotonic()
        if self._sender is not None and sender != self._sender and now - self._received_at < SILENT:
            self.dropped += 1
            return
        for line in filter(bytes.strip, data.split(b"\n")):
            try:
                deltas = parse(line)
            except LinkError:
                self.dropped += 1
                continue
            self._sender, self._received_at = sender, now
            self._reached()
            if deltas is not None:
                self._measure(deltas, arrival)

    def _measure(self, deltas: Deltas, arrival: float) -> None:
        t_valid = self._map(deltas.time - 0.5 * deltas.interval, arrival, deltas.time)
        if deltas.confidence <= 0.0:
            return
        if not 0.0 < deltas.interval <= LONGEST_INTERVAL:
            self.dropped += 1
            return
        x, y, z = (moved / deltas.interval for moved in deltas.moved)
        if max(abs(x), abs(y), abs(z)) > FASTEST:
            self.dropped += 1
            return
        self._keep("dvl", (x, self._sign * y, self._sign * z), t_valid)
        if deltas.standoff is not None and deltas.standoff > 0.0:
            self._keep("altimeter", (deltas.standoff,), self._map(deltas.time, arrival))
