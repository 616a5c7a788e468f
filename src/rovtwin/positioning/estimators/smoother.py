"""Where the vehicle was, from a whole recording at once: what identification wants.

A factor graph: at each frame position, velocity, acceleration and the attitude's noise; between frames the motion of
`motion`; for each marker its pose; for each sighting its corners. JAX linearises, gtsam solves, until nothing moves
(Gauss-Newton); sightings that do not fit in the end are left out and it is solved again.

Reference: Dellaert and Kaess (2017), Factor graphs for robot perception, Foundations and Trends in Robotics 6(1-2).
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from rovtwin.core.extras import imported
from rovtwin.core.frames import quaternion_from_rotation, rotation_from_quaternion, rotation_from_vector
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.types import Index, Matrix3, Vector3
from rovtwin.positioning.estimators.ekf import MarkerEkf
from rovtwin.positioning.estimators.motion import process_noise, transition
from rovtwin.positioning.estimators.run import Association, Outputs, associate
from rovtwin.positioning.images.camera_model import Eyes, see
from rovtwin.positioning.images.observations import Frames

ROUNDS = 15  # Gauss-Newton steps at most
DROPS = 5  # times that what does not fit is left out
STILL = 1e-6  # no state moves further than this [m, m/s, rad]: done
_EXACT = 1e-7  # standard deviation of what is known exactly [m, rad]; gtsam wants a number
_BLOCK = 256  # sightings are linearised so many at a time, so that it is compiled once
_SIZE = 12  # position, velocity, acceleration, noise of the attitude


@dataclass(frozen=True, eq=False)
class Smoothed:
    """The estimate.

    Attributes:
        position: CO in n [m].
        velocity: In n [m/s].
        acceleration: In n [m/s2].
        covariance: Of position and velocity.
        attitude: Quaternions R_nb with the estimated error taken out.
        offset: Of the measured attitude [rad], axes of n.
        offset_std: Its standard deviation [rad].
        ids: Of the landmarks.
        marker_position: In n [m].
        marker_attitude: Quaternions R_nm.
        marker_std: Of shift [m] and turn [rad].
        landmark: Which of the landmarks each slot showed, -1 where it is not used.
        pixel_rms: Of the residuals of their corners' coordinates [px].
    """

    position: Float[np.ndarray, "n 3"]
    velocity: Float[np.ndarray, "n 3"]
    acceleration: Float[np.ndarray, "n 3"]
    covariance: Float[np.ndarray, "n 6 6"]
    attitude: Float[np.ndarray, "n 4"]
    offset: Float[np.ndarray, "3"]
    offset_std: Float[np.ndarray, "3"]
    ids: Int[np.ndarray, " landmarks"]
    marker_position: Float[np.ndarray, "landmarks 3"]
    marker_attitude: Float[np.ndarray, "landmarks 4"]
    marker_std: Float[np.ndarray, "landmarks 6"]
    landmark: Int[np.ndarray, "n slots"]
    pixel_rms: float


def gtsam_library() -> Any:
    """gtsam, or how to get it."""
    return imported("gtsam", "slam", "the smoother")


def smooth(filter: MarkerEkf, frames: Frames, out: Outputs) -> Smoothed:
    """Smooths a recording that the filter has gone through.

    Args:
        filter: Its tuning, cameras, sizes and layout are used here too.
        frames: The recording.
        out: What the filter made of it: where to start, and which sighting is of which landmark.
    """
    graph = _Graph(filter, frames, out)
    graph.solve()
    for _ in range(DROPS):
        if not graph.drop_outliers():
            break
        graph.solve()
    return graph.result()


class _Graph:
    """The problem and where its solution stands."""

    def __init__(self, filter: MarkerEkf, frames: Frames, out: Outputs):
        self.gtsam = gtsam_library()
        self.filter, self.frames = filter, frames
        self.map: Association = associate(filter, frames, out)
        self.k, self.slot = np.nonzero(self.map.landmark >= 0)
        self.x = np.concatenate([out.position, out.velocity, np.zeros((len(frames), 6))], axis=1)
        self.offset = np.zeros(3)
        self.p_nm, self.R_nm = self.map.position.copy(), np.asarray(_rotations(jnp.asarray(self.map.attitude)))
        self.R_meas = np.asarray(_rotations(jnp.asarray(frames.attitude)))
        self.start = np.concatenate([out.position[0], out.velocity[0]]) if not (self.map.known >= 0).any() else None

    # Keys: frames first, then landmarks, then the offset.
    def key(self, landmark: int) -> int:
        return len(self.frames) + landmark

    def linearised(
        self,
    ) -> tuple[
        Float[np.ndarray, "n 8"], Float[np.ndarray, "n 8 12"], Float[np.ndarray, "n 8 3"], Float[np.ndarray, "n 8 6"]
    ]:
        """Residuals [px] and derivatives by vehicle, offset and marker."""
        seen, which = self.frames.sightings, self.map.landmark[self.k, self.slot]
        ids, camera = (np.asarray(a)[self.k, self.slot] for a in (seen.ids, seen.camera))
        corners = np.asarray(seen.corners)[self.k, self.slot]
        columns = (camera, self.x[self.k], self.R_meas[self.k], self.p_nm[which], self.R_nm[which], ids, corners)
        parts = []
        for begin in range(0, len(self.k), _BLOCK):
            rows = [c[begin : begin + _BLOCK] for c in columns]
            n = len(rows[0])
            padded = [jnp.asarray(np.concatenate([r, np.repeat(r[:1], _BLOCK - n, axis=0)])) for r in rows]
            parts.append(
                [np.asarray(a)[:n] for a in _linear(self.filter.eyes, self.filter.sizes, self.offset, *padded)]
            )
        e, by_vehicle, by_offset, by_marker = (np.concatenate(part) for part in zip(*parts, strict=True))
        return e, by_vehicle, by_offset, by_marker

    def solve(self) -> None:
        """Gauss-Newton until nothing moves; a step that makes it worse is halved."""
        cost = self._cost()
        for _ in range(ROUNDS):
            step = self.graph().optimize()
            kept = self.x, self.offset, self.p_nm, self.R_nm
            for share in (1.0, 0.5, 0.25, 0.1, 0.0):
                self.x, self.offset, self.p_nm, self.R_nm = kept
                moved = self._move(step, share)
                new = self._cost()
                if new <= cost * (1 + 1e-9):
                    break
            cost = new
            if moved < STILL:
                return

    def _move(self, step: Any, share: float) -> float:
        """Adds a share of a step; the largest move."""
        dx = share * np.array([step.at(k) for k in range(len(self.frames))])
        dm = share * np.array([step.at(self.key(j)) for j in range(len(self.p_nm))]).reshape(-1, 6)
        do = share * step.at(self.key(len(self.p_nm)))
        self.x, self.offset, self.p_nm = self.x + dx, self.offset + do, self.p_nm + dm[:, :3]
        self.R_nm = self.R_nm @ np.asarray(_turns(jnp.asarray(dm[:, 3:])))
        return float(max(np.abs(part).max(initial=0.0) for part in (dx, dm, do)))

    def graph(self) -> Any:
        """All factors, linear about where the solution stands."""
        gtsam = self.gtsam
        out = gtsam.GaussianFactorGraph()
        unit = {n: gtsam.noiseModel.Unit.Create(n) for n in (3, 6, 8, 9)}
        last = self.key(len(self.p_nm))
        if len(self.k):
            e, by_vehicle, by_offset, by_marker = (a / float(self.filter.tuning.pixel) for a in self.linearised())
            for row, k in enumerate(self.k):
                landmark = self.key(int(self.map.landmark[k, self.slot[row]]))
                parts = int(k), by_vehicle[row], landmark, by_marker[row], last, by_offset[row], e[row]
                out.add(gtsam.JacobianFactor(*parts, unit[8]))
        for keys, blocks, e in self._others():
            arguments = [item for pair in zip(keys, blocks, strict=True) for item in pair]
            out.add(gtsam.JacobianFactor(*arguments, e, unit[len(e)]))
        return out

    def _others(self) -> list[tuple[tuple[int, ...], tuple[Float[np.ndarray, "_ _"], ...], Float[np.ndarray, " _"]]]:
        """Keys, whitened derivatives and residuals of all but sightings: motion, noise of attitude, known places."""
        tuning, n = self.filter.tuning, len(self.frames)
        out, noise = [], np.eye(_SIZE)[9:]
        W = np.diag(1.0 / np.asarray(tuning.attitude))
        for k in range(n):
            out.append(((k,), (W @ noise,), -W @ self.x[k, 9:]))
        moving, zero = np.eye(_SIZE)[:9], np.zeros((9, 3))
        steps = {dt: self._motion(dt) for dt in np.unique(self.frames.dt[1:])}
        for k in range(1, n):
            F, W = steps[self.frames.dt[k]]
            e = self.x[k, :9] - F @ self.x[k - 1, :9]
            out.append(((k - 1, k), (np.concatenate([-W @ F, zero], axis=1), W @ moving), -W @ e))
        out.append(self._beginning())
        W = np.diag(1.0 / np.maximum(np.asarray(tuning.offset), _EXACT))
        out.append(((self.key(len(self.p_nm)),), (W,), -W @ self.offset))
        return out + self._landmarks()

    def _motion(self, dt: float) -> tuple[Float[np.ndarray, "9 9"], Float[np.ndarray, "9 9"]]:
        """Transition of the nine states and the square root of the information of what is added."""
        tuning = self.filter.tuning
        long = as_array(dt)
        F, Q = np.asarray(transition(long, tuning.correlation)), np.asarray(process_noise(long, tuning.correlation))
        whole = np.kron(Q, np.diag(np.asarray(tuning.acceleration) ** 2))
        return np.kron(F, np.eye(3)), np.linalg.inv(np.linalg.cholesky(whole))

    def _beginning(self) -> tuple[tuple[int, ...], tuple[Float[np.ndarray, "9 12"], ...], Float[np.ndarray, "9"]]:
        tuning = self.filter.tuning
        place = float(tuning.start_position) if self.start is not None else 100.0
        std = np.repeat([max(place, _EXACT), float(tuning.start_velocity), 1.0], 3)
        std[6:] = np.asarray(tuning.acceleration)
        at = self.x[0, :9] * 0.0 if self.start is None else np.concatenate([self.start[:3], np.zeros(6)])
        if self.start is None:
            at[:3] = self.x[0, :3]
        return (0,), (np.eye(_SIZE)[:9] / std[:, None],), (at - self.x[0, :9]) / std

    def _landmarks(self) -> list[tuple[tuple[int, ...], tuple[Float[np.ndarray, "6 6"], ...], Float[np.ndarray, "6"]]]:
        """Places that are known, and of all others next to nothing: a landmark left without sightings stays put."""
        out, exact = [], np.maximum(np.sqrt(np.asarray(self.filter.layout_variance)), _EXACT)
        for j, at in enumerate(self.map.known):
            if at < 0:
                out.append(((self.key(j),), (1e-3 * np.eye(6),), np.zeros(6)))
                continue
            turn = np.asarray(self.filter.layout.R_nm)[at].T @ self.R_nm[j]
            off = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2.0
            e = np.concatenate([self.p_nm[j] - np.asarray(self.filter.layout.position)[at], off])
            out.append(((self.key(j),), (np.diag(1.0 / exact),), -e / exact))
        return out

    def _cost(self) -> float:
        e = self.linearised()[0] / float(self.filter.tuning.pixel) if len(self.k) else np.zeros(1)
        return float((e**2).sum() + sum((part**2).sum() for _, _, part in self._others()))

    def drop_outliers(self) -> bool:
        """Leaves out the worst sighting of each frame that the gate does not allow; whether there were any.

        One at a time: a wrong one turns the frame's attitude, and those that are right seem wrong with it.
        """
        if not len(self.k):
            return False
        squares = (self.linearised()[0] ** 2).sum(axis=1) / float(self.filter.tuning.pixel) ** 2
        worst = np.zeros(len(self.frames))
        np.maximum.at(worst, self.k, squares)
        bad = (squares > float(self.filter.tuning.gate)) & (squares == worst[self.k])
        landmark = self.map.landmark.copy()
        landmark[self.k[bad], self.slot[bad]] = -1
        self.map = replace(self.map, landmark=landmark)
        self.k, self.slot = self.k[~bad], self.slot[~bad]
        return bool(bad.any())

    def result(self) -> Smoothed:
        """What it says, with marginal covariances."""
        graph = self.graph()
        marginals = self.gtsam.Marginals(graph, graph.optimize())
        covariance = np.array([marginals.marginalCovariance(k)[:6, :6] for k in range(len(self.frames))])
        keys = [self.key(j) for j in range(len(self.p_nm))]
        std = np.array([np.sqrt(np.diag(marginals.marginalCovariance(key))) for key in keys]).reshape(-1, 6)
        offset = np.asarray(rotation_from_vector(jnp.asarray(self.offset)))
        R_nb = offset @ self.R_meas @ np.asarray(_turns(jnp.asarray(self.x[:, 9:])))
        rms = float(np.sqrt((self.linearised()[0] ** 2).mean())) if len(self.k) else 0.0
        quaternions = jax.vmap(quaternion_from_rotation)
        return Smoothed(
            self.x[:, :3],
            self.x[:, 3:6],
            self.x[:, 6:9],
            covariance,
            np.asarray(quaternions(jnp.asarray(R_nb))),
            self.offset,
            np.sqrt(np.diag(marginals.marginalCovariance(self.key(len(self.p_nm))))),
            self.map.ids,
            self.p_nm,
            np.asarray(quaternions(jnp.asarray(self.R_nm))) if len(keys) else np.zeros((0, 4)),
            std,
            self.map.landmark,
            rms,
        )


_rotations = jax.jit(jax.vmap(rotation_from_quaternion))
_turns = jax.jit(jax.vmap(rotation_from_vector))


@jax.jit
def _linear(
    eyes: Eyes, sizes: Float[Array, " ids"], offset: Vector3, *columns: Array
) -> tuple[Float[Array, "n 8"], Float[Array, "n 8 12"], Float[Array, "n 8 3"], Float[Array, "n 8 6"]]:
    """Residuals and derivatives of many sightings, each with the leading axis of the columns."""

    def one(
        camera: Index,
        x: Float[Array, "12"],
        R_meas: Matrix3,
        p: Vector3,
        R: Matrix3,
        number: Index,
        corners: Float[Array, "8"],
    ):
        R_nb = rotation_from_vector(offset) @ R_meas @ rotation_from_vector(x[9:])
        seen = see(eyes[camera], x[:3], R_nb, p, R, sizes[number])
        by_vehicle = jnp.concatenate([seen.by_position, jnp.zeros((8, 6)), seen.by_noise], axis=1)
        return corners - seen.pixels, by_vehicle, seen.by_offset, seen.by_marker

    return jax.vmap(one)(*columns)
