"""Lab: how QTM's frame lies in n, and how a rigid body's axes lie in the vehicle's."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import euler_from_rotation, rotation_from_euler
from rovtwin.core.errors import ConfigError

HALF_TURN = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
Matrix = Sequence[Sequence[float]]


@dataclass(frozen=True)
class Lab:
    """Poses in n and b (NED, FRD) and in the lab of a motion capture system, whose z is up.

    Attributes:
        R_nq: Maps the lab's axes to n, shape (3, 3). Default: the lab's x north, y west, z up.
        origin: The lab's origin in n [m], shape (3,).
        R_bq: Maps the axes of the rigid body, as defined in QTM, to b, shape (3, 3). Default: x forward, y left, z up,
            what a body gets that is defined while the vehicle lies level along the lab's x.
        lever: The rigid body's origin from CO, in b [m], shape (3,).

    Raises:
        ConfigError: A matrix is no rotation.
    """

    R_nq: Matrix = HALF_TURN
    origin: Sequence[float] = (0.0, 0.0, 0.0)
    R_bq: Matrix = HALF_TURN
    lever: Sequence[float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("R_nq", "R_bq"):
            R = np.array(getattr(self, name), dtype=float)
            if R.shape != (3, 3) or not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0.0:
                raise ConfigError(f"{name}: expected a rotation matrix, three rows of three, right-handed")
        for name in ("origin", "lever"):
            vector = np.array(getattr(self, name), dtype=float)
            if vector.shape != (3,) or not np.isfinite(vector).all():
                raise ConfigError(f"{name}: expected three numbers [m]")

    def to_lab(self, eta: Float[np.ndarray, "6"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
        """Place [m] and rotation from body to lab of eta [m, rad]."""
        R_nb = rotation_from_euler(eta[3:])
        R_nq = np.array(self.R_nq)
        place = R_nq.T @ (eta[:3] + R_nb @ np.array(self.lever) - np.array(self.origin))
        return place, R_nq.T @ R_nb @ np.array(self.R_bq)

    def to_eta(self, place: Float[np.ndarray, "3"], R: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "6"]:
        """eta of a place [m] and a rotation in the lab: the inverse of `to_lab`."""
        R_nq = np.array(self.R_nq)
        R_nb = R_nq @ R @ np.array(self.R_bq).T
        position = R_nq @ place + np.array(self.origin) - R_nb @ np.array(self.lever)
        return np.concatenate([position, euler_from_rotation(R_nb)])
