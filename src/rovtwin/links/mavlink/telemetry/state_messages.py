"""Telemetry of the vehicle's state: sensors, supply, inputs and outputs; each function makes one message."""

from typing import Any

import numpy as np

from rovtwin.core.flow import Measurement
from rovtwin.links.mavlink.firmware.pilot import pulses_of_axes
from rovtwin.links.mavlink.telemetry.scene import Scene, int16, microseconds, milliseconds

GRAVITY = 9.80665  # of the unit mg [m/s2]
DOWNWARD = 25  # MAV_SENSOR_ROTATION_PITCH_270
# Lithium-ion of four cells, estimated: 4.2 V a cell when full, 3.25 V when empty.
FULL_VOLTS, EMPTY_VOLTS = 16.8, 13.0
BOARD_MILLIVOLTS = 5000  # of the autopilot's board, as a BlueROV2 tells it
FREE_MEMORY = 262_144  # [bytes], as a BlueROV2 tells it
# MAV_SYS_STATUS_SENSOR
GYRO, ACCELEROMETER, COMPASS, PRESSURE, GPS, RANGE = 0x1, 0x2, 0x4, 0x8, 0x20, 0x100
DEPTH_CONTROL, PLACE_CONTROL, MOTORS = 0x2000, 0x4000, 0x8000
OTHER_CONTROL = 0x400 | 0x800 | 0x1000  # rates, attitude, yaw
AHRS, BATTERY, BEFORE_ARMING = 0x20_0000, 0x200_0000, 0x1000_0000
MEASURED = {
    **{"gyro": GYRO, "accelerometer": ACCELEROMETER, "attitude": COMPASS, "pressure": PRESSURE},
    **{"position": GPS, "altimeter": RANGE, "battery": BATTERY},
}
LIGHT_OFF, SERVO_CENTRE = 1100, 1500  # [us]


def status(scene: Scene, at: Measurement) -> Any:
    """SYS_STATUS: what is there, what is on, and what is well, as ArduSub counts it."""
    sensors = sum(bit for sensor, bit in MEASURED.items() if scene.reading(sensor) is not None)
    present = OTHER_CONTROL | DEPTH_CONTROL | PLACE_CONTROL | MOTORS | AHRS | BEFORE_ARMING | sensors
    mode, off = scene.autopilot.mode, 0
    off |= 0 if mode.hold_depth else DEPTH_CONTROL | PLACE_CONTROL  # ArduSub has both on from depth hold on
    off |= 0 if scene.autopilot.armed else MOTORS
    ill = GPS if scene.fix() is None else 0
    ill |= BEFORE_ARMING if scene.readiness() else 0
    return scene.dialect.MAVLink_sys_status_message(
        present, present & ~off, present & ~ill, 0, *_supply(scene), 0, 0, 0, 0, 0, 0
    )


def _supply(scene: Scene) -> tuple[int, int, int]:
    """Millivolts, hundredths of an ampere, per cent; -1 where nothing is known."""
    battery = scene.reading("battery")
    if battery is None:
        return 65535, -1, -1
    charge, power = min(1.0, max(0.0, float(battery.value[0]))), float(battery.value[1])
    volts = EMPTY_VOLTS + charge * (FULL_VOLTS - EMPTY_VOLTS)
    return round(volts * 1000.0), int16(power / volts * 100.0), round(charge * 100.0)


def battery(scene: Scene, at: Measurement) -> Any:
    """BATTERY_STATUS, voltage and charge of all cells together."""
    millivolts, current, percent = _supply(scene)
    cells = [millivolts] + [65535] * 9
    return scene.dialect.MAVLink_battery_status_message(0, 0, 3, 32767, cells, current, -1, -1, percent)


def power(scene: Scene, at: Measurement) -> Any:
    """POWER_STATUS."""
    return scene.dialect.MAVLink_power_status_message(BOARD_MILLIVOLTS, 0, 0)


def board(scene: Scene, at: Measurement) -> Any:
    """HWSTATUS."""
    return scene.dialect.MAVLink_hwstatus_message(BOARD_MILLIVOLTS, 0)


def memory(scene: Scene, at: Measurement) -> Any:
    """MEMINFO."""
    return scene.dialect.MAVLink_meminfo_message(0, 65535, FREE_MEMORY)


def water_pressure(scene: Scene, at: Measurement) -> Any:
    """SCALED_PRESSURE2, of the sensor outside."""
    pascal = scene.surface_pressure + scene.density * GRAVITY * float(at.value[0])
    return scene.dialect.MAVLink_scaled_pressure2_message(milliseconds(at.t_valid), pascal / 100.0, 0.0, 0)


def hull_pressure(scene: Scene, at: Measurement) -> Any:
    """SCALED_PRESSURE, of the sensor within the hull: it was closed at the surface."""
    return scene.dialect.MAVLink_scaled_pressure_message(
        milliseconds(at.t_valid), scene.surface_pressure / 100.0, 0.0, 0
    )


def _imu(scene: Scene) -> list[int]:
    force = scene.values("accelerometer", 3) / GRAVITY * 1000.0
    turn = scene.rates() * 1000.0
    return [int16(v) for v in (*force, *turn, 0.0, 0.0, 0.0)]


def raw_imu(scene: Scene, at: Measurement) -> Any:
    """RAW_IMU: specific force and rates; no magnetometer, 0."""
    return scene.dialect.MAVLink_raw_imu_message(microseconds(at.t_valid), *_imu(scene))


def scaled_imu2(scene: Scene, at: Measurement) -> Any:
    """SCALED_IMU2: the same."""
    return scene.dialect.MAVLink_scaled_imu2_message(milliseconds(at.t_valid), *_imu(scene))


def vibration(scene: Scene, at: Measurement) -> Any:
    """VIBRATION: what shakes the accelerometer; nothing clips."""
    x, y, z = (float(v) for v in scene.vibration)
    return scene.dialect.MAVLink_vibration_message(microseconds(at.t_valid), x, y, z, 0, 0, 0)


def servos(scene: Scene, at: Measurement) -> Any:
    """SERVO_OUTPUT_RAW of the thrusters."""
    pulses = [round(1500.0 + 400.0 * u) for u in np.clip(at.value[:8], -1.0, 1.0)]
    pulses += [0] * (8 - len(pulses))
    return scene.dialect.MAVLink_servo_output_raw_message(microseconds(at.t_valid) & 0xFFFFFFFF, 0, *pulses)


def inputs(scene: Scene, at: Measurement) -> Any:
    """RC_CHANNELS: the sticks as ArduSub has them, camera mount still, lights and video switch off."""
    pulses = [*pulses_of_axes(scene.autopilot.axes), SERVO_CENTRE, SERVO_CENTRE, *(LIGHT_OFF,) * 3]
    pulses += [0] * (18 - len(pulses))
    return scene.dialect.MAVLink_rc_channels_message(milliseconds(at.t_valid), 0, *pulses, 0)


def distance(scene: Scene, at: Measurement) -> Any:
    """DISTANCE_SENSOR of the altimeter."""
    centimetres = int(np.clip(round(float(at.value[0]) * 100.0), 0, 65535))
    return scene.dialect.MAVLink_distance_sensor_message(
        milliseconds(at.t_valid), 20, 10000, centimetres, 1, 0, DOWNWARD, 255
    )


def rangefinder(scene: Scene, at: Measurement) -> Any:
    """RANGEFINDER of the altimeter."""
    return scene.dialect.MAVLink_rangefinder_message(max(0.0, float(at.value[0])), 0.0)


def clock(scene: Scene, at: Measurement) -> Any:
    """SYSTEM_TIME."""
    start = np.datetime64(scene.datum.utc_start.removesuffix("Z"), "us").astype(int)
    return scene.dialect.MAVLink_system_time_message(int(start) + microseconds(at.t_valid), milliseconds(at.t_valid))


def named_values(scene: Scene, at: Measurement) -> list[Any]:
    """What ArduSub tells by NAMED_VALUE_FLOAT, in its order; camera mount in the middle, lights off."""
    gain = scene.autopilot.parameters["JS_GAIN_DEFAULT"]
    values = {"CamTilt": 0.5, "CamPan": 0.5, "TetherTrn": scene.turns, "Lights1": 0.0, "Lights2": 0.0}
    values |= {"PilotGain": gain, "InputHold": 0.0, "RollPitch": 0.0}
    message = scene.dialect.MAVLink_named_value_float_message
    return [message(milliseconds(at.t_valid), name.encode(), value) for name, value in values.items()]


def current_item(scene: Scene, at: Measurement) -> Any:
    """MISSION_CURRENT; its total leaves out the first item, which ArduPilot takes for home."""
    missions = scene.autopilot.missions
    return scene.dialect.MAVLink_mission_current_message(missions.current, max(0, len(missions.items(0)) - 1))


def landed(scene: Scene, at: Measurement) -> Any:
    """EXTENDED_SYS_STATE: like ArduSub it does not say whether it has landed."""
    return scene.dialect.MAVLink_extended_sys_state_message(0, 0)
