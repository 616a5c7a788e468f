"""Logs of PX4 (.ulg), through pyulog: every topic becomes a table, those of an underwater vehicle are known.

PX4 has SI units, FRD and NED. Commands are `actuator_motors`, -1 to 1 and one for each rotor; where the log lacks them,
`actuator_outputs`, the pulses [us] of outputs whose PWM_MAIN_FUNCn says which rotor they drive. CA_ROTORn_PX .. AZ,
where each rotor sits and pushes, says which of the vehicle's thrusters it is.

Reference: PX4 user guide, "Control allocation" (CA_ROTORn_*, output functions 101 to 112) and "uORB message reference".
"""

import contextlib
import io
import re
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import IdentificationError
from rovtwin.core.extras import require
from rovtwin.identification.logs.readers.autopilots.motors import FITS, NoCommands, command, matched
from rovtwin.identification.logs.readers.autopilots.servo_outputs import (
    Flight,
    armed_changes,
    at_a_time,
    first_signals,
    listed,
    raw_of,
)
from rovtwin.identification.logs.readers.raw import Raw, Table
from rovtwin.vehicle import Vehicle

ARMED = 2  # vehicle_status.arming_state
MOTOR1 = 101  # output function of the first rotor
LATE = 5.0  # [s]; a sample is published sooner
BODY_FRD = 3  # vehicle_odometry.velocity_frame

_SIGNALS: dict[str, list[tuple[str, list[str], dict[str, Any]]]] = {
    "attitude": [("vehicle_attitude", [f"q[{i}]" for i in range(4)], {"quaternion": "wxyz", "frame": "ned"})],
    "gyro": [
        ("vehicle_angular_velocity", [f"xyz[{i}]" for i in range(3)], {}),
        ("sensor_combined", [f"gyro_rad[{i}]" for i in range(3)], {}),
    ],
    "accelerometer": [("sensor_combined", [f"accelerometer_m_s2[{i}]" for i in range(3)], {})],
    "depth": [("vehicle_local_position", ["z"], {"frame": "down"})],
    "velocity": [("odometry velocity", ["u", "v", "w"], {})],
}


def read_ulog(path: Path, vehicle: Vehicle) -> Raw:
    """Tables of all topics, the signals of an underwater vehicle, and commands of its motors.

    Raises:
        IdentificationError: No ULog, or pyulog is missing.
    """
    require("pyulog", "px4", f"{path}: a PX4 log")
    from pyulog import ULog

    try:
        with contextlib.redirect_stdout(io.StringIO()):  # it warns there of what is damaged
            log: Any = ULog(str(path), disable_str_exceptions=True)
    except Exception as error:  # a damaged log makes the library raise anything
        raise IdentificationError(f"{path}: cannot be read as a PX4 log ({type(error).__name__}: {error})") from None
    tables = _tables(log)
    if not tables:
        raise IdentificationError(f"{path}: found no messages, expected a PX4 log (.ulg)")
    notes = []
    if log.file_corruption:
        last = max(float(table.t.max()) for table in tables.values() if table.t is not None)
        notes.append(f"{path}: cut off or damaged: read to {last:.1f} s")
    if log.dropouts:
        lost = sum(dropout.duration for dropout in log.dropouts) * 1e-3
        notes.append(f"{path}: {len(log.dropouts)} dropouts while logging, {lost:.2f} s in all")
    _add_velocity(tables)
    commands, why = None, ""
    parameters = {n: float(v) for n, v in log.initial_parameters.items() if isinstance(v, (int, float))}
    try:
        commands, remarks = _commands(tables, parameters, vehicle)
        notes += remarks
    except NoCommands as error:
        why = str(error)
    return raw_of(
        Flight(path, tables, first_signals(tables, _SIGNALS), commands, why, _armed(tables), notes=tuple(notes))
    )


def _tables(log: Any) -> dict[str, Table]:
    """Topics over their timestamps; those of a second instance as `name[1]`."""
    tables = {}
    for data in log.data_list:
        columns = tuple(name for name in data.data if name != "timestamp" and data.data[name].dtype.kind in "fiub")
        if "timestamp" not in data.data or not columns or not len(data.data["timestamp"]):
            continue
        t = 1e-6 * data.data["timestamp"].astype(float)
        sampled = 1e-6 * data.data.get("timestamp_sample", data.data["timestamp"]).astype(float)
        # Some topics leave the time of the sample empty.
        t = np.where(np.abs(t - sampled) < LATE, sampled, t)
        keep = at_a_time(t)
        with np.errstate(invalid="ignore"):  # of damaged numbers
            values = np.stack([data.data[name][keep].astype(float) for name in columns], axis=1)
        tables[data.name if data.multi_id == 0 else f"{data.name}[{data.multi_id}]"] = Table(values, columns, t[keep])
    return tables


def _add_velocity(tables: dict[str, Table]) -> None:
    """Velocity of a DVL or visual odometry that was given in b."""
    table = tables.get("vehicle_visual_odometry")
    expected = [f"velocity[{i}]" for i in range(3)] if table and "velocity[0]" in table.columns else ["vx", "vy", "vz"]
    if table is None or table.t is None or not {*expected, "velocity_frame"} <= set(table.columns):
        return
    there = table.column("velocity_frame") == BODY_FRD
    if there.any():
        values = np.stack([table.column(name)[there] for name in expected], axis=1)
        tables["odometry velocity"] = Table(values, ("u", "v", "w"), table.t[there])


def _armed(tables: dict[str, Table]) -> list[tuple[float, bool]]:
    table = tables.get("vehicle_status")
    if table is None or table.t is None or "arming_state" not in table.columns:
        return []
    return armed_changes(table.t, table.column("arming_state") == ARMED)


def _commands(tables: dict[str, Table], parameters: dict[str, float], vehicle: Vehicle) -> tuple[Table, list[str]]:
    names = vehicle.thruster_names
    rotors, notes = _rotors(parameters, vehicle)
    if "actuator_motors" in tables:
        table = tables["actuator_motors"]
        # NaN is a motor that is off.
        u = {r: np.nan_to_num(table.column(f"control[{r}]")) for r, _ in rotors if f"control[{r}]" in table.columns}
    elif "actuator_outputs" in tables:
        table = tables["actuator_outputs"]
        outputs = _outputs(parameters, [r for r, _ in rotors])
        u = {
            r: command(table.column(f"output[{n}]"), 1.0) for r, n in outputs.items() if f"output[{n}]" in table.columns
        }
    else:
        raise NoCommands(f"no actuator_motors or actuator_outputs; it has {listed(tables)}")
    missing = [r for r, _ in rotors if r not in u]
    if missing:
        raise NoCommands(f"nothing is logged of motor {missing[0] + 1}")
    values = np.stack([sign * u[r] for r, sign in rotors], axis=1)
    text = ", ".join(f"{'-' if s < 0 else ''}{n} by motor {r + 1}" for n, (r, s) in zip(names, rotors, strict=True))
    return Table(np.clip(values, -1.0, 1.0), tuple(names), table.t), [*notes, f"thrusters: {text}"]


def _rotors(parameters: dict[str, float], vehicle: Vehicle) -> tuple[list[tuple[int, float]], list[str]]:
    """The rotor of each thruster, from 0, and its sign; notes."""
    names = vehicle.thruster_names
    count = int(parameters.get("CA_ROTOR_COUNT", 0))
    if not count:
        return [(i, 1.0) for i in range(len(names))], [
            "CA_ROTOR_COUNT is not in the log: motors taken in the order of the vehicle's thrusters, signs unknown"
        ]
    if count != len(names):
        raise NoCommands(
            f"it has {count} rotors (CA_ROTOR_COUNT), the vehicle has {len(names)} thrusters ({', '.join(names)}). "
            "Give the vehicle that was driven, or write 'commands' by hand"
        )
    configuration = np.asarray(vehicle.model().thrusters.configuration, dtype=float)
    chosen, fit = matched(np.array([_wrench(parameters, i) for i in range(count)]), configuration)
    worst = int(np.argmin(np.abs(fit)))
    if abs(fit[worst]) < FITS:
        raise NoCommands(f"no rotor (CA_ROTORn_*) pushes like the vehicle's thruster {names[worst]}")
    return [(int(r), float(np.sign(f))) for r, f in zip(chosen, fit, strict=True)], []


def _wrench(parameters: dict[str, float], i: int) -> Float[np.ndarray, "6"]:
    """Of a rotor's unit thrust, FRD about its origin: along its axis, which is upward by default."""
    place = np.array([parameters.get(f"CA_ROTOR{i}_P{axis}", 0.0) for axis in "XYZ"])
    axis = np.array(
        [parameters.get(f"CA_ROTOR{i}_A{a}", default) for a, default in zip("XYZ", (0, 0, -1), strict=True)]
    )
    axis = axis / max(float(np.linalg.norm(axis)), 1e-9)
    return np.concatenate([axis, np.cross(place, axis)])


def _outputs(parameters: dict[str, float], rotors: list[int]) -> dict[int, int]:
    """The output, from 0, of each rotor."""
    found = {}
    for name, value in parameters.items():
        match = re.fullmatch(r"PWM_(?:MAIN|AUX)_FUNC(\d+)", name)
        if match and int(value) - MOTOR1 in rotors:
            found.setdefault(int(value) - MOTOR1, int(match[1]) - 1)
    return found or {r: r for r in rotors}
