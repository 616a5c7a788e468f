"""How well a smoothed track will be known along a path that is only planned: the joint covariance of its key frames.

The filter's horizontal part, linearised about the plan: place in n, velocity in b, the disturbances that `Tuning` has
(forces in n and in b, current, drag, the accelerometer's bias), driven by the same walks, read by the same sensors.
Riccati recursion forwards, Rauch-Tung-Striebel backwards, and between key frames i < j

    Cov(x_i, x_j | all) = G_i .. G_(j-1) P_j.

Left out are attitude, which compass and gyro tell much better than a map needs, and waves. Constants that the filter
knows nothing of (a compass that is off, a Doppler log that is turned or reads too much) are considered: V, how the
smoothed place answers to each of them, is what the same gains make of a path with that constant.

References: Rauch, Tung and Striebel (1965), AIAA Journal 3(8); Jazwinski (1970), Stochastic Processes and Filtering
Theory, sec. 8.4 (consider filter); Särkkä (2013), Bayesian Filtering and Smoothing, ch. 8.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import as_array
from rovtwin.gnc.navigation.accuracy_bound import damping_slopes, discretise
from rovtwin.gnc.navigation.state import ACCELEROMETER_BIAS, CURRENT, DRAG, FORCE_B, FORCE_N
from rovtwin.gnc.navigation.tuning import Tuning
from rovtwin.vehicle.physics.dynamics import damping_force
from rovtwin.vehicle.physics.model import Model

STATES = 14
_P, _V, _N, _B, _C, _A, _D = (slice(2 * i, 2 * i + 2) for i in range(STATES // 2))
_FILTER = ((_N, FORCE_N), (_B, FORCE_B), (_C, CURRENT), (_A, ACCELEROMETER_BIAS), (_D, DRAG))
CONSTANTS = ("heading", "dvl_yaw", "dvl_scale")
"""That are considered: compass bias [rad], the Doppler log's yaw [rad], the share by which it reads too much."""


@dataclass(frozen=True)
class Aids:
    """Readings along the path, each as (standard deviation per axis, rate [Hz]).

    Attributes:
        position: Of north and east [m].
        accelerometer: Of surge and sway [m/s2].
        dvl: Velocity over ground, surge and sway [m/s]; None: no Doppler log.
    """

    position: tuple[float, float]
    accelerometer: tuple[float, float]
    dvl: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("position", "accelerometer", "dvl"):
            pair = getattr(self, name)
            if pair is not None and not (np.isfinite(pair).all() and min(pair) > 0):
                raise ConfigError(f"{name}: found noise and rate {pair}, expected two numbers above 0")


@dataclass(frozen=True)
class KeyFrames:
    """What will be known of the key frames' places.

    Attributes:
        covariance: Of north and east of the k key frames, in order north 1, east 1, north 2 .. [m2].
        response: d(error of the same) / d(constants), see `CONSTANTS` [m/rad, m/rad, m].
    """

    covariance: Float[np.ndarray, "k2 k2"]
    response: Float[np.ndarray, "k2 3"]

    @property
    def std(self) -> Float[np.ndarray, "k 2"]:
        """Of north and east by what sensors and disturbances do, constants not counted [m]."""
        return np.sqrt(np.diagonal(self.covariance)).reshape(-1, 2)


def path_accuracy(
    model: Model,
    tuning: Tuning,
    aids: Aids,
    step: float,
    heading: Float[np.ndarray, " n"],
    speed: Float[np.ndarray, " n"],
    key: Int[np.ndarray, " k"],
    start_std: float,
) -> KeyFrames:
    """The joint covariance along a path.

    Args:
        model: The vehicle.
        tuning: Of the filter that will be flown.
        aids: What it reads.
        step: Between instants [s].
        heading: Of the vehicle in each step [rad].
        speed: Ahead in each step [m/s].
        key: Which instants are key frames, growing; instant i is the end of step i.
        start_std: Of north and east at the beginning [m]; 0 where the place is known exactly.

    Raises:
        ConfigError: No steps, or key frames that are not among them or do not grow.
    """
    if not (len(heading) and len(key) and 0 <= key[0] and key[-1] < len(heading) and (np.diff(key) > 0).all()):
        raise ConfigError(f"path accuracy: key frames must grow and lie within the {len(heading)} steps")
    local = _Linearised(model, tuning, aids, step, float(np.max(speed)))
    P, V = _start(tuning, start_std), np.zeros((STATES, len(CONSTANTS)))
    forwards = []
    for angle, along in zip(heading, speed, strict=True):
        Phi, Q, H, noise = local.matrices(float(angle), bool(along > 0.0))
        drift, bias = local.constants(float(angle), float(along), len(noise))
        P_before = Phi @ P @ Phi.T + Q
        V_before = Phi @ V + drift
        S = H @ P_before @ H.T + np.diag(noise)
        gain = np.linalg.solve(S, H @ P_before).T
        forwards.append((Phi, drift, P, V, P_before, V_before))
        left = np.eye(STATES) - gain @ H
        P = left @ P_before @ left.T + (gain * noise) @ gain.T
        V = left @ V_before - gain @ bias
    return _backwards(forwards, P, V, key)


def _backwards(forwards: list, P: np.ndarray, V: np.ndarray, key: Int[np.ndarray, " k"]) -> KeyFrames:
    """Smoothed places of the key frames and all that they have in common; P and V after the last step."""
    chosen, count = {int(k): i for i, k in enumerate(key)}, len(key)
    covariance, response = np.zeros((2 * count, 2 * count)), np.zeros((2 * count, len(CONSTANTS)))
    later = np.zeros((STATES, 0))  # Cov(x_i, places of key frames after i)
    for i in range(len(forwards) - 1, -1, -1):
        if i in chosen:
            row = slice(2 * chosen[i], 2 * chosen[i] + 2)
            covariance[row, row] = P[_P, _P]
            covariance[row, row.stop :] = later[_P]
            covariance[row.stop :, row] = later[_P].T
            response[row] = V[_P]
            later = np.concatenate([P[:, _P], later], axis=1)
        Phi, drift, P_filtered, V_filtered, P_before, V_before = forwards[i]
        gain = np.linalg.solve(P_before, Phi @ P_filtered).T
        P = P_filtered + gain @ (P - P_before) @ gain.T
        P = 0.5 * (P + P.T)
        V = V_filtered - gain @ (V_before - V)
        later = gain @ later
    return KeyFrames(covariance, response)


def _start(tuning: Tuning, start_std: float) -> Float[np.ndarray, "14 14"]:
    std = np.zeros(STATES)
    std[_P], std[_V] = max(start_std, 1e-6), np.asarray(tuning.initial_std)[3:5]
    for ours, theirs in _FILTER:
        std[ours] = np.asarray(tuning.initial_std)[theirs][:2]
    return np.diag(std**2)


class _Linearised:
    """Matrices of a step, made once for each heading."""

    def __init__(self, model: Model, tuning: Tuning, aids: Aids, step: float, speed: float) -> None:
        self._model, self._aids, self._step = model, aids, step
        self._mass = np.diagonal(np.asarray(model.inertia))[:2]
        self._slopes = {going: damping_slopes(model, speed if going else 0.0) for going in (False, True)}
        drag = np.asarray(damping_force(model, as_array(np.array([speed, 0, 0, 0, 0, 0], float))))[:2]
        self._drag = {False: np.zeros(2), True: np.abs(drag)}
        self._white = np.asarray(tuning.acceleration_noise)[:2] ** 2.0
        walk = np.asarray(tuning.walk)
        self._walk = np.zeros(STATES)
        for ours, theirs in _FILTER:
            self._walk[ours] = walk[theirs][:2] ** 2.0
        self._known: dict[tuple[float, bool], tuple[np.ndarray, ...]] = {}

    def matrices(self, heading: float, going: bool) -> tuple[np.ndarray, ...]:
        """Phi and Q over a step, H of the readings in it, and the variance of each."""
        at = (round(heading, 6), going)
        if at not in self._known:
            self._known[at] = self._matrices(heading, going)
        return self._known[at]

    def _matrices(self, heading: float, going: bool) -> tuple[np.ndarray, ...]:
        R = _rotation(heading)
        slope = np.diag(self._slopes[going] / self._mass)
        acceleration = np.zeros((2, STATES))
        acceleration[:, _V], acceleration[:, _C] = -slope, slope @ R.T
        acceleration[:, _N], acceleration[:, _B] = R.T / self._mass[:, None], np.diag(1.0 / self._mass)
        acceleration[:, _D] = -np.diag(self._drag[going] / self._mass)
        F = np.zeros((STATES, STATES))
        F[_P, _V], F[_V] = R, acceleration
        noise = np.diag(self._walk)
        noise[_V, _V] = np.diag(self._white)
        Phi, Q = discretise(F, noise, self._step)
        rows, variances = [np.eye(STATES)[_P]], [self._variance(self._aids.position)]
        inertial = acceleration.copy()
        inertial[:, _A] = np.eye(2)
        rows.append(inertial)
        # Its mean over a step differs from the model's by what drives the velocity, too.
        variances.append(self._variance(self._aids.accelerometer) + self._white / self._step)
        if self._aids.dvl is not None:
            rows.append(np.eye(STATES)[_V])
            variances.append(self._variance(self._aids.dvl))
        return Phi, Q, np.concatenate(rows), np.concatenate(variances)

    def _variance(self, aid: tuple[float, float]) -> Float[np.ndarray, "2"]:
        """Of the mean of the readings in a step; of those that come less often, their share of one."""
        return np.full(2, aid[0] ** 2 / (aid[1] * self._step))

    def constants(self, heading: float, speed: float, readings: int) -> tuple[np.ndarray, np.ndarray]:
        """What each constant adds to the state over a step that the filter does not know of, and to the readings.

        A compass that is off sends the true way aside of the estimated one; a Doppler log reads the velocity turned
        the other way, or too much.
        """
        drift, bias = np.zeros((STATES, len(CONSTANTS))), np.zeros((readings, len(CONSTANTS)))
        aside = _rotation(heading) @ np.array([0.0, speed])
        drift[_P, CONSTANTS.index("heading")] = aside * self._step
        if self._aids.dvl is not None:
            bias[-1, CONSTANTS.index("dvl_yaw")] = -speed
            bias[-2, CONSTANTS.index("dvl_scale")] = speed
        return drift, bias


def _rotation(heading: float) -> Float[np.ndarray, "2 2"]:
    return np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
