"""Where rays of a line end: on the floor, or on something flat that stands on it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from rovtwin.imaging.floor import FloorHits
from rovtwin.simulation.scene.surfaces import Rectangle

_NEAR = 0.02  # nothing is seen closer to the port [m]
_LIES = 1e-4  # how far what lies on something may be below it [m]


@dataclass(frozen=True)
class Hits(FloorHits):
    """What rays meet first, the floor or what stands on it.

    Attributes:
        standing: Number of the rectangle that is met, -1 for the floor.
        printed: Share 0 or 1 of its second spectrum: what is black of a marker.
    """

    standing: Int[np.ndarray, "*n"]
    printed: Float[np.ndarray, "*n"]


def beside(known: FloorHits, origin: Float[np.ndarray, "*n 3"], direction: Float[np.ndarray, "*n 3"]) -> FloorHits:
    """Of rays that end within a few centimetres of others: on the planes that touch the floor at those.

    On hills whose radius is 10 m a plane is off by 5 um at 1 cm.
    """
    way = np.sum((known.point - origin) * known.normal, -1) / np.sum(direction * known.normal, -1)
    return FloorHits(way, origin + way[..., None] * direction, known.normal)


def first_hits(
    floor: FloorHits,
    rectangles: list[Rectangle],
    origin: Float[np.ndarray, "*n 3"],
    direction: Float[np.ndarray, "*n 3"],
    longest: float,
) -> Hits:
    """What rays meet first: the floor, or a rectangle that stands on it."""
    way, normal = floor.way, floor.normal
    standing, printed = np.full(way.shape, -1), np.zeros(way.shape, np.float32)
    for k in _within(rectangles, origin, origin + np.where(np.isnan(way), longest, way)[..., None] * direction):
        t, black, towards = _of_rectangle(rectangles[k], origin, direction)
        # A print lies in the face that carries it and is seen before it; so does a plate that lies on the floor.
        first = (t < np.where(np.isnan(way), longest, way) + _LIES) & (t > _NEAR)
        way, standing = np.where(first, t, way), np.where(first, k, standing)
        printed, normal = np.where(first, black, printed), np.where(first[..., None], towards, normal)
    return Hits(way, origin + way[..., None] * direction, normal, standing, printed)


def _within(rectangles: list[Rectangle], begin: Float[np.ndarray, "*n 3"], end: Float[np.ndarray, "*n 3"]) -> list[int]:
    """Numbers of the rectangles that come into the box about these rays."""
    both = np.concatenate([begin.reshape(-1, 3), end.reshape(-1, 3)])
    low, high = both.min(axis=0) - _LIES, both.max(axis=0) + _LIES
    return [
        k
        for k, one in enumerate(rectangles)
        if (one.corners.max(axis=0) >= low).all() and (one.corners.min(axis=0) <= high).all()
    ]


def _of_rectangle(
    one: Rectangle, origin: Float[np.ndarray, "*n 3"], direction: Float[np.ndarray, "*n 3"]
) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"], Float[np.ndarray, "3"]]:
    """Way to it (inf: missed), whether its print is black there, and its normal towards the water."""
    normal = one.normal
    facing = direction @ normal
    seen = (facing < -1e-9) | (one.both & (facing > 1e-9))
    way = np.where(seen, ((one.corner - origin) @ normal) / np.where(seen, facing, 1.0), np.inf)
    at = origin + np.where(np.isfinite(way), way, 0.0)[..., None] * direction - one.corner
    u, v = (at @ edge / (edge @ edge) for edge in (one.right, one.up))
    inside = seen & (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
    black = np.zeros(way.shape)
    if one.print is not None:
        count = len(one.print)
        column = np.clip(np.floor(u * count), 0, count - 1).astype(int)
        row = np.clip(count - 1 - np.floor(v * count), 0, count - 1).astype(int)
        black = np.where(facing < 0, 1.0 - one.print[row, column], 0.0)
    upward = -normal if one.both and float(np.mean(facing)) > 0 else normal
    return np.where(inside, way, np.inf), black, upward
