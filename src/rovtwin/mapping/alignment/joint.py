"""Errors of a whole mosaic together: poses at key frames, constants of sensors, calibration of the imager.

One vector: six for each key frame (place in n, small rotation in b), the constants of sensors, then CALIBRATION.
Between key frames errors are taken to be straight lines: over 1 s they bend by less than a millimetre with a Doppler
log.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from rovtwin.core.arrays.key_frames import POSE, KeyFrames
from rovtwin.core.errors import LogError
from rovtwin.imaging.imager import BORESIGHT_STD, CLOCK_STD, LEVER_STD, Mount
from rovtwin.mapping.alignment.ground_points import CALIBRATION, GroundPoints
from rovtwin.mapping.navigation import Navigation

# Before any overlap is looked at [rad, m, s].
_BESIDE = 0.1  # beyond the first or last key frame that still has its errors [s]: a clock put right, no other place
USUAL_STD = dict(zip(CALIBRATION, (*[BORESIGHT_STD] * 3, *[LEVER_STD] * 3, CLOCK_STD), strict=True))


@dataclass(frozen=True)
class JointErrors:
    """What is known of a mosaic's errors.

    Attributes:
        t: Of the key frames [s].
        constants: Names of the sensors' constants.
        mean: Of the errors, what is true less what is stated: zero before anything was measured.
        covariance: Of them.
    """

    t: Float[np.ndarray, " k"]
    constants: tuple[str, ...]
    mean: Float[np.ndarray, " n"]
    covariance: Float[np.ndarray, "n n"]

    @classmethod
    def of(
        cls, keys: KeyFrames, first: float, last: float, std: Mapping[str, float] | None = None, most: int = 700
    ) -> "JointErrors":
        """Of the lines from a time to another [s].

        Args:
            keys: Of the smoothed track.
            first: Of the first line.
            last: Of the last line.
            std: Of the calibration before, in place of some of USUAL_STD; 0: exact.
            most: Key frames that are used; of more than these every second, third ... is.

        Raises:
            LogError: The track does not reach there.
        """
        if not (keys.t[0] <= first < last <= keys.t[-1]):
            raise LogError(
                f"lines from {first:.1f} to {last:.1f} s: the smoothed track goes from {keys.t[0]:.1f} to "
                f"{keys.t[-1]:.1f} s; smooth the run that they were taken on"
            )
        begin, end = np.searchsorted(keys.t, first, side="right") - 1, np.searchsorted(keys.t, last)
        end = min(int(end), len(keys.t) - 1)
        chosen = np.unique(np.append(np.arange(begin, end, max(-(-(end - begin) // most), 1)), end))
        given = {**USUAL_STD, **(std or {})}
        joint, calibration = keys.joint(chosen), np.diag([given[name] ** 2 for name in CALIBRATION])
        n, c = len(joint), len(CALIBRATION)
        covariance = np.zeros((n + c, n + c))
        covariance[:n, :n], covariance[n:, n:] = joint, calibration
        return cls(keys.t[chosen], keys.constants, np.zeros(n + c), covariance)

    def slopes(self, seen: GroundPoints) -> csr_array:
        """Derivative of the points' north and east by the errors, a row each: (2 m, n).

        No numbers for points seen before the first key frame or after the last: nothing is known of errors there.
        """
        m, size = len(seen.t), len(self.mean)
        at, share = self._between(seen.t)
        rows = np.arange(2 * m).reshape(m, 2, 1)
        poses = POSE * at[:, None, None] + np.arange(POSE)
        fixed = size - len(CALIBRATION) + np.arange(len(CALIBRATION))
        parts = [
            (rows, poses, (1.0 - share)[:, None, None] * seen.by_pose),
            (rows, poses + POSE, share[:, None, None] * seen.by_pose),
            (rows, np.broadcast_to(fixed, (m, 1, len(fixed))), seen.by_calibration),
        ]
        row, column, value = (
            np.concatenate([np.broadcast_to(part[i], part[2].shape).ravel() for part in parts]) for i in range(3)
        )
        return csr_array((value, (row, column)), shape=(2 * m, size))

    def pose_errors(self, t: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 6"]:
        """Means of the errors of poses at times [s]; beyond the key frames those of the last."""
        at, share = self._between(np.clip(t, self.t[0], self.t[-1]))
        poses = self.mean[: POSE * len(self.t)].reshape(-1, POSE)
        return (1.0 - share)[:, None] * poses[at] + share[:, None] * poses[at + 1]

    @property
    def calibration(self) -> tuple[Float[np.ndarray, "7"], Float[np.ndarray, "7 7"]]:
        """Mean and covariance of CALIBRATION's errors."""
        c = len(CALIBRATION)
        return self.mean[-c:], self.covariance[-c:, -c:]

    def applied(self, navigation: Navigation) -> Navigation:
        """Poses with their errors taken out; what is left unsure is `covariance`."""
        error = self.pose_errors(navigation.t)
        q = Rotation.from_quat(navigation.quaternion[:, [1, 2, 3, 0]]) * Rotation.from_rotvec(error[:, 3:])
        return replace(
            navigation,
            position=navigation.position + error[:, :3],
            quaternion=q.as_quat()[:, [3, 0, 1, 2]],
            covariance=None,
            source=f"{navigation.source}, registered",
        )

    def mounted(self, mount: Mount) -> tuple[Mount, float]:
        """The mount with its errors taken out, and what is to be added to the stamps [s]."""
        value = self.calibration[0]
        turn = Rotation.from_rotvec(value[:3]).as_matrix()
        return replace(mount, position=mount.position + value[3:6], rotation=turn @ mount.rotation), float(value[6])

    def covers(self, t: Float[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
        """Whether times [s] lie within the key frames."""
        return (t >= self.t[0] - _BESIDE) & (t <= self.t[-1] + _BESIDE)

    def _between(self, t: Float[np.ndarray, " m"]) -> tuple[np.ndarray, Float[np.ndarray, " m"]]:
        """Key frame before each time and the share of the next one; no number outside."""
        at = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        share = np.clip((t - self.t[at]) / (self.t[at + 1] - self.t[at]), 0.0, 1.0)
        return at, np.where(self.covers(t), share, np.nan)
