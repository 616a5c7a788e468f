"""What observers take in: the markers of one instant's images in slots of fixed number, and the attitude."""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from rovtwin.core.numerics import as_array, jax
from rovtwin.core.types import HostArray, Quaternion
from rovtwin.positioning.images.detection import Detections, poses
from rovtwin.vehicle.description.cameras import Camera


class Sightings(eqx.Module):
    """Markers seen at one instant, by all cameras; leading axis is the slot.

    Attributes:
        valid: Whether the slot holds a marker.
        ids: Of the marker in each.
        camera: Which of the cameras saw it.
        corners: Distorted [px]: x and y of the four corners in turn.
        t_cm: Its middle in c by the pose of the marker alone [m].
        R_cm: Maps m to c.
        single: Whether no other marker in the image has that id.
        clear: Whether the pose is the only one that fits.
    """

    valid: Bool[HostArray, " slots"]
    ids: Int[HostArray, " slots"]
    camera: Int[HostArray, " slots"]
    corners: Float[HostArray, "slots 8"]
    t_cm: Float[HostArray, "slots 3"]
    R_cm: Float[HostArray, "slots 3 3"]
    single: Bool[HostArray, " slots"]
    clear: Bool[HostArray, " slots"]


class SightInput(eqx.Module):
    """One frame: what was seen, and the vehicle's attitude as its sensors say, quaternion R_nb."""

    sightings: Sightings
    attitude: Quaternion


CLEAR = 0.6  # a pose is clear when its error is at most this share of that of the other solution


def sightings(
    detections: Sequence[Detections],
    cameras: Sequence[Camera],
    sizes: Float[np.ndarray, " ids"],
    slots: int = 16,
) -> Sightings:
    """Slots, on the host, of what was found in one image of each camera; of too many the largest are kept.

    Args:
        detections: Of each camera; `Detections.none()` where there is no image.
        cameras: In the same order.
        sizes: Side of each marker by its id [m].
        slots: Their number.
    """
    rows = []
    for number, (found, camera) in enumerate(zip(detections, cameras, strict=True)):
        if len(found.ids):
            pose = poses(camera.lens, found.corners, sizes[found.ids])
            single, clear = ~found.duplicated, pose.ambiguity < CLEAR
            for k, marker in enumerate(found.ids):
                rows.append((marker, number, found.corners[k], pose.t_cm[k, 0], pose.R_cm[k, 0], single[k], clear[k]))
    rows.sort(key=lambda row: -float(np.ptp(row[2][:, 0]) * np.ptp(row[2][:, 1])))
    rows = rows[:slots]
    n = len(rows)
    ids, camera = np.zeros(slots, int), np.zeros(slots, int)
    corners, t, R = np.zeros((slots, 8)), np.tile([0.0, 0.0, 1.0], (slots, 1)), np.tile(np.eye(3), (slots, 1, 1))
    flags = np.zeros((2, slots), bool)
    if n:
        columns = list(zip(*rows, strict=True))
        ids[:n], camera[:n], corners[:n] = columns[0], columns[1], np.reshape(columns[2], (n, 8))
        t[:n], R[:n], flags[0, :n], flags[1, :n] = columns[3:]
    valid = np.arange(slots) < n
    return Sightings(valid, ids, camera, corners, t, R, *flags)  # type: ignore[arg-type]  (NumPy: steps take both)


@dataclass(frozen=True, eq=False)
class Frames:
    """A whole recording as observers take it in, on the host.

    Attributes:
        t: Times [s], increasing.
        attitude: Quaternions R_nb as the sensors said at these times.
        sightings: With a leading axis n.
    """

    t: Float[np.ndarray, " n"]
    attitude: Float[np.ndarray, "n 4"]
    sightings: Sightings

    @classmethod
    def of(cls, t: Float[np.ndarray, " n"], attitude: Float[np.ndarray, "n 4"], seen: Sequence[Sightings]) -> "Frames":
        """Of one `Sightings` for each time."""
        return cls(t, attitude, jax.tree.map(lambda *leaves: np.stack(leaves), *seen))

    def __len__(self) -> int:
        return len(self.t)

    def at(self, k: int) -> SightInput:
        """The input of one step."""
        return SightInput(jax.tree.map(lambda leaf: leaf[k], self.sightings), as_array(self.attitude[k]))

    @property
    def dt(self) -> Float[np.ndarray, " n"]:
        """From the frame before [s]; zero for the first."""
        return np.diff(self.t, prepend=self.t[:1])
