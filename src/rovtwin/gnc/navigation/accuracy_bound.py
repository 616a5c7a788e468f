"""What no observer can beat: the steady-state position sigma for a vehicle, its sensors and a declared disturbance.

Along surge and along sway the model is linearised about a speed,

    p_dot = v,   m v_dot = -d v + b,   b_dot = w,

with the disturbance b a random walk. Readings come at their own rates, so that the covariance never settles but repeats
itself; its Riccati recursion over one common period is a map f(P) = G + A P (I + H P)^-1 A' which, put after itself
again and again (doubling), forgets where it began. Computed offline, in NumPy.

Reference: Särkkä and García-Fernández (2021), Temporal Parallelization of Bayesian Smoothers, IEEE TAC 66(1), lemma 8
(composition of the maps); Van Loan (1978), Computing Integrals Involving the Matrix Exponential, IEEE TAC 23(3).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import as_array
from rovtwin.vehicle.physics.linearisation import damping_jacobian
from rovtwin.vehicle.physics.model import Model

When = Literal["mean", "before", "after"]

TICK = 0.02  # sigma is averaged over instants at most this far apart [s]
MAX_STEPS = 20_000


@dataclass(frozen=True)
class Reading:
    """A scalar measurement `row @ x` with noise `sigma`, `rate` times a second."""

    row: Float[np.ndarray, " n"]
    sigma: float
    rate: float


def position_bound(
    model: Model,
    speed: float,
    position_sigma: float,
    position_rate: float,
    force_walk: float,
    dvl_sigma: float | None = None,
    dvl_rate: float | None = None,
    *,
    accelerometer_sigma: float | None = None,
    accelerometer_rate: float | None = None,
    accelerometer_bias_walk: float = 1e-5,
    velocity_noise: float = 0.0,
    when: When = "mean",
) -> Float[np.ndarray, "2"]:
    """Steady-state standard deviation of the position along surge and sway [m].

    Of the optimal filter for the linearised model: of a nonlinear filter in the same conditions, with the mission's
    varying speed and the heading's error, the error is a little more.

    Args:
        model: The vehicle.
        speed: Ahead through the water, about which damping is linearised [m/s]; sway is linearised about zero.
        position_sigma: Noise of the positions per axis [m].
        position_rate: Their rate [Hz].
        force_walk: Random walk of the disturbance force on each axis [N/sqrt(s)].
        dvl_sigma: Noise of the velocity over ground [m/s]; None: no DVL.
        dvl_rate: Its rate [Hz].
        accelerometer_sigma: Noise of an accelerometer used beside the model, its bias estimated [m/s2]; None: not used.
        accelerometer_rate: Its rate [Hz].
        accelerometer_bias_walk: Random walk of its bias [m/s2/sqrt(s)].
        velocity_noise: Unmodelled acceleration as white noise [m/s/sqrt(s)].
        when: Root mean variance over time, or sigma just before or just after a position.
    """
    walks = {"force_walk": force_walk, "velocity_noise": velocity_noise, "bias_walk": accelerometer_bias_walk}
    for name, value in walks.items():
        if not (math.isfinite(value) and value >= 0):
            raise ConfigError(f"position bound: {name}: found {value}, expected a number of at least 0")
    mass, slope = np.diag(model.inertia)[:2], damping_slopes(model, speed)
    sigmas = []
    for m, d in zip(mass, slope, strict=True):
        F = np.array([[0, 1, 0, 0], [0, -d / m, 1 / m, 0], [0, 0, 0, 0], [0, 0, 0, 0]])
        noise = np.diag([0, velocity_noise, force_walk, accelerometer_bias_walk]) ** 2.0
        readings = [_reading("position", [1.0, 0, 0, 0], position_sigma, position_rate)]
        if dvl_sigma is not None:
            readings.append(_reading("dvl", [0, 1.0, 0, 0], dvl_sigma, dvl_rate))
        used = 3  # nothing would tell the accelerometer's bias
        if accelerometer_sigma is not None:
            used = 4
            readings.append(_reading("accelerometer", [0, -d / m, 1 / m, 1.0], accelerometer_sigma, accelerometer_rate))
        readings = [Reading(r.row[:used], r.sigma, r.rate) for r in readings]
        sigmas.append(periodic_sigma(F[:used, :used], noise[:used, :used], readings, when))
    return np.array(sigmas)


def inertial_bound(
    position_sigma: float,
    position_rate: float,
    accelerometer_sigma: float,
    accelerometer_rate: float,
    accelerometer_bias_walk: float = 1e-5,
    dvl_sigma: float | None = None,
    dvl_rate: float | None = None,
    when: When = "mean",
) -> float:
    """The same per axis [m] without a vehicle model: the accelerometer integrated, its slow bias estimated.

    Attitude is taken as known; args as in `position_bound`.
    """
    _positive("accelerometer_sigma", accelerometer_sigma)
    _positive("accelerometer_rate", accelerometer_rate)
    F = np.array([[0.0, 1, 0], [0, 0, 1], [0, 0, 0]])
    white = accelerometer_sigma / math.sqrt(accelerometer_rate)
    noise = np.diag([0.0, white, accelerometer_bias_walk]) ** 2
    readings = [_reading("position", [1.0, 0, 0], position_sigma, position_rate)]
    if dvl_sigma is not None:
        readings.append(_reading("dvl", [0, 1.0, 0], dvl_sigma, dvl_rate))
    return periodic_sigma(F, noise, readings, when)


def damping_slopes(model: Model, speed: float) -> Float[np.ndarray, "2"]:
    """d(damping force)/d(velocity) along surge at `speed` and along sway at zero [N s/m]."""
    nu = as_array(np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0]))
    return np.diagonal(np.asarray(damping_jacobian(model, nu)))[:2]


def periodic_sigma(
    F: Float[np.ndarray, "n n"], noise: Float[np.ndarray, "n n"], readings: Sequence[Reading], when: When = "mean"
) -> float:
    """Steady-state sigma of the first state of x_dot = F x + w, E ww' = noise, under periodic readings.

    Args:
        F: Of the states.
        noise: Intensity of w.
        readings: At least one; the first is the one that `before` and `after` refer to.
        when: See `position_bound`.
    """
    step, due = _schedule([reading.rate for reading in readings])
    Phi, Q = discretise(F, noise, step)
    n = len(F)
    predict = _Map(Phi, Q, np.zeros((n, n)))
    updates = [_Map(np.eye(n), np.zeros((n, n)), np.outer(r.row, r.row) / r.sigma**2) for r in readings]
    period = _Map(np.eye(n), np.zeros((n, n)), np.zeros((n, n)))
    steps = []
    for row in due:
        one = predict
        for update in (u for u, comes in zip(updates, row, strict=True) if comes):
            one = one.then(update)
        steps.append(one)
        period = period.then(one)
    P = _limit(period)
    variance, before = [], []
    for one, row in zip(steps, due, strict=True):
        if row[0]:
            before.append(predict(P)[0, 0])
        P = one(P)
        variance.append(P[0, 0])
    after = [v for v, row in zip(variance, due, strict=True) if row[0]]
    return math.sqrt(np.mean({"mean": variance, "before": before, "after": after}[when]))


def discretise(
    F: Float[np.ndarray, "n n"], noise: Float[np.ndarray, "n n"], step: float
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n n"]]:
    """Phi and Q of x_dot = F x + w over `step` seconds, exactly. Van Loan (1978)."""
    from scipy.linalg import expm  # here, not above: 0.15 s that only the end of a flight needs

    n = len(F)
    whole = expm(np.block([[-F, noise], [np.zeros((n, n)), F.T]]) * step)
    Phi = whole[n:, n:].T
    return Phi, Phi @ whole[:n, n:]


@dataclass(frozen=True)
class _Map:
    """P -> G + A P (I + H P)^-1 A'."""

    A: Float[np.ndarray, "n n"]
    G: Float[np.ndarray, "n n"]
    H: Float[np.ndarray, "n n"]

    def __call__(self, P: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
        middle = np.linalg.solve((np.eye(len(P)) + self.H @ P).T, P.T).T
        after = self.G + self.A @ middle @ self.A.T
        return 0.5 * (after + after.T)

    def then(self, other: "_Map") -> "_Map":
        identity = np.eye(len(self.A))
        left = np.linalg.solve((identity + self.G @ other.H).T, other.A.T).T
        right = np.linalg.solve((identity + other.H @ self.G).T, self.A).T
        return _Map(left @ self.A, other.G + left @ self.G @ other.A.T, self.H + right @ other.H @ self.A)


def _limit(period: _Map) -> Float[np.ndarray, "n n"]:
    """Fixed point of the map: where P = 0 ends after 2^k periods."""
    for _ in range(64):
        twice = period.then(period)
        if np.allclose(twice.G, period.G, rtol=1e-10, atol=1e-14):
            return twice.G
        period = twice
    raise ConfigError("position bound: the variance has no steady state; does a sensor give positions?")


def _schedule(rates: Sequence[float]) -> tuple[float, list[list[bool]]]:
    """Length of a step [s], and for each step of one period which of the readings come at its end."""
    exact = [Fraction(rate).limit_denominator(1000) for rate in rates]
    fastest = Fraction(math.lcm(*(r.numerator for r in exact)), math.gcd(*(r.denominator for r in exact)))
    slowest = Fraction(math.gcd(*(r.numerator for r in exact)), math.lcm(*(r.denominator for r in exact)))
    fastest *= max(1, math.ceil(1 / (TICK * fastest)))
    count = int(fastest / slowest)
    if count > MAX_STEPS:
        raise ConfigError(f"position bound: rates {list(rates)} Hz have no short common period; round them")
    return float(1 / fastest), [[(k * r / fastest).denominator == 1 for r in exact] for k in range(1, count + 1)]


def _reading(name: str, row: list[float], sigma: float, rate: float | None) -> Reading:
    if rate is None:
        raise ConfigError(f"position bound: {name}_rate is missing, expected a rate in Hz beside {name}_sigma")
    return Reading(np.array(row), _positive(f"{name}_sigma", sigma), _positive(f"{name}_rate", rate))


def _positive(name: str, value: float) -> float:
    if not (math.isfinite(value) and value > 0):
        raise ConfigError(f"position bound: {name}: found {value}, expected a number above 0")
    return value
