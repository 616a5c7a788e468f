"""What sources with a thread share: a bounded list of readings, reconnecting with a growing pause, closing at once."""

import abc
import contextlib
import math
import socket
import threading
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np

from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Measurement
from rovtwin.core.link import Source

BACKLOG = 1000  # readings kept for a reader that is late; beyond it the oldest are lost
FIRST_PAUSE, LONGEST_PAUSE = 0.2, 5.0  # before connecting again [s of real time]


class BackgroundSource(Source):
    """A source whose instrument is listened to in a thread.

    An instrument that is away, silent or talks nonsense is quiet; the thread keeps trying to reach it. `status` says
    how it is, for people.

    Attributes:
        where: The instrument's address, for people.
        status: How it is reached, in words.
        connections: How often it was reached.
        dropped: Messages that could not be used.
    """

    def __init__(self, where: str, port: int, clock: Callable[[], float]):
        if not 0 < port < 65536:
            raise LinkError(f"{where}: port {port}: expected 1 to 65535")
        self.where = where
        self.status = f"{where}: not reached yet"
        self.connections = self.dropped = 0
        self.clock = clock
        self._readings: deque[Measurement] = deque(maxlen=BACKLOG)
        self._socket: socket.socket | None = None
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._connected = False
        self._thread = threading.Thread(target=self._run, name=where, daemon=True)

    def read(self) -> list[Measurement]:
        with self._lock:
            readings = list(self._readings)
            self._readings.clear()
        return readings

    def close(self) -> None:
        with self._lock:
            self._closed.set()
            self._readings.clear()
        self._interrupt()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(1.0)
        self.status = f"{self.where}: closed"

    @abc.abstractmethod
    def _visit(self) -> None:
        """Reach the instrument and listen until it is lost (any exception) or the source is closed."""

    def _interrupt(self) -> None:
        """End `_visit` soon: its `_socket`, if there is one, is shut.

        Called from another thread, maybe twice, maybe while nothing is open.
        """
        connection = self._socket
        if connection is not None:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)

    def _run(self) -> None:
        pause = FIRST_PAUSE
        while not self._closed.is_set():
            self._connected = False
            try:
                self._visit()
                reason = "the other end hung up"
            except Exception as error:  # whatever comes from the network: the thread goes on
                reason = str(error) or type(error).__name__
            pause = FIRST_PAUSE if self._connected else min(2.0 * pause, LONGEST_PAUSE)
            if not self._closed.is_set():
                self.status = f"{self.where}: {reason}; trying again in {pause:.1f} s"
            self._closed.wait(pause)

    def _reached(self) -> None:
        """To be called when the instrument has said something that makes sense."""
        self.connections += not self._connected
        self._connected = True
        self.status = f"{self.where}: connected"

    def _keep(self, sensor: str, value: Sequence[float] | np.ndarray, t_valid: float) -> None:
        """One reading for who reads next; what is no number is dropped, and all is once the source is closed."""
        array = np.array(value, dtype=float)
        if not (np.isfinite(array).all() and math.isfinite(t_valid)):
            self.dropped += 1
            return
        with self._lock:
            if not self._closed.is_set():
                self._readings.append(Measurement(sensor, array, float(t_valid)))
