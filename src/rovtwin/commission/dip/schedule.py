"""How hard and how long each thruster is pushed: what tells most, short of walls and of tipping over.

What a push tells grows with force squared times its length, the way that it leads to with force times length squared:
so hard and short pushes are best where room or tilt is the limit, long ones where force is. A vehicle that floats up
meanwhile is brought down again before the next push: at the surface no push tells anything.
"""

import numpy as np
from jaxtyping import Float

from rovtwin.core.flow import Command, Environment
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.types import PerThruster, Vector3
from rovtwin.live.pulses import Pulse
from rovtwin.vehicle.physics.dynamics import State, rollout
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import static_force

LENGTHS = (0.4, 0.6, 1.0, 1.5)  # of pushes that are tried; shorter ones would drown in the lag of the thrusters [s]
REST = 1.5  # after each [s]
DIVE = 2.0  # longest push down [s]
AWAY, TURN, TILT = 0.35, 1.0, 0.3  # largest way [m] and angles [rad] of a push and its rest
SIZES = np.array([0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8])  # of commands that are tried
HEAVE = 2
_STEP = 0.05  # of the foreseen motion [s]


@jax.jit
def _foreseen(model: Model, commands: Float[Array, "steps n"]) -> tuple[Vector3, PerThruster]:
    """Largest way [m], turn and tilt [rad] from rest, and the first force of each thruster [N]."""
    zero = State(jnp.zeros(3), jnp.array([1.0, 0.0, 0.0, 0.0]), jnp.zeros(6), jnp.zeros(commands.shape[1]))
    states = rollout(model, zero, jax.vmap(Command)(commands), Environment.calm(), _STEP)
    R = jax.vmap(rotation_from_quaternion)(states.attitude)
    way = jnp.linalg.norm(states.position, axis=1).max()
    turn = jnp.abs(jnp.cumsum(states.nu[:, 5]) * _STEP).max()  # of several turns all count
    tilt = jnp.arccos(jnp.clip(R[:, 2, 2], -1.0, 1.0)).max()
    return jnp.stack([way, turn, tilt]), jnp.abs(static_force(model.thrusters, commands[0]))


def foreseen(model: Model, u: Float[np.ndarray, " n"], seconds: float, turn: float = TURN) -> bool:
    """Whether a command that lasts so long [s] keeps within way, turn [rad] and tilt, by the model."""
    moved, _ = _foreseen(model, as_array(np.tile(u, (max(1, round(seconds / _STEP)), 1))))
    return bool(np.all(np.asarray(moved) <= [AWAY, turn, TILT]))


def pushes(model: Model) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Command, 0 to 1, and length [s] of each thruster's push: see the module; else the gentlest."""
    count = model.thrusters.count
    size, length, information = np.full(count, SIZES[0]), np.full(count, LENGTHS[0]), np.zeros(count)
    for i in range(count):
        for seconds in LENGTHS:
            for command in SIZES:
                u = np.zeros((round((LENGTHS[-1] + REST) / _STEP), count))
                u[: round(seconds / _STEP), i] = command
                moved, force = (np.asarray(x) for x in _foreseen(model, as_array(u)))
                if not np.all(moved <= [AWAY, TURN, TILT]):
                    break
                if force[i] ** 2 * seconds > information[i]:
                    size[i], length[i], information[i] = command, seconds, force[i] ** 2 * seconds
    return size, length


def shares_along(model: Model, row: int) -> Float[np.ndarray, " n"] | None:
    """Commands, the largest 1, that push along an axis of AXES alone as nearly as can be; None where none does."""
    T = np.asarray(model.thrusters.configuration)
    force = np.linalg.pinv(T)[:, row]
    if abs((T @ force)[row]) < 0.9 or np.abs(force).max() == 0.0:
        return None
    return np.sign(force) * np.sqrt(np.abs(force) / np.abs(force).max())


def dive(model: Model, depth: float) -> Pulse | None:
    """A push down to a depth [m], as hard as a push may be; None of a vehicle that does not heave."""
    shares = shares_along(model, HEAVE)
    usable = [] if shares is None else [u for u in SIZES[:, None] * shares if foreseen(model, u, LENGTHS[-1])]
    return Pulse("down to the middle", usable[-1], DIVE, down_to=depth) if usable else None


def pulses(model: Model, names: list[str], middle: float) -> list[Pulse]:
    """Each thruster ahead and astern, with rests; first a rest, from which the sensors' errors at rest are seen.

    Args:
        model: Of the vehicle.
        names: Of its thrusters.
        middle: Depth that it is brought down to before each push [m].
    """
    sizes, lengths = pushes(model)
    off, down = np.zeros(len(names)), dive(model, middle)
    deeper = [] if down is None else [down]
    found = [Pulse("at rest", off, 2.0), *deeper, *([Pulse("rest", off, REST)] if deeper else [])]
    for i, name in enumerate(names):
        for sign, word in ((1.0, "ahead"), (-1.0, "astern")):
            u = off.copy()
            u[i] = sign * sizes[i]
            push = Pulse(f"{name} {word}, {100 * sizes[i]:.0f} % for {lengths[i]:g} s", u, float(lengths[i]))
            found += [push, *deeper, Pulse("rest", off, REST)]
    return found
