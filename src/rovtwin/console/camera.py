"""The camera's process: what the twin's camera sees from where the twin is now, and the markers found in it.

It asks for the newest pose when it is ready for the next picture, so that it leaves out pictures rather than lag. What
is drawn is as large as the machine keeps up with: see `Sizes`. Pictures have neither motion blur nor noise: they are
for the operator, and the run's own (`scenario.filming`) are recorded apart.
"""

import multiprocessing
import os
import signal
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from rovtwin.core.errors import ConfigError, RovtwinError
from rovtwin.core.frames import rotation_from_euler
from rovtwin.core.numerics import jax
from rovtwin.core.vision import opencv
from rovtwin.positioning.detection import Detector
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.camera.renderer import Renderer
from rovtwin.simulation.camera.sensor import CameraSection, camera_named
from rovtwin.simulation.scene import load_scene
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.camera import cameras_of

RATE = 12.0  # pictures a second at most
SLOWEST = 10.0  # pictures a second below which they are drawn smaller
SHARE = 0.4  # of one core's time, at most
NICE = 3  # below the autopilot and the web server; lower still, and a busy browser starves it
WIDTHS = (640, 480, 384, 320, 256, 192)  # of pictures, the widest first [px]
FIRST = 3  # of WIDTHS: software OpenGL draws it in some 25 ms
QUALITY = 80  # of JPEG
WINDOW = 12  # pictures from which it is judged whether the machine keeps up
PATIENCE = 120  # pictures for which a size holds before a larger one is tried
STILL = 5e-4  # a camera that moved and turned by less sees the same [m, rad]
ENDING = 2.0  # a process that does not end by itself in this time is killed [s]
_WAIT = 0.02  # between two looks for a new pose [s]

Pose = tuple[float, np.ndarray]
"""Time [s] and eta, shape (6,)."""
Source = Callable[[], Pose | None]
"""Gives the newest true pose, None before the first; called in the camera's process, so it must pickle."""

_rotation = jax.jit(rotation_from_euler)


@dataclass(frozen=True)
class Picture:
    """What the camera sees.

    Attributes:
        t: Time of the vehicle at which it does [s].
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


def section_of(scenario: Scenario, vehicle: Vehicle, scene: str | None = None) -> CameraSection:
    """Which camera is shown: the scenario's first, or in a given scene the vehicle's first.

    Raises:
        ConfigError: There is none; says why, and what to do.
    """
    if not cameras_of(vehicle):
        raise ConfigError(f"{vehicle.name} has no camera; give it one under 'cameras:' of its file")
    opencv("the camera's view")
    if scene is not None:
        return CameraSection.model_validate({"scene": scene})
    if not scenario.cameras:
        raise ConfigError(
            f"{scenario.name}: nothing is known of what the camera sees; add 'cameras: [{{scene: pool}}]' to the "
            "scenario, or start with --set 'cameras=[{scene: pool}]'"
        )
    return scenario.cameras[0]


class Sizes:
    """Which of some widths pictures are drawn in: the largest that costs no more than allowed.

    Smaller at once when pictures come too slowly or cost too much; larger again after PATIENCE pictures when what they
    cost, times the pixels, would still do.

    Args:
        cost: Time of a core that a picture may take [s].
        time: Time that may pass while it is made [s].
    """

    def __init__(self, cost: float, time: float, widths: tuple[int, ...] = WIDTHS, first: int = FIRST):
        self._most, self._widths, self._at = np.array([cost, time]), widths, first
        self._taken: deque[tuple[float, float]] = deque(maxlen=WINDOW)
        self._held, self._wait = 0, PATIENCE

    @property
    def width(self) -> int:
        """Of the next picture [px]."""
        return self._widths[self._at]

    def took(self, cost: float, time: float) -> None:
        """What the last picture took."""
        self._taken.append((cost, time))
        self._held += 1
        if len(self._taken) < WINDOW:
            return
        load = np.median(np.array(self._taken), axis=0) / self._most
        if load.max() > 1.0 and self._at < len(self._widths) - 1:
            # A size that did not last is tried again later each time.
            self._wait = min(2 * self._wait, 50 * PATIENCE) if self._held < 2 * PATIENCE else PATIENCE
            self._change(1)
        elif self._at > 0 and self._held >= self._wait:
            if load.max() * (self._widths[self._at - 1] / self.width) ** 2 < 0.9:
                self._change(-1)

    def _change(self, by: int) -> None:
        self._at += by
        self._held = 0
        self._taken.clear()


class Eye:
    """Draws pictures and looks for markers in them.

    Args:
        section: Camera, scene and renderer.
        vehicle: That carries the camera.
        share: Of one core's time that it may take.

    Raises:
        ConfigError: A camera, scene or library is not there.
    """

    def __init__(self, section: CameraSection, vehicle: Vehicle, share: float = SHARE):
        self._cv2: Any = opencv("the camera's view")
        self._cv2.setNumThreads(1)
        self._section, self._scene = section, load_scene(section.scene)
        self._camera = camera_named(vehicle, section.camera)
        layout = self._scene.layout
        self._detector, self._hung = Detector(layout.dictionary), {marker.id for marker in layout.markers}
        self._sizes, self._drawn = Sizes(share / RATE, 0.9 / SLOWEST), {}
        self._made: deque[float] = deque(maxlen=WINDOW)
        self._costs: deque[float] = deque(maxlen=WINDOW)

    def picture(self, t: float, eta: np.ndarray) -> Picture:
        """From a pose, shape (6,)."""
        renderer = self._renderer(self._sizes.width)
        begun, cost = time.monotonic(), time.process_time()
        image = renderer.image(eta[:3], np.asarray(_rotation(np.asarray(eta[3:], float))))
        found = self._detector(image)
        markers = [
            {"id": number, "corners": np.round(corners, 2).tolist()}
            for number, corners in zip(found.ids.tolist(), found.corners, strict=True)
            if number in self._hung
        ]
        options = [self._cv2.IMWRITE_JPEG_QUALITY, QUALITY]
        _, jpeg = self._cv2.imencode(".jpg", image[..., ::-1], options)
        cost = time.process_time() - cost
        self._sizes.took(cost, time.monotonic() - begun)
        self._made.append(time.monotonic())
        self._costs.append(cost)
        return Picture(t, jpeg.tobytes(), (image.shape[1], image.shape[0]), markers, *self._lately())

    def _lately(self) -> tuple[float, float]:
        span = self._made[-1] - self._made[0]
        if not span:
            return 0.0, 0.0
        return (len(self._made) - 1) / span, (sum(self._costs) - self._costs[0]) / span

    def _renderer(self, width: int) -> Renderer:
        if width not in self._drawn:
            camera = replace(self._camera, lens=self._camera.lens.scaled(width / self._camera.lens.size[0]))
            self._drawn[width] = Renderer(self._scene, camera, self._section.renderer)
            self._drawn[width].image(np.array([0.0, 0.0, 0.5]), np.eye(3))  # compiles what it needs
        return self._drawn[width]


def watch(eye: Eye, source: Source, give: Callable[[Picture], None], wait: Callable[[float], bool]) -> None:
    """Picture after picture, at most RATE a second, of the newest pose; none while there is no newer one.

    Args:
        eye: Draws.
        source: Of poses.
        give: Takes a picture.
        wait: Waits some seconds; True when it is over.
    """
    due, seen, last = time.monotonic(), None, None
    while not wait(max(due - time.monotonic(), 0.0)):
        pose = source()
        if pose is None or (seen is not None and pose[0] == seen[0]):
            due = time.monotonic() + _WAIT
            continue
        due = max(due + 1.0 / RATE, time.monotonic())
        if last is None or seen is None or np.abs(pose[1] - seen[1]).max() > STILL:
            seen, last = pose, eye.picture(*pose)
        else:
            seen, last = (pose[0], seen[1]), replace(last, t=pose[0])
        give(last)


class CameraProcess:
    """The process, seen from the web server. Leave it with `close`, or use it as a context manager.

    Args:
        section: Of `section_of`.
        vehicle: That carries the camera.
        source: Of poses.
        share: Of one core's time that it may take.
    """

    def __init__(self, section: CameraSection, vehicle: Vehicle, source: Source, share: float = SHARE):
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=_main, args=(theirs, section, vehicle, source, share), daemon=True, name="rovtwin-camera"
        )
        self._process.start()
        theirs.close()  # or its end would never be seen closed here
        self.why = ""
        """Why there are no pictures any more; empty while there may be."""

    @property
    def pid(self) -> int | None:
        """Of the process."""
        return self._process.pid

    def fileno(self) -> int:
        """Readable when there is something new: for `loop.add_reader`."""
        return self._pipe.fileno()

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
        self._pipe.close()
        self._process.join(ENDING)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()

    def __enter__(self) -> "CameraProcess":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _main(pipe: Connection, section: CameraSection, vehicle: Vehicle, source: Source, share: float) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who started it: that closes the pipe
    os.nice(NICE)
    # Mesa on a processor: threads of its own would take the other core from the autopilot.
    os.environ.setdefault("LP_NUM_THREADS", "0")
    try:
        watch(Eye(section, vehicle, share), source, lambda picture: pipe.send(("picture", picture)), pipe.poll)
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
