"""What the vehicle measures, as ArduSub's telemetry; at what rates, for one peer.

Times on the wire are the vehicle's (`t_valid`), so that rates hold in simulated time however fast it runs. A message
is sent when the reading it stands on is new and its interval has passed: none is repeated.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rovtwin.core.datum import Datum
from rovtwin.core.flow import Measurement
from rovtwin.links.mavlink.guided import Place
from rovtwin.links.rotations import rotation_from_euler
from rovtwin.links.station import Station

GRAVITY = 9.80665  # of the unit mg [m/s2]
DOWNWARD = 25  # MAV_SENSOR_ROTATION_PITCH_270
# Lithium-ion of four cells, estimated: 4.2 V a cell when full, 3.25 V when empty.
FULL_VOLTS, EMPTY_VOLTS = 16.8, 13.0
# Present, enabled and healthy: gyro 1, accelerometer 2, magnetometer 4, absolute pressure 8, motors 32768.
GYRO, ACCELEROMETER, COMPASS, PRESSURE, MOTORS = 1, 2, 4, 8, 32768
EKF_GOOD = 1 | 2 | 4 | 8 | 16 | 32  # attitude, velocities, relative and absolute horizontal place, depth
# Hertz, in the vehicle's time; ground stations ask for what they want.
RATES = {
    **{"ATTITUDE": 10.0, "ATTITUDE_QUATERNION": 0.0, "LOCAL_POSITION_NED": 5.0, "GLOBAL_POSITION_INT": 5.0},
    **{"VFR_HUD": 5.0, "SYS_STATUS": 2.0, "BATTERY_STATUS": 1.0, "SCALED_PRESSURE2": 5.0, "RAW_IMU": 5.0},
    **{"SCALED_IMU2": 5.0, "SERVO_OUTPUT_RAW": 2.0, "EKF_STATUS_REPORT": 1.0, "DISTANCE_SENSOR": 5.0},
    "SYSTEM_TIME": 1.0,
}
FASTEST = 200.0  # no message is sent more often [Hz]
STREAMS = {  # of REQUEST_DATA_STREAM
    0: tuple(RATES),
    1: ("RAW_IMU", "SCALED_IMU2", "SCALED_PRESSURE2"),
    2: ("SYS_STATUS",),
    3: ("SERVO_OUTPUT_RAW",),
    6: ("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT"),
    10: ("ATTITUDE",),
    11: ("VFR_HUD",),
    12: ("BATTERY_STATUS", "EKF_STATUS_REPORT", "SYSTEM_TIME", "DISTANCE_SENSOR"),
}


@dataclass
class Scene:
    """The vehicle as telemetry sees it.

    Attributes:
        latest: The newest reading of each sensor up to the batch that is told of now.
        station: Its names and its time.
        drone: Its name in them.
        dialect: pymavlink's module.
        datum: Origin of n on the map.
        density: Of the water [kg/m3].
        surface_pressure: At the surface [Pa].
    """

    latest: dict[str, Measurement]
    station: Station
    drone: str
    dialect: Any
    datum: Datum
    density: float
    surface_pressure: float

    def reading(self, *sensors: str) -> Measurement | None:
        """The newest of the first of these sensors that is there and has numbers."""
        for sensor in sensors:
            found = self.latest.get(self.station.name(self.drone, sensor)) or self.latest.get(sensor)
            if found is not None and np.all(np.isfinite(found.value)):
                return found
        return None

    def values(self, sensor: str, size: int) -> np.ndarray:
        """Newest values of a sensor, zeros where there are none, shape (size,)."""
        found = self.reading(sensor)
        return found.value if found is not None and found.value.shape == (size,) else np.zeros(size)

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

    def attitude(self) -> np.ndarray | None:
        """zyx Euler angles [rad], shape (3,), or None while they are not known."""
        sensed, estimate = self.reading("attitude"), self.reading("estimate")
        if sensed is not None:
            return sensed.value
        return None if estimate is None else estimate.value[3:6]

    def velocity_n(self) -> np.ndarray:
        """Velocity over ground in n [m/s], shape (3,): the estimate's, or the DVL's turned; zeros without."""
        estimate = self.reading("estimate")
        attitude = self.attitude()
        nu = estimate.value[6:9] if estimate is not None else self.values("dvl", 3)
        return rotation_from_euler(attitude) @ nu if attitude is not None else np.zeros(3)


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


def _int16(value: float) -> int:
    return int(np.clip(round(value), -32768, 32767))


def _int32(value: float) -> int:
    return int(np.clip(round(value), -(2**31), 2**31 - 1))


def _attitude(scene: Scene, at: Measurement) -> Any:
    phi, theta, psi = at.value if at.sensor.endswith("attitude") else at.value[3:6]
    p, q, r = _rates(scene)
    psi = math.remainder(psi, math.tau)
    return scene.dialect.MAVLink_attitude_message(milliseconds(at.t_valid), phi, theta, psi, p, q, r)


def _rates(scene: Scene) -> np.ndarray:
    gyro, estimate = scene.reading("gyro"), scene.reading("estimate")
    if gyro is not None:
        return gyro.value
    return np.zeros(3) if estimate is None else estimate.value[9:12]


def _quaternion(scene: Scene, at: Measurement) -> Any:
    euler = at.value if at.sensor.endswith("attitude") else at.value[3:6]
    (cf, ct, cp), (sf, st, sp) = np.cos(euler / 2), np.sin(euler / 2)
    w, x = cf * ct * cp + sf * st * sp, sf * ct * cp - cf * st * sp
    y, z = cf * st * cp + sf * ct * sp, cf * ct * sp - sf * st * cp
    message = scene.dialect.MAVLink_attitude_quaternion_message
    return message(milliseconds(at.t_valid), w, x, y, z, *_rates(scene))


def _local(scene: Scene, at: Measurement) -> Any:
    place = scene.place()
    if place is None:
        return None
    return scene.dialect.MAVLink_local_position_ned_message(
        milliseconds(at.t_valid), *place[:3], *scene.velocity_n().tolist()
    )


def _global(scene: Scene, at: Measurement) -> Any:
    place = scene.place()
    attitude = scene.attitude()
    heading = 65535 if attitude is None else round(math.degrees(attitude[2]) * 100.0) % 36000
    down = place[2] if place else float(scene.values("pressure", 1)[0])
    latitude = longitude = 0.0
    if place is not None:
        latitude, longitude, _ = (float(v) for v in scene.datum.geodetic(np.array(place[:3])))
    speeds = [_int16(v * 100.0) for v in scene.velocity_n()]
    return scene.dialect.MAVLink_global_position_int_message(
        *(milliseconds(at.t_valid), _int32(latitude * 1e7), _int32(longitude * 1e7)),
        *(_int32((scene.datum.height - down) * 1000.0), _int32(-down * 1000.0), *speeds, heading),
    )


def _hud(scene: Scene, at: Measurement) -> Any:
    place, attitude, v = scene.place(), scene.attitude(), scene.velocity_n()
    pressure = scene.reading("pressure")
    down = float(pressure.value[0]) if pressure is not None else (place[2] if place else 0.0)
    heading = 0 if attitude is None else round(math.degrees(attitude[2])) % 360
    u = scene.reading("thrusters")
    throttle = 0 if u is None or not u.value.size else round(100.0 * min(1.0, float(np.abs(u.value).max())))
    speed = math.hypot(v[0], v[1])
    return scene.dialect.MAVLink_vfr_hud_message(speed, speed, heading, throttle, -down, -float(v[2]))


def _supply(scene: Scene) -> tuple[int, int, int]:
    """Millivolts, hundredths of an ampere, per cent; -1 where nothing is known."""
    battery = scene.reading("battery")
    if battery is None:
        return 65535, -1, -1
    charge, power = min(1.0, max(0.0, float(battery.value[0]))), float(battery.value[1])
    volts = EMPTY_VOLTS + charge * (FULL_VOLTS - EMPTY_VOLTS)
    return round(volts * 1000.0), _int16(power / volts * 100.0), round(charge * 100.0)


def _status(scene: Scene, at: Measurement) -> Any:
    sensors = {"gyro": GYRO, "accelerometer": ACCELEROMETER, "attitude": COMPASS, "pressure": PRESSURE}
    present = MOTORS | sum(bit for sensor, bit in sensors.items() if scene.reading(sensor) is not None)
    return scene.dialect.MAVLink_sys_status_message(present, present, present, 0, *_supply(scene), 0, 0, 0, 0, 0, 0)


def _battery(scene: Scene, at: Measurement) -> Any:
    millivolts, current, percent = _supply(scene)
    cells = [millivolts] + [65535] * 9
    return scene.dialect.MAVLink_battery_status_message(0, 0, 3, 32767, cells, current, -1, -1, percent)


def _pressure(scene: Scene, at: Measurement) -> Any:
    pascal = scene.surface_pressure + scene.density * GRAVITY * float(at.value[0])
    return scene.dialect.MAVLink_scaled_pressure2_message(milliseconds(at.t_valid), pascal / 100.0, 0.0, 0)


def _imu(scene: Scene) -> list[int]:
    force = scene.values("accelerometer", 3) / GRAVITY * 1000.0
    turn = _rates(scene) * 1000.0
    return [_int16(v) for v in (*force, *turn, 0.0, 0.0, 0.0)]


def _raw_imu(scene: Scene, at: Measurement) -> Any:
    return scene.dialect.MAVLink_raw_imu_message(max(0, round(at.t_valid * 1e6)), *_imu(scene))


def _scaled_imu2(scene: Scene, at: Measurement) -> Any:
    return scene.dialect.MAVLink_scaled_imu2_message(milliseconds(at.t_valid), *_imu(scene))


def _servos(scene: Scene, at: Measurement) -> Any:
    pulses = [round(1500.0 + 400.0 * u) for u in np.clip(at.value[:8], -1.0, 1.0)]
    pulses += [0] * (8 - len(pulses))
    return scene.dialect.MAVLink_servo_output_raw_message(max(0, round(at.t_valid * 1e6)) & 0xFFFFFFFF, 0, *pulses)


def _ekf(scene: Scene, at: Measurement) -> Any:
    return scene.dialect.MAVLink_ekf_status_report_message(EKF_GOOD, 0.0, 0.0, 0.0, 0.0, 0.0)


def _distance(scene: Scene, at: Measurement) -> Any:
    centimetres = int(np.clip(round(float(at.value[0]) * 100.0), 0, 65535))
    return scene.dialect.MAVLink_distance_sensor_message(
        milliseconds(at.t_valid), 20, 10000, centimetres, 1, 0, DOWNWARD, 255
    )


def _time(scene: Scene, at: Measurement) -> Any:
    start = np.datetime64(scene.datum.utc_start.removesuffix("Z"), "us").astype(int)
    return scene.dialect.MAVLink_system_time_message(
        int(start) + max(0, round(at.t_valid * 1e6)), milliseconds(at.t_valid)
    )


Build = Callable[[Scene, Measurement], Any]
ANY = ("attitude", "estimate", "pressure", "position", "battery", "accelerometer", "gyro")
# Message -> what makes it, and the sensors it stands on, the first that is there.
MESSAGES: dict[str, tuple[Build, tuple[str, ...]]] = {
    "ATTITUDE": (_attitude, ("attitude", "estimate")),
    "ATTITUDE_QUATERNION": (_quaternion, ("attitude", "estimate")),
    "LOCAL_POSITION_NED": (_local, ("estimate", "position")),
    "GLOBAL_POSITION_INT": (_global, ("estimate", "position", "pressure")),
    "VFR_HUD": (_hud, ("pressure", "estimate", "attitude")),
    "SYS_STATUS": (_status, ANY),
    "BATTERY_STATUS": (_battery, ("battery",)),
    "SCALED_PRESSURE2": (_pressure, ("pressure",)),
    "RAW_IMU": (_raw_imu, ("accelerometer", "gyro")),
    "SCALED_IMU2": (_scaled_imu2, ("accelerometer", "gyro")),
    "SERVO_OUTPUT_RAW": (_servos, ("thrusters",)),
    "EKF_STATUS_REPORT": (_ekf, ("estimate",)),
    "DISTANCE_SENSOR": (_distance, ("altimeter",)),
    "SYSTEM_TIME": (_time, ANY),
}


def build(scene: Scene, name: str) -> Any:
    """A telemetry message as of now, or None where the vehicle does not measure what it needs."""
    make, sensors = MESSAGES[name]
    at = scene.reading(*sensors)
    return None if at is None else make(scene, at)


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
        wanted = min(max(rate, 0.0), FASTEST) if math.isfinite(rate) else 0.0
        if wanted != self.rate(name):
            self._rates[name] = wanted
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
            if at is None or not self._take(name, at.t_valid, 1.0 / rate):
                continue
            message = make(scene, at)
            if message is not None:
                found.append(message)
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
