"""Camera files: a calibrated lens by itself, with the keys that a camera has in a vehicle file."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import model_validator

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import near, parse, read_yaml
from rovtwin.vehicle.description.cameras import Camera, cameras_of, lens_of
from rovtwin.vehicle.description.schema import Camera as CameraSchema
from rovtwin.vehicle.description.vehicle import Vehicle
from rovtwin.vehicle.physics.camera import Lens


class CameraFile(CameraSchema):
    """A camera by itself."""

    @model_validator(mode="after")
    def _of_some_size(self) -> "CameraFile":
        if self.resolution is None:
            raise ValueError("resolution: missing; a lens is calibrated for one size of the image [px]")
        return self


def read_lens(path: str | Path) -> Lens:
    """The lens in a camera file.

    Raises:
        ConfigError: It cannot be read, or says something that cannot be.
    """
    return lens_of(parse(CameraFile, read_yaml(Path(path)), str(path)))


def choose(vehicle: Vehicle, names: list[str], lenses: list[Path]) -> list[Camera]:
    """Cameras of a vehicle by name, with lenses from files in place of the vehicle's.

    Args:
        vehicle: That carries them.
        names: Of the cameras; the end of a name does where it is the only one; empty: all.
        lenses: Camera files: none, or one for each camera.

    Raises:
        ConfigError: No such camera, or a number of files that does not fit.
    """
    there = cameras_of(vehicle)
    if not there:
        raise ConfigError(f"{vehicle.where}: has no camera; add one under 'cameras:'")
    chosen = [_named(there, name, vehicle.where) for name in names] or there
    if lenses and len(lenses) != len(chosen):
        raise ConfigError(
            f"found {len(lenses)} lens files for {len(chosen)} cameras ({', '.join(c.name for c in chosen)}), expected "
            "one for each, in this order"
        )
    if not lenses:
        return chosen
    return [replace(camera, lens=read_lens(path)) for camera, path in zip(chosen, lenses, strict=True)]


def _named(cameras: list[Camera], name: str, where: str) -> Camera:
    found = [c for c in cameras if c.name == name] or [c for c in cameras if name in c.name.split(".")]
    if len(found) != 1:
        known = [c.name for c in cameras]
        text = f"several: {', '.join(c.name for c in found)}" if found else f"none.{near(name, known)}"
        raise ConfigError(f"{where}: camera '{name}': found {text}")
    return found[0]


def as_data(name: str, lens: Lens, source: str) -> dict[str, Any]:
    """What a camera file says of a lens."""
    distortion = [round(float(k), 6) for k in lens.distortion]
    while len(distortion) > 5 and distortion[-1] == 0.0:
        distortion.pop()
    data = {
        "name": name,
        "resolution": list(lens.size),
        "focal_length": [round(float(f), 3) for f in lens.focal],
        "principal_point": [round(float(c), 3) for c in lens.principal],
        "distortion": distortion,
        "source": source,
    }
    if lens.port is not None:
        port = lens.port
        parts = {"distance": port.distance, "thickness": port.thickness, "glass": port.glass, "water": port.water}
        data["port"] = {key: round(float(value), 6) for key, value in parts.items()}
    return data
