"""A picture of the vehicle from outside, as a diver beside it would take it."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, UInt8

from rovtwin.core.arrays.rotations import turn_about_z
from rovtwin.simulation.camera.renderer import Renderer
from rovtwin.simulation.scene.bodies import vehicle_meshes
from rovtwin.simulation.scene.scene import Scene
from rovtwin.vehicle.description.cameras import Camera
from rovtwin.vehicle.description.vehicle import Vehicle
from rovtwin.vehicle.physics.camera import R_DEVICE_C, lens_from

_ROOM = 0.15  # from walls, floor and surface [m]


def outside_view(
    scene: Scene,
    vehicle: Vehicle,
    position: object,
    R_nb: object,
    *,
    distance: float = 1.9,
    bearing_deg: float = 145.0,
    elevation_deg: float = 14.0,
    size: tuple[int, int] = (1280, 720),
) -> UInt8[np.ndarray, "H W 3"]:
    """RGB, uint8, with the vehicle in its middle.

    Args:
        scene: Around it.
        vehicle: Which one.
        position: CO in n [m].
        R_nb: Attitude.
        distance: Of the camera from CO [m]; less where a wall is in the way.
        bearing_deg: Where the camera is, from the bow over starboard.
        elevation_deg: How far above the vehicle.
        size: Width and height [px].
    """
    position, R_nb = np.asarray(position, float), np.asarray(R_nb, float)
    heading = np.arctan2(R_nb[1, 0], R_nb[0, 0]) + np.radians(bearing_deg)
    level, up = np.cos(np.radians(elevation_deg)), np.sin(np.radians(elevation_deg))
    eye = position + distance * np.array([level * np.cos(heading), level * np.sin(heading), -up])
    eye = _inside(scene, eye)
    R_nd = _towards(position - eye, heading)
    width, height = size
    lens = lens_from([0.8 * width] * 2, [0.5 * (width - 1), 0.5 * (height - 1)], size)
    camera = Camera("outside", lens, R_nb.T @ (eye - position), R_nb.T @ R_nd @ R_DEVICE_C)
    around = replace(scene, bodies=vehicle_meshes(vehicle, position, R_nb))
    return Renderer(around, camera, "gl").image(position, R_nb)


def _towards(way: Float[np.ndarray, "3"], heading: float) -> Float[np.ndarray, "3 3"]:
    """Attitude of a device (x forward, y right, z down) that looks along a way, level.

    Straight up or down, where every side is level, its right is that of who looks from that heading [rad]; where there
    is no way at all, it looks down.
    """
    length = np.linalg.norm(way)
    ahead = way / length if length > 1e-6 else np.array([0.0, 0.0, 1.0])
    right = np.cross([0.0, 0.0, 1.0], ahead)
    if np.linalg.norm(right) < 1e-6:
        right = np.array([np.sin(heading), -np.cos(heading), 0.0])
    right /= np.linalg.norm(right)
    return np.column_stack([ahead, right, np.cross(ahead, right)])


def _inside(scene: Scene, eye: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """The point, moved into the water."""
    tank = scene.file.tank
    if tank is None:
        return np.array([*eye[:2], np.clip(eye[2], _ROOM, max(scene.depth - 3 * _ROOM, _ROOM))])
    R = turn_about_z(np.radians(tank.heading_deg))
    local = R.T @ (eye - tank.position)
    half = np.maximum(0.5 * np.array([tank.length, tank.width]) - _ROOM, 0.0)
    local[:2] = np.clip(local[:2], -half, half)
    local[2] = np.clip(local[2], min(_ROOM, 0.5 * tank.depth), max(tank.depth - _ROOM, 0.5 * tank.depth))
    return R @ local + tank.position
