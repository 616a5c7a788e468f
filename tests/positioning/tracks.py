"""Drives past markers for tests and measurements: the square of thesis 6.3, and what a camera and a compass see."""

from dataclasses import dataclass

import numpy as np

from rovtwin.core.markers import Layout
from rovtwin.core.numerics import jax, jnp
from rovtwin.positioning.images.detection import Detections
from rovtwin.vehicle.description.cameras import Camera
from rovtwin.vehicle.physics.camera import R_DEVICE_C, lens_from, project

_project = jax.jit(project)
LENS = lens_from([1025, 1027], [987, 552], (1920, 1080), [0.31, 0.08, 0.0, 0.0, 0.03])  # thesis table 5.8, left


def camera(lens=LENS, y: float = -0.29) -> Camera:
    return Camera("camera", lens, np.array([0.25, y, -0.09]), R_DEVICE_C)


def wall(places=((-0.4, 0.65), (0.0, 0.9), (0.4, 0.75)), north: float = 4.0, size: float = 0.15, **more) -> Layout:
    """Markers on a wall that looks south, at (east, depth) [m]; by default three on the thesis's yellow box."""
    markers = [
        {"id": k, "size": size, "position": [north, east, depth], "faces": [-1, 0, 0], **more}
        for k, (east, depth) in enumerate(places)
    ]
    return Layout.model_validate({"markers": markers})


@dataclass(frozen=True)
class Drive:
    """Times [s] (n,), true position and velocity in n (n, 3), true and measured attitude R_nb (n, 3, 3)."""

    t: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    R_nb: np.ndarray
    R_meas: np.ndarray


def square(side: float = 1.0, speed: float = 0.15, rate: float = 10.0, seed: int = 0, noise: float = 1e-3) -> Drive:
    """Ahead, starboard, astern, port with rests between; the attitude sways by a degree and is measured with noise.

    Each seed has its own place, hand and phases of what sways, and its own noise.
    """
    rng = np.random.default_rng(seed)
    hand, aside = rng.choice([-1.0, 1.0]), rng.uniform(-0.1, 0.1, 2)
    phase, (heave, depth) = rng.uniform(0.0, 2.0 * np.pi, 3), rng.uniform(0.0, [2.0 * np.pi, 0.1])
    corners = np.array([[0, 0], [side, 0], [side, side], [0, side], [0, 0]]) + [0.8, -0.5 * side]
    corners = corners * [1.0, hand] + aside
    leg, rest = side / speed * 1.3, 3.0
    t = np.arange(0.0, 4 * leg + 5 * rest, 1.0 / rate)
    position, velocity = np.zeros((len(t), 3)), np.zeros((len(t), 3))
    for k, now in enumerate(t):
        number, within = divmod(now - rest, leg + rest)
        number = int(np.clip(number, 0, 3)) if now > rest else 0
        s = np.clip((within if now > rest else 0.0) / leg, 0.0, 1.0)
        if now - rest > 4 * (leg + rest):
            s = 1.0
        way = corners[number + 1] - corners[number]
        position[k, :2] = corners[number] + (10 * s**3 - 15 * s**4 + 6 * s**5) * way
        velocity[k, :2] = (30 * s**2 - 60 * s**3 + 30 * s**4) / leg * way
    position[:, 2] = 0.7 + depth + 0.02 * np.sin(0.5 * t + heave)
    velocity[:, 2] = 0.01 * np.cos(0.5 * t + heave)
    angles = 0.017 * np.sin(np.outer(t, [0.9, 0.7, 0.5]) + phase)
    return Drive(t, position, velocity, rotations(angles), rotations(angles + rng.normal(0, noise, angles.shape)))


def rotations(angles: np.ndarray) -> np.ndarray:
    """R_nb of zyx Euler angles, shapes (n, 3) -> (n, 3, 3)."""
    (cf, ct, cp), (sf, st, sp) = np.cos(angles).T, np.sin(angles).T
    rows = [
        [cp * ct, -sp * cf + cp * st * sf, sp * sf + cp * cf * st],
        [sp * ct, cp * cf + sf * st * sp, -cp * sf + st * sp * cf],
        [-st, ct * sf, ct * cf],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def corners_seen(layout: Layout, eye: Camera, p_nb, R_nb, rng, pixel: float = 0.2) -> Detections:
    """Projected corners with noise of those markers that are wholly in the image and turned to the camera."""
    R_nc = R_nb @ eye.R_bc
    p_nc = p_nb + R_nb @ eye.position
    if not layout.markers:
        return Detections.none()
    in_c = (np.stack([m.corners for m in layout.markers]) - p_nc) @ R_nc
    pixels = np.asarray(_project(eye.lens, jnp.asarray(in_c)))
    faces = [m.R_nm[:, 2] @ (p_nc - m.position) > 0 for m in layout.markers]
    inside = ((pixels > 5) & (pixels < np.array(eye.lens.size) - 6)).all(axis=(1, 2))
    keep = np.array(faces) & (in_c[..., 2] > 0.1).all(axis=1) & inside
    ids = np.array([m.id for m in layout.markers])[keep]
    return Detections(ids, pixels[keep] + rng.normal(0, pixel, pixels[keep].shape))
