"""Where a vehicle touched floor and walls during a run, or came out of the water in a test: found after it.

The geometry is that of the plant (`vehicle.physics.boundaries`): corners of the hull against planes, elements of
buoyancy against the still surface. The true pose of every control tick is looked at, so that the compiled loop has
nothing to do with it; a touch shorter than a control period can be missed.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.numerics import as_array, jax
from rovtwin.runs.scoring.scores import Flown
from rovtwin.simulation.environment.world import World
from rovtwin.vehicle import Model

TOGETHER = 1.0  # touches with less than that between them are reported as one [s]
LISTED = 3  # touches of one thing that are reported by their times, the longest first
FLOOR = "the floor"
FIT = "identify knows no such force and takes it for the vehicle's own: test in more water, or with shorter steps"


def touched(flown: Flown, model: Model, world: World, test: bool) -> list[str]:
    """A line for each thing that was touched, with times and durations.

    Args:
        flown: Uses `pose` and `control_dt`.
        model: The vehicle as it truly is, for its hull.
        world: Floor, walls and surface.
        test: Whether the log is for `identify`: then coming out of the water counts, too.
    """
    if flown.pose is None:
        return []
    reaches = dict(beyond_walls(flown.pose, model, world))
    if test and world.surface is not None and world.waves is None:
        reaches["the surface"] = _above(flown.pose, model, float(world.surface))
    lines = []
    for name, beyond in reaches.items():
        if found := _stretches(beyond > 0.0, flown.control_dt):
            verb = "came out of the water" if name == "the surface" else f"touched {name}"
            lines.append(f"{verb} {_times(found)}" + (f"; {FIT}" if test else ""))
    return lines


def beyond_walls(
    pose: Float[np.ndarray, "m 6"], model: Model, world: World
) -> Iterator[tuple[str, Float[np.ndarray, " m"]]]:
    """Name of each of walls and floor, and how far the hull's outermost corner is beyond it at each pose [m]."""
    if world.walls is None:
        return
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_euler("ZYX", pose[:, 5:2:-1]).as_matrix()
    corners = np.asarray(model.hull.corners)
    normals, offsets = np.asarray(world.walls.normals), np.asarray(world.walls.offsets)
    for k, (normal, offset) in enumerate(zip(normals, offsets, strict=True)):
        if world.relief is not None and k == len(normals) - 1:
            walls: Any = jax.vmap(lambda at: world.bounds_at(at)[0])(as_array(pose[:, :3]))
            normal, offset = np.asarray(walls.normals)[:, k], np.asarray(walls.offsets)[:, k]
        seen = np.einsum("mj,mji->mi", np.broadcast_to(normal, (len(pose), 3)), turned)
        yield _name(normal), np.sum(pose[:, :3] * normal, axis=1) - offset + (seen @ corners.T).max(axis=1)


def _name(normal: Float[np.ndarray, "*axes 3"]) -> str:
    """Of a plane by its outward normal, or of many of a floor that is not level."""
    if normal.ndim > 1 or normal[2] > 0.5:
        return FLOOR
    side = {(1, 0): "northern", (-1, 0): "southern", (0, 1): "eastern", (0, -1): "western"}
    return f"the {side[(round(float(normal[0])), round(float(normal[1])))]} wall"


def _above(pose: Float[np.ndarray, "m 6"], model: Model, surface: float) -> Float[np.ndarray, " m"]:
    """How far the uppermost element of buoyancy is out of the water [m]."""
    from scipy.spatial.transform import Rotation

    down = Rotation.from_euler("ZYX", pose[:, 5:2:-1]).as_matrix()[:, 2]
    elements = np.asarray(model.center_of_buoyancy) + np.asarray(model.hull.offsets)
    return surface - (pose[:, 2] + (down @ elements.T - np.asarray(model.hull.reach)).min(axis=1))


def _stretches(touching: Bool[np.ndarray, " m"], dt: float) -> list[tuple[float, float]]:
    """Start and duration [s] of each touch."""
    k = np.flatnonzero(touching)
    if not k.size:
        return []
    parts = np.split(k, np.flatnonzero(np.diff(k) * dt > TOGETHER) + 1)
    return [(part[0] * dt, (part[-1] - part[0] + 1) * dt) for part in parts]


def _times(found: list[tuple[float, float]]) -> str:
    """As in `at 27.3 s for 0.2 s and at 176.5 s for 0.1 s`."""
    listed = sorted(sorted(found, key=lambda one: -one[1])[:LISTED])
    times = [f"at {start:.1f} s for {max(lasted, 0.1):.1f} s" for start, lasted in listed]
    if len(found) > LISTED:
        return f"{len(found)} times, longest {', '.join(times)}"
    return " and ".join(times)
