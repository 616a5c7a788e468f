"""What a vehicle does when its thrusters push, against what its model says it should: for checks, not for estimates.

The measured acceleration of each axis is split into what the thrusters' forces explain and what speed, attitude and
gyroscopic products explain, all of them free. What is left of the model is then only the pattern in which forces act on
axes, M^-1 T, and the shape of the thrust curve: both survive a model whose masses and damping are wrong by factors.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.signal import lfilter

from rovtwin.core.flow import Command, Environment
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.identification.logs.motion import STEP, Motion, held
from rovtwin.identification.logs.record import Signal
from rovtwin.vehicle.physics.dynamics import State, rollout
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import static_force

AXES = ("u", "v", "w", "p", "q", "r")
ROLLOUT_STEP = 0.05
MEMORY = 10.0  # [s]; slower than roll and pitch swing, faster than a gyro drifts

_forces = jax.jit(jax.vmap(static_force, in_axes=(None, 0)))


@jax.jit
def _rolled(model: Model, commands: Float[Array, "steps n"]) -> tuple[Float[Array, "steps 6"], Float[Array, "steps 3"]]:
    zero = State(jnp.zeros(3), jnp.array([1.0, 0, 0, 0]), jnp.zeros(6), jnp.zeros(commands.shape[1]))
    states = rollout(model, zero, jax.vmap(Command)(commands), Environment.calm(), ROLLOUT_STEP)
    return states.nu, states.position


def commanded_motion(
    model: Model, t_command: Float[np.ndarray, " m"], command: Float[np.ndarray, "m n"]
) -> dict[str, Signal]:
    """What the model does with commands from rest: body rates, velocity and depth, as signals without noise."""
    grid = np.arange(t_command[0], t_command[-1] + ROLLOUT_STEP, ROLLOUT_STEP)
    nu, position = (np.asarray(x) for x in _rolled(model, as_array(held(t_command, command, grid))))
    t, good = grid + ROLLOUT_STEP, np.isfinite(nu).all(axis=1)
    parts = {"gyro": nu[:, 3:], "velocity": nu[:, :3], "depth": position[:, 2:]}
    return {name: Signal(t[good], value[good]) for name, value in parts.items()}


def thruster_forces(
    model: Model, motion: Motion, lag: float = 0.0, shape: float | None = None, limit: float = np.inf
) -> Float[np.ndarray, "m n"]:
    """Force of each thruster on the motion's grid [N], through its lag and the kernel.

    Args:
        model: Thrust curves and lags.
        motion: Grid and commands.
        lag: By how much the commands are taken to be later than they are logged [s].
        shape: Instead of the model's curve, sign(u) |u|^shape.
        limit: Beyond which commands do nothing more.
    """
    u = np.clip(held(motion.record.t_command + lag, motion.record.command, motion.t), -limit, limit)
    force = np.asarray(_forces(model.thrusters, as_array(u))) if shape is None else np.sign(u) * np.abs(u) ** shape
    return motion.smooth(_lagged(force, np.asarray(model.thrusters.time_constant)))


def _lagged(force: Float[np.ndarray, "m n"], time_constant: Float[np.ndarray, " n"]) -> Float[np.ndarray, "m n"]:
    decay = np.where(time_constant > 0, np.exp(-STEP / np.maximum(time_constant, 1e-9)), 0.0)
    return np.stack([lfilter([1.0 - a], [1.0, -a], column) for a, column in zip(decay, force.T, strict=True)], axis=1)


@dataclass(frozen=True, eq=False)
class Response:
    """Partial regression of accelerations on thruster forces, what speed and attitude explain taken out of both.

    Attributes:
        axes: Indices of the axes that are measured, out of AXES.
        gram: F'F of the forces' residuals per axis.
        cross: F'y per axis.
        power: y'y per axis.
        expected: Rows of M^-1 T of those axes.
    """

    axes: tuple[int, ...]
    gram: Float[np.ndarray, "a n n"]
    cross: Float[np.ndarray, "a n"]
    power: Float[np.ndarray, " a"]
    expected: Float[np.ndarray, "a n"]

    def explained(self, rows: Float[np.ndarray, "a n"]) -> tuple[Float[np.ndarray, " a"], Float[np.ndarray, " a"]]:
        """Share of each axis' power that forces acting through `rows` explain, and the gain on them."""
        size = np.einsum("an,anm,am->a", rows, self.gram, rows)
        along = np.einsum("an,an->a", rows, self.cross)
        gain = along / np.maximum(size, 1e-12)
        return np.where(size > 1e-9 * size.max(initial=1e-12), along * gain / np.maximum(self.power, 1e-12), 0.0), gain

    @property
    def explainable(self) -> Float[np.ndarray, " a"]:
        """The largest share that any row explains."""
        ridge = 1e-6 * np.trace(self.gram, axis1=1, axis2=2)[:, None, None] * np.eye(self.gram.shape[-1])
        best = np.linalg.solve(self.gram + ridge + 1e-12 * np.eye(self.gram.shape[-1]), self.cross[..., None])[..., 0]
        return np.einsum("an,an->a", best, self.cross) / np.maximum(self.power, 1e-12)


def nuisances(motion: Motion) -> Float[np.ndarray, "m k"]:
    """Everything but the thrusters that accelerates, as columns: speeds, drag, products, attitude, 1."""
    columns = [np.ones((len(motion.t), 1))]
    for series in (motion.velocity, motion.omega):
        if series is not None:
            columns += [series, series * np.abs(series), series * np.roll(series, 1, axis=1)]
    if motion.velocity is not None and motion.omega is not None:
        columns.append(np.cross(motion.velocity, motion.omega))
    if motion.rotation is not None:
        columns.append(motion.rotation[:, 2, :])
    elif motion.omega is not None:
        # Instead of the attitude, whose restoring moments would look like late thrust: what the rates add up to.
        columns.append(_lately(motion.omega))
    return np.concatenate(columns, axis=1)


def _lately(rate: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
    """Integral of rates that forgets with MEMORY."""
    keep = np.exp(-STEP / MEMORY)
    return np.asarray(lfilter([STEP], [1.0, -keep], np.nan_to_num(rate), axis=0))


@dataclass(frozen=True, eq=False)
class Regression:
    """What is left of the accelerations when speed and attitude have explained what they can; forces come later.

    Attributes:
        axes: Indices of the axes that are measured, out of AXES.
        left: Residuals of the accelerations.
        basis: Orthonormal, of what is taken out.
        good: Which times of the grid are used.
        pattern: Rows of M^-1 T of those axes.
    """

    axes: tuple[int, ...]
    left: Float[np.ndarray, "k a"]
    basis: Float[np.ndarray, "k b"]
    good: Bool[np.ndarray, " m"]
    pattern: Float[np.ndarray, "a n"]

    @classmethod
    def of(cls, model: Model, motion: Motion) -> "Regression | None":
        """None where too little is measured."""
        axes, y = motion.accelerations
        others = nuisances(motion)
        good = np.asarray(np.isfinite(np.column_stack([y, others])).all(axis=1))
        if not axes or good.sum() < 10 * others.shape[1]:
            return None
        others = others[good] / (np.abs(others[good]).max(axis=0) + 1e-9)
        Q = np.linalg.qr(others + 1e-9 * np.random.default_rng(0).normal(size=others.shape))[0]
        left = y[good] - Q @ (Q.T @ y[good])
        pattern = np.asarray(model.inertia_inverse @ model.thrusters.configuration)[list(axes)]
        return cls(axes, left, Q, good, pattern)

    def against(self, force: Float[np.ndarray, "m n"]) -> Response:
        """What forces of the thrusters on the grid [N] explain of it."""
        F = force[self.good]
        F = F - self.basis @ (self.basis.T @ F)
        gram = np.repeat((F.T @ F)[None], len(self.axes), axis=0)
        return Response(self.axes, gram, self.left.T @ F, (self.left**2).sum(axis=0), self.pattern)
