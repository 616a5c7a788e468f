"""What each thruster's force does to the vehicle, as measured: the columns of M^-1 T by regression.

Accelerations come from the gyro (its rate) and the accelerometer,

    nu_dot_1 = f + R_nb' g - omega_dot x r - omega x (omega x r),

r being where it sits: the inverse of `vehicle.physics.measurement.acceleration_of_point`. What attitude, rates and
recent motion explain is taken out first (as in `identification.logs.response`), so that masses and drag of the file
hardly matter. Reference for the two steps of the regression: Frisch and Waugh (1933), Partial time regressions as
compared with individual trends, Econometrica 1(4).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.signal import lfilter

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.logs.motion import STEP, WIDTH, Motion
from rovtwin.identification.logs.record import Record
from rovtwin.identification.logs.response import nuisances, thruster_forces
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.physics.model import Model

CLEAR = 0.05  # least distance of the hull from floor and surface [m]
MEMORY = 3.0  # of the way that accelerations add up to, for drag [s]
LAGS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)  # of the whole answer, tried [s]


@dataclass(frozen=True, eq=False)
class Columns:
    """Acceleration of CO per newton of each thruster [1/kg, 1/(kg m)].

    Attributes:
        measured: As found; NaN on axes that no sensor tells.
        std: Of it.
        inverse: M^-1 of the file.
        configuration: T of the file.
        explained: Share of each axis' acceleration that thrusters explain.
        lag: At which the answer fits best, beyond that of the thrusters [s].
    """

    measured: Float[np.ndarray, "6 n"]
    std: Float[np.ndarray, "6 n"]
    inverse: Float[np.ndarray, "6 6"]
    configuration: Float[np.ndarray, "6 n"]
    explained: Float[np.ndarray, "6"]
    lag: float

    @property
    def expected(self) -> Float[np.ndarray, "6 n"]:
        """As the file says, M^-1 T."""
        return self.inverse @ self.configuration


def columns(model: Model, record: Record, floor: float = np.inf, lags: Sequence[float] = LAGS) -> Columns:
    """The columns from a record of pushes, at the lag of these that explains most.

    Args:
        model: Of the vehicle as its file has it.
        record: Commands and signals.
        floor: Depth of the floor [m]: while the hull is near it, or near the surface, nothing is used.
        lags: That are tried [s].

    Raises:
        IdentificationError: Too little is left.
    """
    motion = Motion.of(record)
    y = accelerations(motion)
    others = _others(motion, y)
    known = np.isfinite(y).any(axis=0)
    good = np.isfinite(y[:, known]).all(axis=1) & np.isfinite(others).all(axis=1) & clear(model, motion, floor, CLEAR)
    if good.sum() < 10 * (others.shape[1] + model.thrusters.count):
        raise IdentificationError(
            f"{record.source}: found {good.sum() * STEP:.1f} s of pushes with gyro and attitude, clear of floor and "
            "surface, expected more. Begin in the middle of the tank, trimmed to float a little, and let go of it only "
            "when the first thruster turns"
        )
    Q = _orthonormal(others[good])
    y = y[good][:, known]
    fits = [_fit(y - Q @ (Q.T @ y), Q, thruster_forces(model, motion, float(lag))[good]) for lag in lags]
    best = int(np.argmin([left for *_, left in fits]))
    slopes, std, explained, _ = fits[best]
    inverse, T = np.asarray(model.inertia_inverse), np.asarray(model.thrusters.configuration)
    measured, errors, shares = np.full(T.shape, np.nan), np.full(T.shape, np.nan), np.full(6, np.nan)
    measured[known], errors[known], shares[known] = slopes, std, explained
    return Columns(measured, errors, inverse, T, shares, float(lags[best]))


def accelerations(motion: Motion) -> Float[np.ndarray, "m 6"]:
    """Accelerations of CO on the grid, b; NaN where no sensor tells."""
    found = np.full((len(motion.t), 6), np.nan)
    gyro, force, R = motion.values("gyro"), motion.values("accelerometer"), motion.rotation
    if gyro is None:
        return found
    omega, omega_dot = gyro
    found[:, 3:] = omega_dot
    if force is not None and R is not None:
        lever = motion.record.signals["accelerometer"].lever
        gravity = R[:, 2, :] * GRAVITY  # R_nb' g, g down
        turning = np.cross(omega_dot, lever) + np.cross(omega, np.cross(omega, lever))
        found[:, :3] = force[0] + gravity - turning
    return found


def clear(model: Model, motion: Motion, floor: float, least: float) -> Bool[np.ndarray, " m"]:
    """When the hull is `least` [m] or more from floor and surface; always where nobody measures depth."""
    depth = motion.values("depth")
    if depth is None:
        return np.ones(len(motion.t), dtype=bool)
    height, z = np.asarray(model.hull.corners)[:, 2], depth[0][:, 0]
    return ~((z + height.max() > floor - least) | (z + height.min() < least))


def speeds(motion: Motion, y: Float[np.ndarray, "m 6"]) -> Float[np.ndarray, "m 6"]:
    """Of CO on the grid, b: body rates, and what accelerations y add up to of late."""
    keep = np.exp(-STEP / MEMORY)
    way = np.asarray(lfilter([STEP], [1.0, -keep], np.nan_to_num(y[:, :3]), axis=0))
    return np.concatenate([way, np.full_like(way, np.nan) if motion.omega is None else motion.omega], axis=1)


def _others(motion: Motion, y: Float[np.ndarray, "m 6"]) -> Float[np.ndarray, "m k"]:
    """What else accelerates: see `nuisances`; and speed as far as accelerations add up to it."""
    way = speeds(motion, y)[:, :3]
    return np.concatenate([nuisances(motion), way, way * np.abs(way)], axis=1)


def _orthonormal(others: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "m k"]:
    """A basis of columns, of which some may be the same or zero."""
    scaled = others / (np.abs(others).max(axis=0) + 1e-12)
    return np.linalg.qr(scaled + 1e-9 * np.random.default_rng(0).normal(size=scaled.shape))[0]


def _fit(
    y: Float[np.ndarray, "m a"], Q: Float[np.ndarray, "m k"], force: Float[np.ndarray, "m n"]
) -> tuple[Float[np.ndarray, "a n"], Float[np.ndarray, "a n"], Float[np.ndarray, " a"], float]:
    """Slopes (a, n), their standard deviations, the share of each axis explained (a,), and the share left in all.

    Args:
        y: Accelerations, what else accelerates taken out.
        Q: Orthonormal, of what else accelerates.
        force: Of each thruster.
    """
    F = force - Q @ (Q.T @ force)
    gram = F.T @ F
    gram += 1e-9 * np.trace(gram) * np.eye(len(gram)) + 1e-12 * np.eye(len(gram))
    slopes = np.linalg.solve(gram, F.T @ y).T
    left = y - F @ slopes.T
    # Neighbours on the grid went through one kernel: so many of them are one independent value.
    alike = 2.0 * np.sqrt(np.pi) * WIDTH / STEP
    variance = (left**2).sum(axis=0) / max(len(y) - alike * F.shape[1], 1.0)
    std = np.sqrt(alike * variance[:, None] * np.diag(np.linalg.inv(gram))[None, :])
    power = (y**2).sum(axis=0) + 1e-12
    share = 1.0 - (left**2).sum(axis=0) / power
    return slopes, std, share, float(np.mean(1.0 - share))
