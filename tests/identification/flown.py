"""Synthetic tests: a vehicle driven open loop, seen by noisy sensors, as a Record."""

from functools import cache

import numpy as np

from rovtwin.core.arrays.rotations import euler_from_rotation
from rovtwin.core.flow import Command, Environment
from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.identification.logs.record import Record, Signal
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics.dynamics import State, rollout

STEP = 0.02
_rollout = jax.jit(rollout, static_argnames="dt")
EXCITATIONS = ("multisine", "steps", "telegraph", "doublets", "chirp", "gentle")
# Rate [1/s] and noise of the sensors.
SENSORS = {
    "position": (15.0, 0.01),
    "attitude": (50.0, 0.01),
    "gyro": (100.0, 0.005),
    "velocity": (10.0, 0.02),
    "depth": (20.0, 0.01),
}


@cache
def model_of(name):
    return load_vehicle(name).model()


def commands(kind, n, rng, duration):
    """Commands of n thrusters on the grid, shape (m, n), within +-1."""
    t = np.arange(0.0, duration, STEP)
    if kind in ("multisine", "gentle"):
        f, phase = rng.uniform(0.05, 0.5, (6, n)), rng.uniform(0, 2 * np.pi, (6, n))
        u = np.tanh(np.sin(2 * np.pi * f * t[:, None, None] + phase).sum(axis=1) / 3)
        return u * (0.25 if kind == "gentle" else 0.9)
    if kind == "chirp":
        rate = 0.05 + 0.45 * t / duration
        return 0.8 * np.sin(np.cumsum(2 * np.pi * rate * STEP)[:, None] + rng.uniform(0, 2 * np.pi, n))
    if kind == "telegraph":
        return _held(t, rng.choice([-0.7, 0.7], (int(duration / 0.4) + 1, n)), 0.4)
    if kind == "steps":
        return _held(t, rng.uniform(-0.8, 0.8, (int(duration / 4) + 1, n)), 4.0)
    u, slot = np.zeros((len(t), n)), np.floor(t / 2.0).astype(int)
    order = rng.permutation(np.arange(int(duration / 2) + 1) % n)
    sign = np.where(t % 2.0 < 1.0, 0.8, -0.8)
    u[np.arange(len(t)), order[slot]] = sign
    return u


def _held(t, levels, every):
    return levels[np.floor(t / every).astype(int)]


@cache
def fly(name, kind="multisine", seed=0, duration=60.0, sensors=tuple(SENSORS), plant=None):
    """One test of a library vehicle.

    Args:
        name: Of the vehicle.
        kind: Of EXCITATIONS.
        seed: Of commands and noise.
        duration: [s].
        sensors: Which are on board.
        plant: What the thrusters do with the commands, if anything but obey.
    """
    model, rng = model_of(name), np.random.default_rng(seed)
    u = commands(kind, model.thrusters.count, rng, duration)
    done = u if plant is None else plant(u)
    start = State(as_array([0.0, 0, 30]), as_array([1.0, 0, 0, 0]), jnp.zeros(6), jnp.zeros(u.shape[1]))
    states = _rollout(model, start, jax.vmap(Command)(as_array(done)), Environment.calm(), dt=STEP)
    q = np.asarray(states.attitude)
    w, x, y, z = q.T
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)
    nu, place = np.asarray(states.nu), np.asarray(states.position)
    t = STEP * (1 + np.arange(len(u)))
    truth = {"position": place, "gyro": nu[:, 3:], "velocity": nu[:, :3], "depth": place[:, 2:]}
    truth["attitude"] = euler_from_rotation(R)
    signals = {}
    for sensor in sensors:
        rate, noise = SENSORS[sensor]
        pick = np.searchsorted(t, np.arange(0.1, duration - 0.1, 1 / rate))
        value = truth[sensor][pick] + rng.normal(0, noise, truth[sensor][pick].shape)
        if sensor == "attitude":
            value[:, [0, 2]] = (value[:, [0, 2]] + np.pi) % (2 * np.pi) - np.pi
        signals[sensor] = Signal(t[pick], value, np.full(value.shape[1], noise))
    return Record(f"{name} {kind} {seed}", t - STEP, u, signals, end=duration, source=f"{name}_{kind}")
