"""The cameras of a vehicle: of each its lens and where it sits."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.vehicle.description import schema
from rovtwin.vehicle.description.vehicle import Vehicle
from rovtwin.vehicle.physics.camera import R_DEVICE_C, Lens, Port, lens_from


@dataclass(frozen=True)
class Camera:
    """A lens and where it sits.

    Attributes:
        name: With the names of the parts it sits in, `port.camera`.
        lens: Its parameters.
        position: Centre of projection in b at CO [m].
        R_bc: Maps c to b.
    """

    name: str
    lens: Lens
    position: Float[np.ndarray, "3"]
    R_bc: Float[np.ndarray, "3 3"]


def cameras_of(vehicle: Vehicle) -> list[Camera]:
    """The vehicle's cameras, in the order of the file."""
    return [
        Camera(m.name, lens_of(m.item), m.position, m.rotation @ R_DEVICE_C)
        for m in vehicle.cameras
        if isinstance(m.item, schema.Camera)
    ]


def lens_of(camera: schema.Camera) -> Lens:
    """Of a description; without a resolution, 1920 x 1080, without a principal point, the middle of the image."""
    width, height = camera.resolution or (1920, 1080)
    principal = camera.principal_point or [0.5 * (width - 1), 0.5 * (height - 1)]
    port = camera.port and Port.of(camera.port.distance, camera.port.thickness, camera.port.glass, camera.port.water)
    return lens_from(camera.focal_length, principal, (width, height), camera.distortion, port)
