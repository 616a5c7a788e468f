"""What on board a vehicle measures: each sensor of its parts, an imu taken apart, with the figures that are usual."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.sensors import SENSORS
from rovtwin.vehicle.description.schema import Sensor, SensorFigures
from rovtwin.vehicle.description.vehicle import Vehicle


@dataclass(frozen=True)
class Instrument:
    """A sensor of one kind of `core.sensors`.

    Attributes:
        part: Its name with the parts that it sits in, `port.imu`.
        kind: A row of the table.
        position: Its place seen from CO, b [m].
        rotation: R_bs, maps its axes to b.
        figures: How well it measures, in SI; those of the file, else usual ones.
        spare: Whether it is on board but not read.
    """

    part: str
    kind: str
    position: Float[np.ndarray, "3"]
    rotation: Float[np.ndarray, "3 3"]
    figures: dict[str, Any]
    spare: bool


def instruments(vehicle: Vehicle) -> list[Instrument]:
    """All that can be simulated, in order of the file; what is `SHOWN_ONLY` is not among them."""
    found = []
    for mounted in vehicle.sensors:
        assert isinstance(mounted.item, Sensor)
        for kind, figures in _measured(mounted.item):
            place = (mounted.position, mounted.rotation)
            found.append(Instrument(mounted.name, kind, *place, _complete(kind, figures), mounted.spare))
    return found


def carries(vehicle: Vehicle, kind: str) -> bool:
    """Whether a sensor of a kind sits in one of its parts and is read."""
    return any(one.kind == kind and not one.spare for one in instruments(vehicle))


def _measured(sensor: Sensor) -> list[tuple[str, SensorFigures]]:
    """Kinds that a sensor measures, with their figures."""
    if sensor.kind != "imu":
        return [(sensor.kind, sensor)] if sensor.kind in SENSORS else []
    usual = SensorFigures.model_validate({})
    inertial = [("accelerometer", sensor.accelerometer or usual), ("gyro", sensor.gyro or usual)]
    return inertial + ([("attitude", sensor.attitude)] if sensor.attitude is not None else [])


def _complete(kind: str, figures: SensorFigures) -> dict[str, Any]:
    row = SENSORS[kind]
    given = figures.model_dump(include=set(SensorFigures.model_fields), exclude_none=True)
    return {"rate_hz": row.rate_hz, "noise": row.std, "bias": row.bias} | given
