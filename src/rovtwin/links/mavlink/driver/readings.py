"""ArduSub's telemetry as readings of our sensors: SI, radians, NED and FRD."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from rovtwin.core.errors import LinkError
from rovtwin.links.mavlink.wire import text_of

GRAVITY = 9.80665  # of the unit mg [m/s2]
DOWNWARD = 25  # MAV_SENSOR_ROTATION_PITCH_270
LEAK_LIFE = 30.0  # ArduSub tells of a leak every 20 s: so long after, it is taken for over [s]
DEPTHS = ("SCALED_PRESSURE2", "VFR_HUD", "GLOBAL_POSITION_INT")

Reading = tuple[str, list[float], float | None]  # sensor, values, time since boot [s] or None: when it arrived


@dataclass
class Readings:
    """What is made of which message.

    Attributes:
        depth: Message that the depth is taken from: the outer pressure sensor, or what the autopilot makes of it.
        position: Whether the autopilot's own horizontal place is handed on as `position`; it is no sensor's.
        density: Of the water [kg/m3], for SCALED_PRESSURE2.
        surface_pressure: [Pa], for SCALED_PRESSURE2.
    """

    depth: str = "SCALED_PRESSURE2"
    position: bool = False
    density: float = 1025.0
    surface_pressure: float = 101325.0
    _imu: str = ""
    _leak_at: float = -math.inf

    def __post_init__(self) -> None:
        if self.depth not in DEPTHS:
            raise LinkError(f"mavlink: depth from {self.depth!r}: expected one of {', '.join(DEPTHS)}")

    def of(self, message: Any, arrival: float) -> Iterator[Reading]:
        """Readings of a message; none with a value that is no number."""
        make = MAKERS.get(message.get_type())
        for reading in make(self, message, arrival) if make else ():
            if np.all(np.isfinite(reading[1])):
                yield reading

    def is_imu(self, name: str) -> bool:
        """Whether this message is the one that the accelerometer is read from: RAW_IMU where there is one."""
        if self._imu in ("", "SCALED_IMU2"):
            self._imu = name
        return self._imu == name


def _attitude(self: Readings, m: Any, arrival: float) -> Iterator[Reading]:
    boot = m.time_boot_ms * 1e-3
    yield "attitude", [m.roll, m.pitch, m.yaw], boot
    yield "gyro", [m.rollspeed, m.pitchspeed, m.yawspeed], boot


def _raw_imu(self: Readings, m: Any, arrival: float) -> Iterator[Reading]:
    if self.is_imu("RAW_IMU"):
        yield "accelerometer", [v * GRAVITY / 1000.0 for v in (m.xacc, m.yacc, m.zacc)], m.time_usec * 1e-6


def _scaled_imu2(self: Readings, m: Any, arrival: float) -> Iterator[Reading]:
    if self.is_imu("SCALED_IMU2"):
        yield "accelerometer", [v * GRAVITY / 1000.0 for v in (m.xacc, m.yacc, m.zacc)], m.time_boot_ms * 1e-3


def _pressure(self: Readings, m: Any, arrival: float) -> Iterator[Reading]:
    if self.depth == "SCALED_PRESSURE2":
        depth = (m.press_abs * 100.0 - self.surface_pressure) / (self.density * GRAVITY)
        yield "pressure", [depth], m.time_boot_ms * 1e-3


def _hud(self: Readings, m: Any, arrival: float) -> Iterator[Reading]:
    if self.depth == "VFR_HUD":
        yield "pressure", [-m.alt], None


def _global(self: Readings, m: Any, arrival: float) -> Iterator[Reading]:
    if self.depth == "GLOBAL_POSITION_INT":
        yield "pressure", [-m.relative_alt * 1e-3], m.time_boot_ms * 1e-3


def _local(self: Readings, m: Any, arrival: float) -> Iterator[Reading]:
    if self.position:
        yield "position", [m.x, m.y], m.time_boot_ms * 1e-3


def _distance(self: Readings, m: Any, arrival: float) -> Iterator[Reading]:
    if m.orientation == DOWNWARD and m.min_distance <= m.current_distance <= m.max_distance:
        yield "altimeter", [m.current_distance * 0.01], m.time_boot_ms * 1e-3


def _status(self: Readings, m: Any, arrival: float) -> Iterator[Reading]:
    if m.battery_remaining >= 0:
        known = m.voltage_battery != 65535 and m.current_battery >= 0
        power = m.voltage_battery * 1e-3 * m.current_battery * 1e-2 if known else 0.0
        yield "battery", [min(1.0, m.battery_remaining * 0.01), power], None
    yield "leak", [1.0 if arrival - self._leak_at < LEAK_LIFE else 0.0], None


def _text(self: Readings, m: Any, arrival: float) -> Iterator[Reading]:
    if "leak detected" in text_of(m.text).lower():
        self._leak_at = arrival
        yield "leak", [1.0], None


MAKERS: dict[str, Callable[[Readings, Any, float], Iterator[Reading]]] = {
    "ATTITUDE": _attitude,
    "RAW_IMU": _raw_imu,
    "SCALED_IMU2": _scaled_imu2,
    "SCALED_PRESSURE2": _pressure,
    "VFR_HUD": _hud,
    "GLOBAL_POSITION_INT": _global,
    "LOCAL_POSITION_NED": _local,
    "DISTANCE_SENSOR": _distance,
    "SYS_STATUS": _status,
    "STATUSTEXT": _text,
}
