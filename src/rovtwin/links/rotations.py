"""Rotations on the host, in NumPy: what servers and sources need a hundred times a second without compiling.

The conventions are those of `core.frames`, against which the tests hold these.
"""

import math

import numpy as np


def rotation_from_euler(euler: np.ndarray) -> np.ndarray:
    """R_nb, shape (3, 3), of zyx Euler angles [phi, theta, psi] [rad], shape (3,). Fossen (2021), eq. 2.31."""
    (cf, ct, cp), (sf, st, sp) = np.cos(euler), np.sin(euler)
    return np.array(
        [
            [cp * ct, -sp * cf + cp * st * sf, sp * sf + cp * cf * st],
            [sp * ct, cp * cf + sf * st * sp, -cp * sf + st * sp * cf],
            [-st, ct * sf, ct * cf],
        ]
    )


def euler_from_rotation(R: np.ndarray) -> np.ndarray:
    """zyx Euler angles [phi, theta, psi] [rad], shape (3,), of R_nb, shape (3, 3); singular at theta = +-pi/2."""
    theta = -math.asin(min(1.0, max(-1.0, float(R[2, 0]))))
    return np.array([math.atan2(R[2, 1], R[2, 2]), theta, math.atan2(R[1, 0], R[0, 0])])


def turn_about_z(angle: float) -> np.ndarray:
    """Rotation about z [rad], shape (3, 3): clockwise seen from above, where z is down."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
