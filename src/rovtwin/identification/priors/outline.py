"""Outline: the box around a vehicle and how much of each side of it the vehicle fills."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.priors.surface import corner_points, solids
from rovtwin.vehicle.description.vehicle import Vehicle

_GRID = 600  # samples along the longer side of a projection: areas to about 0.3 %


@dataclass(frozen=True, eq=False)
class Outline:
    """Length, width, height [m], and areas seen from ahead, from abeam, from above [m2]."""

    size: Float[np.ndarray, "3"]
    areas: Float[np.ndarray, "3"]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.size).all() and np.isfinite(self.areas).all() and (self.size > 0).all()):
            raise IdentificationError(f"outline: found size {self.size.tolist()} m, expected three lengths above 0")
        names, faces = ("front", "side", "top"), self._faces()
        for name, area, face in zip(names, self.areas, faces, strict=True):
            if not 0 < area <= 1.001 * face:
                raise IdentificationError(
                    f"outline: found a {name} area of {area:.4g} m2, expected more than 0 and at most the box's "
                    f"{face:.4g} m2" + (": looks like mm2, divide by 1e6" if area > 1000 * face else "")
                )

    def _faces(self) -> Float[np.ndarray, "3"]:
        length, width, height = self.size
        return np.array([width * height, length * height, length * width])

    @property
    def fill(self) -> Float[np.ndarray, "3"]:
        """Area over that of the box's face."""
        return self.areas / self._faces()


def full_box(size: Float[np.ndarray, "3"]) -> Outline:
    """A box without gaps [m]."""
    length, width, height = np.asarray(size, dtype=float)
    return Outline(np.asarray(size, dtype=float), np.array([width * height, length * height, length * width]))


def outline_of(vehicle: Vehicle) -> Outline:
    """Of the shapes of a vehicle's parts, in its body frame.

    Raises:
        IdentificationError: No part has a shape.
    """
    bodies = [corner_points(solid) for solid in solids(vehicle)]
    every = np.concatenate(bodies)
    low, high = every.min(axis=0), every.max(axis=0)
    return Outline(high - low, np.array([_shadow(bodies, axis) for axis in range(3)]))


def _shadow(bodies: list[np.ndarray], axis: int) -> float:
    """Area of all bodies seen along an axis, counted once where they cover each other; each body is convex."""
    flat = [np.delete(body, axis, axis=1) for body in bodies]
    every = np.concatenate(flat)
    low, span = every.min(axis=0), np.ptp(every, axis=0)
    count = np.maximum(np.ceil(_GRID * span / span.max()).astype(int), 2)
    u, v = (low[k] + span[k] * (np.arange(count[k]) + 0.5) / count[k] for k in range(2))
    points = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    covered = np.zeros(len(points), dtype=bool)
    for body in flat:
        edges = ConvexHull(body).equations
        covered |= (points @ edges[:, :2].T + edges[:, 2] <= 1e-12).all(axis=1)
    return float(covered.mean() * span.prod())
