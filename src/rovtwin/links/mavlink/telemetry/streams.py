"""Which telemetry there is, and which one peer gets when.

Times on the wire are the vehicle's (`t_valid`), so that rates hold in simulated time however fast it runs. A message
is sent when the reading it stands on is new and its interval has passed: none is repeated.

Streams and rates are those of a BlueROV2 under a ground station, counted in its telemetry.
"""

import math
from collections.abc import Callable
from typing import Any

from rovtwin.core.flow import Measurement
from rovtwin.links.mavlink.telemetry import motion_messages as motion
from rovtwin.links.mavlink.telemetry import state_messages as state
from rovtwin.links.mavlink.telemetry.scene import Scene

FASTEST = 200.0  # no message is sent more often [Hz]
STREAMS = {  # of REQUEST_DATA_STREAM
    1: ("RAW_IMU", "SCALED_IMU2", "SCALED_PRESSURE", "SCALED_PRESSURE2"),
    2: (
        *("SYS_STATUS", "POWER_STATUS", "MEMINFO", "MISSION_CURRENT", "GPS_RAW_INT", "NAV_CONTROLLER_OUTPUT"),
        "NAMED_VALUE_FLOAT",
    ),
    3: ("SERVO_OUTPUT_RAW", "RC_CHANNELS"),
    6: ("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT"),
    10: ("ATTITUDE", "AHRS2"),
    11: ("VFR_HUD",),
    12: (
        *("AHRS", "HWSTATUS", "SYSTEM_TIME", "RANGEFINDER", "DISTANCE_SENSOR", "BATTERY_STATUS"),
        *("EKF_STATUS_REPORT", "VIBRATION"),
    ),
}
STREAM_RATES = {1: 2.0, 2: 2.0, 3: 2.0, 6: 3.0, 10: 20.0, 11: 10.0, 12: 3.0}  # [Hz]
ON_REQUEST = (
    *("ATTITUDE_QUATERNION", "EXTENDED_SYS_STATE", "POSITION_TARGET_GLOBAL_INT", "POSITION_TARGET_LOCAL_NED"),
    "GPS_GLOBAL_ORIGIN",
)
STREAM_ONLY = ("NAMED_VALUE_FLOAT",)  # neither by an interval of its own nor once: ArduSub has no number for it
# Hertz, in the vehicle's time; ground stations ask for what they want.
RATES = {name: STREAM_RATES[stream] for stream, names in STREAMS.items() for name in names}
STREAMS[0] = tuple(RATES)  # all
RATES |= dict.fromkeys(ON_REQUEST, 0.0)
# ArduPilot tells home when it changes; MAVSDK listens for it later, and waits for ever without.
RATES["HOME_POSITION"] = 0.5

Build = Callable[[Scene, Measurement], Any]
ANY = ("attitude", "estimate", "pressure", "position", "battery", "accelerometer", "gyro")
# Message -> what makes it, and the sensors it stands on, the first that is there.
MESSAGES: dict[str, tuple[Build, tuple[str, ...]]] = {
    "ATTITUDE": (motion.attitude, ("attitude", "estimate")),
    "ATTITUDE_QUATERNION": (motion.quaternion, ("attitude", "estimate")),
    "AHRS": (motion.ahrs, ANY),
    "AHRS2": (motion.ahrs2, ("attitude", "estimate")),
    "LOCAL_POSITION_NED": (motion.local, ("estimate", "position")),
    "GLOBAL_POSITION_INT": (motion.on_earth, ("estimate", "position", "pressure")),
    "GPS_RAW_INT": (motion.gps, ANY),
    "VFR_HUD": (motion.hud, ("pressure", "estimate", "attitude")),
    "NAV_CONTROLLER_OUTPUT": (motion.steering_to, ANY),
    "POSITION_TARGET_GLOBAL_INT": (motion.target, ANY),
    "POSITION_TARGET_LOCAL_NED": (motion.target_n, ANY),
    "HOME_POSITION": (motion.home, ANY),
    "GPS_GLOBAL_ORIGIN": (lambda scene, at: motion.origin(scene) if scene.home else None, ANY),
    "EKF_STATUS_REPORT": (motion.ekf, ANY),
    "SYS_STATUS": (state.status, ANY),
    "BATTERY_STATUS": (state.battery, ("battery",)),
    "POWER_STATUS": (state.power, ANY),
    "HWSTATUS": (state.board, ANY),
    "MEMINFO": (state.memory, ANY),
    "MISSION_CURRENT": (state.current_item, ANY),
    "NAMED_VALUE_FLOAT": (state.named_values, ANY),
    "EXTENDED_SYS_STATE": (state.landed, ANY),
    "SCALED_PRESSURE": (state.hull_pressure, ("pressure",)),
    "SCALED_PRESSURE2": (state.water_pressure, ("pressure",)),
    "RAW_IMU": (state.raw_imu, ("accelerometer", "gyro")),
    "SCALED_IMU2": (state.scaled_imu2, ("accelerometer", "gyro")),
    "VIBRATION": (state.vibration, ("accelerometer",)),
    "SERVO_OUTPUT_RAW": (state.servos, ("thrusters",)),
    "RC_CHANNELS": (state.inputs, ANY),
    "DISTANCE_SENSOR": (state.distance, ("altimeter",)),
    "RANGEFINDER": (state.rangefinder, ("altimeter",)),
    "SYSTEM_TIME": (state.clock, ANY),
}


def build(scene: Scene, name: str) -> list[Any]:
    """Telemetry of a name as of now; empty where the vehicle does not measure what it needs."""
    make, sensors = MESSAGES[name]
    at = scene.reading(*sensors)
    return [] if at is None else _messages(make(scene, at))


def _messages(made: Any) -> list[Any]:
    return made if isinstance(made, list) else [] if made is None else [made]


class Schedule:
    """Which telemetry one peer gets when, in the vehicle's time."""

    def __init__(self, rates: dict[str, float]):
        self._at_first, self._rates = dict(rates), dict(rates)
        self._due: dict[str, float] = {}
        self._sent: dict[str, float] = {}  # t_valid of what went out last

    def rate(self, name: str) -> float:
        """[Hz], 0 for a message that is off."""
        return self._rates.get(name, 0.0)

    def set_rate(self, name: str, rate: float) -> None:
        """0 or less turns a message off; no faster than FASTEST."""
        requested = min(max(rate, 0.0), FASTEST) if math.isfinite(rate) else 0.0
        if requested != self.rate(name):
            self._rates[name] = requested
            self._due.pop(name, None)

    def reset_rate(self, name: str) -> None:
        """The rate that a message had at first."""
        self.set_rate(name, self._at_first.get(name, 0.0))

    def due(self, scene: Scene) -> list[Any]:
        """Messages that are due with the readings that are there now."""
        found = []
        for name, rate in self._rates.items():
            make, sensors = MESSAGES[name]
            at = scene.reading(*sensors) if rate > 0.0 else None
            if at is not None and self._take(name, at.t_valid, 1.0 / rate):
                found += _messages(make(scene, at))
        return found

    def _take(self, name: str, t: float, interval: float) -> bool:
        before = self._sent.get(name)
        if before is not None and t < before:  # the vehicle's clock began anew
            self._due.pop(name, None)
        elif t == before:
            return False
        due = self._due.get(name, t)
        # A millisecond of grace: readings at 0.02 s and an interval of 0.02 s differ in the last digits.
        if t < due - 1e-3:
            return False
        self._due[name] = due + interval if t - due < interval else t + interval
        self._sent[name] = t
        return True
