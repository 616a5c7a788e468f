"""What the vehicle measures and has decided, as its messages tell it."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import rotation_from_euler
from rovtwin.core.datum import Datum
from rovtwin.core.flow import Measurement
from rovtwin.links.mavlink.firmware.autopilot import Autopilot
from rovtwin.links.mavlink.firmware.guided import Place
from rovtwin.links.servers.served_vehicle import ServedVehicle

FIX_LASTS = 4.0  # a position is a fix for so long, as ArduPilot trusts a GPS [s]
SMOOTHED, JUDGED = 5.0, 2.0  # cut-off of the mean and of the deviation that ArduPilot calls vibration [Hz]

Home = tuple[float, float, float]  # latitude, longitude [deg], height over the ellipsoid [m]


@dataclass
class Scene:
    """The vehicle as telemetry sees it.

    Attributes:
        latest: The newest reading of each sensor up to the batch that is sent now.
        station: Its names and its time.
        drone: Its name in them.
        dialect: pymavlink's module.
        datum: Origin of n on the map.
        density: Of the water [kg/m3].
        surface_pressure: At the surface [Pa].
        autopilot: What is decided.
        home_given: Home where a client has set it; None: the origin of n, once the vehicle knows where it is.
    """

    latest: dict[str, Measurement]
    station: ServedVehicle
    drone: str
    dialect: Any
    datum: Datum
    density: float
    surface_pressure: float
    autopilot: Autopilot
    home_given: Home | None = None
    _trend: "Trend" = field(default_factory=lambda: Trend())

    def take(self, readings: Sequence[Measurement]) -> None:
        """Take in the vehicle's newest readings."""
        self.latest.update((reading.sensor, reading) for reading in readings)
        for reading in readings:
            name = reading.sensor.rpartition("/")[2]
            if name in ("accelerometer", "attitude") and self.reading(name) is reading:
                self._trend.take(name, reading)

    @property
    def vibration(self) -> Float[np.ndarray, "3"]:
        """Root mean square of what shakes the accelerometer [m/s2]."""
        return np.sqrt(self._trend.variance)

    @property
    def turns(self) -> float:
        """Turns of the tether by heading since the start, in quarters as ArduSub counts them; clockwise positive."""
        return math.trunc(self._trend.turned / (math.pi / 2.0)) / 4.0

    def reading(self, *sensors: str) -> Measurement | None:
        """The newest of the first of these sensors that is there and has numbers."""
        for sensor in sensors:
            found = self.latest.get(self.station.name(self.drone, sensor)) or self.latest.get(sensor)
            if found is not None and np.all(np.isfinite(found.value)):
                return found
        return None

    def values(self, sensor: str, size: int) -> Float[np.ndarray, " size"]:
        """Newest values of a sensor, zeros where there are none."""
        found = self.reading(sensor)
        return found.value if found is not None and found.value.shape == (size,) else np.zeros(size)

    def fix(self) -> Measurement | None:
        """The newest horizontal position of a sensor, or None where there is none or it is too old."""
        found = self.reading("position")
        return found if found is not None and self.station.now - found.t_valid <= FIX_LASTS else None

    def place(self) -> Place | None:
        """Where the vehicle is and its heading, by its own estimate or by its sensors; None when it does not know."""
        estimate = self.reading("estimate")
        if estimate is not None:
            eta = estimate.value
            return float(eta[0]), float(eta[1]), float(eta[2]), float(eta[5])
        parts = [self.reading(sensor) for sensor in ("position", "pressure", "attitude")]
        if any(part is None for part in parts):
            return None
        position, pressure, attitude = (part.value for part in parts if part is not None)
        return float(position[0]), float(position[1]), float(pressure[0]), float(attitude[2])

    def on_map(self, north: float, east: float, down: float) -> tuple[int, int, float]:
        """Latitude and longitude [1e-7 deg] and height [m] of a place in n, as they stand in messages."""
        latitude, longitude, height = self.datum.geodetic(np.array([north, east, down]))
        return int32(float(latitude) * 1e7), int32(float(longitude) * 1e7), float(height)

    def fresh_depth(self) -> float | None:
        """Depth of the pressure sensor, else of the estimate [m]; None where neither has spoken lately."""
        for sensor, component in (("pressure", 0), ("estimate", 2)):
            found = self.reading(sensor)
            if found is not None:
                return float(found.value[component]) if self.station.now - found.t_valid <= FIX_LASTS else None
        return None

    def down(self) -> float:
        """Depth of the vehicle [m]: of the pressure sensor, else of its estimate, else 0."""
        pressure, place = self.reading("pressure"), self.place()
        return float(pressure.value[0]) if pressure is not None else (place[2] if place else 0.0)

    @property
    def home(self) -> Home | None:
        """Home on the map, or None while it is not set: nobody set it and the vehicle does not know where it is."""
        if self.home_given is not None:
            return self.home_given
        known = self.place() is not None
        return (self.datum.latitude, self.datum.longitude, self.datum.height) if known else None

    @property
    def ground(self) -> float:
        """Height over the ellipsoid that relative heights count from: home's, else the water's [m]."""
        return self.home_given[2] if self.home_given else self.datum.height

    def attitude(self) -> Float[np.ndarray, "3"] | None:
        """zyx Euler angles [rad], or None while they are not known."""
        sensed, estimate = self.reading("attitude"), self.reading("estimate")
        if sensed is not None:
            return sensed.value
        return None if estimate is None else estimate.value[3:6]

    def rates(self) -> Float[np.ndarray, "3"]:
        """Angular velocity in b [rad/s]: the gyro's, or the estimate's; zeros without."""
        gyro, estimate = self.reading("gyro"), self.reading("estimate")
        if gyro is not None:
            return gyro.value
        return np.zeros(3) if estimate is None else estimate.value[9:12]

    def velocity_n(self) -> Float[np.ndarray, "3"]:
        """Velocity over ground in n [m/s]: the estimate's, or the DVL's turned; zeros without."""
        estimate = self.reading("estimate")
        attitude = self.attitude()
        nu = estimate.value[6:9] if estimate is not None else self.values("dvl", 3)
        return rotation_from_euler(attitude) @ nu if attitude is not None else np.zeros(3)

    def readiness(self) -> str:
        """What is missing before the vehicle may be armed; empty when nothing is."""
        return "" if self.attitude() is not None else "no attitude yet"


class Trend:
    """What becomes of readings over time: how the vehicle shakes and how often it has turned.

    Attributes:
        variance: Of the specific force about its mean of late [m2/s4], shape (3,).
        turned: Heading gone through since the start, clockwise positive [rad].
    """

    def __init__(self) -> None:
        self.variance, self.turned = np.zeros(3), 0.0
        self._mean: np.ndarray | None = None
        self._at, self._heading = 0.0, math.nan

    def take(self, sensor: str, reading: Measurement) -> None:
        """A new reading of `accelerometer` or `attitude`."""
        if sensor == "attitude":
            heading = float(reading.value[2])
            self.turned += math.remainder(heading - self._heading, math.tau) if math.isfinite(self._heading) else 0.0
            self._heading = heading
            return
        passed, self._at = reading.t_valid - self._at, reading.t_valid
        if self._mean is None or not 0.0 < passed < 1.0:  # the first one, or after a gap
            self._mean = reading.value
            return
        self._mean = self._mean + _share(passed, SMOOTHED) * (reading.value - self._mean)
        self.variance = self.variance + _share(passed, JUDGED) * ((reading.value - self._mean) ** 2 - self.variance)


def _share(passed: float, cut_off: float) -> float:
    """Share of a step that a low-pass filter of first order goes within a time [s]."""
    return passed / (passed + 1.0 / (math.tau * cut_off))


def rounds(batch: Sequence[Measurement]) -> list[list[Measurement]]:
    """A batch in pieces that hold each sensor once: none of a fast sensor's readings is passed over."""
    found: list[list[Measurement]] = []
    seen: Counter[str] = Counter()
    for reading in batch:
        row = seen[reading.sensor]
        seen[reading.sensor] += 1
        if row == len(found):
            found.append([])
        found[row].append(reading)
    return found


def milliseconds(t: float) -> int:
    """The vehicle's time as `time_boot_ms`."""
    return max(0, round(t * 1000.0)) & 0xFFFFFFFF


def microseconds(t: float) -> int:
    """The vehicle's time as `time_usec`."""
    return max(0, round(t * 1e6))


def int16(value: float) -> int:
    """Rounded and cut to what a field of 16 bits holds."""
    return int(np.clip(round(value), -32768, 32767))


def int32(value: float) -> int:
    """Rounded and cut to what a field of 32 bits holds."""
    return int(np.clip(round(value), -(2**31), 2**31 - 1))
