"""What was known of every instant once all had been received: the filter forwards, then backwards through its passages.

    dx_k = G (x_smoothed(k+1) - x_predicted(k+1)),   G = P_k Phi' P_predicted^-1

Everything is linear in the error about the filter's own states, whose attitude is a small rotation. Constants of the
sensors are taken out of the readings by a step each way; what filter and smoother answer goes backwards through the
same gains.

Reference: Rauch, Tung and Striebel (1965), AIAA Journal 3(8); Särkkä (2013), Bayesian Filtering and Smoothing, ch. 8.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.transform import Rotation

from rovtwin.core.arrays.key_frames import KeyFrames
from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Measurements
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import PerThruster
from rovtwin.gnc.interfaces import ObserverInput
from rovtwin.gnc.navigation.constants import SensorConstant, estimate_constants, started_without, without
from rovtwin.gnc.navigation.filter import NavigationFilter, NavigationMemory
from rovtwin.gnc.navigation.state import ATTITUDE, ERRORS, MOVING, POSITION, WAVE_PLACE
from rovtwin.gnc.navigation.state_errors import QUATERNION, difference, differences, sum_of, sums

SECONDS_AT_ONCE = 60  # of the filter, between host and compiled loop
KEY_INTERVAL = 1.0  # between key frames [s]
_POSE = np.zeros((6, ERRORS))  # errors of CO's pose, waves and all, of those of the state
_POSE[:3, POSITION] = _POSE[:3, WAVE_PLACE] = _POSE[3:, ATTITUDE] = np.eye(3)


@dataclass(frozen=True)
class Smoothed:
    """A track, smoothed.

    Attributes:
        t: Time [s].
        eta: Pose of CO with the waves' motion, zyx Euler angles.
        nu: Velocity over ground, b.
        std: Of north, east, down, Euler angles (small angles, b) and linear velocity [m, rad, m/s].
        filtered: The filter's own pose.
        covariance: Of place in n and attitude (small rotation, b) at each tick, constants of the sensors included.
        keys: How the errors of different instants hang together.
    """

    t: Float[np.ndarray, " n"]
    eta: Float[np.ndarray, "n 6"]
    nu: Float[np.ndarray, "n 6"]
    std: Float[np.ndarray, "n 9"]
    filtered: Float[np.ndarray, "n 6"]
    covariance: Float[np.ndarray, "n 6 6"]
    keys: KeyFrames


@dataclass(frozen=True)
class _Forwards:
    """Of the filter at each tick, and at its end."""

    x: Float[np.ndarray, "n 32"]
    P: Float[np.ndarray, "n 31 31"]
    x_after: Float[np.ndarray, "n 32"]
    P_after: Float[np.ndarray, "n 31 31"]
    B: Float[np.ndarray, "n 15 31"]
    innovations: Float[np.ndarray, "n m"]
    omega: Float[np.ndarray, "n 3"]
    filtered: Float[np.ndarray, "n 6"]
    x_n: Float[np.ndarray, "32"]
    P_n: Float[np.ndarray, "31 31"]


@dataclass(frozen=True)
class _Backwards:
    """Of the smoother at each tick: states, covariances, responses to steps; products of gains between key frames."""

    states: Float[np.ndarray, "n 32"]
    covariances: Float[np.ndarray, "n 31 31"]
    moved: Float[np.ndarray, "n 31 steps"]
    gains: Float[np.ndarray, "k-1 31 31"]


def smooth(
    filter: NavigationFilter,
    start: Start,
    slots: Measurements,
    commands: Float[np.ndarray, "n thrusters"],
    dt: float,
    constants: Sequence[SensorConstant] = (),
) -> Smoothed:
    """Smooth a recording.

    Args:
        filter: Its beliefs.
        start: Where the recording begins.
        slots: Readings by sensor, tick by tick: leading axis n.
        commands: That were sent over the tick before.
        dt: Tick [s].
        constants: Of the sensors, to be estimated as far as the readings know them.
    """
    n = len(commands)
    found = _run_forwards(filter, start, slots, commands, dt)
    deltas, innovations = _responses(filter, start, slots, commands, dt, constants, found)
    at = np.unique(np.append(np.arange(0, n, max(round(KEY_INTERVAL / dt), 1)), n - 1))
    back = _run_backwards(found, deltas, at)
    steps, half = np.array([one.std for one in constants]), len(constants)
    plus, minus = back.moved[..., :half], back.moved[..., half:]
    V = (plus - minus) / (2.0 * steps)
    value, S = estimate_constants(found.innovations.ravel(), innovations[:half], innovations[half:], steps, steps)
    size = np.abs(_POSE @ (plus - minus)).max(axis=(0, 1), initial=0.0)
    bent = np.abs(_POSE @ (plus + minus)).max(axis=(0, 1), initial=0.0) / np.maximum(size, 1e-12)
    states = sums(back.states, V @ value)
    place, q = states[:, :3] + states[:, 10:13], states[:, QUATERNION]
    names = tuple(one.name for one in constants)
    links = dt * at, place[at], q[at], back.gains, back.covariances[at], _POSE
    keys = KeyFrames(*links, names, _POSE @ V[at], steps, value, S, bent)
    for piece in _pieces(n, dt):
        back.covariances[piece] += V[piece] @ S @ V[piece].transpose(0, 2, 1)
    return _track(dt * np.arange(n), found, states, back.covariances, keys)


def _track(
    t: Float[np.ndarray, " n"],
    found: _Forwards,
    states: Float[np.ndarray, "n 32"],
    covariances: Float[np.ndarray, "n 31 31"],
    keys: KeyFrames,
) -> Smoothed:
    R = Rotation.from_quat(states[:, QUATERNION], scalar_first=True)
    v = states[:, 3:6] + R.inv().apply(states[:, 13:16])
    poses = _POSE @ covariances @ _POSE.T
    variance = np.concatenate([np.diagonal(poses, axis1=1, axis2=2), _of_velocity(covariances, R)], axis=1)
    return Smoothed(
        t=t,
        eta=np.concatenate([states[:, :3] + states[:, 10:13], R.as_euler("ZYX")[:, ::-1]], axis=1),
        nu=np.concatenate([v, found.omega], axis=1),
        std=np.sqrt(variance),
        filtered=found.filtered,
        covariance=poses,
        keys=keys,
    )


def _run_forwards(
    filter: NavigationFilter, start: Start, slots: Measurements, commands: Float[np.ndarray, "n thrusters"], dt: float
) -> _Forwards:
    memory, kept = _in_chunks(filter, start, slots, commands, dt, whole=True)
    x, x_after, innovations, P, P_after, B, omega, filtered = kept
    end = np.asarray(memory.x.as_vector()), np.asarray(memory.P)
    return _Forwards(x, P, x_after, P_after, B, innovations, omega, filtered, *end)


def _in_chunks(
    filter: NavigationFilter,
    start: Start,
    slots: Measurements,
    commands: Float[np.ndarray, "n thrusters"],
    dt: float,
    whole: bool,
) -> tuple[NavigationMemory, list[np.ndarray]]:
    """The filter's memory at the end, and what `_forwards` keeps of all ticks."""
    memory, kept, n = filter.init(jax.random.key(0), start), [], len(commands)
    for at in _pieces(n, dt):
        some = jax.tree.map(lambda leaf, at=at: jnp.asarray(leaf[at]), (slots, commands))
        memory, out = _forwards(filter, memory, *some, dt, whole)
        kept = kept or [np.empty((n, *leaf.shape[1:]), leaf.dtype) for leaf in out]  # filled in place: it is large
        for all_of_it, leaf in zip(kept, out, strict=True):
            all_of_it[at] = leaf
    return memory, kept


def _pieces(n: int, dt: float) -> list[slice]:
    """Ticks of SECONDS_AT_ONCE each."""
    chunk = round(SECONDS_AT_ONCE / dt)
    return [slice(begin, begin + chunk) for begin in range(0, n, chunk)]


def _responses(
    filter: NavigationFilter,
    start: Start,
    slots: Measurements,
    commands: Float[np.ndarray, "n thrusters"],
    dt: float,
    constants: Sequence[SensorConstant],
    found: _Forwards,
) -> tuple[tuple[Float[np.ndarray, "n+1 31 steps"], Float[np.ndarray, "n 31 steps"]], Float[np.ndarray, "steps m"]]:
    """By how much states after and before corrections move, and the innovations then.

    Of each constant's step taken out, then of each put in.
    """
    n, before, after, innovations = len(commands), [], [], []
    turns = Rotation.from_quat(found.x_after[:, QUATERNION], scalar_first=True).inv()
    velocity = found.x_after[:, 3:6] + turns.apply(found.x_after[:, 13:16])
    for sign in (1.0, -1.0):
        for one in constants:
            changed = without(slots, one, sign * one.std, filter.tuning, velocity)
            began = started_without(start, one, sign * one.std)
            memory, (x, x_after, z) = _in_chunks(filter, began, changed, commands, dt, whole=False)
            last = differences(np.asarray(memory.x.as_vector())[None], found.x_n[None])
            before.append(np.concatenate([differences(x, found.x), last]))
            after.append(differences(x_after, found.x_after))
            innovations.append(z.ravel())
    if not constants:
        none = np.zeros((n, ERRORS, 0))
        return (np.zeros((n + 1, ERRORS, 0)), none), np.zeros((0, found.innovations.size))
    return (np.stack(before, axis=-1), np.stack(after, axis=-1)), np.stack(innovations)


def _of_velocity(P: Float[np.ndarray, "n 31 31"], R: Rotation) -> Float[np.ndarray, "n 3"]:
    """Variance of the velocity and the waves' together, b."""
    R_bn = R.inv().as_matrix()
    cross = np.einsum("nij,nij->ni", R_bn, P[:, 3:6, 12:15])
    waves = np.einsum("nij,njk,nik->ni", R_bn, P[:, 12:15, 12:15], R_bn)
    return np.diagonal(P[:, 3:6, 3:6], axis1=1, axis2=2) + 2.0 * cross + waves


_Tick = tuple[Measurements, PerThruster]


@partial(jax.jit, static_argnames=("dt", "whole"))
def _forwards(
    filter: NavigationFilter,
    memory: NavigationMemory,
    slots: Measurements,
    commands: Float[Array, "n thrusters"],
    dt: float,
    whole: bool,
) -> tuple[NavigationMemory, tuple[Float[Array, "..."], ...]]:
    """The filter over a chunk of ticks: states before and after the step, innovations; if `whole`, all the rest too.

    Covariances of readings with a constant put in are nearly those of the readings as they are.
    """

    def tick(memory: NavigationMemory, inputs: _Tick) -> tuple[NavigationMemory, tuple[Float[Array, "..."], ...]]:
        slots, u = inputs
        after, estimate, passed = filter.passed(memory, ObserverInput(slots, Command(u)), dt)
        states = passed.x.as_vector(), passed.x_after.as_vector(), passed.innovations
        return after, (*states, passed.P, passed.P_after, passed.B, after.omega, estimate.eta) if whole else states

    return jax.lax.scan(tick, memory, (slots, commands))


def _run_backwards(
    found: _Forwards,
    deltas: tuple[Float[np.ndarray, "n+1 31 steps"], Float[np.ndarray, "n 31 steps"]],
    at: Int[np.ndarray, " k"],
) -> _Backwards:
    """Through the gains, with products of them between key frames, ticks `at`, the last among them.

    Covariances take the place of `found.P`, which are used up: an hour has gigabytes of them.
    """
    states, covariance = np.empty_like(found.x), found.P_n
    before, after = deltas
    moved, gains, product = np.empty_like(after), [], np.eye(ERRORS)
    states[-1], moved[-1] = found.x_n, before[-1]
    keys = set(at.tolist())
    for k in range(len(states) - 1, 0, -1):
        Phi = np.eye(ERRORS)
        Phi[:MOVING] += found.B[k]
        Phi = Phi @ Phi
        # Scaled to correlations: the states' units differ by ten orders of magnitude.
        s = 1.0 / np.sqrt(np.diagonal(found.P_after[k]))
        factor = cho_factor(found.P_after[k] * s[:, None] * s + 1e-12 * np.eye(ERRORS), check_finite=False)
        G = (s[:, None] * cho_solve(factor, s[:, None] * (Phi @ found.P[k]), check_finite=False)).T
        states[k - 1] = sum_of(found.x[k], G @ difference(states[k], found.x_after[k]))
        earlier = found.P[k] + G @ (covariance - found.P_after[k]) @ G.T
        found.P[k], covariance = covariance, earlier
        moved[k - 1] = before[k] + G @ (moved[k] - after[k])
        product = G @ product
        if k - 1 in keys:
            gains.append(product)
            product = np.eye(ERRORS)
    found.P[0] = covariance
    return _Backwards(states, found.P, moved, np.array(gains[::-1]).reshape(-1, ERRORS, ERRORS))
