"""Readings of a record, laid on the filter's steps: averages, how old they are, and their noise."""

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import quaternion_from_euler
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.identification.logs.record import Record, Signal
from rovtwin.monitoring.filter import Levers, Seen
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import static_force

ROWS = {"gyro": slice(0, 3), "attitude": slice(3, 6), "depth": slice(6, 7), "velocity": slice(7, 10)}
ROWS["horizontal"] = slice(10, 12)
LOOKS = 5  # so often a step is the command looked at
# Noise that averaging does not take away: of rates, angles, depth, velocity, place [rad/s, rad, m, m/s, m]. A depth is
# a pressure, and waves press.
FLOOR = {"gyro": 5e-4, "attitude": 2e-3, "depth": 2e-2, "velocity": 1e-3, "horizontal": 5e-3}


def usable(record: Record) -> dict[str, Signal]:
    """Signals that the filter takes in: a position in three axes is one in two and a depth."""
    signals = {name: signal for name, signal in record.signals.items() if name in ROWS and len(signal.t)}
    if "position" in record.signals:
        place = record.signals["position"]
        sigma = place.sigma if place.sigma is None else np.broadcast_to(place.sigma, 3)
        for name, columns in (("horizontal", slice(0, 2)), ("depth", slice(2, 3))):
            own = None if sigma is None else sigma[columns]
            signals.setdefault(name, Signal(place.t, place.value[:, columns], own, place.lever))
    return signals


def levers_of(signals: dict[str, Signal]) -> Levers:
    """Places of the sensors."""
    zero = np.zeros(3)
    found = {name: signals[name].lever if name in signals else zero for name in ("depth", "velocity", "horizontal")}
    return Levers(**{name: jnp.asarray(lever, float) for name, lever in found.items()})


def seen(model: Model, record: Record, h: float) -> Seen:
    """A record's readings on steps of h from its start, leading axis steps; NumPy."""
    steps = int(np.floor(record.duration / h + 1e-6))
    signals, ends = usable(record), record.start + h * np.arange(1, steps + 1)
    values = {
        name: np.zeros((steps, 4 if name == "attitude" else rows.stop - rows.start)) for name, rows in ROWS.items()
    }
    values["attitude"][:, 0] = 1.0
    variance, age = np.full((steps, 12), np.inf), np.zeros((steps, len(ROWS)))
    for i, (name, rows) in enumerate(ROWS.items()):
        if name not in signals:
            continue
        signal = signals[name]
        # A step has what came within (end - h, end].
        at = np.ceil((signal.t - record.start) / h - 1e-6).astype(int) - 1
        inside = (at >= 0) & (at < steps)
        at, t, value = at[inside], signal.t[inside], signal.value[inside]
        count = np.bincount(at, minlength=steps)
        there = count > 0
        sigma = noise_of(signal)
        number = np.ones(steps) if name == "attitude" else np.maximum(count, 1)
        variance[there, rows] = (sigma**2 / number[:, None] + FLOOR[name] ** 2)[there]
        if name == "attitude":
            values[name][at], age[at, i] = quaternion_from_euler(value), ends[at] - t
            continue
        for column in range(value.shape[1]):
            values[name][:, column] = np.bincount(at, value[:, column], steps) / np.maximum(count, 1)
        age[:, i] = np.where(there, np.bincount(at, ends[at] - t, steps) / np.maximum(count, 1), 0.0)
    return Seen(_targets(model, record, ends, h), variance=variance, age=age, **values)  # type: ignore[arg-type]  (NumPy: the compiled step takes both)


def noise_of(signal: Signal) -> Float[np.ndarray, " k"]:
    """Standard deviation of each component: as declared, or what second differences say."""
    if signal.sigma is not None:
        return np.broadcast_to(np.asarray(signal.sigma, float), signal.value.shape[1:])
    if len(signal.t) < 10:
        return np.full(signal.value.shape[1], np.inf)
    value = np.unwrap(signal.value, axis=0) if signal.value.shape[1] == 3 else signal.value
    return np.median(np.abs(np.diff(value, n=2, axis=0)), axis=0) / 0.6745 / np.sqrt(6.0)


def _targets(model: Model, record: Record, ends: Float[np.ndarray, " steps"], h: float) -> Float[np.ndarray, "steps n"]:
    """Force to which commands send each thruster, averaged over each step [N]."""
    looks = (ends[:, None] - h * (np.arange(LOOKS)[::-1] + 0.5) / LOOKS).ravel()
    force = np.asarray(_forces(model, jnp.asarray(record.command_at(looks))))
    return force.reshape(len(ends), LOOKS, -1).mean(axis=1)


@jax.jit
def _forces(model: Model, command: Float[Array, "m n"]) -> Float[Array, "m n"]:
    return jax.vmap(lambda u: static_force(model.thrusters, u))(command)
