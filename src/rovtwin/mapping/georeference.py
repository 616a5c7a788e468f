"""Where pixels of lines lie: rays of the imager through its port, turned by the vehicle's pose, to the floor."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.imaging.floor import Floor, floor_hits
from rovtwin.imaging.imager import Imager, Mount
from rovtwin.mapping.navigation import Navigation

LONGEST = 12.0  # way through the water to a floor that is still mapped [m]


@dataclass(frozen=True)
class Located:
    """Pixels of lines on the floor.

    Attributes:
        point: n [m]; no number where not valid.
        way: Through the water from the port to it [m].
        cosine: Of the angle at the floor between the ray and its normal.
        normal: Of the floor there, into the water, n.
        position: Of the centre of projection at each line, n [m].
        rotation: R_ns at each line, maps the imager's frame to n.
        valid: Where there is a pose and the ray meets the floor within `LONGEST`.
    """

    point: Float[np.ndarray, "line pixel 3"]
    way: Float[np.ndarray, "line pixel"]
    cosine: Float[np.ndarray, "line pixel"]
    normal: Float[np.ndarray, "line pixel 3"]
    position: Float[np.ndarray, "line 3"]
    rotation: Float[np.ndarray, "line 3 3"]
    valid: Bool[np.ndarray, "line pixel"]


@dataclass(frozen=True)
class Georeference:
    """An imager on a vehicle over a floor.

    Attributes:
        imager: Which one.
        mount: Where it sits.
        navigation: Of the vehicle.
        floor: That the rays end on.
    """

    imager: Imager
    mount: Mount
    navigation: Navigation
    floor: Floor

    @cached_property
    def bundle(self) -> tuple[np.ndarray, np.ndarray]:
        """Where each pixel's ray enters the water, and its direction there, in s: see `Imager.rays`."""
        return self.imager.rays()

    def rays(
        self, t: Float[np.ndarray, " line"], pixels: slice = slice(None)
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Of lines at times [s]: where rays enter the water and their unit directions (line, pixel, 3), n; the centre
        of projection (line, 3); R_ns (line, 3, 3); and which lines have a pose (line,).
        """
        poses = self.navigation.at(np.asarray(t, float))
        point, direction = (x[pixels] for x in self.bundle)
        R_ns = poses.rotation @ self.mount.rotation
        position = poses.position + poses.rotation @ self.mount.position
        turned = np.swapaxes(R_ns, -1, -2)
        return position[:, None] + point @ turned, direction @ turned, position, R_ns, poses.valid

    def locate(self, t: Float[np.ndarray, " line"], pixels: slice = slice(None)) -> Located:
        """Where pixels of lines at times [s] lie, all of them or a part; what time a line has is the caller's affair.

        Closed form on a plane to 1e-9 m (`tests/mapping/test_georeference.py`), by Newton's method on others.
        """
        origin, direction, position, R_ns, posed = self.rays(t, pixels)
        hits = floor_hits(self.floor, origin, direction, LONGEST)
        valid = np.isfinite(hits.way) & posed[:, None]
        cosine = -np.sum(direction * hits.normal, axis=-1)
        point = np.where(valid[..., None], hits.point, np.nan)
        return Located(point, np.where(valid, hits.way, np.nan), cosine, hits.normal, position, R_ns, valid)
