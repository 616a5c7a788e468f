"""What was known of every instant once all had been received: the filter forwards, then backwards through its passages.

    dx_k = G (x_smoothed(k+1) - x_predicted(k+1)),   G = P_k Phi' P_predicted^-1

Everything is linear in the error about the filter's own states, whose attitude is a small rotation.

Reference: Rauch, Tung and Striebel (1965), AIAA Journal 3(8); Särkkä (2013), Bayesian Filtering and Smoothing, ch. 8.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.transform import Rotation

from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Measurements
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import PerThruster
from rovtwin.gnc.interfaces import ObserverInput
from rovtwin.gnc.navigation.filter import NavigationFilter, NavigationMemory
from rovtwin.gnc.navigation.state import ATTITUDE, ERRORS, MOVING

_Q = slice(6, 10)  # the quaternion in the state's vector of 32 numbers; one more than its error has
SECONDS_AT_ONCE = 60  # of the filter, between host and compiled loop


@dataclass(frozen=True)
class Smoothed:
    """A track, smoothed.

    Attributes:
        t: Time [s].
        eta: Pose of CO with the waves' motion, zyx Euler angles.
        nu: Velocity over ground, b.
        std: Of north, east, down, Euler angles (small angles, b) and linear velocity [m, rad, m/s].
        filtered: The filter's own pose.
    """

    t: Float[np.ndarray, " n"]
    eta: Float[np.ndarray, "n 6"]
    nu: Float[np.ndarray, "n 6"]
    std: Float[np.ndarray, "n 9"]
    filtered: Float[np.ndarray, "n 6"]


def smooth(
    filter: NavigationFilter, start: Start, slots: Measurements, commands: Float[np.ndarray, "n thrusters"], dt: float
) -> Smoothed:
    """Smooth a recording.

    Args:
        filter: Its beliefs.
        start: Where the recording begins.
        slots: Readings by sensor, tick by tick: leading axis n.
        commands: That were sent over the tick before.
        dt: Tick [s].
    """
    n = len(commands)
    memory, parts = filter.init(jax.random.key(0), start), []
    chunk = round(SECONDS_AT_ONCE / dt)
    for begin in range(0, n, chunk):
        some = jax.tree.map(lambda leaf, b=begin: jnp.asarray(leaf[b : b + chunk]), (slots, commands))
        memory, out = _forwards(filter, memory, *some, dt)
        parts.append(jax.device_get(out))
    x, P, x_after, P_after, B, omega, filtered = (np.concatenate(part) for part in zip(*parts, strict=True))
    states, covariances = _backwards(x, P, x_after, P_after, B, np.asarray(memory.x.as_vector()), np.asarray(memory.P))
    R = Rotation.from_quat(states[:, _Q], scalar_first=True)
    euler = R.as_euler("ZYX")[:, ::-1]
    v = states[:, 3:6] + R.inv().apply(states[:, 13:16])
    variance = np.diagonal(covariances, axis1=1, axis2=2)
    return Smoothed(
        t=dt * np.arange(n),
        eta=np.concatenate([states[:, :3] + states[:, 10:13], euler], axis=1),
        nu=np.concatenate([v, omega], axis=1),
        std=np.sqrt(np.concatenate([_with_waves(covariances), variance[:, 6:9], _of_velocity(covariances, R)], axis=1)),
        filtered=filtered,
    )


def _with_waves(P: Float[np.ndarray, "n 31 31"]) -> Float[np.ndarray, "n 3"]:
    """Variance of position and waves together."""
    i, j = np.arange(3), np.arange(9, 12)
    return P[:, i, i] + 2.0 * P[:, i, j] + P[:, j, j]


def _of_velocity(P: Float[np.ndarray, "n 31 31"], R: Rotation) -> Float[np.ndarray, "n 3"]:
    """Variance of the velocity and the waves' together, b."""
    R_bn = R.inv().as_matrix()
    cross = np.einsum("nij,nij->ni", R_bn, P[:, 3:6, 12:15])
    waves = np.einsum("nij,njk,nik->ni", R_bn, P[:, 12:15, 12:15], R_bn)
    return np.diagonal(P[:, 3:6, 3:6], axis1=1, axis2=2) + 2.0 * cross + waves


@partial(jax.jit, static_argnames="dt")
def _forwards(
    filter: NavigationFilter,
    memory: NavigationMemory,
    slots: Measurements,
    commands: Float[Array, "n thrusters"],
    dt: float,
) -> tuple[NavigationMemory, tuple[Float[Array, "..."], ...]]:
    def tick(
        memory: NavigationMemory, inputs: tuple[Measurements, PerThruster]
    ) -> tuple[NavigationMemory, tuple[Float[Array, "..."], ...]]:
        slots, u = inputs
        after, estimate, passed = filter.passed(memory, ObserverInput(slots, Command(u)), dt)
        kept = passed.x.as_vector(), passed.P, passed.x_after.as_vector(), passed.P_after, passed.B
        return after, (*kept, after.omega, estimate.eta)

    return jax.lax.scan(tick, memory, (slots, commands))


def _backwards(
    x: Float[np.ndarray, "n 32"],
    P: Float[np.ndarray, "n 31 31"],
    x_after: Float[np.ndarray, "n 32"],
    P_after: Float[np.ndarray, "n 31 31"],
    B: Float[np.ndarray, "n 15 31"],
    x_n: Float[np.ndarray, "32"],
    P_n: Float[np.ndarray, "31 31"],
) -> tuple[Float[np.ndarray, "n 32"], Float[np.ndarray, "n 31 31"]]:
    """States and covariances after each tick."""
    states, covariances = np.empty_like(x), np.empty_like(P)
    states[-1], covariances[-1] = x_n, P_n
    for k in range(len(x) - 1, 0, -1):
        Phi = np.eye(ERRORS)
        Phi[:MOVING] += B[k]
        Phi = Phi @ Phi
        # Scaled to correlations: the states' units differ by ten orders of magnitude.
        s = 1.0 / np.sqrt(np.diagonal(P_after[k]))
        factor = cho_factor(P_after[k] * s[:, None] * s + 1e-12 * np.eye(ERRORS), check_finite=False)
        G = (s[:, None] * cho_solve(factor, s[:, None] * (Phi @ P[k]), check_finite=False)).T
        states[k - 1] = _plus(x[k], G @ _minus(states[k], x_after[k]))
        change = covariances[k] - P_after[k]
        covariances[k - 1] = P[k] + G @ change @ G.T
    return states, covariances


def _minus(a: Float[np.ndarray, "32"], b: Float[np.ndarray, "32"]) -> Float[np.ndarray, "31"]:
    """Error that takes state b to a."""
    e = np.concatenate([a[:6] - b[:6], np.zeros(3), a[10:] - b[10:]])
    turn = Rotation.from_quat(b[_Q], scalar_first=True).inv() * Rotation.from_quat(a[_Q], scalar_first=True)
    e[ATTITUDE] = turn.as_rotvec()
    return e


def _plus(x: Float[np.ndarray, "32"], e: Float[np.ndarray, "31"]) -> Float[np.ndarray, "32"]:
    """State x with an error added."""
    turned = Rotation.from_quat(x[_Q], scalar_first=True) * Rotation.from_rotvec(e[ATTITUDE])
    return np.concatenate([x[:6] + e[:6], turned.as_quat(scalar_first=True), x[10:] + e[9:]])
