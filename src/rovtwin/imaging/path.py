"""Where the vehicle is at any time between the ticks of a log."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from rovtwin.core.errors import LogError

POSES = {"estimate": "autopilot/eta", "truth": "truth/eta", "smoothed": "smoothed/eta"}  # channels of a run's logs
LONGEST_STEP = 0.2  # between poses of a path that may be interpolated [s]


@dataclass(frozen=True)
class PosePath:
    """A path: cubic splines through positions, and through quaternions, which are then made unit again.

    Attributes:
        t: [s], increasing.
        position: Of CO in n [m].
        attitude: Quaternion q_nb.
    """

    t: Float[np.ndarray, " k"]
    position: Float[np.ndarray, "k 3"]
    attitude: Float[np.ndarray, "k 4"]

    @classmethod
    def of(cls, t: Float[np.ndarray, " k"], eta: Float[np.ndarray, "k 6"], where: str = "the path") -> "PosePath":
        """Of positions [m] and Euler angles [rad].

        Raises:
            LogError: Fewer than two poses, no numbers among them, times that do not grow, or that leave gaps.
        """
        if len(t) < 2:
            raise LogError(f"{where}: found {len(t)} poses, expected at least 2")
        steps = np.diff(t)
        if not np.isfinite(eta).all() or not np.isfinite(t).all():
            raise LogError(f"{where}: there are no numbers among the poses")
        if not (steps > 0).all():
            raise LogError(f"{where}: times do not grow at {t[int(np.argmin(steps > 0))]:.3f} s")
        if (steps > LONGEST_STEP).any():
            k = int(np.argmax(steps))
            raise LogError(
                f"{where}: no pose from {t[k]:.2f} to {t[k + 1]:.2f} s; between poses {LONGEST_STEP:g} s apart at most "
                "lines can be placed. Log the truth more often (log.rate of the scenario)"
            )
        return cls.through(t, eta[:, :3], quaternions(eta[:, 3:6]))

    @classmethod
    def through(
        cls, t: Float[np.ndarray, " k"], position: Float[np.ndarray, "k 3"], attitude: Float[np.ndarray, "k 4"]
    ) -> "PosePath":
        """Of two or more poses in order, however the signs of their quaternions change: q and -q are one attitude."""
        q = np.array(attitude, float)
        same = np.cumprod(np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1.0, 1.0))
        q[1:] *= same[:, None]
        return cls(np.asarray(t, float), np.asarray(position, float), q)

    @cached_property
    def _splines(self) -> tuple[CubicSpline, CubicSpline]:
        return CubicSpline(self.t, self.position), CubicSpline(self.t, self.attitude)

    def at(
        self, t: Float[np.ndarray, "*n"]
    ) -> tuple[Float[np.ndarray, "*n 3"], Float[np.ndarray, "*n 3 3"], Float[np.ndarray, "*n 4"]]:
        """Position of CO in n [m], R_nb and q_nb at times within the path [s]."""
        places, turns = self._splines
        q = turns(t)
        q = q / np.linalg.norm(q, axis=-1, keepdims=True)
        R = Rotation.from_quat(q[..., [1, 2, 3, 0]].reshape(-1, 4)).as_matrix().reshape((*np.shape(t), 3, 3))
        return places(t), R, q


def quaternions(euler: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 4"]:
    """Unit quaternions q_nb, scalar first, of zyx Euler angles [phi, theta, psi] [rad]."""
    return Rotation.from_euler("ZYX", euler[:, ::-1]).as_quat()[:, [3, 0, 1, 2]]
