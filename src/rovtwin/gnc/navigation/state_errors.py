"""States as vectors of 32 numbers and their errors of 31, in NumPy: what smoothers add and subtract."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from rovtwin.gnc.navigation.state import ATTITUDE

QUATERNION = slice(6, 10)  # in the vector; one more than its error has


def difference(a: Float[np.ndarray, "32"], b: Float[np.ndarray, "32"]) -> Float[np.ndarray, "31"]:
    """Error that takes state b to a."""
    return differences(a[None], b[None])[0]


def sum_of(x: Float[np.ndarray, "32"], e: Float[np.ndarray, "31"]) -> Float[np.ndarray, "32"]:
    """State x with an error added."""
    return sums(x[None], e[None])[0]


def differences(a: Float[np.ndarray, "n 32"], b: Float[np.ndarray, "n 32"]) -> Float[np.ndarray, "n 31"]:
    """Errors that take states b to a."""
    e = np.concatenate([a[:, :6] - b[:, :6], np.zeros((len(a), 3)), a[:, 10:] - b[:, 10:]], axis=1)
    turn = Rotation.from_quat(b[:, QUATERNION], scalar_first=True).inv() * Rotation.from_quat(
        a[:, QUATERNION], scalar_first=True
    )
    e[:, ATTITUDE] = turn.as_rotvec()
    return e


def sums(x: Float[np.ndarray, "n 32"], e: Float[np.ndarray, "n 31"]) -> Float[np.ndarray, "n 32"]:
    """States x with errors added."""
    turned = Rotation.from_quat(x[:, QUATERNION], scalar_first=True) * Rotation.from_rotvec(e[:, ATTITUDE])
    return np.concatenate([x[:, :6] + e[:, :6], turned.as_quat(scalar_first=True), x[:, 10:] + e[:, 9:]], axis=1)
