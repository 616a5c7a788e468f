"""Where a body sits in its parent's frame, and the box that stands for its volume. Plain NumPy."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import rotation_from_euler, skew


@dataclass(frozen=True)
class Placement:
    """A frame in its parent: origin [m], and rotation (frame to parent)."""

    position: Float[np.ndarray, "3"]
    rotation: Float[np.ndarray, "3 3"]

    @classmethod
    def of(cls, position: object, attitude_deg: object = (0.0, 0.0, 0.0)) -> "Placement":
        return cls(np.array(position, dtype=float), rotation_from_euler(np.radians(np.asarray(attitude_deg, float))))

    def after(self, outer: "Placement") -> "Placement":
        """This frame as seen from the parent of `outer`, when `outer` is its parent."""
        return Placement(outer.point(self.position), outer.rotation @ self.rotation)

    def point(self, p: Sequence[float] | Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        """A point of this frame as seen from the parent."""
        return self.position + self.rotation @ p

    def twist(self) -> Float[np.ndarray, "6 6"]:
        """H: the parent's velocity nu at its origin -> the velocity of this frame, in this frame.

        Fossen (2021), eq. 3.34 and app. C (system transformation), with the rotation.
        """
        R_t = self.rotation.T
        return np.block([[R_t, -R_t @ skew(self.position)], [np.zeros((3, 3)), R_t]])


HERE = Placement(np.zeros(3), np.eye(3))


SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)  # of a box's corners


@dataclass(frozen=True)
class Box:
    """A box that stands for a part's volume.

    Attributes:
        size: Full dimensions along its axes [m].
        placement: Of its centre and axes.
        volume: Of the water that the part displaces [m3]; less than the box's where water runs through it.
    """

    size: Float[np.ndarray, "3"]
    placement: Placement
    volume: float

    def moved(self, placement: Placement) -> "Box":
        """The same seen from the parent's frame."""
        return Box(self.size, self.placement.after(placement), self.volume)

    def corners(self) -> Float[np.ndarray, "8 3"]:
        """Seen from the parent [m]."""
        return self.placement.position + 0.5 * SIGNS * self.size @ self.placement.rotation.T
