"""Pictures of printed markers through the exact lens, drawn here: each pixel is the mean of rays that meet a marker."""

import cv2
import numpy as np

from rovtwin.core.markers import Layout
from rovtwin.core.numerics import jax, jnp
from rovtwin.vehicle.physics.camera import Lens, project, ray

_ray, _project = jax.jit(ray), jax.jit(project)
WATER, INK, PAPER, MARGIN = 120.0, 25.0, 225.0, 1.34  # grey levels; side of the print over that of the marker


def picture(
    layout: Layout, lens: Lens, p_nc: np.ndarray, R_nc: np.ndarray, seed: int = 0, noise: float = 2.0, samples: int = 4
) -> np.ndarray:
    """What a camera at p_nc [m] with axes R_nc sees, uint8 (height, width); blurred a little, with noise."""
    width, height = lens.size
    image = np.full((height, width), WATER)
    for marker in sorted(layout.markers, key=lambda m: -np.linalg.norm(m.position - p_nc)):
        edge = (marker.corners - marker.position) * MARGIN + marker.position
        p_c = (edge - p_nc) @ R_nc
        if (p_c[:, 2] < 0.05).any() or (marker.R_nm[:, 2] @ (p_nc - marker.position)) <= 0:
            continue
        pixels = np.asarray(_project(lens, jnp.asarray(p_c)))
        low = np.maximum(np.floor(pixels.min(axis=0)).astype(int) - 3, 0)
        high = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + 4, [width, height])
        if not np.isfinite(pixels).all() or (high <= low).any():
            continue
        _draw(image, low, high, marker, layout.dictionary, lens, p_nc, R_nc, samples)
    image = cv2.GaussianBlur(image, (0, 0), 0.6)
    image += np.random.default_rng(seed).normal(0.0, noise, image.shape)
    return np.clip(np.round(image), 0, 255).astype(np.uint8)


def _draw(image, low, high, marker, dictionary, lens, p_nc, R_nc, samples):
    (x0, y0), (x1, y1) = low, high
    step = (np.arange(samples) + 0.5) / samples - 0.5
    xs, ys = (np.arange(a, b)[:, None] + step for a, b in ((x0, x1), (y0, y1)))
    grid = np.stack(np.meshgrid(xs.ravel(), ys.ravel()), axis=-1).reshape(-1, 2)
    padded = np.concatenate([grid, np.repeat(grid[:1], -len(grid) % 65536, axis=0)])  # few shapes, few compilations
    parts = [_ray(lens, jnp.asarray(part)) for part in padded.reshape(-1, 65536, 2)]
    point = np.concatenate([np.asarray(p) for p, _ in parts])[: len(grid)]
    direction = np.concatenate([np.asarray(d) for _, d in parts])[: len(grid)]
    to_m = R_nc.T @ marker.R_nm  # vectors in c, as rows, to m
    origin = (p_nc - np.array(marker.position)) @ marker.R_nm + point @ to_m
    along = direction @ to_m
    hit = origin + along * (-origin[:, 2] / along[:, 2])[:, None]
    cells = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    bits = cells.markerSize + 2
    code = cv2.aruco.generateImageMarker(cells, marker.id, bits)
    column, row = np.floor((hit[:, :2] / marker.size * [1, -1] + 0.5) * bits).astype(int).T
    inside = (column >= 0) & (column < bits) & (row >= 0) & (row < bits)
    grey = np.full(len(grid), PAPER)
    grey[inside] = np.where(code[row[inside], column[inside]] > 0, PAPER, INK)
    on_print = (np.abs(hit[:, :2]) <= 0.5 * MARGIN * marker.size).all(axis=1) & (along[:, 2] < 0)
    shape = (y1 - y0, samples, x1 - x0, samples)
    weight = on_print.reshape(shape).mean(axis=(1, 3))
    colour = (grey * on_print).reshape(shape).mean(axis=(1, 3))
    image[y0:y1, x0:x1] = colour + (1 - weight) * image[y0:y1, x0:x1]
