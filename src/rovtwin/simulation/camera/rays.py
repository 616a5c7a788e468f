"""Where every pixel of a camera looks; computed once per lens."""

from functools import lru_cache

import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import jax, jnp
from rovtwin.vehicle.physics.camera import Lens, Port, lens_from, seen_ray

_ROWS = 64


class Rays:
    """Of all pixels of a lens, in c.

    Attributes:
        point: Where they enter the water [m], shape (H, W, 3), or (1, 1, 3) where all pass through one point.
        direction: Unit, shape (H, W, 3); no number where the lens's model leads no ray to a pixel.
        along: Change of direction per pixel to the right and down.
        point_along: The same of the point, or None.
    """

    def __init__(self, point: Float[np.ndarray, "_ _ 3"], direction: Float[np.ndarray, "H W 3"]):
        self.point, self.direction = point, direction
        self.along = _slope(direction, 1), _slope(direction, 0)
        self.point_along = None if point.shape[0] == 1 else (_slope(point, 1), _slope(point, 0))


def _slope(field: Float[np.ndarray, "H W 3"], axis: int) -> Float[np.ndarray, "H W 3"]:
    """Change per pixel along columns (axis 1) or rows (axis 0)."""
    return np.gradient(field, axis=axis).astype(np.float32) if min(field.shape[:2]) > 1 else np.zeros_like(field)


def rays_of(lens: Lens) -> Rays:
    """Of a lens; the same lens is computed once."""
    port = None
    if lens.port is not None:
        port = tuple(float(x) for x in (lens.port.distance, lens.port.thickness, lens.port.glass, lens.port.water))
    numbers = tuple(np.concatenate([lens.focal, lens.principal, lens.distortion]).tolist())
    return _rays(numbers, lens.size, port)


@lru_cache(maxsize=4)
def _rays(numbers: tuple[float, ...], size: tuple[int, int], port: tuple[float, ...] | None) -> Rays:
    lens = lens_from(numbers[:2], numbers[2:4], size, numbers[4:], None if port is None else Port.of(*port))
    width, height = size

    strip = jax.jit(lambda pixels: seen_ray(lens, pixels))
    points, directions = [], []
    for start in range(0, height, _ROWS):
        rows = jnp.arange(start, start + _ROWS, dtype=float)
        pixels = jnp.stack(jnp.meshgrid(jnp.arange(width, dtype=float), rows), axis=-1)
        point, direction = strip(pixels)
        points.append(np.asarray(point, np.float32))
        directions.append(np.asarray(direction, np.float32))
    direction = np.concatenate(directions)[:height]
    point = np.zeros((1, 1, 3), np.float32) if port is None else np.concatenate(points)[:height]
    return Rays(point, direction)
