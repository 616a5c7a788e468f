r"""Messages of the DVL A50, JSON on lines that end with "\r\n" (the vendor's reader splits there, others at "\n").

Fields as in Water Linked's description of its TCP JSON API, json_v3.1, and `protocols.md`. Pure functions: bytes in,
dataclass out, and no exception but LinkError.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import LinkError
from rovtwin.links.waterlinked.fields import flag, number, numbers, read_object, text

FORMAT = "json_v3.1"
BEAM_TILT = math.radians(22.5)  # of each of the four beams from the z axis (data sheet of the A50: 4-beam Janus)
# From x towards y, of transducers 0 to 3: crosswise between the axes. Which is which was not verified.
BEAM_AZIMUTHS = tuple(math.radians(a) for a in (45.0, 135.0, 225.0, 315.0))
NO_ALTITUDE = -1.0  # what stands for "no echo"
CONFIG = {
    "speed_of_sound": 1475.0,
    "acoustic_enabled": True,
    "dark_mode_enabled": False,
    "mounting_rotation_offset": 0.0,
    "range_mode": "auto",
    "periodic_cycling_enabled": True,
}


@dataclass(frozen=True)
class Transducer:
    """One beam: velocity along it [m/s], distance along it [m], signal strength and noise density [dBm]."""

    id: int
    velocity: float
    distance: float
    rssi: float
    nsd: float
    beam_valid: bool


@dataclass(frozen=True)
class VelocityReport:
    """One ping.

    Attributes:
        velocity: Over ground, forward, right, down of the vehicle frame [m/s], shape (3,).
        valid: Whether there is bottom lock; velocity and altitude mean nothing without.
        altitude: Distance to the floor along z [m]; -1 where there is none, also of a twin that knows no floor.
        fom: Largest standard deviation of the velocity in any direction [m/s].
        covariance: Of the velocity [(m/s)^2], three rows of three; None from old firmware.
        transducers: Its beams; empty from old firmware.
        since_last: Since the last report [ms].
        status: Bit 0: too hot.
        time_of_validity: When the sound met the floor, the DVL's clock [us since 1970]; None from old firmware.
        time_of_transmission: When the report was sent, same clock [us]; None from old firmware.
        bottom: Whether velocity is over ground, rather than through the water (water tracking).
    """

    velocity: tuple[float, float, float]
    valid: bool
    altitude: float
    fom: float
    covariance: tuple[tuple[float, ...], ...] | None = None
    transducers: tuple[Transducer, ...] = ()
    since_last: float = 0.0
    status: int = 0
    time_of_validity: int | None = None
    time_of_transmission: int | None = None
    bottom: bool = True


@dataclass(frozen=True)
class PositionReport:
    """Dead reckoning since the last reset, in the frame that the vehicle had then.

    `ts` in seconds since 1970, `x`, `y`, `z` and `std` in metres, `roll`, `pitch`, `yaw` in degrees.
    """

    ts: float
    x: float
    y: float
    z: float
    std: float
    roll: float
    pitch: float
    yaw: float
    status: int = 0


@dataclass(frozen=True)
class Response:
    """What the DVL says to a command."""

    response_to: str
    success: bool
    error_message: str = ""
    result: Any = None


@dataclass(frozen=True)
class Order:
    """A command to the DVL and its parameters."""

    command: str
    parameters: dict[str, Any] = field(default_factory=dict)


Report = VelocityReport | PositionReport | Response


def parse_report(line: bytes) -> Report | None:
    """A line from a DVL; None for a type that is not known.

    Raises:
        LinkError: It is not what such a DVL sends.
    """
    found = read_object(line)
    kind = text(found, "type")
    if kind in ("velocity", "velocity_water"):
        return _velocity(found, kind)
    if kind == "position_local":
        values = {key: number(found, key) for key in ("ts", "x", "y", "z", "std", "roll", "pitch", "yaw")}
        return PositionReport(status=int(number(found, "status", 0.0)), **values)
    if kind == "response":
        return Response(
            text(found, "response_to"), flag(found, "success"), text(found, "error_message", ""), found.get("result")
        )
    return None


def _velocity(found: dict[str, Any], kind: str) -> VelocityReport:
    rows = found.get("covariance")
    covariance = None
    if rows is not None:
        if not isinstance(rows, list) or len(rows) != 3:
            raise LinkError("covariance: expected three rows")
        covariance = tuple(numbers({"covariance": row}, "covariance", 3) for row in rows)
    beams = found.get("transducers", [])
    if not isinstance(beams, list) or len(beams) > 16 or not all(isinstance(beam, dict) for beam in beams):
        raise LinkError("transducers: expected a list of at most 16 objects")
    return VelocityReport(
        velocity=(number(found, "vx"), number(found, "vy"), number(found, "vz")),
        valid=flag(found, "velocity_valid"),
        altitude=number(found, "altitude"),
        fom=number(found, "fom"),
        covariance=covariance,
        transducers=tuple(_transducer(beam) for beam in beams),
        since_last=number(found, "time", 0.0),
        status=int(number(found, "status", 0.0)),
        time_of_validity=_stamp(found, "time_of_validity"),
        time_of_transmission=_stamp(found, "time_of_transmission"),
        bottom=kind == "velocity" and text(found, "tracking_mode", "bottom") == "bottom",
    )


def _transducer(beam: dict[str, Any]) -> Transducer:
    values = {key: number(beam, key) for key in ("velocity", "distance", "rssi", "nsd")}
    return Transducer(id=int(number(beam, "id")), beam_valid=flag(beam, "beam_valid"), **values)


def _stamp(found: dict[str, Any], key: str) -> int | None:
    return int(number(found, key)) if key in found else None


def parse_order(line: bytes) -> Order:
    """A line from a client.

    Raises:
        LinkError: It is no command.
    """
    found = read_object(line)
    parameters = found.get("parameters")
    if parameters is not None and not isinstance(parameters, dict):
        raise LinkError("parameters: expected an object")
    return Order(text(found, "command"), parameters or {})


def split_orders(data: bytes) -> tuple[list[bytes], bytes]:
    """Whole commands, and what is left of the last one.

    The DVL takes a JSON object as soon as it is whole: C++ drivers (libwaterlinked, dvl-a50) send no end of line after
    it, and dvl-a50 sends commands without parameters as a list, which is answered as what it is. What is neither is a
    line, which ends where lines do.
    """
    orders = []
    while data := data.lstrip():
        order = _object_of(data)
        if not order:
            order, end, _ = data.partition(b"\n")
            if not end:
                break
        orders.append(order)
        data = data[len(order) :]
    return orders, data


def _object_of(data: bytes) -> bytes:
    """The JSON object, or list, that data begin with; empty where there is none, or not all of it."""
    try:
        text = data.decode()
        return text[: _DECODER.raw_decode(text)[1]].encode() if text.startswith(("{", "[")) else b""
    except (ValueError, RecursionError):  # also what is no UTF-8
        return b""


_DECODER = json.JSONDecoder()


def order_line(command: str, **parameters: Any) -> bytes:
    """A command as a client sends it."""
    message: dict[str, Any] = {"command": command}
    return _line(message | ({"parameters": parameters} if parameters else {}))


def report_line(report: Report) -> bytes:
    """A report as the DVL sends it."""
    if isinstance(report, Response):
        return _line(asdict(report) | {"format": FORMAT, "type": "response"})
    if isinstance(report, PositionReport):
        return _line(asdict(report) | {"type": "position_local", "format": FORMAT})
    vx, vy, vz = report.velocity
    message = {
        "time": report.since_last,
        "vx": vx,
        "vy": vy,
        "vz": vz,
        "fom": report.fom,
        "covariance": report.covariance,
        "altitude": report.altitude,
        "transducers": [asdict(beam) for beam in report.transducers],
        "velocity_valid": report.valid,
        "status": report.status,
        "format": FORMAT,
        "type": "velocity",
        "time_of_validity": report.time_of_validity,
        "time_of_transmission": report.time_of_transmission,
    }
    return _line(message)


def _line(message: dict[str, Any]) -> bytes:
    return json.dumps(message, allow_nan=False).encode() + b"\r\n"


def checked_config(config: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """A configuration with changes.

    Raises:
        LinkError: A key or a value that the DVL has not.
    """
    new = dict(config)
    for key in changes:
        if key not in CONFIG:
            raise LinkError(f"{ascii(key)[:40]}: no such parameter; expected one of {', '.join(CONFIG)}")
        limits = {"speed_of_sound": (1000.0, 2000.0), "mounting_rotation_offset": (0.0, 360.0)}.get(key)
        if limits is not None:
            new[key] = number(changes, key)
            if not limits[0] <= new[key] <= limits[1]:
                raise LinkError(f"{key}: found {new[key]:g}, expected {limits[0]:g} to {limits[1]:g}")
        elif key == "range_mode":
            new[key] = text(changes, key)
            if not _is_range_mode(new[key]):
                raise LinkError("range_mode: expected auto, wt, =n or n<=m with n and m from 0 to 4")
        else:
            new[key] = flag(changes, key)
    return new


def _is_range_mode(mode: str) -> bool:
    if mode in ("auto", "wt"):
        return True
    steps = mode.split("<=") if "<=" in mode else [mode[1:]] if mode.startswith("=") else []
    return bool(steps) and len(steps) <= 2 and all(step in ("0", "1", "2", "3", "4") for step in steps)


def beam_directions() -> Float[np.ndarray, "4 3"]:
    """Unit vectors along the beams in the DVL's body frame."""
    across = math.sin(BEAM_TILT)
    return np.array([[across * math.cos(a), across * math.sin(a), math.cos(BEAM_TILT)] for a in BEAM_AZIMUTHS])


def beams(velocity: Sequence[float], altitude: float, valid: bool) -> tuple[Transducer, ...]:
    """What the four beams measure of a velocity in the DVL's body frame [m/s] over level ground [m].

    Signal strengths are those of the vendor's printed example, -30 and -90 dBm: the twin has no sonar equation.
    """
    along = beam_directions() @ np.asarray(velocity, dtype=float)
    distance = altitude / math.cos(BEAM_TILT) if altitude > 0 else NO_ALTITUDE
    return tuple(
        Transducer(i, float(v) if valid else 0.0, distance if valid else NO_ALTITUDE, -30.0, -90.0, valid)
        for i, v in enumerate(along)
    )


def figure_of_merit(covariance: Sequence[Sequence[float]]) -> float:
    """Largest standard deviation in any direction [m/s]: gives what the vendor's printed example has, 1.6016e-4."""
    return float(np.sqrt(np.linalg.eigvalsh(np.asarray(covariance, dtype=float))[-1]))
