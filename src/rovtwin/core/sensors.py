"""The table of sensors: what a reading of each kind holds, in which unit and frame, and how good a usual one is.

Log channels, records, readers, filters, reports, links, the console and the keys of vehicle and scenario files take it
from here: a new kind is a row here and its noise-free reading in `simulation/sensors/kinds.py`. A sensor is named after
its kind; the second of a kind is `dvl_2`, and so on: `kind_of` gives the kind of a name.
"""

import math
import re
from dataclasses import dataclass
from typing import NamedTuple

FRAMES = ("n", "sensor", "")
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
        world: Key of the scenario's `world` with what it reads of the place, or "" where it reads nothing of it.
    """

    fields: tuple[str, ...]
    units: tuple[str, ...]
    frame: str
    description: str
    rate_hz: float
    std: float = 0.0
    bias: float = 0.0
    signal: str = ""
    world: str = ""

    @property
    def size(self) -> int:
        """Number of values in a reading."""
        return len(self.fields)


def _kind(
    fields: str, unit: str, frame: str, description: str, *usual: float, signal: str = "", world: str = ""
) -> SensorKind:
    names = tuple(fields.split())
    return SensorKind(names, (unit,) * len(names), frame, description, *usual, signal=signal, world=world)


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
    "magnetometer": _kind("x y z", "uT", "sensor", "magnetic field", 50.0, 0.2, world="magnetic_field"),
}
"""By kind. Figures of the first five: thesis table 5.7, with the biases of accelerometer and gyro put right.

Of the magnetometer: resolution of Honeywell's HMC5983, 2 mG. Its bias is the hard iron around it, which is the
vehicle's.
"""

EARTH_FIELD = (52.2, 75.0, 5.0)
"""Strength [uT], inclination (down positive) and declination (east positive) [deg] of the Earth's magnetic field at the
default datum, 63.45 N 10.36 E, in 2025 (IGRF-14).
"""

SHOWN_ONLY = ("sonar", "imager")
"""What a vehicle may carry besides and nobody simulates."""


class Plausible(NamedTuple):
    """The most that a class of sensors has, what a usual one has, and what a larger number is most often.

    Attributes:
        noise: Standard deviation of a reading, in the kind's unit.
        bias: Constant error; inf where one may be anything.
        typical: A usual noise, in words.
        slip: The unit that is most often meant.
    """

    noise: float
    bias: float
    typical: str
    slip: str


# Noise of a consumer MEMS gyro is 0.1 deg/s at 100 Hz, of its accelerometer 1 to 4 mg.
PLAUSIBLE = {
    "gyro": Plausible(0.02, 0.2, "0.0012 in a consumer MEMS unit", "deg/s"),
    "accelerometer": Plausible(0.5, 2.0, "0.012 in a consumer MEMS unit", "mg"),
    "attitude": Plausible(0.1, math.inf, "0.001 to 0.02 in AHRS units", "degrees"),
    "pressure": Plausible(0.5, math.inf, "0.001 to 0.01 in pressure sensors for 300 m", "mm, or a pressure"),
    "dvl": Plausible(0.3, math.inf, "0.005 in a small Doppler log", "mm/s or cm/s"),
    "altimeter": Plausible(1.0, math.inf, "0.01 to 0.05 in an echo sounder", "mm or cm"),
    "position": Plausible(20.0, math.inf, "0.03 to 2 with acoustics", "cm"),
    "magnetometer": Plausible(5.0, 1000.0, "0.02 to 0.5 in MEMS units", "nT"),
}
"""By kind, where a number may well be in another unit."""

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
