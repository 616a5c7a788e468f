"""Sensors: an ideal reading, made as imperfect and as irregular as a real one.

One Block serves every kind. It ticks at its own rate on the physics clock k, an integer that is never batched, so that
the work of a reading is done only when there is one, also for a thousand vehicles at once.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.block import Block, Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Slot
from rovtwin.core.frames import wrap
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.sensors import ESSENTIAL, SENSORS, SensorKind
from rovtwin.core.types import Flag, Matrix3, PRNGKey, RawKey, Scalar, Vector3
from rovtwin.simulation.checks import (
    require,
    require_finite,
    require_not_negative,
    require_positive,
    require_probability,
    require_rotation,
    require_shape,
    require_spans,
    within,
)
from rovtwin.simulation.noise import raw_key
from rovtwin.simulation.sensors.acoustic import AcousticErrors, AcousticState
from rovtwin.simulation.sensors.kinds import BEAM, IDEAL, SITE, SensorInput, range_along
from rovtwin.simulation.sensors.own import kind_of_block, seen_at
from rovtwin.simulation.sensors.values import Offsets, offsets_of, per_axis, spans_of

__all__ = ["PHYSICS_RATE", "Offsets", "Sensor", "SensorInput", "SensorMemory", "put", "table_5_7", "usual_sensor"]

PHYSICS_RATE = 500.0  # of all shipped scenarios [Hz]
MAX_RANGE = 50.0  # of a small echo sounder or DVL over sand [m]
DOWN = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # R_bs of a sensor whose x axis looks down


class Wear(eqx.Module):
    """What a reading leaves behind.

    Attributes:
        wander: Bias that walks.
        last: The last valid reading, or None where the sensor never freezes.
        known: Whether there was one, or None.
        acoustic: Of an acoustic position's errors, or None.
        own: Memory of the block that is a sensor of one's own, or None.
    """

    wander: Float[Array, " n"]
    last: Float[Array, " n"] | None
    known: Flag | None
    acoustic: AcousticState | None = None
    own: Any = None


class SensorMemory(eqx.Module):
    """Key; what the last reading left; readings under way, capacity as many as the latency holds, or None."""

    key: RawKey
    wear: Wear
    under_way: Slot | None


class Sensor(Block):
    """A sensor with a rate, noise, bias, latency, clock, faults and a mounting pose of its own.

    It reads the state after a physics step. Step k is a tick when floor((k + 1) rate / physics_rate) exceeds
    floor(k rate / physics_rate): 42 Hz on a 500 Hz clock gives exactly 42 readings a second, 11 or 12 steps apart. The
    first reading comes 1/rate (rounded up to a step) after the start, and delivery follows `latency_steps` later.
    `step(memory, SensorInput, dt) -> (memory, Slot of capacity 1)`, `valid` False between deliveries.

    reading = ideal + bias + wander + noise (+ outlier); all per axis of the sensor.

    Attributes:
        kind: A row of `core.sensors.SENSORS`, which says what it reads, in which unit and frame; of one's own its name.
        row: That row.
        rate: Millihertz.
        physics_rate: Of the clock k, millihertz.
        latency_steps: Physics steps from a reading to its delivery.
        noise: Standard deviation of white noise.
        bias: Constant.
        bias_walk: Intensity of the bias's random walk, per sqrt(s).
        clock_drift: Relative error of its clock's rate.
        clock_offset: Its clock at time zero [s]: t_valid = (1 + drift) t + offset.
        dropout: Probability that a reading is lost.
        outlier: Probability that a reading that comes is an outlier.
        outlier_size: Length of what an outlier adds, in a direction drawn uniformly.
        blackouts: Spans of true time without readings, from (included) to (excluded) [s].
        offsets: Bias within spans of time, or None.
        frozen: Spans in which it repeats its last reading, with new time stamps [s], or None.
        min_range: Of an altimeter and a DVL [m]; nearer to the floor there is no reading.
        max_range: The same, farther away. A DVL in a world without a floor always reads.
        lever: Its place seen from CO, b [m].
        rotation: R_bs, maps its axes to b.
        errors: Of an acoustic position, beside the rest; or None.
        site: What it reads of the place (`row.world`), or None.
        own: Block that gives the ideal reading of a sensor of one's own, or None.
    """

    kind: str = eqx.field(static=True)
    row: SensorKind = eqx.field(static=True)
    rate: int = eqx.field(static=True)
    physics_rate: int = eqx.field(static=True)
    latency_steps: int = eqx.field(static=True)
    noise: Float[Array, " n"]
    bias: Float[Array, " n"]
    bias_walk: Float[Array, " n"]
    clock_drift: Scalar
    clock_offset: Scalar
    dropout: Scalar
    outlier: Scalar
    outlier_size: Scalar
    blackouts: Float[Array, "m 2"]
    offsets: Offsets | None
    frozen: Float[Array, "f 2"] | None
    min_range: Scalar
    max_range: Scalar
    lever: Vector3
    rotation: Matrix3
    errors: AcousticErrors | None
    site: Float[Array, " k"] | None
    own: Block | None

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
        offsets: Sequence[tuple[float, float, Any]] = (),
        frozen: Sequence[tuple[float, float]] = (),
        min_range: Any = 0.0,
        max_range: Any = MAX_RANGE,
        lever: Any = (0.0, 0.0, 0.0),
        rotation: Any = None,
        errors: AcousticErrors | str | None = None,
        site: Any = None,
        own: Block | None = None,
    ):
        """Rates in hertz and latency in seconds; numbers serve all axes. Latency is rounded to physics steps.

        `offsets` are (from, to, bias), one for each span. An altimeter looks down unless `rotation` is given, all else
        ahead. `errors` is "acoustic" for those of an Underwater GPS as it was fitted. `site` is usual unless given.
        """
        self.kind, self.row, self.own = kind, _row(kind, own), own
        self.rate, self.physics_rate = round(1000 * rate_hz), round(1000 * physics_rate_hz)
        if not 0 < self.rate <= self.physics_rate:
            raise ConfigError(f"{kind}.rate: found {rate_hz} Hz, expected above 0 and at most {physics_rate_hz} Hz")
        self.latency_steps = round(latency * physics_rate_hz)
        self.noise, self.bias, self.bias_walk = (
            per_axis(f"{kind}.{name}", value, self.size)
            for name, value in (("noise", noise), ("bias", bias), ("bias_walk", bias_walk))
        )
        self.clock_drift, self.clock_offset = as_array(clock_drift), as_array(clock_offset)
        self.dropout, self.outlier, self.outlier_size = as_array(dropout), as_array(outlier), as_array(outlier_size)
        self.blackouts = spans_of(blackouts)
        self.offsets = offsets_of(f"{kind}.offsets", offsets, self.size) if len(offsets) else None
        self.frozen = spans_of(frozen) if len(frozen) else None
        self.min_range = as_array(min_range)
        self.max_range = as_array(max_range)
        self.lever = as_array(lever)
        straight = DOWN if kind == "altimeter" else np.eye(3)
        self.rotation = as_array(straight if rotation is None else rotation)
        self.errors = AcousticErrors() if errors == "acoustic" else errors  # type: ignore[assignment]  (checked)
        site = SITE.get(kind) if site is None else site
        self.site = None if site is None else as_array(site)
        self._check(as_array(latency))

    def _check(self, latency: Scalar) -> None:
        kind, R = self.kind, self.rotation
        if self.errors is not None and not (kind == "position" and isinstance(self.errors, AcousticErrors)):
            raise ConfigError(
                f"{kind}.errors: found acoustic ones, or none that are known; expected acoustic, of a position"
            )
        require_not_negative(f"{kind}.latency", latency)
        require_not_negative(f"{kind}.noise", self.noise)
        require_finite(f"{kind}.bias", self.bias)
        require_not_negative(f"{kind}.bias_walk", self.bias_walk)
        require(f"{kind}.clock_drift", self.clock_drift, lambda x: np.abs(x) < 0.5, "a relative error below 0.5")
        require_finite(f"{kind}.clock_offset", self.clock_offset)
        require_probability(f"{kind}.dropout", self.dropout)
        require_probability(f"{kind}.outlier", self.outlier)
        require_not_negative(f"{kind}.outlier_size", self.outlier_size)
        for name, spans in (
            ("blackouts", self.blackouts),
            ("offsets", None if self.offsets is None else self.offsets.spans),
            ("frozen", self.frozen),
        ):
            if spans is not None:
                require_spans(f"{kind}.{name}", spans)
        require_not_negative(f"{kind}.min_range", self.min_range)
        require_positive(f"{kind}.max_range", self.max_range)
        require_shape(f"{kind}.lever", self.lever, (3,))
        require_finite(f"{kind}.lever", self.lever)
        require_shape(f"{kind}.rotation", R, (3, 3))
        require_rotation(f"{kind}.rotation", R)

    @property
    def size(self) -> int:
        """Number of values in a reading."""
        return self.row.size

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

    def init(self, key: PRNGKey, start: Start) -> SensorMemory:
        """No wander yet, nothing under way."""
        under_way = Slot.empty(self.capacity(self.latency_steps + 1), self.size) if self.latency_steps else None
        freezes = self.frozen is not None
        last, known = (jnp.zeros(self.size), jnp.zeros((), dtype=bool)) if freezes else (None, None)
        acoustic = None if self.errors is None else self.errors.init(jax.random.fold_in(key, 1))
        own = None if self.own is None else self.own.init(jax.random.fold_in(key, 2), start)
        return SensorMemory(raw_key(key), Wear(jnp.zeros(self.size), last, known, acoustic, own), under_way)

    def step(self, memory: SensorMemory, input: SensorInput, dt: float) -> tuple[SensorMemory, Slot]:
        """One physics step of `dt` seconds, which must be that of `physics_rate`."""
        if abs(dt * self.physics_rate / 1000 - 1.0) > 1e-6:
            raise ValueError(f"{self.kind}: made for physics at {self.physics_rate / 1000} Hz, stepped by {dt} s")
        if memory.under_way is not None:
            return self._step_late(memory, memory.under_way, input, dt)
        wear, slot = jax.lax.cond(
            self.ticks(input.k),
            lambda: self._read(memory, input, dt),
            lambda: (memory.wear, Slot.empty(1, self.size)),
        )
        return SensorMemory(memory.key, wear, None), slot

    def _step_late(
        self, memory: SensorMemory, under_way: Slot, input: SensorInput, dt: float
    ) -> tuple[SensorMemory, Slot]:
        """With latency: a ring of readings, written and read at places that depend on k alone."""
        rows = jnp.arange(under_way.valid.shape[0])
        taken, delivered = self.readings_before(input.k), self.delivered_before(input.k)

        def write() -> tuple[Wear, Slot]:
            wear, slot = self._read(memory, input, dt)
            return wear, put(under_way, slot, rows == taken % rows.shape[0])

        def read() -> Slot:
            here = rows == delivered % rows.shape[0]
            value = jnp.where(here[:, None], under_way_now.value, 0.0).sum(0)
            t_valid = jnp.where(here, under_way_now.t_valid, 0.0).sum()
            return Slot(value[None], (here & under_way_now.valid).any()[None], t_valid[None])

        wear, under_way_now = jax.lax.cond(self.ticks(input.k), write, lambda: (memory.wear, under_way))
        due = self.delivered_before(input.k + 1) > delivered
        slot = jax.lax.cond(due, read, lambda: Slot.empty(1, self.size))
        return SensorMemory(memory.key, wear, under_way_now), slot

    def _read(self, memory: SensorMemory, input: SensorInput, dt: float) -> tuple[Wear, Slot]:
        """One reading, and what it leaves behind: Slot of capacity 1."""
        n = self.size
        (white, walk, direction), (lost, odd) = _draw(jax.random.fold_in(memory.key, input.k), n)
        t = (input.k + 1) * dt
        wander = memory.wear.wander + self.bias_walk * jnp.sqrt(1000.0 / self.rate) * walk
        own, ideal = self._ideal(memory.wear.own, input, dt)
        value = ideal + self.bias + wander + self.noise * white
        outlier = self.outlier_size * direction / jnp.sqrt((direction**2).sum())
        value = value + jnp.where(odd < self.outlier, outlier, 0.0)
        if self.offsets is not None:
            value = value + jnp.where(within(self.offsets.spans, t, dt)[:, None], self.offsets.value, 0.0).sum(0)
        if self.kind == "attitude":
            value = wrap(value)
        comes = (lost >= self.dropout) & ~within(self.blackouts, t, dt).any()
        acoustic = memory.wear.acoustic
        if self.errors is not None and acoustic is not None:
            own_key = jax.random.fold_in(jax.random.fold_in(memory.key, input.k), 1)
            acoustic, error, fixed = self.errors.step(acoustic, ideal, own_key, 1000.0 / self.rate)
            value, comes = value + error, comes & fixed
        # A gauge knows nothing where no battery is simulated: full for ever, it would keep every rule about it asleep.
        valid = comes & (self.kind != "battery" or input.energy is not None)
        if self.own is not None:
            valid = valid & jnp.isfinite(value).all()
        if self.kind in BEAM and (self.kind == "altimeter" or input.environment.floor is not None):
            away = range_along(BEAM[self.kind], self, input)
            valid = valid & (away > 0.0) & (away >= self.min_range) & (away <= self.max_range)
            value = jnp.where(valid, value, 0.0)  # no echo, no number: what is not finite must not reach a memory
        last, known = memory.wear.last, memory.wear.known
        if self.frozen is not None and last is not None and known is not None:
            stuck = known & within(self.frozen, t, dt).any()
            value, valid = jnp.where(stuck, last, value), valid | (stuck & comes)  # it needs no echo
            last, known = jnp.where(valid, value, last), known | valid
        # A reading that never was must not leak out through its filler.
        value = jnp.where(valid, value, 0.0)
        t_valid = jnp.where(valid, (1.0 + self.clock_drift) * t + self.clock_offset, 0.0)
        return Wear(wander, last, known, acoustic, own), Slot(value[None], valid[None], t_valid[None])

    def _ideal(self, own: Any, input: SensorInput, dt: float) -> tuple[Any, Float[Array, " n"]]:
        """Memory of a block of one's own, and the reading without any error."""
        if self.own is None:
            return None, IDEAL[self.kind](self, input)
        return self.own.step(own, seen_at(self, input, dt), 1000.0 / self.rate)


def _row(kind: str, own: Block | None) -> SensorKind:
    if own is not None:
        return kind_of_block(own)
    if kind not in SENSORS:
        raise ConfigError(f"sensor kind: found {kind!r}, expected one of {', '.join(sorted(SENSORS))}")
    return SENSORS[kind]


def _draw(key: RawKey, n: int) -> tuple[Float[Array, "3 {n}"], Float[Array, "2"]]:
    """Standard normal numbers, and uniform ones in (0, 1), from one call: half the time."""
    least = float(np.nextafter(-1.0, 0.0))
    u = jax.random.uniform(key, (3 * n + 2,), minval=least, maxval=1.0)
    return (jnp.sqrt(2.0) * jax.lax.erf_inv(u[: 3 * n])).reshape(3, n), 0.5 * (1.0 + u[3 * n :])


def put(slots: Slot, one: Slot, here: Bool[Array, " capacity"]) -> Slot:
    """`slots` with the rows where `here` is True replaced by the row of `one` (capacity 1)."""
    return Slot(
        jnp.where(here[:, None], one.value, slots.value),
        jnp.where(here, one.valid, slots.valid),
        jnp.where(here, one.t_valid, slots.t_valid),
    )


def usual_sensor(kind: str, **given: Any) -> Sensor:
    """A sensor with the usual figures of its kind.

    Args:
        kind: A row of `core.sensors.SENSORS`, or the name of one's own.
        given: Arguments of `Sensor` that differ.
    """
    row = _row(kind, given.get("own"))
    figures: dict[str, Any] = {"rate_hz": row.rate_hz, "noise": row.std, "bias": row.bias}
    return Sensor(kind, **(figures | given))


def table_5_7(
    as_printed: bool = False,
    physics_rate_hz: float = PHYSICS_RATE,
    changes: Mapping[str, Mapping[str, Any]] | None = None,
    extra: Sequence[str] = (),
) -> dict[str, Sensor]:
    """The sensors of thesis table 5.7, at CO, by name.

    Args:
        as_printed: With the biases of accelerometer (6.8e-6 m/s2) and gyro (0.017 rad/s) as the thesis prints them;
            they are swapped there, and by default stand corrected (0.017 m/s2 and 6.8e-6 rad/s).
        physics_rate_hz: Rate of the physics clock.
        changes: By sensor name, arguments of `Sensor` that differ, such as `{"position": {"dropout": 0.1}}`.
        extra: Kinds to have besides, such as a DVL of 5 mm/s per axis at 10 Hz.
    """
    printed = {"accelerometer": {"bias": SENSORS["gyro"].bias}, "gyro": {"bias": SENSORS["accelerometer"].bias}}
    kinds = [kind for kind in SENSORS if kind in ESSENTIAL or kind in extra]
    changes = changes or {}
    if unknown := sorted(set(changes) - set(kinds)):
        raise ConfigError(f"sensors: found changes of {', '.join(unknown)}, expected those of {', '.join(kinds)}")
    swapped = printed if as_printed else {}
    return {
        kind: usual_sensor(
            kind, **({"physics_rate_hz": physics_rate_hz} | swapped.get(kind, {}) | dict(changes.get(kind, {})))
        )
        for kind in kinds
    }
