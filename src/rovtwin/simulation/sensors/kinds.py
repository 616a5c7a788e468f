"""What sensors see, and what they would read without noise: one ideal reading for each kind of `core.sensors`."""

from collections.abc import Callable
from typing import Any

import equinox as eqx

from rovtwin.core.flow import Environment
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import Array, jnp
from rovtwin.core.sensors import EARTH_FIELD
from rovtwin.core.types import Flag, Index, Scalar, Vector2, Vector3, Vector6
from rovtwin.vehicle.physics import measurement
from rovtwin.vehicle.physics.dynamics import State


class SensorInput(eqx.Module):
    """What a sensor sees at the end of physics step k.

    Attributes:
        state: Of the vehicle after the step.
        nu_dot: Rate of its nu [m/s2, rad/s2]; needed by accelerometers only, and only when they tick.
        k: Number of the physics step, from 0, never batched: the state is that at time (k + 1) dt.
        environment: What surrounded the vehicle during that step.
        energy: Charge of the emptiest battery (0 to 1) and power drawn from all [W], or None without.
        leak: Whether water comes in, or None where it cannot.
    """

    state: State
    nu_dot: Vector6
    k: Index
    environment: Environment
    energy: Vector2 | None = None
    leak: Flag | None = None


Ideal = Callable[[Any, SensorInput], Array]  # of a Sensor


def _depth(sensor: Any, seen: SensorInput) -> Scalar:
    """Pressure as a depth: with the waves' dynamic pressure where there is one."""
    still = measurement.depth(seen.state, sensor.lever)
    return still if seen.environment.head is None else still + seen.environment.head


def range_along(axis: int, sensor: Any, seen: SensorInput) -> Scalar:
    """Distance to the floor along one of the sensor's axes [m], scalar; infinite in a world without a floor."""
    floor, slope = seen.environment.floor, seen.environment.slope
    if floor is None:
        return jnp.asarray(jnp.inf)
    beam_first = jnp.roll(sensor.rotation, -axis, axis=1)
    return measurement.range_to_floor(seen.state, sensor.lever, beam_first, floor, slope)


def _magnetic_field(sensor: Any, seen: SensorInput) -> Vector3:
    """The Earth's field F along the sensor's axes [uT], by inclination I and declination D.

        m = R_ns^T F [cos I cos D, cos I sin D, sin I]

    Fossen (2021), sec. 14.1 (magnetometers of an inertial measurement unit).
    """
    strength, inclination, declination = sensor.site[0], *jnp.radians(sensor.site[1:])
    level = jnp.cos(inclination)
    north, east = level * jnp.cos(declination), level * jnp.sin(declination)
    R_ns = rotation_from_quaternion(seen.state.attitude) @ sensor.rotation
    return strength * jnp.stack([north, east, jnp.sin(inclination)]) @ R_ns


IDEAL: dict[str, Ideal] = {
    "position": lambda sensor, seen: measurement.position_at(seen.state, sensor.lever)[:2],
    "pressure": lambda sensor, seen: _depth(sensor, seen)[None],
    "accelerometer": lambda sensor, seen: measurement.specific_force(
        seen.state, seen.nu_dot, sensor.lever, sensor.rotation
    ),
    "gyro": lambda sensor, seen: measurement.angular_rate(seen.state, sensor.rotation),
    "attitude": lambda sensor, seen: measurement.attitude_euler(seen.state, sensor.rotation),
    "dvl": lambda sensor, seen: measurement.velocity_over_ground_at(seen.state, sensor.lever, sensor.rotation),
    "altimeter": lambda sensor, seen: range_along(BEAM["altimeter"], sensor, seen)[None],
    "battery": lambda sensor, seen: jnp.zeros(2) if seen.energy is None else seen.energy,
    "leak": lambda sensor, seen: jnp.zeros(1) if seen.leak is None else seen.leak.astype(float)[None],
    "magnetometer": _magnetic_field,
}
SITE = {"magnetometer": EARTH_FIELD}
"""What a kind reads of a usual place, as the key `SensorKind.world` of a scenario's world gives it."""

BEAM = {"altimeter": 0, "dvl": 2}  # the axis along which the floor must be in range
