"""Test logs without a scenario: the plant itself, driven by given commands, read with given noise."""

import numpy as np

from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Environment
from rovtwin.core.frames import euler_from_quaternion
from rovtwin.core.numerics import jax, jnp
from rovtwin.identification.joint.model.nodes import NODE
from rovtwin.identification.logs.record import Record, Signal
from rovtwin.vehicle.physics.dynamics import State, rollout

STEP = 0.01
NOISE = {
    "position": 0.03,
    "horizontal": 0.03,
    "depth": 1e-3,
    "attitude": 1e-3,
    "gyro": 3e-4,
    "accelerometer": 0.0308,
    "velocity": 0.005,
}
RATE = {
    "position": 15.0,
    "horizontal": 15.0,
    "depth": 20.0,
    "attitude": 50.0,
    "gyro": 50.0,
    "accelerometer": 50.0,
    "velocity": 10.0,
}


@jax.jit
def _simulate(model, state, commands):
    return rollout(model, state, jax.vmap(Command)(commands), Environment.calm(), STEP)


def steps_command(vehicle, seed, duration, hold=2.0, names=None):
    """Random held commands, all thrusters, shape (m, n), and when each begins."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, hold)
    u = rng.uniform(-1, 1, (len(t), len(vehicle.thruster_names)))
    u[0] = 0.0  # thrusters start at rest
    return t, u


def record(
    model, t_command, command, duration, seed=0, signals=("horizontal", "depth", "attitude", "gyro"), start=None, **kw
):
    """What sensors read of a run of the plant."""
    steps = round(duration / STEP)
    held = command[np.searchsorted(t_command, (np.arange(steps) + 0.5) * STEP, side="right") - 1]
    state = State.at(model, Start.at([0.0, 0.0, 1.0]) if start is None else start)
    path = _simulate(model, state, jnp.asarray(held))
    return records_of(path, t_command, command, duration, seed, signals, **kw)


def records_of(path, t_command, command, duration, seed, signals, **kw):
    """What sensors read along a path of the plant."""
    rng, steps = np.random.default_rng(seed + 1000), round(duration / STEP)
    t = STEP * np.arange(1, steps + 1)
    euler = np.asarray(jax.vmap(euler_from_quaternion)(path.attitude))
    truth = {
        "position": np.asarray(path.position),
        "horizontal": np.asarray(path.position)[:, :2],
        "depth": np.asarray(path.position)[:, 2:],
        "attitude": euler,
        "gyro": np.asarray(path.nu)[:, 3:],
        "velocity": np.asarray(path.nu)[:, :3],
    }
    found = {}
    for name in signals:
        every = max(1, round(1 / RATE[name] / STEP))
        rows = np.arange(every - 1, steps, every)
        value = truth[name][rows]
        value = value + NOISE[name] * rng.standard_normal(value.shape)
        found[name] = Signal(t[rows], value, np.full(value.shape[1], NOISE[name]))
    return Record("synthetic", np.asarray(t_command), np.asarray(command), found, duration, **kw)


def full_pull(model):
    """What a scale reads while every thruster pushes ahead as hard as it can [N]."""
    row, thrusters = np.asarray(model.thrusters.configuration)[0], model.thrusters
    return float(np.sum(np.where(row > 0.0, row * thrusters.force_ahead, -row * thrusters.force_astern)))


def slopes_of_the_ends(problem, theta):
    """Derivatives of the ends of segments by theta, shape (S, 12, n): as compiled, and by differences; under a push."""
    shooting, arrays, n = problem.shooting, problem.segments.arrays, len(theta)
    pushes = 0.1 * np.random.default_rng(0).standard_normal((problem.segments.count, 6))
    nodes = problem.guess._replace(push=pushes)
    offsets, sigma = np.zeros(len(problem.groups)), np.ones(len(problem.groups))
    found = np.asarray(shooting.blocks(theta, offsets, nodes, sigma, arrays).defect_jacobian)[:, :12, NODE : NODE + n]
    columns = []
    for step in 1e-4 * np.eye(n):
        ends = [
            np.asarray(shooting.residuals(x, offsets, nodes, arrays)[1])[:, :12] for x in (theta + step, theta - step)
        ]
        columns.append((ends[0] - ends[1]) / 2e-4)
    return found, np.stack(columns, axis=-1)
