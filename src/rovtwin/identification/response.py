"""What a vehicle does when its thrusters push, against what its model says it should: for checks, not for estimates.

The measured acceleration of each axis is split into what the thrusters' forces explain and what speed, attitude and
gyroscopic products explain, all of them free. What is left of the model is then only the pattern in which forces act on
axes, M^-1 T, and the shape of the thrust curve: both survive a model whose masses and damping are wrong by factors.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from rovtwin.core.flow import Command, Environment
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.identification.motion import STEP, Motion, held
from rovtwin.identification.record import Signal
from rovtwin.vehicle.dynamics import State, rollout
from rovtwin.vehicle.model import Model
from rovtwin.vehicle.thrusters import static_force

AXES = ("u", "v", "w", "p", "q", "r")
ROLLOUT_STEP = 0.05

_forces = jax.jit(jax.vmap(static_force, in_axes=(None, 0)))


@jax.jit
def _rolled(model: Model, commands: Array) -> tuple[Array, Array]:
    zero = State(jnp.zeros(3), jnp.array([1.0, 0, 0, 0]), jnp.zeros(6), jnp.zeros(commands.shape[1]))
    states = rollout(model, zero, Command(commands), Environment.calm(), ROLLOUT_STEP)
    return states.nu, states.position


def commanded_motion(model: Model, t_command: np.ndarray, command: np.ndarray) -> dict[str, Signal]:
    """What the model does with commands from rest: body rates, velocity and depth, as signals without noise."""
    grid = np.arange(t_command[0], t_command[-1] + ROLLOUT_STEP, ROLLOUT_STEP)
    nu, position = (np.asarray(x) for x in _rolled(model, as_array(held(t_command, command, grid))))
    t, good = grid + ROLLOUT_STEP, np.isfinite(nu).all(axis=1)
    parts = {"gyro": nu[:, 3:], "velocity": nu[:, :3], "depth": position[:, 2:]}
    return {name: Signal(t[good], value[good]) for name, value in parts.items()}


def thruster_forces(model: Model, motion: Motion, lag: float = 0.0, shape: float | None = None) -> np.ndarray:
    """Force of each thruster on the motion's grid [N], shape (m, n), through its lag and the kernel.

    Args:
        model: Thrust curves and lags.
        motion: Grid and commands.
        lag: By how much the commands are taken to be late [s]; negative: early.
        shape: Instead of the model's curve, sign(u) |u|^shape.
    """
    u = held(motion.record.t_command + lag, motion.record.command, motion.t)
    force = np.asarray(_forces(model.thrusters, as_array(u))) if shape is None else np.sign(u) * np.abs(u) ** shape
    return motion.smooth(_lagged(force, np.asarray(model.thrusters.time_constant)))


def _lagged(force: np.ndarray, time_constant: np.ndarray) -> np.ndarray:
    decay = np.where(time_constant > 0, np.exp(-STEP / np.maximum(time_constant, 1e-9)), 0.0)
    return np.stack([lfilter([1.0 - a], [1.0, -a], column) for a, column in zip(decay, force.T, strict=True)], axis=1)


@dataclass(frozen=True, eq=False)
class Response:
    """Partial regression of accelerations on thruster forces, what speed and attitude explain taken out of both.

    Attributes:
        axes: Indices of the axes that are measured, out of AXES.
        gram: F'F of the forces' residuals per axis, shape (a, n, n).
        cross: F'y per axis, shape (a, n).
        power: y'y per axis, shape (a,).
        expected: Rows of M^-1 T of those axes, shape (a, n).
    """

    axes: tuple[int, ...]
    gram: np.ndarray
    cross: np.ndarray
    power: np.ndarray
    expected: np.ndarray

    def explained(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Share of each axis' power that forces acting through `rows`, shape (a, n), explain, and the gain on them."""
        size = np.einsum("an,anm,am->a", rows, self.gram, rows)
        along = np.einsum("an,an->a", rows, self.cross)
        gain = along / np.maximum(size, 1e-12)
        return np.where(size > 1e-9 * size.max(initial=1e-12), along * gain / np.maximum(self.power, 1e-12), 0.0), gain

    @property
    def explainable(self) -> np.ndarray:
        """The largest share that any row explains, shape (a,)."""
        ridge = 1e-6 * np.trace(self.gram, axis1=1, axis2=2)[:, None, None] * np.eye(self.gram.shape[-1])
        best = np.linalg.solve(self.gram + ridge + 1e-12 * np.eye(self.gram.shape[-1]), self.cross[..., None])[..., 0]
        return np.einsum("an,an->a", best, self.cross) / np.maximum(self.power, 1e-12)


def accelerations(motion: Motion) -> tuple[tuple[int, ...], np.ndarray]:
    """Axes that are measured and their accelerations, shape (m, a)."""
    axes, columns = [], []
    for first, series in ((0, motion.velocity), (3, motion.omega)):
        if series is not None and np.isfinite(series).all(axis=1).sum() > 50:
            axes += range(first, first + 3)
            columns.append(motion.slope(series))
    return tuple(axes), np.concatenate(columns, axis=1) if columns else np.empty((len(motion.t), 0))


def nuisances(motion: Motion) -> np.ndarray:
    """Everything but the thrusters that accelerates, as columns, shape (m, k): speeds, drag, products, attitude, 1."""
    columns = [np.ones((len(motion.t), 1))]
    for series in (motion.velocity, motion.omega):
        if series is not None:
            columns += [series, series * np.abs(series), series * np.roll(series, 1, axis=1)]
    if motion.velocity is not None and motion.omega is not None:
        columns.append(np.cross(motion.velocity, motion.omega))
    if motion.rotation is not None:
        columns.append(motion.rotation[:, 2, :])
    return np.concatenate(columns, axis=1)


def response(model: Model, motion: Motion, force: np.ndarray) -> Response | None:
    """The regression, or None where too little is measured.

    Args:
        model: Its M^-1 T is what is expected.
        motion: Measured.
        force: Of the thrusters on its grid [N], shape (m, n).
    """
    axes, y = accelerations(motion)
    if not axes:
        return None
    others = nuisances(motion)
    good = np.isfinite(y).all(axis=1) & np.isfinite(others).all(axis=1) & np.isfinite(force).all(axis=1)
    if good.sum() < 10 * others.shape[1]:
        return None
    others = others[good] / (np.std(others[good], axis=0) + np.abs(others[good]).max(axis=0) * 1e-3 + 1e-9)
    Q = np.linalg.qr(others)[0]
    F, left = force[good], y[good] - y[good].mean(axis=0)
    F, left = F - Q @ (Q.T @ F), left - Q @ (Q.T @ left)
    pattern = np.asarray(model.mass_inverse @ model.thrusters.configuration)[list(axes)]
    gram = np.repeat((F.T @ F)[None], len(axes), axis=0)
    return Response(axes, gram, left.T @ F, (left**2).sum(axis=0), pattern)
