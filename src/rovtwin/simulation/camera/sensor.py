"""A camera as a sensor: which one, when it takes pictures, when they arrive, which are lost."""

import zlib
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float, Int
from pydantic import Field

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import NonNegative, Number, Positive, Share, Strict
from rovtwin.core.user_files.yamlfile import near
from rovtwin.simulation.camera.renderer import Renderer
from rovtwin.simulation.scene.scene import Scene
from rovtwin.vehicle.description.cameras import Camera, cameras_of
from rovtwin.vehicle.description.vehicle import Vehicle

_STREAM = 0xCA3E  # keeps these draws apart from others of the same seed


class CameraSection(Strict):
    """A camera that records while the vehicle moves."""

    scene: str = Field(description="a scene of the library or a file")
    camera: str | None = Field(None, description="name of the vehicle's camera, such as port.camera; default the first")
    rate_hz: Annotated[Number, Field(gt=0, le=120)] = Field(10.0, description="pictures a second")
    latency: Annotated[Number, Field(ge=0, le=2)] = Field(0.1, description="from a picture to its delivery [s]")
    jitter: NonNegative = Field(0.0, description="standard deviation of the latency; pictures stay in order [s]")
    dropped: Share = Field(0.0, description="share of the pictures that are lost")
    renderer: Literal["auto", "gl", "raycast"] = "auto"
    resolution_scale: Annotated[Number, Field(gt=0.02, le=2)] = Field(
        1.0, description="pixels a side over the camera's own: 0.5 is four times as fast"
    )
    exposure: Positive = Field(0.01, description="time that the shutter is open: moving pictures blur [s]")
    noise: NonNegative = Field(2.0, description="standard deviation of a pixel [grey levels of 255]")


@dataclass(frozen=True)
class Frames:
    """The pictures of a run.

    Attributes:
        taken: When each is taken, the middle of its exposure [s], increasing.
        delivered: When it arrives [s], non-decreasing: what is held up comes together with the next.
        number: Of the picture, counted with those that are lost: also the seed of its noise.
    """

    taken: Float[np.ndarray, " n"]
    delivered: Float[np.ndarray, " n"]
    number: Int[np.ndarray, " n"]


def frames(section: CameraSection, duration: float, seed: int = 0) -> Frames:
    """Times of the pictures that arrive in a run of a duration [s]; the same for the same seed and camera.

    The first is taken at 1 / rate, as with all sensors. What happens to a picture is drawn from its number, so that a
    longer run begins as the shorter one.
    """
    number = np.arange(int(np.floor(duration * section.rate_hz * (1 + 1e-12))))
    taken = (number + 1) / section.rate_hz
    camera = zlib.crc32((section.camera or "").encode())  # each camera loses its own
    chances = np.random.default_rng([seed, _STREAM, camera]).random((len(number), 2))
    # A latency that varies by a uniform draw of the same standard deviation, and never is negative.
    late = np.maximum(section.latency + section.jitter * np.sqrt(12.0) * (chances[:, 1] - 0.5), 0.0)
    delivered = np.maximum.accumulate(taken + late)  # what comes over one cable comes in order
    kept = chances[:, 0] >= section.dropped
    return Frames(taken[kept], delivered[kept], number[kept])


def camera_named(vehicle: Vehicle, name: str | None = None, scale: float = 1.0) -> Camera:
    """One of the vehicle's cameras, with `scale` times its pixels a side.

    Raises:
        ConfigError: It has none, or none of that name.
    """
    found = cameras_of(vehicle)
    if not found:
        raise ConfigError(f"{vehicle.where}: has no camera; give one under 'cameras:'")
    names = [camera.name for camera in found]
    if name is not None and name not in names:
        raise ConfigError(f"{vehicle.where}: found no camera '{name}'.{near(name, names)}")
    camera = found[0 if name is None else names.index(name)]
    return camera if scale == 1.0 else replace(camera, lens=camera.lens.scaled(scale))


def camera_renderer(section: CameraSection, scene: Scene, vehicle: Vehicle) -> Renderer:
    """The renderer that a camera section asks for."""
    camera = camera_named(vehicle, section.camera, section.resolution_scale)
    return Renderer(scene, camera, section.renderer, section.exposure, section.noise)
