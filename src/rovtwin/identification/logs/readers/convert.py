"""Units, frames and attitudes of recordings, to SI, NED and FRD. Plain NumPy, leading axis n.

A world frame w and a body frame v of the file map to n and b by the constant rotations R_nw and R_bv, so that
R_nb = R_nw R_wv R_bv'. ENU and FLU are those of ROS REP 103; NWU is any frame with z up whose x is called north.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from rovtwin.core.arrays.rotations import euler_from_rotation
from rovtwin.identification.logs.log_spec import SignalSpec

_FLU = np.diag([1.0, -1.0, -1.0])
_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
WORLD = {"ned": np.eye(3), "enu": _ENU, "nwu": _FLU, "frd": np.eye(3), "flu": _FLU}
BODY = {"frd": np.eye(3), "flu": _FLU, "ned": np.eye(3), "enu": _FLU, "nwu": _FLU}


def attitude(values: Float[np.ndarray, "n k"], spec: SignalSpec) -> Float[np.ndarray, "n 3"]:
    """zyx Euler angles of R_nb [rad], of angles [rad], quaternions or matrices."""
    if values.shape[1] == 3:
        order = values[:, ::-1] if spec.euler == "zyx" else values
        R_wv = Rotation.from_euler("ZYX" if spec.euler == "zyx" else "XYZ", order).as_matrix()
    elif values.shape[1] == 4:
        R_wv = Rotation.from_quat(values, scalar_first=spec.quaternion == "wxyz").as_matrix()
    else:
        R_wv = values.reshape(-1, 3, 3)
        if spec.matrix == "columns":
            R_wv = R_wv.transpose(0, 2, 1)
    frame = spec.frame or "ned"
    return euler_from_rotation(WORLD[frame] @ R_wv @ to_body(spec).T)


def to_body(spec: SignalSpec) -> Float[np.ndarray, "3 3"]:
    """R_bv: the file's body axes to b, by its frame and by how the sensor is mounted."""
    mounting = Rotation.from_euler("ZYX", spec.mounting_deg[::-1], degrees=True).as_matrix()
    return mounting @ BODY[spec.frame or "frd"]


def world_vector(values: Float[np.ndarray, "n 3"], spec: SignalSpec) -> Float[np.ndarray, "n 3"]:
    """Positions in n."""
    return values @ WORLD[spec.frame or "ned"].T


def depth(
    values: Float[np.ndarray, "n 1"], spec: SignalSpec, is_pressure: bool, density: float
) -> Float[np.ndarray, "n 1"]:
    """Depth [m], of depth, height or pressure [Pa] already less its zero."""
    if is_pressure:
        return values / (density * 9.81)
    return -values if spec.frame in ("up", "enu", "nwu", "flu") else values
