"""A camera on the network, as far as its clients see: MJPEG over HTTP, a printed marker on a wall."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import cv2
import numpy as np

from rovtwin.simulation.scene import load_scene

HEAD = b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=frame\r\n\r\n"
MARKER = 1  # hangs in the pool
CORNER, SIDE = (400, 250), 300  # of it in the picture [px]
SIZE = (1920, 1080)


def photograph() -> bytes:
    """A marker on a white wall, full HD."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, load_scene("pool").layout.dictionary))
    image = np.full((SIZE[1], SIZE[0], 3), 230, np.uint8)
    (u, v), marker = CORNER, cv2.aruco.generateImageMarker(dictionary, MARKER, SIDE)
    image[v : v + SIDE, u : u + SIDE] = marker[..., None]
    return cv2.imencode(".jpg", image)[1].tobytes()


@dataclass
class Film:
    """Where it is to be seen, and whether it goes on."""

    url: str
    ended: threading.Event = field(default_factory=threading.Event)


@contextmanager
def filming() -> Iterator[Film]:
    """A camera that sends 25 pictures a second to one who asks, until it has `ended`."""
    jpeg = photograph()
    part = b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(jpeg) + jpeg + b"\r\n"
    with socket.create_server(("127.0.0.1", 0)) as server:
        film = Film(f"http://127.0.0.1:{server.getsockname()[1]}/stream")

        def serve() -> None:
            try:
                caller, _ = server.accept()
                with caller:
                    caller.recv(4096)
                    caller.sendall(HEAD)
                    while not film.ended.is_set():
                        caller.sendall(part)
                        time.sleep(0.04)
            except OSError:  # nobody looks any more
                pass

        threading.Thread(target=serve, daemon=True).start()
        try:
            yield film
        finally:
            film.ended.set()
