"""Sensors of one's own: a Block gives the reading without noise, `Sensor` makes it as imperfect as any other."""

from typing import Any

import equinox as eqx
from jaxtyping import Float

from rovtwin.core.block import Block
from rovtwin.core.flow import Environment
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import Array
from rovtwin.core.sensors import SensorKind
from rovtwin.core.types import Matrix3, Scalar, Vector3
from rovtwin.simulation.sensors.kinds import SensorInput
from rovtwin.vehicle.physics import measurement
from rovtwin.vehicle.physics.dynamics import State


class OwnSensorInput(eqx.Module):
    """What a sensor of one's own sees when it reads.

    Attributes:
        time: Since the start [s], scalar.
        position: Of the sensor, n [m].
        rotation: R_ns, maps its axes to n.
        state: Of the vehicle.
        environment: What surrounds the vehicle.
        site: What `SensorKind.world` names of the place, or None.
    """

    time: Scalar
    position: Vector3
    rotation: Matrix3
    state: State
    environment: Environment
    site: Float[Array, " k"] | None = None


def seen_at(sensor: Any, seen: SensorInput, dt: float) -> OwnSensorInput:
    """What a Sensor sees at its place after a physics step of `dt` seconds."""
    return OwnSensorInput(
        (seen.k + 1) * dt,
        measurement.position_at(seen.state, sensor.lever),
        rotation_from_quaternion(seen.state.attitude) @ sensor.rotation,
        seen.state,
        seen.environment,
        sensor.site,
    )


def kind_of_block(block: Block) -> SensorKind:
    """What a Block that is a sensor of one's own reads; its attribute `kind`, which has been looked at."""
    kind = getattr(block, "kind", None)
    assert isinstance(kind, SensorKind)
    return kind
