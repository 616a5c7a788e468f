"""Attitudes of whole records and readings turned to b, plain NumPy, leading axis n."""

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


TURNED = ("gyro", "accelerometer", "velocity", "attitude")
"""Signals whose readings depend on how their sensor points."""


def in_body(signal: str, value: np.ndarray, R_bs: np.ndarray) -> np.ndarray:
    """Readings as a sensor along the axes of b would give them.

    Args:
        signal: A name of `record.SIGNALS`.
        value: Vectors along the sensor's axes, or zyx Euler angles of these axes in n [rad], shape (n, 3).
        R_bs: The sensor's axes to b, shape (3, 3).
    """
    if signal == "attitude":
        return euler_from_matrices(matrices_from_euler(value) @ R_bs.T)
    return value @ R_bs.T if signal in TURNED else value


def std_in_body(signal: str, std: np.ndarray, R_bs: np.ndarray) -> np.ndarray:
    """Standard deviations along the axes of b of readings whose errors are independent along the sensor's, shape (k,).

    Of an attitude to first order near level, where Euler angles err as the axes turn.
    """
    return np.sqrt((R_bs * R_bs) @ (std * std)) if signal in TURNED else std
