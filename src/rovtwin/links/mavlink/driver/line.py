"""The line to a vehicle through pymavlink: frames out, messages in, one thread that listens."""

import threading
from collections.abc import Callable
from typing import Any

from rovtwin.core.errors import LinkError
from rovtwin.links.mavlink.wire import Decoder, Encoder, dialect

FORMS = ("udpin:", "udpout:", "tcp:", "/dev/")  # pymavlink would also run programs and read files


def open_line(url: str, baud: int) -> Any:
    """pymavlink's connection of a URL in its own form; a scheme `mavlink://` before it is left out.

    Raises:
        LinkError: pymavlink is missing, the form is not known, or it cannot be opened.
    """
    dialect()
    from pymavlink import mavutil

    device = url.removeprefix("mavlink://")
    if not device.startswith(FORMS):
        raise LinkError(
            f"mavlink: {url!r}: expected udpin:HOST:PORT (the vehicle calls us), udpout:HOST:PORT, tcp:HOST:PORT or a "
            "serial port such as /dev/ttyACM0"
        )
    try:
        return mavutil.mavlink_connection(device, baud=baud, retries=1)
    except Exception as error:  # whatever the port's driver throws
        raise LinkError(
            f"mavlink: {url}: cannot be opened ({error}). Is the vehicle there, and the port free?"
        ) from None


class Line:
    """Frames out and messages in.

    Args:
        url: In pymavlink's form.
        baud: Of a serial port.
        system, component: Our own address.
        take: Gets every message, in the listening thread.
    """

    def __init__(self, url: str, baud: int, system: int, component: int, take: Callable[[Any], None]):
        self.url = url
        self._connection = open_line(url, baud)
        self._encoder = Encoder(system, component)
        self._decoder = Decoder()
        self._datagrams = "udp" in url.removeprefix("mavlink://")[:6]
        self._take = take
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self.failure = ""  # why the line is of no use any more
        self._thread = threading.Thread(target=self._listen, name="mavlink listens", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def send(self, message: Any) -> None:
        """Send a message; a line that fails says so by `failure`."""
        with self._lock:
            if self._closed.is_set() or self.failure:
                return
            try:
                self._connection.write(self._encoder.frame(message))
            except OSError as error:
                self.failure = f"cannot be written to ({error})"

    def close(self) -> None:
        """Close; waits for the listening thread, a tenth of a second at most or so."""
        with self._lock:
            self._closed.set()
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join(1.0)
        self._connection.close()

    def _listen(self) -> None:
        while not self._closed.is_set() and not self.failure:
            try:
                data = self._received()
            except Exception as error:  # pyserial has its own kinds
                self.failure = f"cannot be read ({error})"
                return
            try:
                for message in self._decoder.feed(data):
                    self._take(message)
            except LinkError:  # a frame that cannot be parsed is as good as lost
                continue
            except Exception as error:  # a listener that dies unheard would leave a link that is only quiet
                self.failure = f"a message could not be taken in ({type(error).__name__}: {error})"
                return
            if self._datagrams:
                self._decoder.reset()

    def _received(self) -> bytes:
        if not self._connection.select(0.1):
            return b""
        data = self._connection.recv(4096)
        if not data and self._connection.__class__.__name__ == "mavtcp":
            raise OSError("the other side closed the connection")
        return bytes(data) if data else b""
