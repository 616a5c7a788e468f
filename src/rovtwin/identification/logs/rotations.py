"""Readings of whole records turned to b, plain NumPy, leading axis n."""

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import euler_from_rotation, rotation_from_euler

TURNED = ("gyro", "accelerometer", "velocity", "attitude")
"""Signals whose readings depend on how their sensor points."""


def in_body(signal: str, value: Float[np.ndarray, "n 3"], R_bs: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "n 3"]:
    """Readings as a sensor along the axes of b would give them.

    Args:
        signal: A name of `record.SIGNALS`.
        value: Vectors along the sensor's axes, or zyx Euler angles of these axes in n [rad].
        R_bs: The sensor's axes to b.
    """
    if signal == "attitude":
        return euler_from_rotation(rotation_from_euler(value) @ R_bs.T)
    return value @ R_bs.T if signal in TURNED else value


def std_in_body(signal: str, std: Float[np.ndarray, " k"], R_bs: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, " k"]:
    """Standard deviations along the axes of b of readings whose errors are independent along the sensor's.

    Of an attitude to first order near level, where Euler angles err as the axes turn.
    """
    return np.sqrt((R_bs * R_bs) @ (std * std)) if signal in TURNED else std
