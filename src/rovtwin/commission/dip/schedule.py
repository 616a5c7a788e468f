"""How hard each thruster is pushed: enough to see, too little to hit a wall or to tip over, as the model foresees."""

import numpy as np

from rovtwin.core.flow import Command, Environment
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.live.pulses import Pulse
from rovtwin.vehicle.physics.dynamics import State, rollout
from rovtwin.vehicle.physics.model import Model

PUSH, REST = 1.5, 1.5  # [s]
AWAY, TURN, TILT = 0.35, 1.0, 0.3  # largest way [m] and angles [rad] of a push and its rest
SIZES = np.array([0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8])  # of commands that are tried
_STEP = 0.05  # of the foreseen motion [s]


@jax.jit
def _foreseen(model: Model, commands: Array) -> Array:
    """Largest way [m], turn and tilt [rad] under commands, shape (steps, n), from rest; shape (3,)."""
    zero = State(jnp.zeros(3), jnp.array([1.0, 0.0, 0.0, 0.0]), jnp.zeros(6), jnp.zeros(commands.shape[1]))
    states = rollout(model, zero, Command(commands), Environment.calm(), _STEP)
    R = jax.vmap(rotation_from_quaternion)(states.attitude)
    way = jnp.linalg.norm(states.position, axis=1).max()
    turn = jnp.abs(jnp.arctan2(R[:, 1, 0], R[:, 0, 0])).max()
    return jnp.stack([way, turn, jnp.arccos(jnp.clip(R[:, 2, 2], -1.0, 1.0)).max()])


def commands(model: Model) -> np.ndarray:
    """The size of each thruster's command, shape (n,): the largest of SIZES that stays within limits, or the smallest."""
    count, pushing = model.thrusters.count, round(PUSH / _STEP)
    chosen = np.full(count, SIZES[0])
    for i in range(count):
        for size in SIZES:
            u = np.zeros((round((PUSH + REST) / _STEP), count))
            u[:pushing, i] = size
            moved = np.asarray(_foreseen(model, as_array(u)))
            if not np.all(moved <= [AWAY, TURN, TILT]):
                break
            chosen[i] = size
    return chosen


def pulses(model: Model, names: list[str]) -> list[Pulse]:
    """Each thruster ahead and astern, with rests; first a rest, from which the sensors' errors at rest are seen."""
    sizes, off = commands(model), np.zeros(len(names))
    found = [Pulse("at rest", off, 2.0)]
    for i, name in enumerate(names):
        for sign, word in ((1.0, "ahead"), (-1.0, "astern")):
            u = off.copy()
            u[i] = sign * sizes[i]
            found += [Pulse(f"{name} {word}, {100 * sizes[i]:.0f} %", u, PUSH), Pulse("rest", off, REST)]
    return found
