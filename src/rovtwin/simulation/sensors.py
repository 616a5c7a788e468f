"""Sensors: an ideal reading, made as imperfect and as irregular as a real one.

One Block serves every kind. It ticks at its own rate on the physics clock k, an integer that is never batched, so that
the work of a reading is done only when there is one, also for a thousand vehicles at once.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import equinox as eqx
import numpy as np

from rovtwin.core.block import Block, Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Environment, Slot
from rovtwin.core.frames import wrap
from rovtwin.core.numerics import Array, as_array, jax, jnp, module_for
from rovtwin.simulation.checks import (
    require,
    require_finite,
    require_not_negative,
    require_probability,
    require_shape,
)
from rovtwin.simulation.noise import raw_key
from rovtwin.vehicle import measurement
from rovtwin.vehicle.dynamics import State

PHYSICS_RATE = 500.0  # of all shipped scenarios [Hz]


class SensorInput(eqx.Module):
    """What a sensor sees at the end of physics step k.

    Attributes:
        state: Of the vehicle after the step.
        nu_dot: Rate of its nu, shape (6,) [m/s2, rad/s2]; needed by accelerometers only, and only when they tick.
        k: Number of the physics step, int, from 0, never batched: the state is that at time (k + 1) dt.
        environment: What surrounded the vehicle during that step.
    """

    state: State
    nu_dot: Array
    k: Array
    environment: Environment


class SensorMemory(eqx.Module):
    """Key; bias that wanders, shape (n,); readings under way, capacity as many as the latency holds, or None."""

    key: Array
    wander: Array
    under_way: Slot | None


Ideal = Callable[["Sensor", SensorInput], Array]


def _depth(sensor: "Sensor", seen: SensorInput) -> Array:
    """Pressure as a depth: with the waves' dynamic pressure where there is one."""
    still = measurement.depth(seen.state, sensor.lever)
    return still if seen.environment.head is None else still + seen.environment.head


# kind -> (number of values, noise-free reading)
KINDS: dict[str, tuple[int, Ideal]] = {
    "position": (2, lambda sensor, seen: measurement.position_at(seen.state, sensor.lever)[:2]),
    "pressure": (1, lambda sensor, seen: _depth(sensor, seen)[None]),
    "accelerometer": (
        3,
        lambda sensor, seen: measurement.specific_force(seen.state, seen.nu_dot, sensor.lever, sensor.rotation),
    ),
    "gyro": (3, lambda sensor, seen: measurement.angular_rate(seen.state, sensor.rotation)),
    "attitude": (3, lambda sensor, seen: measurement.attitude_euler(seen.state, sensor.rotation)),
    "dvl": (3, lambda sensor, seen: measurement.velocity_over_ground_at(seen.state, sensor.lever, sensor.rotation)),
}


class Sensor(Block):
    """A sensor with a rate, noise, bias, latency, clock, faults and a mounting pose of its own.

    It reads the state after a physics step. Step k is a tick when floor((k + 1) rate / physics_rate) exceeds
    floor(k rate / physics_rate): 42 Hz on a 500 Hz clock gives exactly 42 readings a second, 11 or 12 steps apart. The
    first reading comes 1/rate (rounded up to a step) after the start, and delivery follows `latency_steps` later.
    `step(memory, SensorInput, dt) -> (memory, Slot of capacity 1)`, `valid` False between deliveries.

    reading = ideal + bias + wander + noise (+ outlier); all per axis of the sensor.

    Attributes:
        kind: "position" (north, east [m]), "pressure" (depth [m]), "accelerometer" (specific force [m/s2]), "gyro"
            [rad/s], "attitude" (zyx Euler [rad], wrapped) or "dvl" (velocity over ground [m/s]).
        rate: Millihertz, int.
        physics_rate: Of the clock k, millihertz, int.
        latency_steps: Physics steps from a reading to its delivery, int.
        noise: Standard deviation of white noise, shape (n,).
        bias: Constant, shape (n,).
        bias_walk: Intensity of the bias's random walk, per sqrt(s), shape (n,).
        clock_drift: Relative error of its clock's rate.
        clock_offset: Its clock at time zero [s]: t_valid = (1 + drift) t + offset.
        dropout: Probability that a reading is lost.
        outlier: Probability that a reading that comes is an outlier.
        outlier_size: Length of what an outlier adds, in a direction drawn uniformly.
        blackouts: Spans of true time without readings, from (included) to (excluded) [s], shape (m, 2).
        lever: Its place seen from CO, b [m], shape (3,).
        rotation: R_bs, maps its axes to b, shape (3, 3).
    """

    kind: str = eqx.field(static=True)
    rate: int = eqx.field(static=True)
    physics_rate: int = eqx.field(static=True)
    latency_steps: int = eqx.field(static=True)
    noise: Array
    bias: Array
    bias_walk: Array
    clock_drift: Array
    clock_offset: Array
    dropout: Array
    outlier: Array
    outlier_size: Array
    blackouts: Array
    lever: Array
    rotation: Array

    def __init__(
        self,
        kind: str,
        rate_hz: float,
        *,
        physics_rate_hz: float = PHYSICS_RATE,
        noise: Any = 0.0,
        bias: Any = 0.0,
        bias_walk: Any = 0.0,
        latency: float = 0.0,
        clock_drift: Any = 0.0,
        clock_offset: Any = 0.0,
        dropout: Any = 0.0,
        outlier: Any = 0.0,
        outlier_size: Any = 0.0,
        blackouts: Sequence[tuple[float, float]] = (),
        lever: Any = (0.0, 0.0, 0.0),
        rotation: Any = None,
    ):
        """Rates in hertz and latency in seconds; numbers serve all axes. Latency is rounded to physics steps."""
        if kind not in KINDS:
            raise ConfigError(f"sensor kind: found {kind!r}, expected one of {', '.join(sorted(KINDS))}")
        self.kind = kind
        self.rate, self.physics_rate = round(1000 * rate_hz), round(1000 * physics_rate_hz)
        if not 0 < self.rate <= self.physics_rate:
            raise ConfigError(f"{kind}.rate: found {rate_hz} Hz, expected above 0 and at most {physics_rate_hz} Hz")
        self.latency_steps = round(latency * physics_rate_hz)
        self.noise, self.bias, self.bias_walk = (
            _per_axis(f"{kind}.{name}", value, self.size)
            for name, value in (("noise", noise), ("bias", bias), ("bias_walk", bias_walk))
        )
        self.clock_drift, self.clock_offset = as_array(clock_drift), as_array(clock_offset)
        self.dropout, self.outlier, self.outlier_size = as_array(dropout), as_array(outlier), as_array(outlier_size)
        self.blackouts = as_array(module_for(blackouts).reshape(blackouts, (-1, 2)))
        self.lever = as_array(lever)
        self.rotation = as_array(np.eye(3) if rotation is None else rotation)
        self._check(as_array(latency))

    def _check(self, latency: Array) -> None:
        kind, R = self.kind, self.rotation
        require_not_negative(f"{kind}.latency", latency)
        require_not_negative(f"{kind}.noise", self.noise)
        require_finite(f"{kind}.bias", self.bias)
        require_not_negative(f"{kind}.bias_walk", self.bias_walk)
        require(f"{kind}.clock_drift", self.clock_drift, lambda x: np.abs(x) < 0.5, "a relative error below 0.5")
        require_finite(f"{kind}.clock_offset", self.clock_offset)
        require_probability(f"{kind}.dropout", self.dropout)
        require_probability(f"{kind}.outlier", self.outlier)
        require_not_negative(f"{kind}.outlier_size", self.outlier_size)
        require(f"{kind}.blackouts", self.blackouts, lambda spans: spans[:, 0] < spans[:, 1], "pairs (from, to)")
        require_shape(f"{kind}.lever", self.lever, (3,))
        require_finite(f"{kind}.lever", self.lever)
        require_shape(f"{kind}.rotation", R, (3, 3))
        require(f"{kind}.rotation", R, _is_rotation, "a rotation matrix (R R' = I, det R = 1)")

    @property
    def size(self) -> int:
        """Number of values in a reading."""
        return KINDS[self.kind][0]

    def readings_before(self, k: Any) -> Any:
        """How many readings are taken in physics steps 0 .. k - 1; int, or an int array like k."""
        common = math.gcd(self.rate, self.physics_rate)
        k = k.astype(jnp.int64) if isinstance(k, Array) else k
        return k * (self.rate // common) // (self.physics_rate // common)

    def ticks(self, k: Any) -> Any:
        """Whether a reading is taken at the end of physics step k; k may be an int or an int array."""
        return self.readings_before(k + 1) > self.readings_before(k)

    def delivered_before(self, k: Any) -> Any:
        """How many readings (valid or not) are delivered in physics steps 0 .. k - 1."""
        earlier = k - self.latency_steps
        return self.readings_before(jnp.maximum(earlier, 0) if isinstance(k, Array) else max(earlier, 0))

    def capacity(self, steps: int) -> int:
        """The largest number of readings that any `steps` successive physics steps deliver."""
        return -(-steps * self.rate // self.physics_rate)

    def init(self, key: Array, start: Start) -> SensorMemory:
        """No wander yet, nothing under way."""
        under_way = Slot.empty(self.capacity(self.latency_steps + 1), self.size) if self.latency_steps else None
        return SensorMemory(raw_key(key), jnp.zeros(self.size), under_way)

    def step(self, memory: SensorMemory, input: SensorInput, dt: float) -> tuple[SensorMemory, Slot]:
        """One physics step of `dt` seconds, which must be that of `physics_rate`."""
        if abs(dt * self.physics_rate / 1000 - 1.0) > 1e-6:
            raise ValueError(f"{self.kind}: made for physics at {self.physics_rate / 1000} Hz, stepped by {dt} s")
        ticks = self.ticks(input.k)
        if memory.under_way is None:
            wander, slot = jax.lax.cond(
                ticks,
                lambda: self._read(memory, input, dt),
                lambda: (memory.wander, Slot.empty(1, self.size)),
            )
            return SensorMemory(memory.key, wander, None), slot
        return self._step_late(memory, memory.under_way, input, dt)

    def _step_late(
        self, memory: SensorMemory, under_way: Slot, input: SensorInput, dt: float
    ) -> tuple[SensorMemory, Slot]:
        """With latency: a ring of readings, written and read at places that depend on k alone."""
        rows = jnp.arange(under_way.valid.shape[0])
        taken, delivered = self.readings_before(input.k), self.delivered_before(input.k)

        def write() -> tuple[Array, Slot]:
            wander, slot = self._read(memory, input, dt)
            return wander, put(under_way, slot, rows == taken % rows.shape[0])

        def read() -> Slot:
            here = rows == delivered % rows.shape[0]
            value = jnp.where(here[:, None], under_way_now.value, 0.0).sum(0)
            t_valid = jnp.where(here, under_way_now.t_valid, 0.0).sum()
            return Slot(value[None], (here & under_way_now.valid).any()[None], t_valid[None])

        wander, under_way_now = jax.lax.cond(self.ticks(input.k), write, lambda: (memory.wander, under_way))
        due = self.delivered_before(input.k + 1) > delivered
        slot = jax.lax.cond(due, read, lambda: Slot.empty(1, self.size))
        return SensorMemory(memory.key, wander, under_way_now), slot

    def _read(self, memory: SensorMemory, input: SensorInput, dt: float) -> tuple[Array, Slot]:
        """One reading: the bias's next value, and a Slot of capacity 1."""
        n = self.size
        (white, walk, direction), (lost, odd) = _draw(jax.random.fold_in(memory.key, input.k), n)
        t = (input.k + 1) * dt
        wander = memory.wander + self.bias_walk * jnp.sqrt(1000.0 / self.rate) * walk
        value = KINDS[self.kind][1](self, input) + self.bias + wander + self.noise * white
        outlier = self.outlier_size * direction / jnp.sqrt((direction**2).sum())
        value = value + jnp.where(odd < self.outlier, outlier, 0.0)
        if self.kind == "attitude":
            value = wrap(value)
        # A thousandth of a step keeps rounding from deciding which side of an edge a reading is on.
        begin, end = self.blackouts[:, 0] - 1e-3 * dt, self.blackouts[:, 1] - 1e-3 * dt
        dark = ((begin <= t) & (t < end)).any()
        valid = (lost >= self.dropout) & ~dark
        # A reading that never was must not leak out through its filler.
        value = jnp.where(valid, value, 0.0)
        t_valid = jnp.where(valid, (1.0 + self.clock_drift) * t + self.clock_offset, 0.0)
        return wander, Slot(value[None], valid[None], t_valid[None])


def _per_axis(where: str, value: Any, size: int) -> Array:
    """A number for all axes, or one for each, as shape (size,)."""
    xp = module_for(value)
    value = xp.asarray(value, dtype=float)
    if value.shape not in ((), (size,)):
        raise ConfigError(f"{where}: found {value.size} numbers, expected 1 or {size}")
    return as_array(xp.broadcast_to(value, (size,)))


def _is_rotation(R: np.ndarray) -> bool:
    return bool(np.all(np.abs(R @ R.T - np.eye(3)) < 1e-6) and np.linalg.det(R) > 0)


def _draw(key: Array, n: int) -> tuple[Array, Array]:
    """Standard normal numbers, shape (3, n), and uniform ones in (0, 1), shape (2,), from one call: half the time."""
    least = float(np.nextafter(-1.0, 0.0))
    u = jax.random.uniform(key, (3 * n + 2,), minval=least, maxval=1.0)
    return (jnp.sqrt(2.0) * jax.lax.erf_inv(u[: 3 * n])).reshape(3, n), 0.5 * (1.0 + u[3 * n :])


def put(slots: Slot, one: Slot, here: Array) -> Slot:
    """`slots` with the rows where `here`, shape (capacity,), is True replaced by the row of `one` (capacity 1)."""
    return Slot(
        jnp.where(here[:, None], one.value, slots.value),
        jnp.where(here, one.valid, slots.valid),
        jnp.where(here, one.t_valid, slots.t_valid),
    )


def table_5_7(
    as_printed: bool = False,
    dvl: bool = False,
    physics_rate_hz: float = PHYSICS_RATE,
    changes: Mapping[str, Mapping[str, Any]] | None = None,
) -> dict[str, Sensor]:
    """The sensors of thesis table 5.7, at CO, by name.

    Args:
        as_printed: With the biases of accelerometer (6.8e-6 m/s2) and gyro (0.017 rad/s) as the thesis prints them;
            they are swapped there, and by default stand corrected (0.017 m/s2 and 6.8e-6 rad/s).
        dvl: With a DVL of 5 mm/s per axis at 10 Hz, which the thesis's vehicle has not.
        physics_rate_hz: Rate of the physics clock.
        changes: By sensor name, arguments of `Sensor` that differ, such as `{"position": {"dropout": 0.1}}`.
    """
    changes = dict(changes or {})
    accelerometer_bias, gyro_bias = (6.8e-6, 0.017) if as_printed else (0.017, 6.8e-6)

    def sensor(kind: str, rate_hz: float, **parameters: Any) -> Sensor:
        given: dict[str, Any] = {"rate_hz": rate_hz} | parameters | dict(changes.pop(kind, {}))
        return Sensor(kind, physics_rate_hz=physics_rate_hz, **given)

    sensors = {
        "position": sensor("position", 1.0, noise=0.5),
        "pressure": sensor("pressure", 42.0, noise=1e-3),
        "accelerometer": sensor("accelerometer", 100.0, noise=0.0308, bias=accelerometer_bias),
        "gyro": sensor("gyro", 100.0, noise=3.08e-5, bias=gyro_bias),
        "attitude": sensor("attitude", 100.0, noise=1e-3),
    }
    if dvl:
        sensors["dvl"] = sensor("dvl", 10.0, noise=5e-3)
    if changes:
        raise ConfigError(f"sensors: found changes of {', '.join(changes)}, expected those of {', '.join(sensors)}")
    return sensors
