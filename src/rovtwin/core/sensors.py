"""The table of sensors: what a reading of each kind holds, in which unit and frame, and how good a usual one is.

Log channels, records, readers, filters, reports, links and the console take it from here. A sensor is named after its
kind; the second of a kind is `dvl_2`, and so on: `kind_of` gives the kind of a name.
"""

import re
from dataclasses import dataclass

_NUMBERED = re.compile(r"_[2-9]\d*$|_1\d+$")


@dataclass(frozen=True)
class SensorKind:
    """One kind of sensor.

    Attributes:
        fields: Names of the values of a reading.
        units: Of each value.
        frame: Of the values: "n" (NED), "sensor" (its own axes), or "" where there is none.
        description: What is measured.
        rate_hz: Usual readings a second.
        std: Usual standard deviation of a value; 0 where a reading has no noise.
        bias: Usual constant error of a value.
        signal: What it is called in identification, or "" where that makes no use of it.
    """

    fields: tuple[str, ...]
    units: tuple[str, ...]
    frame: str
    description: str
    rate_hz: float
    std: float = 0.0
    bias: float = 0.0
    signal: str = ""

    @property
    def size(self) -> int:
        """Number of values in a reading."""
        return len(self.fields)


def _kind(fields: str, unit: str, frame: str, description: str, *usual: float, signal: str = "") -> SensorKind:
    names = tuple(fields.split())
    return SensorKind(names, (unit,) * len(names), frame, description, *usual, signal=signal)


SENSORS: dict[str, SensorKind] = {
    "position": _kind("north east", "m", "n", "acoustic position of the transponder", 1.0, 0.5, signal="horizontal"),
    "pressure": _kind("depth", "m", "n", "depth from pressure", 42.0, 1e-3, signal="depth"),
    "accelerometer": _kind("x y z", "m/s2", "sensor", "specific force", 100.0, 0.0308, 0.017, signal="accelerometer"),
    "gyro": _kind("x y z", "rad/s", "sensor", "angular rate", 100.0, 3.08e-5, 6.8e-6, signal="gyro"),
    "attitude": _kind("phi theta psi", "rad", "n", "zyx Euler angles", 100.0, 1e-3, signal="attitude"),
    "dvl": _kind("x y z", "m/s", "sensor", "velocity over ground", 10.0, 5e-3, signal="velocity"),
    "altimeter": _kind("range", "m", "sensor", "distance to the floor along the beam", 10.0, 0.01),
    "battery": SensorKind(("charge", "power"), ("1", "W"), "", "charge of the emptiest battery, power of all", 1.0),
    "leak": _kind("leak", "1", "", "1 when water comes in", 1.0),
}
"""By kind. Figures of the first five: thesis table 5.7, with the biases of accelerometer and gyro put right."""

ESSENTIAL = ("position", "pressure", "accelerometer", "gyro", "attitude")
"""Kinds that autopilots and tests need: what the thesis's vehicle has."""

IMU = ("accelerometer", "gyro", "attitude")
"""Kinds that a vehicle's protocol tells along the vehicle's axes, however the sensor is built in."""


def kind_of(name: str) -> str:
    """The kind of a sensor's name: of `dvl` and `dvl_2` it is `dvl`."""
    return _NUMBERED.sub("", name)


def kind_named(name: str) -> SensorKind:
    """The row of the table for a sensor's name; KeyError where there is none."""
    return SENSORS[kind_of(name)]


def names_of(kind: str, count: int) -> list[str]:
    """Names of so many sensors of a kind: `dvl`, `dvl_2`, .."""
    return [kind if i == 0 else f"{kind}_{i + 1}" for i in range(count)]
