"""Cameras on the network, as far as their clients see: a printed marker on a wall, by MJPEG or H.264."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import cv2
import numpy as np
from tests.console.rtsp import USER, h264_over_rtsp

from rovtwin.simulation.scene import load_scene

HEAD = b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=frame\r\n\r\n"
MARKER = 1  # hangs in the pool
# Of pictures: where the marker's corner is, its side, and width and height [px].
FULL_HD, SMALL = ((400, 250), 300, (1920, 1080)), ((60, 40), 96, (320, 192))


def photograph(place: tuple[tuple[int, int], int, tuple[int, int]]) -> np.ndarray:
    """A marker on a light wall, shape (height, width)."""
    (u, v), side, (width, height) = place
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, load_scene("pool").layout.dictionary))
    image = np.full((height, width), 230, np.uint8)
    image[v : v + side, u : u + side] = cv2.aruco.generateImageMarker(dictionary, MARKER, side)
    return image


def mjpeg_over_http(caller: socket.socket, image: np.ndarray, ended: threading.Event) -> None:
    """Send one who asks 25 pictures a second, until that has `ended`."""
    jpeg = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))[1].tobytes()
    part = b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(jpeg) + jpeg + b"\r\n"
    caller.recv(4096)
    caller.sendall(HEAD)
    while not ended.wait(0.04):
        caller.sendall(part)


# By scheme: what is filmed, how it is sent, and the address of host and port.
CAMERAS = {
    "http": (FULL_HD, mjpeg_over_http, "http://{}/stream"),
    "rtsp": (SMALL, h264_over_rtsp, f"rtsp://{USER}@{{}}/test"),
}


@dataclass
class Film:
    """Where it is to be seen, what it shows (`FULL_HD` or `SMALL`), and whether it goes on."""

    url: str
    place: tuple[tuple[int, int], int, tuple[int, int]]
    ended: threading.Event = field(default_factory=threading.Event)


@contextmanager
def filming(scheme: str = "http") -> Iterator[Film]:
    """A camera that films for one client, until it has `ended`."""
    place, show, address = CAMERAS[scheme]
    with socket.create_server(("127.0.0.1", 0)) as server:
        film = Film(address.format(f"127.0.0.1:{server.getsockname()[1]}"), place)

        def serve() -> None:
            try:
                caller, _ = server.accept()
                with caller:
                    show(caller, photograph(place), film.ended)
            except OSError:  # nobody looks any more
                pass

        threading.Thread(target=serve, daemon=True).start()
        try:
            yield film
        finally:
            film.ended.set()
