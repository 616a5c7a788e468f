"""What the tests of instruments share: ports, waiting, readings, and peers that misbehave."""

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from rovtwin.core.flow import Measurement
from rovtwin.core.link import Source

HOST = "127.0.0.1"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        return probe.getsockname()[1]


def wait_until(condition: Callable[[], object], seconds: float = 5.0, every: float = 0.01) -> None:
    """Wait for something that happens in another thread; fail when it does not."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(every)


def gather(source: Source, count: int, seconds: float = 5.0) -> list[Measurement]:
    """At least so many readings of a source."""
    got: list[Measurement] = []

    def enough() -> bool:
        got.extend(source.read())
        return len(got) >= count

    wait_until(enough, seconds)
    return got


def reading(sensor: str, t: float, *value: float) -> Measurement:
    return Measurement(sensor, np.array(value, dtype=float), t)


def connect(port: int, receive_buffer: int | None = None) -> socket.socket:
    """A client's socket, once the server listens."""
    end = time.monotonic() + 5.0
    while True:
        client = socket.socket()
        client.settimeout(5.0)
        if receive_buffer is not None:
            client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        try:
            client.connect((HOST, port))
            return client
        except ConnectionRefusedError:
            client.close()
            assert time.monotonic() < end, "nobody listens"
            time.sleep(0.01)


def is_closed(client: socket.socket, seconds: float = 5.0) -> bool:
    """Whether the other end hangs up, whatever it sends before."""
    client.settimeout(seconds)
    try:
        while client.recv(65536):
            pass
    except TimeoutError:
        return False
    except OSError:
        pass
    return True


@contextmanager
def peer(answer: Callable[[socket.socket], None], port: int) -> Iterator[list[int]]:
    """A server that does `answer` with every client, one after the other; gives how many came."""
    listener = socket.create_server((HOST, port))
    count, held, done = [0], [], threading.Event()

    def run() -> None:
        while not done.is_set():
            try:
                client, _ = listener.accept()
            except OSError:
                return
            count[0] += 1
            held.append(client)
            client.settimeout(2.0)
            with contextlib.suppress(OSError):
                answer(client)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield count
    finally:
        done.set()
        with contextlib.suppress(OSError):
            listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        for client in held:
            client.close()
        thread.join(3.0)
