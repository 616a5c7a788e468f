"""The smoothed path of every record on the grid of its segments: states good enough to ask the model about forces."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from rovtwin.identification.joint.model.nodes import Nodes, undisturbed
from rovtwin.identification.joint.solver.segments import Grid, Segments
from rovtwin.identification.logs.motion import body_rates, on_grid, rotation_on_grid
from rovtwin.identification.logs.record import Record

KERNEL = 0.3  # standard deviation of the smoothing [s]: positions of 3 cm at 15 Hz become velocities of 2 cm/s


def smoothed_path(segments: Segments, grid: Grid) -> tuple[Nodes, Float[np.ndarray, "N 6"]]:
    """States of S segments at K points each, leading axis N = S K, and whether each component of nu was seen, (N, 6).

    `grid` says step and points; its segments last as long as those of the segments.
    """
    parts = []
    bounds = [*segments.first, segments.count]
    for record, a, b in zip(segments.records, bounds, bounds[1:], strict=False):
        t = record.start + grid.step * np.arange((b - a) * grid.steps)
        parts.append(_Smoothed(record, t).states())
    position, attitude, nu, seen = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return undisturbed(position, attitude, nu), seen


class _Smoothed:
    """One record on even times t."""

    def __init__(self, record: Record, t: Float[np.ndarray, " n"]):
        self.record, self.t = record, t

    def states(
        self,
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 4"], Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6"]]:
        """Position, quaternion, nu, and where nu was seen: 1, else 0."""
        attitude, R, omega, turned = self._attitude()
        omega, turning = self._rates(omega, turned)
        position, velocity, moving = self._translation(R, omega, turned)
        inside = (self.t > self.record.start + 2 * KERNEL) & (self.t < self.record.end - 2 * KERNEL)
        seen = np.repeat(np.stack([moving & inside, turning & inside], axis=1), 3, axis=1)
        return position, attitude, np.concatenate([velocity, omega], axis=1), seen.astype(float)

    def _at(self, name: str) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, "n k"], Bool[np.ndarray, " n"]]:
        """Value and rate of a signal, zero in gaps, and where there is none."""
        signal = self.record.signals[name]
        found, slope = on_grid(signal.t, signal.value, self.t, KERNEL)
        good = np.asarray(np.isfinite(found).all(axis=1))
        return np.where(good[:, None], found, 0.0), np.where(good[:, None], slope, 0.0), good

    def _attitude(
        self,
    ) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3"], Bool[np.ndarray, " n"]]:
        """Quaternion, R_nb, body rates that go with it, and where it was measured; level elsewhere."""
        R, omega = np.tile(np.eye(3), (len(self.t), 1, 1)), np.zeros((len(self.t), 3))
        good = np.zeros(len(self.t), bool)
        if "attitude" in self.record.signals:
            found, rate = rotation_on_grid(self.record.signals["attitude"], self.t, KERNEL)
            good = np.asarray(np.isfinite(found).all(axis=(1, 2)))
            R[good], omega[good] = found[good], body_rates(found, rate)[good]
        return Rotation.from_matrix(R).as_quat(scalar_first=True), R, omega, good

    def _rates(
        self, omega: Float[np.ndarray, "n 3"], turned: Bool[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n 3"], Bool[np.ndarray, " n"]]:
        if "gyro" not in self.record.signals:
            return omega, turned
        value, _, good = self._at("gyro")
        return value, good

    def _translation(
        self, R: Float[np.ndarray, "n 3 3"], omega: Float[np.ndarray, "n 3"], turned: Bool[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Bool[np.ndarray, " n"]]:
        """Position of CO, its velocity in b, and where that was seen: of a velocity sensor, else of positions."""
        n, signals = len(self.t), self.record.signals
        position, rate, known = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3), bool)
        arm = np.zeros(3)
        for name, columns in (("position", [0, 1, 2]), ("horizontal", [0, 1]), ("depth", [2])):
            if name in signals:
                value, slope, good = self._at(name)
                lever = signals[name].lever
                position[:, columns] = value - np.einsum("nij,j->ni", R, lever)[:, columns]
                rate[:, columns], known[:, columns] = slope, good[:, None]
                arm = lever if name != "depth" else arm
        if "velocity" in signals:
            value, _, good = self._at("velocity")
            return position, value - np.cross(omega, signals["velocity"].lever), good
        velocity = np.einsum("nji,nj->ni", R, rate) - np.cross(omega, arm)
        return position, velocity, known.all(axis=1) & turned
