"""What the twin's camera sees from where the twin is now, and the markers found in it.

It asks for the newest pose when it is ready for the next picture, so that it leaves out pictures rather than lag. What
is drawn is as large as the machine keeps up with: see `Sizes`. Pictures have neither motion blur nor noise: they are
for the operator, and the run's own (`runs.recording.filming`) are recorded apart.
"""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from rovtwin.console.pictures import RATE, Developer, Give, Picture, Wait
from rovtwin.core.arrays.rotations import rotation_from_euler
from rovtwin.core.errors import ConfigError
from rovtwin.core.vision import opencv
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.camera.renderer import Renderer
from rovtwin.simulation.camera.sensor import CameraSection, camera_named
from rovtwin.simulation.scene import load_scene
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.description.cameras import cameras_of

SLOWEST = 10.0  # pictures a second below which they are drawn smaller
SHARE = 0.4  # of one core's time, at most
WIDTHS = (640, 480, 384, 320, 256, 192)  # of pictures, the widest first [px]
FIRST = 3  # of WIDTHS: software OpenGL draws it in some 25 ms
WINDOW = 12  # pictures from which it is judged whether the machine keeps up
PATIENCE = 120  # pictures for which a size holds before a larger one is tried
STILL = 5e-4  # a camera that moved and turned by less sees the same [m, rad]
_WAIT = 0.02  # between two looks for a new pose [s]

Pose = tuple[float, np.ndarray]
"""Time [s] and eta, shape (6,)."""
Source = Callable[[], Pose | None]
"""Gives the newest true pose, None before the first; called in the camera's process, so it must pickle."""


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
        self._section, self._scene = section, load_scene(section.scene)
        self._camera = camera_named(vehicle, section.camera)
        self._developed = Developer(self._scene)
        self._sizes, self._drawn = Sizes(share / RATE, 0.9 / SLOWEST), {}
        self._made: deque[float] = deque(maxlen=WINDOW)
        self._costs: deque[float] = deque(maxlen=WINDOW)

    def picture(self, t: float, eta: Float[np.ndarray, "6"]) -> Picture:
        """From a pose."""
        renderer = self._renderer(self._sizes.width)
        begun, cost = time.monotonic(), time.process_time()
        image = renderer.image(eta[:3], rotation_from_euler(eta[3:]))
        picture = self._developed(t, image)
        cost = time.process_time() - cost
        self._sizes.took(cost, time.monotonic() - begun)
        self._made.append(time.monotonic())
        self._costs.append(cost)
        rate, share = self._lately()
        return replace(picture, rate=rate, share=share)

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


def watch(eye: Eye, source: Source, give: Give, wait: Wait) -> None:
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


@dataclass(frozen=True)
class Drawn:
    """A feed of what a twin's camera sees.

    Attributes:
        section: Of `section_of`.
        vehicle: That carries the camera.
        source: Of poses.
        share: Of one core's time that it may take.
    """

    section: CameraSection
    vehicle: Vehicle
    source: Source
    share: float = SHARE

    def __call__(self, give: Give, wait: Wait) -> None:
        watch(Eye(self.section, self.vehicle, self.share), self.source, give, wait)
