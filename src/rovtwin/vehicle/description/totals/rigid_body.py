"""Mass, centre of gravity and inertia of assemblies: the full parallel-axis theorem.

The thesis's (2.19) adds m |d|^2 of the whole offset and forgets the parts' own inertia; here own inertia, offset,
products of inertia and orientation are all in the tensor equation I = sum R I_i R' - m_i S(d_i)^2.
Plain NumPy: done once per vehicle, on the host.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import skew
from rovtwin.vehicle.solids.placement import Placement


@dataclass(frozen=True)
class MassProperties:
    """Mass [kg], centre of gravity [m], inertia about it [kg m2]."""

    mass: float
    center_of_gravity: Float[np.ndarray, "3"]
    inertia: Float[np.ndarray, "3 3"]

    def moved(self, placement: Placement) -> "MassProperties":
        """The same body as seen from the parent's frame."""
        R = placement.rotation
        return MassProperties(self.mass, placement.point(self.center_of_gravity), R @ self.inertia @ R.T)

    def inertia_about(self, point: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
        """Tensor about another point: I_g - m S(d)^2. Fossen (2021), eq. 3.37."""
        S = skew(self.center_of_gravity - point)
        return self.inertia - self.mass * S @ S


def combine(bodies: list[MassProperties]) -> MassProperties:
    """One rigid body from several seen in the same frame."""
    mass = sum(body.mass for body in bodies)
    if mass <= 0:
        return MassProperties(0.0, np.zeros(3), np.zeros((3, 3)))
    center = sum((body.mass * body.center_of_gravity for body in bodies), np.zeros(3)) / mass
    inertia = sum((body.inertia_about(center) for body in bodies), np.zeros((3, 3)))
    return MassProperties(mass, center, inertia)
