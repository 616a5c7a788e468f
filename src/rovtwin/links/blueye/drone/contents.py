"""What is in a drone's telemetry: messages from its newest readings and from what it knows of itself."""

import math
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import rotation_from_euler
from rovtwin.core.datum import Datum
from rovtwin.core.flow import Measurement
from rovtwin.links.blueye import readings
from rovtwin.links.blueye.drone.divelog import stamp_of
from rovtwin.links.blueye.drone.drone import Drone
from rovtwin.links.blueye.mission.notes import Note
from rovtwin.links.blueye.mission.supervisor import Here
from rovtwin.links.blueye.protobuf import message, text

# What a drone may know of a station's readings
SENSORS = (
    *("pressure", "attitude", "gyro", "accelerometer", "battery", "leak", "dvl", "altimeter", "position"),
    *("force", "estimate"),
)
IMUS = ("CalibratedImuTel", "Imu1Tel", "Imu2Tel")
FRESH = 0.1  # age up to which an instrument's reading goes into a message with another's [s]
SEEN = 2.0  # age up to which an altitude counts [s]
SUBMERGED = 0.25  # depth from which dive time counts [m], message_formats.proto
EARTH_FIELD = np.array([13.7, 0.0, 50.1])  # near Trondheim (IGRF, 2020s), n [uT]; without declination, as our compasses
CELL = (3.2, 4.2)  # voltage of a lithium-ion cell, empty and full [V]. Linear between, and four of them: guesses
CELLS, CAPACITY = 4, 6.7  # capacity in Ah, about 100 Wh
STORAGE = {"total_space": 64 << 30, "free_space": 60 << 30}  # bytes; nothing is recorded
PIONEER, SINGLE_BATTERY, NOT_CALIBRATING = 1, 1, 1  # numbers of the protocol's enumerations


class Contents:
    """The newest of all that one drone can tell.

    Attributes:
        latest: Its newest readings by sensor, SI, radians, FRD.
        now: The vehicle's time [s].
        datum: Where n is on the map, or None: the position estimate is not valid then.
        note: The last notification.
    """

    def __init__(self, drone: Drone, datum: Datum | None = None):
        if datum is not None:
            datum.geodetic([0.0, 0.0, 0.0])  # imports what maps need now: later it would hold up the other servers
        self.datum = datum
        self.note: tuple[Note, float] | None = None
        self.latest: dict[str, Measurement] = {}
        self.now = 0.0
        self._drone = drone
        self._dive_time = 0.0
        self._dvl_at = 0.0

    def pass_time(self, now: float) -> None:
        """The vehicle's time moves on; dive time with it while the drone is under water, and the odometer."""
        estimate = self._value("estimate")
        if estimate is not None:
            self._drone.odometer += math.hypot(estimate[6], estimate[7]) * min(max(0.0, now - self.now), 1.0)
        depth = self._value("pressure")
        if depth is not None and depth[0] > SUBMERGED:
            self._dive_time += max(0.0, now - self.now)
        self.now = now

    def message(self, name: str) -> Any:
        """The message of a name as protobuf, or None where there is nothing to tell."""
        if name in IMUS:
            return self._imu(name)
        if name in _FIXED:
            return message(name)(**_FIXED[name])
        return getattr(self, "_" + name.removesuffix("Tel"), lambda: None)()

    def _value(self, sensor: str) -> Float[np.ndarray, " n"] | None:
        found = self.latest.get(sensor)
        if found is None or not np.isfinite(found.value).all():
            return None
        return np.asarray(found.value, dtype=float)

    def _fresh(self, sensor: str, than: float) -> Float[np.ndarray, " n"] | None:
        found = self.latest.get(sensor)
        return self._value(sensor) if found is not None and than - found.t_valid <= FRESH else None

    # What sensors read

    def _Depth(self) -> Any:
        depth = self._value("pressure")
        return None if depth is None else readings.depth_telemetry(depth[0])

    def _Attitude(self) -> Any:
        euler = self._value("attitude")
        return None if euler is None else readings.attitude_telemetry(euler)

    def _imu(self, name: str) -> Any:
        newest = max((self.latest[s].t_valid for s in ("gyro", "accelerometer") if s in self.latest), default=None)
        if newest is None:
            return None
        gyro, force = self._fresh("gyro", newest), self._fresh("accelerometer", newest)
        if gyro is None and force is None:
            return None
        euler = self._value("attitude")
        field = None if euler is None else EARTH_FIELD @ rotation_from_euler(euler)
        return readings.imu_telemetry(name, gyro, force, field, self._drone.about.water_temperature)

    def _DvlVelocity(self) -> Any:
        velocity, altitude = self._value("dvl"), self._value("altimeter")
        if velocity is None:
            return None
        t = self.latest["dvl"].t_valid
        since, self._dvl_at = t - self._dvl_at, t
        return readings.dvl_telemetry(velocity, since, None if altitude is None else altitude[0])

    def _Altitude(self) -> Any:
        altitude = self._value("altimeter")
        return None if altitude is None else readings.altitude_telemetry(altitude[0])

    def _PositionEstimate(self) -> Any:
        """The vehicle's own estimate, as a drone sends it; of a vehicle without one, what it measures."""
        own = self._value("estimate")
        if own is not None:
            place, heading = own[:2], own[5]
        else:
            place, euler = self._value("position"), self._value("attitude")
            heading = 0.0 if euler is None else euler[2]
        if place is None:
            return None
        estimate: dict[str, Any] = {"northing": place[0], "easting": place[1], "heading": heading}
        estimate |= {"odometer": self._drone.odometer, "is_valid": self.datum is not None}
        if self.datum is not None:
            latitude, longitude, _ = self.datum.geodetic([place[0], place[1], 0.0])
            estimate["global_position"] = {"latitude": float(latitude), "longitude": float(longitude)}
        if own is not None:
            rates = {"surge_rate": own[6], "sway_rate": own[7], "yaw_rate": own[11]}
            course = heading + math.atan2(own[7], own[6])
            estimate |= rates | {"speed_over_ground": math.hypot(own[6], own[7])}
            estimate["course_over_ground"] = math.degrees(course) % 360.0
        return message("PositionEstimateTel")(position_estimate=estimate)

    def _ControlForce(self) -> Any:
        force = self._value("force")
        if force is None:
            return None
        content = {"surge": force[0], "sway": force[1], "heave": force[2], "yaw": force[5]}
        return message("ControlForceTel")(control_force=content)

    def _battery(self) -> dict[str, float] | None:
        battery = self._value("battery")
        if battery is None:
            return None
        level = min(1.0, max(0.0, float(battery[0])))
        voltage = CELLS * (CELL[0] + level * (CELL[1] - CELL[0]))
        return {"voltage": voltage, "level": level, "temperature": self._drone.about.water_temperature}

    def _Battery(self) -> Any:
        battery = self._battery()
        return None if battery is None else message("BatteryTel")(battery=battery)

    def _BatteryBQ40Z50(self) -> Any:
        simple, full = self._battery(), self._value("battery")
        if simple is None or full is None:
            return None
        level, voltage, current = simple["level"], simple["voltage"], -float(full[1]) / simple["voltage"]
        cells = {f"cell_{i}": voltage / CELLS for i in range(1, CELLS + 1)}
        content: dict[str, Any] = {"voltage": {"total": voltage, **cells}, "current": current}
        content |= {"relative_state_of_charge": level, "absolute_state_of_charge": level, "average_current": current}
        content |= {"calculated_state_of_charge": level, "remaining_capacity": level * CAPACITY}
        content |= {"full_charge_capacity": CAPACITY, "design_capacity": CAPACITY, "device_name": "rovtwin"}
        if current < -1e-3:
            content["runtime_to_empty"] = min(65535, int(3600 * level * CAPACITY / -current))
        return message("BatteryBQ40Z50Tel")(battery=content)

    def _ErrorFlags(self) -> Any:
        leak = self._value("leak")
        return message("ErrorFlagsTel")(error_flags={"inner_pressure_spike": leak is not None and leak[0] > 0.5})

    # What the drone knows of itself

    def _ControlMode(self) -> Any:
        return message("ControlModeTel")(state=dict.fromkeys(self._drone.modes, True))

    def _Lights(self) -> Any:
        return message("LightsTel")(lights={"value": self._drone.lights})

    def _Reference(self) -> Any:
        surge, sway, heave, _, _, yaw = self._drone.motion
        return message("ReferenceTel")(reference={"surge": surge, "sway": sway, "heave": heave, "yaw": yaw})

    def _DroneInfo(self) -> Any:
        about = self._drone.about
        serials = {"serial_number": about.serial.encode(), "hardware_id": about.hardware.encode()}
        content = {"blunux_version": about.software, "model": PIONEER, "power_source": SINGLE_BATTERY, **serials}
        return message("DroneInfoTel")(drone_info=content)

    def _DroneTime(self) -> Any:
        now = {"unix_timestamp": stamp_of(self._drone.clock())}
        return message("DroneTimeTel")(real_time_clock=now, monotonic_clock={"unix_timestamp": stamp_of(self.now)})

    def _DiveTime(self) -> Any:
        return message("DiveTimeTel")(dive_time={"value": int(self._dive_time)})

    def _ConnectedClients(self) -> Any:
        clients = self._drone.clients
        return message("ConnectedClientsTel")(
            client_id_in_control=clients.in_control, connected_clients=listed(clients)
        )

    def _WaterTemperature(self) -> Any:
        return message("WaterTemperatureTel")(temperature={"value": self._drone.about.water_temperature})

    def _TiltAngle(self) -> Any:
        return message("TiltAngleTel")(angle={"value": self._drone.mission.tilt})

    def _MissionStatus(self) -> Any:
        return message("MissionStatusTel")(mission_status=self._drone.mission.status())

    def _Notification(self) -> Any:
        """The last one; its words travel as a StringValue, which the SDK logs."""
        if self.note is None:
            return None
        note, t = self.note
        content: dict[str, Any] = {"type_": note.kind, "level": note.level, "timestamp": stamp_of(t)}
        if note.text:
            content["value"] = {"type_url": "type.googleapis.com/google.protobuf.StringValue", "value": text(note.text)}
        return message("NotificationTel")(notification=content)

    # Where it is

    @property
    def sees_the_floor(self) -> bool:
        """Whether it has an altimeter that sees the floor now."""
        found = self.latest.get("altimeter")
        return self._value("altimeter") is not None and found is not None and self.now - found.t_valid <= SEEN

    def here(self, alone: bool) -> Here:
        """Where it is: `alone`, by the vehicle's own estimate; half of a pair knows depth and heading only."""
        own, depth, euler = self._value("estimate"), self._value("pressure"), self._value("attitude")
        altitude = self._value("altimeter") if self.sees_the_floor else None
        above = None if altitude is None else float(altitude[0])
        if alone and own is not None:
            place, down, heading = (float(own[0]), float(own[1])), float(own[2]), float(own[5])
            return Here(self.now, place, down, heading, above)
        depth, heading = None if depth is None else float(depth[0]), None if euler is None else float(euler[2])
        return Here(self.now, None, depth, heading, above)


# Messages that are always the same: there is no camera, no recording and no calibration
_FIXED: dict[str, dict[str, Any]] = {
    "NStreamersTel": {"n_streamers": {"main": 0, "guestport": 0}},
    "DataStorageSpaceTel": {"storage_space": STORAGE},
    "VideoStorageSpaceTel": {"storage_space": STORAGE},
    "RecordStateTel": {"record_state": {}},
    "TiltStabilizationTel": {"state": {"enabled": False}},
    "CalibrationStateTel": {"calibration_state": {"status": NOT_CALIBRATING}},
}


def listed(clients: Any) -> list[dict[str, Any]]:
    """Connected clients as the protocol lists them."""
    return [
        {
            "client_id": c.id,
            "client_info": {**_info(c.client.text), "is_observer": c.client.observer},
        }
        for c in clients.all.values()
    ]


def _info(text: dict[str, str]) -> dict[str, str]:
    fields = message("ClientInfo").DESCRIPTOR.fields_by_name
    return {(key if key in fields else key.rstrip("_")): value for key, value in text.items()}
