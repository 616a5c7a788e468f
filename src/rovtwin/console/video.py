"""A real camera's stream, as the operator sees it: the newest picture, smaller, with the markers found in it."""

import os
import threading
import time
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from jaxtyping import Float

from rovtwin.console.pictures import RATE, Developer, Give, Wait
from rovtwin.core.errors import ConfigError, LinkError
from rovtwin.core.vision import opencv
from rovtwin.links.registry import find
from rovtwin.links.url import Url
from rovtwin.simulation.scene import load_scene

SCHEMES = ("rtsp", "http", "https", "udp", "tcp", "rtp", "srt")
WIDEST = 960  # of pictures for browsers [px]
PATIENCE = 5000  # for an answer, and for the next picture [ms]
LOOK = 0.01  # between two looks for a new picture [s]
# Of FFmpeg: nothing is kept back. RTSP over TCP, which a tether and a relay pass on whole.
HASTE = "rtsp_transport;tcp|fflags;nobuffer|flags;low_delay"


@dataclass(frozen=True)
class Filmed:
    """A feed of a camera's stream, whatever FFmpeg can read.

    Attributes:
        url: Of the stream, as `rtsp://192.168.1.101:8554/test`.
        scene: Name or file of the scene whose markers are looked for; None: none are.
    """

    url: str
    scene: str | None = None

    def __call__(self, give: Give, wait: Wait) -> None:
        developer = Developer(None if self.scene is None else load_scene(self.scene))
        reader, began = _Reader(self.url), time.monotonic()
        while not wait(LOOK):
            image = reader.newest()
            if image is not None:
                give(developer(time.monotonic() - began, image))


class _Reader(threading.Thread):
    """Takes every picture of a stream, so that none gets old there, and keeps the newest."""

    def __init__(self, url: str):
        super().__init__(daemon=True, name="film")
        self._cv2: Any = opencv("a camera's picture")
        self._shown = public(url)
        os.environ.setdefault("OPENCV_FFMPEG_CAPTURE_OPTIONS", HASTE)
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # it is said once, where a user looks
        cv2 = self._cv2
        patience = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, PATIENCE, cv2.CAP_PROP_READ_TIMEOUT_MSEC, PATIENCE]
        self._film = cv2.VideoCapture(url, cv2.CAP_FFMPEG, [*patience, cv2.CAP_PROP_N_THREADS, 1])
        if not self._film.isOpened():
            raise LinkError(f"{self._shown}: found no stream. Is the camera on, and the address right?")
        self._image: np.ndarray | None = None
        self._ended = False
        self.start()

    def run(self) -> None:
        due = time.monotonic()
        while self._film.grab():
            if time.monotonic() >= due:
                due = max(due + 1.0 / RATE, time.monotonic())
                self._image = self._film.retrieve()[1]
        self._ended = True

    def newest(self) -> Float[np.ndarray, "height width 3"] | None:
        """RGB, uint8, at most WIDEST wide; None: nothing since it was last asked.

        Raises:
            LinkError: The stream ended.
        """
        image, self._image = self._image, None
        if image is None:
            if self._ended:
                raise LinkError(f"{self._shown}: the stream ended, or stood still for {PATIENCE / 1e3:g} s")
            return None
        height, width = image.shape[:2]
        if width > WIDEST:
            size = (WIDEST, round(height * WIDEST / width))
            image = self._cv2.resize(image, size, interpolation=self._cv2.INTER_AREA)
        return image[..., ::-1]


def public(url: str) -> str:
    """Scheme and host of an address: what follows them may hold a password, and all who watch see this."""
    scheme, _, rest = url.partition("://")
    return f"{scheme}://{rest.partition('/')[0].partition('?')[0].rpartition('@')[2]}"


def camera_of(link: str) -> str | None:
    """The stream of the camera that a vehicle has at a link's URL, if it is known."""
    endpoint = find(link.partition("://")[0])
    return None if endpoint is None else endpoint.camera(Url.of(link, endpoint.options, "--link"))


def require_stream(url: str) -> str:
    """The address; raises ConfigError where it cannot be that of a stream."""
    try:
        parts = urlsplit(url)
        if parts.scheme in SCHEMES and parts.hostname and parts.port != 0:
            return url
    except ValueError:  # brackets that do not close, a port that is no number
        pass
    names = ", ".join(f"{name}://" for name in SCHEMES)
    raise ConfigError(f"--camera {public(url)}: expected the address of a stream: one of {names}, HOST, :PORT, /PATH")
