"""Pictures for the operator, made in a process of their own: a feed gives them, whoever shows them asks for the newest.

The process runs below the autopilot and the web server in priority, and leaves out pictures rather than lag.
"""

import os
import signal
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from jaxtyping import UInt8

from rovtwin.core.errors import RovtwinError
from rovtwin.core.processes.child import end, started
from rovtwin.core.vision import opencv
from rovtwin.positioning.images.detection import Detector
from rovtwin.simulation.scene import Scene

RATE = 12.0  # pictures a second at most
NICE = 3  # below the autopilot and the web server; lower still, and a busy browser starves it
QUALITY = 80  # of JPEG
ENDING = 2.0  # a process that does not end by itself in this time is killed [s]


@dataclass(frozen=True)
class Picture:
    """What a camera sees.

    Attributes:
        t: Time at which it does [s].
        jpeg: The picture.
        size: Its width and height [px].
        markers: Those found in it that hang there: `{"id": 3, "corners": [[x, y], ...]}`, four corners from the top
            left one of the print, clockwise [px].
        rate: Pictures a second lately.
        share: Of one core's time that they took lately.
    """

    t: float
    jpeg: bytes
    size: tuple[int, int]
    markers: list[dict[str, Any]]
    rate: float = 0.0
    share: float = 0.0


Give = Callable[[Picture], None]
"""Takes a picture."""
Wait = Callable[[float], bool]
"""Waits some seconds; True when it is over."""
Feed = Callable[[Give, Wait], None]
"""Gives pictures until it is over; called in a process of its own, so it must pickle. Raises RovtwinError: no more."""


class Developer:
    """Finds markers in images, and makes JPEGs of them.

    Args:
        scene: Whose markers are looked for; None: none are.
    """

    def __init__(self, scene: Scene | None):
        self._cv2: Any = opencv("the camera's view")
        self._cv2.setNumThreads(1)
        self._detector = None if scene is None else Detector(scene.layout.dictionary)
        self._hung = set() if scene is None else {marker.id for marker in scene.layout.markers}

    def __call__(self, t: float, image: UInt8[np.ndarray, "height width 3"]) -> Picture:
        """The picture of a time [s] from RGB, uint8."""
        found = None if self._detector is None else self._detector(image)
        markers = [
            {"id": number, "corners": np.round(corners, 2).tolist()}
            for number, corners in ([] if found is None else zip(found.ids.tolist(), found.corners, strict=True))
            if number in self._hung
        ]
        options = [self._cv2.IMWRITE_JPEG_QUALITY, QUALITY]
        _, jpeg = self._cv2.imencode(".jpg", image[..., ::-1], options)
        return Picture(t, jpeg.tobytes(), (image.shape[1], image.shape[0]), markers)


class PictureProcess:
    """The process, seen from the web server. Leave it with `close`, or use it as a context manager."""

    def __init__(self, feed: Feed):
        self._process, self._pipe = started(_main, feed, name="rovtwin-camera", nice=NICE)
        self.why = ""
        """Why there are no pictures any more; empty while there may be."""

    @property
    def pid(self) -> int | None:
        """Of the process."""
        return self._process.pid

    def newest(self) -> Picture | None:
        """The newest picture since the last call; None: no new one, see `why`. Never waits for the process."""
        picture = None
        try:
            while not self.why and self._pipe.poll():
                kind, content = self._pipe.recv()
                if kind == "picture":
                    picture = content
                else:
                    self.why = content
        except (EOFError, OSError):
            self.why = "the camera's process ended, or was killed"
        return picture

    def close(self) -> None:
        """End the process; may be called twice."""
        self.why = self.why or "closed"
        end(self._process, self._pipe, ENDING)

    def __enter__(self) -> "PictureProcess":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _main(pipe: Connection, feed: Feed) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who started it: that closes the pipe
    # Mesa on a processor: threads of its own would take the other core from the autopilot.
    os.environ.setdefault("LP_NUM_THREADS", "0")
    try:
        feed(lambda picture: pipe.send(("picture", picture)), pipe.poll)
    except RovtwinError as error:
        _tell(pipe, str(error))
    except (EOFError, OSError):
        pass  # nobody is there to see
    except Exception as error:  # a mistake of ours: said there, where a user looks
        _tell(pipe, f"{type(error).__name__}: {error}")
        raise


def _tell(pipe: Connection, why: str) -> None:
    try:
        pipe.send(("none", why))
    except OSError:
        pass  # nobody is there to read it
