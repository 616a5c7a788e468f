"""What sensors see, and what they would read without noise: one ideal reading for each kind."""

from collections.abc import Callable
from typing import Any

import equinox as eqx

from rovtwin.core.flow import Environment
from rovtwin.core.numerics import Array, jnp
from rovtwin.vehicle import measurement
from rovtwin.vehicle.dynamics import State


class SensorInput(eqx.Module):
    """What a sensor sees at the end of physics step k.

    Attributes:
        state: Of the vehicle after the step.
        nu_dot: Rate of its nu, shape (6,) [m/s2, rad/s2]; needed by accelerometers only, and only when they tick.
        k: Number of the physics step, int, from 0, never batched: the state is that at time (k + 1) dt.
        environment: What surrounded the vehicle during that step.
        energy: Charge of the emptiest battery (0 to 1) and power drawn from all [W], shape (2,), or None without.
        leak: Whether water comes in, bool, or None where it cannot.
    """

    state: State
    nu_dot: Array
    k: Array
    environment: Environment
    energy: Array | None = None
    leak: Array | None = None


Ideal = Callable[[Any, SensorInput], Array]  # of a Sensor


def _depth(sensor: Any, seen: SensorInput) -> Array:
    """Pressure as a depth: with the waves' dynamic pressure where there is one."""
    still = measurement.depth(seen.state, sensor.lever)
    return still if seen.environment.head is None else still + seen.environment.head


def _range(sensor: Any, seen: SensorInput) -> Array:
    floor = seen.environment.floor
    if floor is None:
        return jnp.full(1, jnp.inf)
    slope = seen.environment.slope
    return measurement.range_to_floor(seen.state, sensor.lever, sensor.rotation, floor, slope)[None]


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
    "altimeter": (1, _range),
    "battery": (2, lambda sensor, seen: jnp.array([1.0, 0.0]) if seen.energy is None else seen.energy),
    "leak": (1, lambda sensor, seen: jnp.zeros(1) if seen.leak is None else seen.leak.astype(float)[None]),
}
