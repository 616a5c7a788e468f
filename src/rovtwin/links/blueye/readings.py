"""Telemetry of a Blueye drone and our readings: one module knows the units and frames of both.

| ours | message | theirs |
|---|---|---|
| pressure [m] | DepthTel | m |
| attitude [rad] | AttitudeTel | deg, -180 to 180 |
| gyro [rad/s], accelerometer [m/s2], FRD | CalibratedImuTel | rad/s, g |
| battery: charge, power [W] | BatteryTel, BatteryBQ40Z50Tel | level 0 to 1; V and A, discharge negative |
| leak 0 or 1 | ErrorFlagsTel | jump of the inner pressure |
| dvl [m/s], FRD | DvlVelocityTel | m/s, forward, left, down |
| altimeter [m] | AltitudeTel | m |
| position: north, east [m] | PositionEstimateTel | m |

Source: blueye.protocol 3.5 (message_formats.proto). What it does not say, or says oddly:
the accelerometer is taken as specific force (level and at rest z = -1 g), the DVL's y as left, as written.
There is no leak sensor in the protocol: the flag of an inner pressure that jumps is the nearest to one.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import LinkError
from rovtwin.links.blueye.protobuf import message, parse

STANDARD_GRAVITY = 9.80665  # m/s2, the "g" of accelerometers
DVL_AXES = np.array([1.0, -1.0, 1.0])  # forward, left, down <-> forward, right, down
BEAMS = 3  # of a DVL that must see the floor for a velocity
LARGEST_TELEMETRY = 1 << 20  # bytes; the largest that we know is a multibeam ping

# Messages that the link reads -> the sensors they are
SENSORS = {
    "DepthTel": ("pressure",),
    "AttitudeTel": ("attitude",),
    "CalibratedImuTel": ("gyro", "accelerometer"),
    "BatteryTel": ("battery",),
    "ErrorFlagsTel": ("leak",),
    "DvlVelocityTel": ("dvl",),
    "AltitudeTel": ("altimeter",),
    "PositionEstimateTel": ("position",),
}


def parse_telemetry(
    name: str, payload: bytes, accelerometer_sign: float = 1.0
) -> list[tuple[str, Float[np.ndarray, " _"]]]:
    """Readings in a telemetry message: sensor and value [SI, radians, FRD], shape (n,). Unknown messages have none.

    A message that says of itself that it is not valid has no reading. `battery` comes without its power (0 W).

    Args:
        name: Of the message, without the package.
        payload: Its bytes.
        accelerometer_sign: -1 for a drone that reads +1 g along z when level and at rest.

    Raises:
        LinkError: The bytes are not this message, or a number in it is none.
    """
    if name not in SENSORS:
        return []
    if len(payload) > LARGEST_TELEMETRY:
        raise LinkError(f"{name}: {len(payload)} bytes, expected at most {LARGEST_TELEMETRY}")
    content = parse(name, payload)
    found = [(sensor, np.array(value, dtype=float)) for sensor, value in _values(name, content, accelerometer_sign)]
    if not all(np.isfinite(value).all() for _, value in found):
        raise LinkError(f"{name}: a number that is none (NaN or infinity)")
    return found


def _values(name: str, content: Any, accelerometer_sign: float) -> list[tuple[str, Sequence[float]]]:
    if name == "DepthTel":
        return [("pressure", [content.depth.value])]
    if name == "AttitudeTel":
        angles = content.attitude
        return [("attitude", [_radians(a) for a in (angles.roll, angles.pitch, angles.yaw)])]
    if name == "CalibratedImuTel":
        return _imu_values(content.imu, accelerometer_sign * STANDARD_GRAVITY)
    if name == "BatteryTel":
        return [("battery", [min(1.0, max(0.0, content.battery.level)), 0.0])]
    if name == "ErrorFlagsTel":
        return [("leak", [float(content.error_flags.inner_pressure_spike)])]
    if name == "DvlVelocityTel":
        dvl = content.dvl_velocity
        return [("dvl", list(DVL_AXES * _vector(dvl.velocity)))] if _tracks(dvl) else []
    if name == "AltitudeTel":
        return [("altimeter", [content.altitude.value])] if content.altitude.is_valid else []
    estimate = content.position_estimate
    return [("position", [estimate.northing, estimate.easting])] if estimate.is_valid else []


def _imu_values(imu: Any, g: float) -> list[tuple[str, Sequence[float]]]:
    """Only what is in the message: an instrument that says nothing does not read zero."""
    gyro = [("gyro", _vector(imu.gyroscope))] if imu.HasField("gyroscope") else []
    force = [("accelerometer", [g * a for a in _vector(imu.accelerometer)])] if imu.HasField("accelerometer") else []
    return [*gyro, *force]


def _radians(angle: float) -> float:
    """In [-pi, pi) [rad]; what is no number stays none."""
    return math.remainder(math.radians(angle), 2 * math.pi) if math.isfinite(angle) else math.nan


def _vector(vector: Any) -> list[float]:
    return [vector.x, vector.y, vector.z]


def _tracks(dvl: Any) -> bool:
    """Whether a DVL's velocity is over ground: not through water, and enough beams see the floor where given."""
    beams = sum(beam.beam_valid for beam in dvl.transducers)
    return not dvl.is_water_tracking and (not dvl.transducers or beams >= BEAMS)


def parse_power(payload: bytes) -> float:
    """Power drawn from a smart battery [W] by a BatteryBQ40Z50Tel; a discharging current is negative there.

    Raises:
        LinkError: The bytes are not this message, or a number in it is none.
    """
    battery = parse("BatteryBQ40Z50Tel", payload).battery
    power = abs(battery.voltage.total * battery.current)
    if not math.isfinite(power):
        raise LinkError("BatteryBQ40Z50Tel: a number that is none (NaN or infinity)")
    return power


def depth_telemetry(depth: float) -> Any:
    """DepthTel of a depth [m]."""
    return message("DepthTel")(depth={"value": depth})


def attitude_telemetry(euler: Float[np.ndarray, "3"]) -> Any:
    """AttitudeTel of zyx Euler angles [rad], shape (3,)."""
    roll, pitch, yaw = np.degrees(euler)
    return message("AttitudeTel")(attitude={"roll": roll, "pitch": pitch, "yaw": yaw})


def imu_telemetry(
    name: str,
    gyro: Float[np.ndarray, "3"] | None,
    force: Float[np.ndarray, "3"] | None,
    field: Float[np.ndarray, "3"] | None,
    temperature: float,
) -> Any:
    """CalibratedImuTel, Imu1Tel or Imu2Tel of angular rate [rad/s], specific force [m/s2] and magnetic field [uT].

    All three are FRD, shape (3,), or None where there is none; the temperature is in degrees Celsius.
    """
    parts = {
        "gyroscope": gyro,
        "accelerometer": None if force is None else force / STANDARD_GRAVITY,
        "magnetometer": field,
    }
    imu: dict[str, Any] = {
        key: dict(zip("xyz", map(float, part), strict=True)) for key, part in parts.items() if part is not None
    }
    return message(name)(imu=imu | {"temperature": temperature})


def dvl_telemetry(velocity: Float[np.ndarray, "3"], since: float, altitude: float | None) -> Any:
    """DvlVelocityTel of a velocity over ground, FRD [m/s], shape (3,), `since` [s] the last; altitude [m] for beams."""
    x, y, z = DVL_AXES * velocity
    slant = 0.0 if altitude is None else altitude / math.cos(math.radians(22.5))  # beams of a Water Linked A50
    beams = [{"id": i, "beam_valid": True, "distance": slant} for i in range(4)]
    content = {"sensor_id": 1, "delta_time": 1e3 * since, "velocity": {"x": x, "y": y, "z": z}, "transducers": beams}
    return message("DvlVelocityTel")(dvl_velocity=content)


def altitude_telemetry(altitude: float) -> Any:
    """AltitudeTel of a distance to the floor [m]."""
    return message("AltitudeTel")(altitude={"value": altitude, "is_valid": True})
