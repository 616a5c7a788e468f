"""Attitudes of whole records, plain NumPy: zyx Euler angles and matrices, leading axis n."""

import numpy as np
from scipy.spatial.transform import Rotation


def matrices_from_euler(euler: np.ndarray) -> np.ndarray:
    """R_nb, shape (n, 3, 3), of zyx Euler angles [phi, theta, psi] [rad], shape (n, 3)."""
    return Rotation.from_euler("ZYX", euler[:, ::-1]).as_matrix()


def euler_from_matrices(R_nb: np.ndarray) -> np.ndarray:
    """zyx Euler angles [phi, theta, psi] [rad], shape (n, 3), of R_nb, shape (n, 3, 3)."""
    phi = np.arctan2(R_nb[:, 2, 1], R_nb[:, 2, 2])
    theta = -np.arcsin(np.clip(R_nb[:, 2, 0], -1.0, 1.0))
    return np.stack([phi, theta, np.arctan2(R_nb[:, 1, 0], R_nb[:, 0, 0])], axis=1)
