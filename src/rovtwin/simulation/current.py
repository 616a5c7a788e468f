"""Ocean current: constant, sheared with depth, wandering (first-order Gauss-Markov), or a sum of them.

Every current is a Block with `step(memory, position, dt) -> (memory, Flow)`, the position being CO in n [m].
"""

import equinox as eqx

from rovtwin.core.block import Block, Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.simulation.checks import require, require_finite, require_not_negative, require_positive, require_shape
from rovtwin.simulation.noise import key_for, normals, raw_key


class Flow(eqx.Module):
    """The moving water at one place over one step, in n.

    Attributes:
        velocity: v_c at the start of the step [m/s], shape (3,).
        acceleration: Its rate at a fixed place, the local part of D v_c / Dt [m/s2], shape (3,); held over the step,
            so that `velocity + elapsed * acceleration` meets the velocity of the next step.
        shear: d v_c / d depth [1/s], shape (3,).
    """

    velocity: Array
    acceleration: Array
    shear: Array

    @classmethod
    def still(cls) -> "Flow":
        return cls(jnp.zeros(3), jnp.zeros(3), jnp.zeros(3))

    def __add__(self, other: "Flow") -> "Flow":
        return Flow(self.velocity + other.velocity, self.acceleration + other.acceleration, self.shear + other.shear)


class ConstantCurrent(Block):
    """The same velocity everywhere and always.

    Attributes:
        velocity: v_c in n [m/s], shape (3,).
    """

    velocity: Array = eqx.field(converter=as_array)

    def __check_init__(self):
        require_shape("ConstantCurrent.velocity", self.velocity, (3,))
        require_finite("ConstantCurrent.velocity", self.velocity)

    def init(self, key: Array, start: Start) -> None:
        """No memory."""
        return None

    def step(self, memory: None, input: Array, dt: float) -> tuple[None, Flow]:
        """Flow at the position `input` [m], shape (3,)."""
        return None, Flow(self.velocity, jnp.zeros(3), jnp.zeros(3))


class ShearedCurrent(Block):
    """Steady current that changes with depth: linear between given depths, constant above the first, below the last.

    Attributes:
        depths: Increasing [m], shape (k,), k >= 2.
        velocities: v_c in n at these depths [m/s], shape (k, 3).
    """

    depths: Array = eqx.field(converter=as_array)
    velocities: Array = eqx.field(converter=as_array)

    def __check_init__(self):
        where = "ShearedCurrent.depths"
        if self.depths.ndim != 1 or self.depths.shape[0] < 2:
            raise ConfigError(f"{where}: found shape {self.depths.shape}, expected two depths or more")
        require(where, self.depths, self.depths[1:] > self.depths[:-1], "depths that increase")
        require_shape("ShearedCurrent.velocities", self.velocities, (self.depths.shape[0], 3))
        require_finite("ShearedCurrent.velocities", self.velocities)

    def init(self, key: Array, start: Start) -> None:
        """No memory."""
        return None

    def step(self, memory: None, input: Array, dt: float) -> tuple[None, Flow]:
        """Flow at the position `input` [m], shape (3,)."""
        depth = input[2]
        slopes = (self.velocities[1:] - self.velocities[:-1]) / (self.depths[1:] - self.depths[:-1])[:, None]
        # How far the depth reaches into each layer; the sum over layers needs no search for the right one.
        reach = jnp.clip(depth, self.depths[:-1], self.depths[1:]) - self.depths[:-1]
        inside = (depth >= self.depths[:-1]) & (depth < self.depths[1:])
        velocity = self.velocities[0] + (slopes * reach[:, None]).sum(0)
        return None, Flow(velocity, jnp.zeros(3), jnp.where(inside[:, None], slopes, 0.0).sum(0))


class GaussMarkovMemory(eqx.Module):
    """Nodes that the velocity runs between, shape (3,) each; number of nodes drawn; steps since the last node."""

    key: Array
    before: Array
    after: Array
    nodes: Array
    steps: Array


class GaussMarkovCurrent(Block):
    """Uniform current that wanders about a mean: v_dot = -(v - mean)/T + noise, exactly discretised, stationary.

    Nodes `interval` seconds apart follow the exact discrete process, with phi = exp(-interval/T),

        v+ = mean + phi (v - mean) + sigma sqrt(1 - phi^2) n

    and between them the velocity is linear in time. The process itself has no derivative: its increments over a step dt
    would be accelerations of rms sigma sqrt(2/(T dt)), without limit as dt shrinks, and an accelerometer in the water
    would read them. With nodes the acceleration belongs to the water and not to the step. Fossen (2021), sec. 10.3.

    Attributes:
        mean: In n [m/s], shape (3,).
        sigma: Standard deviation about the mean, per axis [m/s], shape (3,).
        time_constant: T [s].
        interval: Between nodes [s]; default T / 100, at least one step.
    """

    mean: Array
    sigma: Array
    time_constant: Array
    interval: Array

    def __init__(self, mean: object, sigma: object, time_constant: object, interval: object = None):
        self.mean, self.sigma, self.time_constant = as_array(mean), as_array(sigma), as_array(time_constant)
        self.interval = self.time_constant / 100.0 if interval is None else as_array(interval)
        for name in ("mean", "sigma"):
            require_shape(f"GaussMarkovCurrent.{name}", getattr(self, name), (3,))
        require_finite("GaussMarkovCurrent.mean", self.mean)
        require_not_negative("GaussMarkovCurrent.sigma", self.sigma)
        require_positive("GaussMarkovCurrent.time_constant", self.time_constant)
        require_positive("GaussMarkovCurrent.interval", self.interval)

    def _next_node(self, key: Array, node: Array, count: Array, spacing: Array) -> Array:
        phi = jnp.exp(-spacing / self.time_constant)
        kick = self.sigma * jnp.sqrt(-jnp.expm1(-2.0 * spacing / self.time_constant)) * normals(key, count, 3)
        return self.mean + phi * (node - self.mean) + kick

    def init(self, key: Array, start: Start) -> GaussMarkovMemory:
        """A stationary draw for the first node; the first step draws the second."""
        key = raw_key(key)
        zero = jnp.zeros((), dtype=jnp.int64)
        first = self.mean + self.sigma * normals(key, zero, 3)
        return GaussMarkovMemory(key, first, first, zero + 1, zero)

    def step(self, memory: GaussMarkovMemory, input: Array, dt: float) -> tuple[GaussMarkovMemory, Flow]:
        """Flow over the next `dt`; the position does not matter."""
        per_node = jnp.maximum(jnp.round(self.interval / dt), 1.0)
        at_node = memory.steps == 0
        fresh = self._next_node(memory.key, memory.after, memory.nodes, per_node * dt)
        before = jnp.where(at_node, memory.after, memory.before)
        after = jnp.where(at_node, fresh, memory.after)
        rate = (after - before) / (per_node * dt)
        flow = Flow(before + memory.steps * dt * rate, rate, jnp.zeros(3))
        steps = jnp.where(memory.steps + 1 >= per_node, 0, memory.steps + 1)
        return GaussMarkovMemory(memory.key, before, after, memory.nodes + at_node, steps), flow


class CombinedCurrent(Block):
    """The sum of several currents, for instance a sheared tide and a wandering part.

    Attributes:
        parts: Current blocks; each gets random numbers of its own.
    """

    parts: tuple[Block, ...]

    def init(self, key: Array, start: Start) -> tuple:
        """Memory of each part, in order."""
        return tuple(part.init(key_for(key, f"part {i}"), start) for i, part in enumerate(self.parts))

    def step(self, memory: tuple, input: Array, dt: float) -> tuple[tuple, Flow]:
        """Sum of the flows at the position `input` [m], shape (3,)."""
        stepped = [part.step(m, input, dt) for part, m in zip(self.parts, memory, strict=True)]
        return tuple(m for m, _ in stepped), sum((flow for _, flow in stepped), Flow.still())
