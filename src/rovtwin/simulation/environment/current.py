"""Ocean current: constant, sheared with depth, wandering (first-order Gauss-Markov), or a sum of them.

Every current is a Block with `step(memory, position, dt) -> (memory, Flow)`, the position being CO in n [m].
"""

import abc
from typing import Any

import equinox as eqx
from jaxtyping import Float

from rovtwin.core.block import Block, Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.types import Index, Matrix3, PRNGKey, RawKey, Scalar, Vector3
from rovtwin.simulation.checks import require, require_finite, require_not_negative, require_positive, require_shape
from rovtwin.simulation.noise import key_for, normals, raw_key


class Flow(eqx.Module):
    """The moving water at one place over one step, in n.

    Attributes:
        velocity: v_c at the start of the step [m/s].
        rate: Its rate at a fixed place, the local part of D v_c / Dt [m/s2]; held over the step, so that
            `velocity + elapsed * rate` meets the velocity of the next step.
        gradient: d v_i / d x_j [1/s], or None where the water moves as one.
    """

    velocity: Vector3
    rate: Vector3
    gradient: Matrix3 | None = None

    @classmethod
    def still(cls) -> "Flow":
        return cls(jnp.zeros(3), jnp.zeros(3))

    def __add__(self, other: "Flow") -> "Flow":
        gradients = [g for g in (self.gradient, other.gradient) if g is not None]
        gradient = sum(gradients[1:], gradients[0]) if gradients else None
        return Flow(self.velocity + other.velocity, self.rate + other.rate, gradient)


class Current(Block):
    """A current: `step` says what the water does at CO, `velocities` how it moves at other places at that time."""

    @abc.abstractmethod
    def step(self, memory: Any, input: Vector3, dt: float) -> tuple[Any, Flow]:
        """Flow at the position `input` (CO in n [m]) over the next `dt`."""

    @abc.abstractmethod
    def velocities(self, memory: Any, positions: Float[Array, "k 3"], dt: float) -> Float[Array, "k 3"]:
        """v_c at the start of the next step of `dt` at places in n [m], in n [m/s]."""


class ConstantCurrent(Current):
    """The same velocity everywhere and always.

    Attributes:
        velocity: v_c in n [m/s].
    """

    velocity: Vector3 = eqx.field(converter=as_array)

    def __check_init__(self):
        require_shape("ConstantCurrent.velocity", self.velocity, (3,))
        require_finite("ConstantCurrent.velocity", self.velocity)

    def init(self, key: PRNGKey, start: Start) -> None:
        """No memory."""
        return None

    def step(self, memory: None, input: Vector3, dt: float) -> tuple[None, Flow]:
        """Flow at the position `input` [m]."""
        return None, Flow(self.velocity, jnp.zeros(3))

    def velocities(self, memory: None, positions: Float[Array, "k 3"], dt: float) -> Float[Array, "k 3"]:
        """The same at all places."""
        return jnp.broadcast_to(self.velocity, positions.shape)


class ShearedCurrent(Current):
    """Steady current that changes with depth: linear between given depths, constant above the first, below the last.

    Attributes:
        depths: Increasing, two or more [m].
        layers: v_c in n at these depths [m/s].
    """

    depths: Float[Array, " k"] = eqx.field(converter=as_array)
    layers: Float[Array, "k 3"] = eqx.field(converter=as_array)

    def __check_init__(self):
        where = "ShearedCurrent.depths"
        if self.depths.ndim != 1 or self.depths.shape[0] < 2:
            raise ConfigError(f"{where}: found shape {self.depths.shape}, expected two depths or more")
        require(where, self.depths, lambda depths: depths[1:] > depths[:-1], "depths that increase")
        require_shape("ShearedCurrent.layers", self.layers, (self.depths.shape[0], 3))
        require_finite("ShearedCurrent.layers", self.layers)

    def init(self, key: PRNGKey, start: Start) -> None:
        """No memory."""
        return None

    def step(self, memory: None, input: Vector3, dt: float) -> tuple[None, Flow]:
        """Flow at the position `input` [m]."""
        depth = input[2]
        inside = (depth >= self.depths[:-1]) & (depth < self.depths[1:])
        shear = jnp.where(inside[:, None], self._slopes(), 0.0).sum(0)
        gradient = jnp.zeros((3, 3)).at[:, 2].set(shear)
        return None, Flow(self._at(depth), jnp.zeros(3), gradient)

    def velocities(self, memory: None, positions: Float[Array, "k 3"], dt: float) -> Float[Array, "k 3"]:
        """By depth alone."""
        return jax.vmap(self._at)(positions[:, 2])

    def _slopes(self) -> Float[Array, "layers 3"]:
        return (self.layers[1:] - self.layers[:-1]) / (self.depths[1:] - self.depths[:-1])[:, None]

    def _at(self, depth: Scalar) -> Vector3:
        # How far the depth reaches into each layer; the sum over layers needs no search for the right one.
        reach = jnp.clip(depth, self.depths[:-1], self.depths[1:]) - self.depths[:-1]
        return self.layers[0] + (self._slopes() * reach[:, None]).sum(0)


class GaussMarkovMemory(eqx.Module):
    """Nodes that the velocity runs between; number of nodes drawn; steps since the last node."""

    key: RawKey
    before: Vector3
    after: Vector3
    nodes: Index
    steps: Index


class GaussMarkovCurrent(Current):
    """Uniform current that wanders about a mean: v_dot = -(v - mean)/T + noise, exactly discretised, stationary.

    Nodes `interval` seconds apart follow the exact discrete process, with phi = exp(-interval/T),

        v+ = mean + phi (v - mean) + sigma sqrt(1 - phi^2) n

    and between them the velocity is linear in time. The process itself has no derivative: its increments over a step dt
    would be accelerations of rms sigma sqrt(2/(T dt)), without limit as dt shrinks, and an accelerometer in the water
    would read them. With nodes the acceleration belongs to the water and not to the step. Fossen (2021), sec. 10.3.

    Attributes:
        mean: In n [m/s].
        sigma: Standard deviation about the mean, per axis [m/s].
        time_constant: T [s].
        interval: Between nodes [s]; default T / 100, at least one step.
    """

    mean: Vector3
    sigma: Vector3
    time_constant: Scalar
    interval: Scalar

    def __init__(self, mean: object, sigma: object, time_constant: object, interval: object = None):
        self.mean, self.sigma, self.time_constant = as_array(mean), as_array(sigma), as_array(time_constant)
        self.interval = self.time_constant / 100.0 if interval is None else as_array(interval)
        for name in ("mean", "sigma"):
            require_shape(f"GaussMarkovCurrent.{name}", getattr(self, name), (3,))
        require_finite("GaussMarkovCurrent.mean", self.mean)
        require_not_negative("GaussMarkovCurrent.sigma", self.sigma)
        require_positive("GaussMarkovCurrent.time_constant", self.time_constant)
        require_positive("GaussMarkovCurrent.interval", self.interval)

    def _next_node(self, key: RawKey, node: Vector3, count: Index, spacing: Scalar) -> Vector3:
        phi = jnp.exp(-spacing / self.time_constant)
        kick = self.sigma * jnp.sqrt(-jnp.expm1(-2.0 * spacing / self.time_constant)) * normals(key, count, 3)
        return self.mean + phi * (node - self.mean) + kick

    def init(self, key: PRNGKey, start: Start) -> GaussMarkovMemory:
        """A stationary draw for the first node; the first step draws the second."""
        key = raw_key(key)
        zero = jnp.zeros((), dtype=jnp.int64)
        first = self.mean + self.sigma * normals(key, zero, 3)
        return GaussMarkovMemory(key, first, first, zero + 1, zero)

    def step(self, memory: GaussMarkovMemory, input: Vector3, dt: float) -> tuple[GaussMarkovMemory, Flow]:
        """Flow over the next `dt`; the position does not matter."""
        per_node = jnp.maximum(jnp.round(self.interval / dt), 1.0)
        at_node = memory.steps == 0
        fresh = self._next_node(memory.key, memory.after, memory.nodes, per_node * dt)
        before = jnp.where(at_node, memory.after, memory.before)
        after = jnp.where(at_node, fresh, memory.after)
        rate = (after - before) / (per_node * dt)
        flow = Flow(before + memory.steps * dt * rate, rate)
        steps = jnp.where(memory.steps + 1 >= per_node, 0, memory.steps + 1)
        return GaussMarkovMemory(memory.key, before, after, memory.nodes + at_node, steps), flow

    def velocities(self, memory: GaussMarkovMemory, positions: Float[Array, "k 3"], dt: float) -> Float[Array, "k 3"]:
        """The same at all places."""
        share = memory.steps / jnp.maximum(jnp.round(self.interval / dt), 1.0)
        now = jnp.where(memory.steps == 0, memory.after, memory.before + share * (memory.after - memory.before))
        return jnp.broadcast_to(now, positions.shape)


class CombinedCurrent(Current):
    """The sum of several currents, for instance a sheared tide and a wandering part.

    Attributes:
        parts: Current blocks; each gets random numbers of its own.
    """

    parts: tuple[Current, ...]

    def init(self, key: PRNGKey, start: Start) -> tuple:
        """Memory of each part, in order."""
        return tuple(part.init(key_for(key, f"part {i}"), start) for i, part in enumerate(self.parts))

    def step(self, memory: tuple, input: Vector3, dt: float) -> tuple[tuple, Flow]:
        """Sum of the flows at the position `input` [m]."""
        stepped = [part.step(m, input, dt) for part, m in zip(self.parts, memory, strict=True)]
        return tuple(m for m, _ in stepped), sum((flow for _, flow in stepped), Flow.still())

    def velocities(self, memory: tuple, positions: Float[Array, "k 3"], dt: float) -> Float[Array, "k 3"]:
        """Sum of the parts."""
        return sum(
            (part.velocities(m, positions, dt) for part, m in zip(self.parts, memory, strict=True)),
            jnp.zeros_like(positions),
        )
