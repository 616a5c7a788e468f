"""Telemetry of where the vehicle is and how it moves; each function makes one message of a reading's time."""

import math
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import quaternion_from_euler
from rovtwin.core.flow import Measurement
from rovtwin.links.mavlink.telemetry.scene import Scene, int16, int32, microseconds, milliseconds

UNKNOWN16 = 65535
NO_GPS, NO_FIX, FIX_3D = 0, 1, 3  # GPS_FIX_TYPE
LOCAL_NED, GLOBAL = 1, 0  # MAV_FRAME
PLACE_ONLY = 0b0000_1101_1111_1000  # POSITION_TARGET_TYPEMASK: only the place counts
# EKF_STATUS_FLAGS of ArduSub that knows its place: attitude, velocities, relative, absolute and predicted places and
# depth; and of one that has attitude and depth only and takes its place for constant.
EKF_PLACED, EKF_STILL = 831, 1 | 4 | 32 | 128


def attitude(scene: Scene, at: Measurement) -> Any:
    """ATTITUDE: zyx Euler angles and rates."""
    phi, theta, psi = _euler(at)
    psi = math.remainder(psi, math.tau)
    return scene.dialect.MAVLink_attitude_message(milliseconds(at.t_valid), phi, theta, psi, *scene.rates())


def quaternion(scene: Scene, at: Measurement) -> Any:
    """ATTITUDE_QUATERNION."""
    message = scene.dialect.MAVLink_attitude_quaternion_message
    return message(milliseconds(at.t_valid), *quaternion_from_euler(_euler(at)), *scene.rates())


def _euler(at: Measurement) -> Float[np.ndarray, "3"]:
    return at.value if at.sensor.endswith("attitude") else at.value[3:6]


def ahrs(scene: Scene, at: Measurement) -> Any:
    """AHRS: no drift of the gyro is estimated and no error of the attitude is known, so all of it is 0."""
    return scene.dialect.MAVLink_ahrs_message(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def ahrs2(scene: Scene, at: Measurement) -> Any:
    """AHRS2, ArduSub's second opinion; here it is the first one again."""
    phi, theta, psi = _euler(at)
    latitude, longitude, height = _on_map(scene)
    return scene.dialect.MAVLink_ahrs2_message(phi, theta, math.remainder(psi, math.tau), height, latitude, longitude)


def _on_map(scene: Scene) -> tuple[int, int, float]:
    """Latitude, longitude [1e-7 deg], 0 where they are not known, and height [m]."""
    place, down = scene.place(), scene.down()
    if place is None:
        return 0, 0, scene.datum.height - down
    latitude, longitude, _ = scene.on_map(place[0], place[1], down)
    return latitude, longitude, scene.datum.height - down


def local(scene: Scene, at: Measurement) -> Any:
    """LOCAL_POSITION_NED, None while the place is not known."""
    place = scene.place()
    if place is None:
        return None
    return scene.dialect.MAVLink_local_position_ned_message(
        milliseconds(at.t_valid), *place[:3], *scene.velocity_n().tolist()
    )


def on_earth(scene: Scene, at: Measurement) -> Any:
    """GLOBAL_POSITION_INT; like ArduSub's its latitude and longitude are 0 while they are not known."""
    heading = scene.attitude()
    angle = UNKNOWN16 if heading is None else round(math.degrees(heading[2]) * 100.0) % 36000
    place = scene.place()
    down = place[2] if place else scene.down()
    latitude, longitude = scene.on_map(*place[:3])[:2] if place else (0, 0)
    height = scene.datum.height - down
    speeds = [int16(v * 100.0) for v in scene.velocity_n()]
    return scene.dialect.MAVLink_global_position_int_message(
        *(milliseconds(at.t_valid), latitude, longitude),
        *(int32(height * 1000.0), int32((height - scene.ground) * 1000.0), *speeds, angle),
    )


def gps(scene: Scene, at: Measurement) -> Any:
    """GPS_RAW_INT of the position sensor, as a BlueROV2 tells the fixes that GPS_INPUT brings it.

    Its accuracy, speed and number of satellites are not known. Without a sensor there is no GPS, with an old fix none.
    """
    message, fix = scene.dialect.MAVLink_gps_raw_int_message, scene.fix()
    blind = NO_GPS if scene.reading("position") is None else NO_FIX
    if fix is None:
        return message(microseconds(at.t_valid), blind, 0, 0, 0, UNKNOWN16, UNKNOWN16, UNKNOWN16, UNKNOWN16, 255)
    latitude, longitude, height = scene.on_map(float(fix.value[0]), float(fix.value[1]), scene.down())
    unknown = (UNKNOWN16,) * 4
    return message(
        *(microseconds(fix.t_valid), FIX_3D, latitude, longitude, int32(height * 1000.0), *unknown, 255),
    )


def ekf(scene: Scene, at: Measurement) -> Any:
    """EKF_STATUS_REPORT; its test ratios are those of a filter that agrees with all it hears."""
    placed = scene.place() is not None and scene.fix() is not None
    flags = EKF_PLACED if placed else EKF_STILL
    return scene.dialect.MAVLink_ekf_status_report_message(flags, 0.0, 0.0, 0.0, 0.0, 0.0)


def hud(scene: Scene, at: Measurement) -> Any:
    """VFR_HUD; its throttle is the largest command of a thruster."""
    euler, v = scene.attitude(), scene.velocity_n()
    heading = 0 if euler is None else round(math.degrees(euler[2])) % 360
    u = scene.reading("thrusters")
    throttle = 0 if u is None or not u.value.size else round(100.0 * min(1.0, float(np.abs(u.value).max())))
    speed = math.hypot(v[0], v[1])
    return scene.dialect.MAVLink_vfr_hud_message(speed, speed, heading, throttle, -scene.down(), -float(v[2]))


def steering_to(scene: Scene, at: Measurement) -> Any:
    """NAV_CONTROLLER_OUTPUT: heading, bearing and distance of where GUIDED goes to."""
    place, target, euler = scene.place(), scene.autopilot.target, scene.attitude()
    psi = 0.0 if euler is None else float(euler[2])
    bearing, distance, climb = psi, 0.0, 0.0
    if place is not None and target is not None:
        north, east = target[0] - place[0], target[1] - place[1]
        bearing, distance, climb = math.atan2(east, north), math.hypot(north, east), place[2] - target[2]
        psi = target[3]
    wrapped = round(math.degrees(math.remainder(psi, math.tau)))
    return scene.dialect.MAVLink_nav_controller_output_message(
        0.0, 0.0, wrapped, round(math.degrees(bearing)) % 360, min(round(distance), UNKNOWN16), climb, 0.0, 0.0
    )


def target(scene: Scene, at: Measurement) -> Any:
    """POSITION_TARGET_GLOBAL_INT: where GUIDED goes to, None where it goes nowhere."""
    goal = scene.autopilot.target
    if goal is None:
        return None
    latitude, longitude, height = scene.on_map(*goal[:3])
    return scene.dialect.MAVLink_position_target_global_int_message(
        milliseconds(at.t_valid), GLOBAL, PLACE_ONLY, latitude, longitude, height, *(0.0,) * 6, goal[3], 0.0
    )


def target_n(scene: Scene, at: Measurement) -> Any:
    """POSITION_TARGET_LOCAL_NED: the same in n."""
    goal = scene.autopilot.target
    if goal is None:
        return None
    return scene.dialect.MAVLink_position_target_local_ned_message(
        milliseconds(at.t_valid), LOCAL_NED, PLACE_ONLY, *goal[:3], *(0.0,) * 6, goal[3], 0.0
    )


def home(scene: Scene, at: Measurement | None = None) -> Any:
    """HOME_POSITION, None while there is no home."""
    where = scene.home
    if where is None:
        return None
    north, east, down = scene.datum.position(where[0], where[1], scene.datum.height - where[2])
    return scene.dialect.MAVLink_home_position_message(
        *(int32(where[0] * 1e7), int32(where[1] * 1e7), int32(where[2] * 1000.0), north, east, down),
        *([1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, microseconds(scene.station.now)),
    )


def origin(scene: Scene, at: Measurement | None = None) -> Any:
    """GPS_GLOBAL_ORIGIN: the origin of n."""
    datum = scene.datum
    place = int32(datum.latitude * 1e7), int32(datum.longitude * 1e7), int32(datum.height * 1000.0)
    return scene.dialect.MAVLink_gps_global_origin_message(*place, microseconds(scene.station.now))
