"""The floor that rays meet: its depth by place, and where a ray comes to it."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

_STEPS, _CLOSE = 12, 1e-10  # of Newton's method; it ends where no ray is farther than that from the floor [m]
_GRAZING = 1e-3  # a ray that comes to the floor at a smaller sine never does


class Floor(Protocol):
    """A floor of the sea, of a tank, or of a model of either: one depth at every place."""

    def depth_and_slope(
        self, place: Float[np.ndarray, "*n 2"]
    ) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n 2"]]:
        """Depth [m], and how much deeper it gets per metre north and east, at places north and east in n [m].

        No number where nothing is known of the floor.
        """
        ...


@dataclass(frozen=True)
class Plane:
    """A plane: depth = depth + slope . (north, east)."""

    depth: float
    slope: tuple[float, float] = (0.0, 0.0)

    def depth_and_slope(
        self, place: Float[np.ndarray, "*n 2"]
    ) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n 2"]]:
        """See `Floor`."""
        slope = np.broadcast_to(np.asarray(self.slope), place.shape)
        return self.depth + place @ np.asarray(self.slope), slope


@dataclass(frozen=True)
class FloorHits:
    """Where rays end.

    Attributes:
        way: Through the water [m]; no number where nothing is met.
        point: n [m].
        normal: Of what is met, into the water, n.
    """

    way: Float[np.ndarray, "*n"]
    point: Float[np.ndarray, "*n 3"]
    normal: Float[np.ndarray, "*n 3"]


@runtime_checkable
class RayCaster(Protocol):
    """A floor that knows itself where rays first meet it, such as a mesh, which may have several depths at a place."""

    def hits(
        self, origin: Float[np.ndarray, "*n 3"], direction: Float[np.ndarray, "*n 3"], longest: float
    ) -> FloorHits:
        """As `floor_hits`."""
        ...


def normals(slope: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 3"]:
    """Unit normals of the floor, into the water (up), in n."""
    upward = np.concatenate([slope, -np.ones((*slope.shape[:-1], 1))], axis=-1)
    return upward / np.linalg.norm(upward, axis=-1, keepdims=True)


def ways_to(
    floor: Floor,
    origin: Float[np.ndarray, "*n 3"],
    direction: Float[np.ndarray, "*n 3"],
    longest: float = np.inf,
) -> Float[np.ndarray, "*n"]:
    """Ways of rays to the floor [m], by Newton's method on the depth along each; no number for those that miss it.

    Args:
        floor: Which one.
        origin: Where the rays begin, n [m], above the floor.
        direction: Unit vectors, n.
        longest: A ray that is longer misses [m].
    """
    origin, direction = np.broadcast_arrays(origin, direction)
    with np.errstate(invalid="ignore", divide="ignore"):
        depth, slope = floor.depth_and_slope(origin[..., :2])
        way = _step(depth - origin[..., 2], slope, direction)
        for _ in range(_STEPS):
            at = origin + way[..., None] * direction
            depth, slope = floor.depth_and_slope(at[..., :2])
            above = depth - at[..., 2]
            if not (np.abs(above) > _CLOSE).any():  # no number: misses
                break
            way = way + _step(above, slope, direction)
        missed = ~(np.abs(above) < 1e-6) | ~(way > 0.0) | (way > longest)
    return np.where(missed, np.nan, way)


def floor_hits(
    floor: Floor, origin: Float[np.ndarray, "*n 3"], direction: Float[np.ndarray, "*n 3"], longest: float
) -> FloorHits:
    """Of rays from where they enter the water, n [m], along unit vectors; none is longer than `longest` [m]."""
    if isinstance(floor, RayCaster):
        return floor.hits(origin, direction, longest)
    way = ways_to(floor, origin, direction, longest)
    point = origin + way[..., None] * direction
    return FloorHits(way, point, normals(floor.depth_and_slope(np.nan_to_num(point[..., :2]))[1]))


def _step(
    above: Float[np.ndarray, "*n"], slope: Float[np.ndarray, "*n 2"], direction: Float[np.ndarray, "*n 3"]
) -> Float[np.ndarray, "*n"]:
    """Way along a ray to the plane that touches the floor below a point that is so far above it."""
    sinking = direction[..., 2] - np.sum(slope * direction[..., :2], axis=-1)
    return np.where(sinking > _GRAZING, above / np.maximum(sinking, _GRAZING), np.nan)
