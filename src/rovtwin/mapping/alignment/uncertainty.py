"""How unsure points of a mosaic are: absolutely, and within the mosaic, once what all of it shares is taken off.

    Sigma = J C J' + f f' sigma_h^2,   within: (J - M) C (J - M)' + f f' sigma_h^2

J is a point's derivative by all errors, C their covariance, M the mean of J over the mosaic: M e is by how much the
mosaic lies off as a whole.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_array

from rovtwin.mapping.alignment.ground_points import GroundPoints
from rovtwin.mapping.alignment.joint import JointErrors

_AT_ONCE = 4000  # points


@dataclass(frozen=True)
class PointUncertainty:
    """Of points, north and east.

    Attributes:
        absolute: Covariance in n [m2].
        within: Of the point less the mean error of the mosaic [m2].
        common: Covariance of that mean error [m2].
    """

    absolute: Float[np.ndarray, "m 2 2"]
    within: Float[np.ndarray, "m 2 2"]
    common: Float[np.ndarray, "2 2"]

    def sigma(self, kind: str = "absolute") -> Float[np.ndarray, " m"]:
        """Root of the trace of a covariance [m]."""
        return np.sqrt(np.trace(getattr(self, kind), axis1=-2, axis2=-1))


def point_uncertainty(
    joint: JointErrors,
    seen: GroundPoints,
    depth_std: float | Float[np.ndarray, " m"] = 0.0,
    mosaic: GroundPoints | None = None,
) -> PointUncertainty:
    """Of points seen; no numbers for those beyond the key frames, which do not count in the mosaic's mean either.

    Args:
        joint: Errors and their covariance.
        seen: The points.
        depth_std: Of the floor's depth at each [m], independent from point to point.
        mosaic: Points spread over the whole of it; None: those seen.
    """
    J, whole = joint.slopes(seen), seen if mosaic is None else mosaic
    M = mean_slope(joint, whole)
    MC = M @ joint.covariance
    common = MC @ M.T
    f = seen.by_depth * np.broadcast_to(depth_std, len(seen.t))[:, None]
    floor = f[:, :, None] * f[:, None, :]
    absolute, within = np.empty((2, len(seen.t), 2, 2))
    for begin in range(0, len(seen.t), _AT_ONCE):
        some = slice(begin, begin + _AT_ONCE)
        block = csr_array(J[2 * begin : 2 * (begin + _AT_ONCE)])
        absolute[some] = _own_blocks(block, joint.covariance) + floor[some]
        cross = (block @ MC.T).reshape(-1, 2, 2)
        within[some] = absolute[some] - cross - np.swapaxes(cross, -1, -2) + common
    return PointUncertainty(absolute, within, common)


def mean_slope(joint: JointErrors, mosaic: GroundPoints) -> Float[np.ndarray, "2 n"]:
    """M: derivative of the mean error of a mosaic's points."""
    known = joint.covers(mosaic.t)
    J, count = joint.slopes(mosaic)[np.repeat(known, 2)], max(int((mosaic.valid & known).sum()), 1)
    rows = np.arange(J.shape[0])
    pick = csr_array((np.full(len(rows), 1.0 / count), (rows % 2, rows)), shape=(2, len(rows)))
    return csr_array(pick @ J).toarray()


def _own_blocks(J: csr_array, C: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "m 2 2"]:
    """J C J' of each point alone."""
    product = (J @ C).reshape(-1, 2, C.shape[0])
    dense = J.toarray().reshape(product.shape)
    return np.einsum("min,mjn->mij", product, dense)
