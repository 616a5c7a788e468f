"""One face to both renderers: a picture from where the vehicle is."""

from collections.abc import Callable
from typing import Literal

import numpy as np
from jaxtyping import Float, UInt8

from rovtwin.core.errors import ConfigError
from rovtwin.simulation.camera.image import moved, noisy, toned
from rovtwin.simulation.camera.lighting import Lighting, lighting
from rovtwin.simulation.camera.rays import Rays, rays_of
from rovtwin.simulation.scene.scene import Scene
from rovtwin.vehicle.description.cameras import Camera

Kind = Literal["auto", "raycast", "gl"]
_Draw = Callable[[Lighting, Float[np.ndarray, "3 3"]], tuple[Float[np.ndarray, "H W 3"], Float[np.ndarray, "H W"]]]
_HIGHEST = 0.02  # a camera above the water sees what it would see this far below its surface [m]
_SHIFT = 1.5  # between the shifted pictures of a blur, at most [px]
_SHIFTS = (3, 9)


class Renderer:
    """Pictures of a scene through one camera.

    Attributes:
        kind: "raycast" or "gl".
        exposure: Time for which the shutter is open [s].
        noise: Standard deviation of a pixel with a seed [grey levels].
    """

    def __init__(self, scene: Scene, camera: Camera, kind: Kind = "auto", exposure: float = 0.01, noise: float = 2.0):
        self.scene, self.camera, self.exposure, self.noise = scene, camera, exposure, noise
        self.rays = rays_of(camera.lens)
        if not np.isfinite(self.rays.direction).all():
            numbers = np.round(np.asarray(camera.lens.distortion), 4).tolist()
            raise ConfigError(
                f"camera {camera.name}: its distortion {numbers} leads no ray to some pixels of "
                f"{camera.lens.size[0]} x {camera.lens.size[1]}; calibrate again, or crop"
            )
        self.kind, self._draw = _backend(scene, camera, self.rays, kind)

    def image(
        self, position: object, R_nb: object, velocity: object = None, seed: int | None = None
    ) -> UInt8[np.ndarray, "H W 3"]:
        """The picture, RGB, uint8.

        Args:
            position: CO of the vehicle in n [m].
            R_nb: Its attitude.
            velocity: nu in b at CO [m/s, rad/s], or its first three: blurs by motion. None: none.
            seed: Of the noise; None: none.
        """
        position, R_nb = np.asarray(position, float), np.asarray(R_nb, float)
        colour, way = self.brightness(position, R_nb)
        if velocity is not None:
            colour = self._blurred(colour, way, np.asarray(velocity, float))
        image = toned(colour)
        return image if seed is None else noisy(image, self.noise, seed)

    def brightness(
        self, position: Float[np.ndarray, "3"], R_nb: Float[np.ndarray, "3 3"]
    ) -> tuple[Float[np.ndarray, "H W 3"], Float[np.ndarray, "H W"]]:
        """Linear, 1 is full scale, and the way through the water to what is seen [m]."""
        eye = position + R_nb @ self.camera.position
        eye[2] = max(eye[2], _HIGHEST)
        light = lighting(self.scene, position, R_nb, eye)
        return self._draw(light, R_nb @ self.camera.R_bc)

    def _blurred(
        self, colour: Float[np.ndarray, "H W 3"], way: Float[np.ndarray, "H W"], velocity: Float[np.ndarray, " _"]
    ) -> Float[np.ndarray, "H W 3"]:
        flow = self.exposure * image_flow(self.rays, self.camera, way, velocity)
        most = float(np.quantile(np.linalg.norm(flow[::8, ::8], axis=-1), 0.98))
        if most < 0.3:
            return colour
        return moved(flow, colour, int(np.clip(np.ceil(most / _SHIFT), *_SHIFTS)) | 1)


def image_flow(
    rays: Rays, camera: Camera, way: Float[np.ndarray, "H W"], velocity: Float[np.ndarray, " _"]
) -> Float[np.ndarray, "H W 2"]:
    """How fast what a pixel shows moves through the picture [px/s] of a still scene.

    Args:
        rays: Of the camera's lens.
        camera: Where it sits.
        way: To what is seen [m].
        velocity: nu in b at CO, or its first three.
    """
    nu = np.zeros(6)
    nu[: len(velocity)] = velocity
    v = camera.R_bc.T @ (nu[:3] + np.cross(nu[3:], camera.position))
    omega = camera.R_bc.T @ nu[3:]
    d = rays.direction
    turning = -(v.astype(np.float32) / np.maximum(way, 0.05)[..., None]) - np.cross(omega.astype(np.float32), d)
    # d_dot = flow_x d_x + flow_y d_y, with the rays' slopes per pixel: least squares, 2 x 2.
    a, b = rays.along
    aa, ab, bb = (a * a).sum(-1), (a * b).sum(-1), (b * b).sum(-1)
    p, q = (a * turning).sum(-1), (b * turning).sum(-1)
    determinant = np.maximum(aa * bb - ab * ab, 1e-20)
    return np.stack([(bb * p - ab * q) / determinant, (aa * q - ab * p) / determinant], axis=-1).astype(np.float32)


def _backend(scene: Scene, camera: Camera, rays: Rays, kind: Kind) -> tuple[str, _Draw]:
    if kind not in ("auto", "gl", "raycast"):
        raise ConfigError(f"renderer: found {kind!r}, expected auto, gl or raycast")
    if kind != "raycast":
        from rovtwin.simulation.camera.gl import gl_drawer

        try:
            return "gl", gl_drawer(scene, rays, camera.name).draw
        except ConfigError as error:
            if kind == "gl":
                raise
            without_gl = error
    from rovtwin.simulation.camera.raycast import Raycaster

    try:
        return "raycast", Raycaster(scene, rays).draw
    except ConfigError as error:
        raise error if kind == "raycast" else ConfigError(f"{error}\n{without_gl}") from None


def renderer(scene: Scene, camera: Camera, kind: Kind = "auto", exposure: float = 0.01, noise: float = 2.0) -> Renderer:
    """A renderer of the scene through the camera: "gl" where the machine has it, else "raycast"."""
    return Renderer(scene, camera, kind, exposure, noise)
