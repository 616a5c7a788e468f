"""Dead reckoning as the DVL does it: where it thinks it is since the last reset."""

import math

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import euler_from_rotation, rotation_from_euler

LONGEST_STEP = 1.0  # a gap beyond it is not bridged [s]


class Reckoning:
    """Velocity in b integrated in the frame that b was at the last reset.

    Attributes:
        position: In that frame [m], shape (3,).
        std: Of the horizontal position [m]: grows with the figure of merit of every step, as for errors that stay.
    """

    def __init__(self) -> None:
        self._R_nb = np.eye(3)
        self._t = math.nan
        self._turned = False
        self.reset()

    def reset(self) -> None:
        """Here and now is zero."""
        self.position, self.std = np.zeros(3), 0.0
        self._R_n0 = self._R_nb

    def turn(self, attitude: Float[np.ndarray, "3"]) -> None:
        """The newest attitude, zyx Euler [rad]; the first one also is that of the start."""
        self._R_nb = rotation_from_euler(attitude)
        if not self._turned:
            self._turned, self._R_n0 = True, self._R_nb

    def move(self, velocity: Float[np.ndarray, "3"], fom: float, t: float) -> None:
        """A velocity in b [m/s], valid at t [s], with its figure of merit [m/s]."""
        dt = t - self._t
        if 0.0 < dt <= LONGEST_STEP:
            self.position = self.position + self._R_n0.T @ self._R_nb @ velocity * dt
            self.std += fom * dt
        self._t = t

    @property
    def attitude(self) -> Float[np.ndarray, "3"]:
        """Against the frame of the last reset, zyx Euler [rad]."""
        return euler_from_rotation(self._R_n0.T @ self._R_nb)
