"""ArduPilot's on-board logs (.BIN): every message becomes a table, those of ArduSub are known.

Units are those of the messages after ArduPilot's own multipliers: deg, rad/s, m/s2, m. Body vectors are FRD and angles
those of FRD in NED; BARO.Alt and CTUN.BAlt are metres up, negative under water. A message of several sensors is a table
of each: `IMU` the first, `IMU[1]` the next.

Reference: ArduPilot, "Onboard message log messages for Sub", and the units that each log itself holds (FMTU).
"""

from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.identification.logs.log_spec import SignalSpec
from rovtwin.identification.logs.readers.autopilots.dataflash_file import Message, read_messages
from rovtwin.identification.logs.readers.autopilots.motors import NoCommands, command, drives
from rovtwin.identification.logs.readers.autopilots.places import gps_table, speed_table
from rovtwin.identification.logs.readers.autopilots.servo_outputs import (
    Flight,
    at_a_time,
    board_deg,
    first_signals,
    listed,
    raw_of,
)
from rovtwin.identification.logs.readers.raw import Raw, Table, spec
from rovtwin.vehicle import Vehicle

OUTPUTS = "RCOU"

# Of the first table that is there: columns and what else is to be said.
_SIGNALS: dict[str, list[tuple[str, list[str], dict[str, Any]]]] = {
    "attitude": [
        ("ATT", ["Roll", "Pitch", "Yaw"], {"unit": "deg"}),
        ("XKQ", ["Q1", "Q2", "Q3", "Q4"], {}),
        ("AHR2", ["Roll", "Pitch", "Yaw"], {"unit": "deg"}),
    ],
    "gyro": [("IMU", ["GyrX", "GyrY", "GyrZ"], {"unit": "rad/s"})],
    "accelerometer": [("IMU", ["AccX", "AccY", "AccZ"], {"unit": "m/s2"})],
    "velocity": [("VISO velocity", ["u", "v", "w"], {"unit": "m/s"})],
    "horizontal": [("GPS place", ["north", "east"], {"unit": "m"})],
}
_DEPTHS = [("CTUN", "BAlt"), ("POS", "RelHomeAlt"), ("CTUN", "Alt")]


def read_dataflash(path: Path, vehicle: Vehicle) -> Raw:
    """Tables of all messages, the signals that ArduSub logs, and commands from its servo outputs.

    Raises:
        IdentificationError: No dataflash log.
    """
    messages, lost, size = read_messages(path)
    parameters = _parameters(messages)
    tables = _tables(messages)
    notes = []
    if lost:
        last = max((float(t.t[-1]) for t in tables.values() if t.t is not None and len(t.t)), default=0.0)
        notes.append(f"{path}: cut off or damaged: read to {last:.1f} s, {lost} of {size} bytes are in no message")
    _derive(tables)
    signals = _signals(tables, parameters, notes)
    commands, why = None, ""
    try:
        commands, remarks = _commands(tables, parameters, vehicle)
        notes += remarks
    except NoCommands as error:
        why = str(error)
    gravity = parameters.get("BARO_SPEC_GRAV")
    density = round(1000.0 * gravity, 3) if gravity else None
    flight = Flight(path, tables, signals, commands, why, _armed(messages), density, tuple(notes))
    return raw_of(flight)


def _parameters(messages: dict[str, Message]) -> dict[str, float]:
    """The last value of each."""
    if "PARM" not in messages:
        return {}
    rows = messages["PARM"].rows
    if not {"Name", "Value"} <= set(rows.dtype.names or ()):
        return {}
    return {name.decode("ascii", "replace"): float(v) for name, v in zip(rows["Name"], rows["Value"], strict=True)}


def _tables(messages: dict[str, Message]) -> dict[str, Table]:
    """Messages that have a time, their numbers; one table for each instance."""
    tables = {}
    for name, message in messages.items():
        rows = message.rows
        columns = [c for c in rows.dtype.names or () if rows.dtype[c].kind != "S"]
        if "TimeUS" not in columns or len(columns) < 2:
            continue
        columns.remove("TimeUS")
        rows = rows[at_a_time(1e-6 * rows["TimeUS"])]
        of = np.zeros(len(rows)) if message.instance is None else np.asarray(rows[message.instance], dtype=float)
        for i, number in enumerate(np.unique(of)):
            mine = rows[of == number]
            values = np.stack([mine[c] for c in columns], axis=1)
            tables[name if i == 0 else f"{name}[{number:g}]"] = Table(values, tuple(columns), 1e-6 * mine["TimeUS"])
    return tables


def _derive(tables: dict[str, Table]) -> None:
    """Add tables that are made of others: velocity of a DVL or visual odometry, places of a GPS in metres."""
    visual = tables.get("VISO")
    if visual is not None and visual.t is not None and {"dt", "PosDX", "PosDY", "PosDZ"} <= set(visual.columns):
        moved = np.stack([visual.column(f"PosD{axis}") for axis in "XYZ"], axis=1)
        tables["VISO velocity"] = speed_table(visual.t, visual.column("dt"), moved)
    gps = tables.get("GPS")
    if gps is not None and {"Status", "Lat", "Lng"} <= set(gps.columns):
        if (places := gps_table(gps, "Status", "Lat", "Lng")) is not None:
            tables["GPS place"] = places


def _signals(tables: dict[str, Table], parameters: dict[str, float], notes: list[str]) -> dict[str, SignalSpec]:
    found = first_signals(tables, _SIGNALS)
    for name in ("gyro", "accelerometer"):
        if name in found:
            found[name] = found[name].model_copy(update={"mounting_deg": board_deg(parameters)})
    if "velocity" in found:
        lever = [parameters.get(f"VISO_POS_{axis}", 0.0) for axis in "XYZ"]
        found["velocity"] = found["velocity"].model_copy(update={"lever": lever})
    accuracy = tables.get("GPA")
    if "horizontal" in found and accuracy is not None and "HAcc" in accuracy.columns:
        sigma = float(np.median(accuracy.column("HAcc")))
        found["horizontal"] = found["horizontal"].model_copy(update={"sigma": sigma} if sigma > 0 else {})
    depth = _depth(tables, parameters)
    if depth is not None:
        found["depth"] = spec(table=depth[0], columns=[depth[1]], unit="m", frame="up")
        notes.append(f"depth: {depth[0]}.{depth[1]}, metres up from where the pressure was zeroed")
    return found


def _depth(tables: dict[str, Table], parameters: dict[str, float]) -> tuple[str, str] | None:
    """The table and column of the height: of the barometer that is in the water, else of what was made of it."""
    several = sum(name.startswith("BARO") for name in tables) > 1
    # Which of several is in the water only the parameter says; the other one measures the air in the hull.
    primary = int(parameters.get("BARO_PRIMARY", -1 if several else 0))
    names = [n for n in (f"BARO[{primary}]", f"BARO{primary + 1}", "BARO") if n in tables]
    if primary == 0:
        names = [n for n in names if n == "BARO"]
    for name in names:
        if "Alt" in tables[name].columns:
            return name, "Alt"
    return next(((t, c) for t, c in _DEPTHS if t in tables and c in tables[t].columns), None)


def _commands(tables: dict[str, Table], parameters: dict[str, float], vehicle: Vehicle) -> tuple[Table, list[str]]:
    if OUTPUTS not in tables:
        raise NoCommands(f"no {OUTPUTS} messages (servo outputs); it has {listed(tables)}")
    table = tables[OUTPUTS]
    outputs = [int(c[1:]) for c in table.columns if c.startswith("C") and c[1:].isdigit()]
    configuration = np.asarray(vehicle.model().thrusters.configuration, dtype=float)
    found, notes = drives(parameters, configuration, vehicle.thruster_names, outputs)
    u = [command(table.column(f"C{drive.output}"), drive.sign) for drive in found.values()]
    return Table(np.stack(u, axis=1), tuple(found), table.t), notes


def _armed(messages: dict[str, Message]) -> list[tuple[float, bool]]:
    """When it was armed and disarmed [s], of ARM, else of EV."""
    for name, column, states in (("ARM", "ArmState", {1: True, 0: False}), ("EV", "Id", {10: True, 11: False})):
        if name in messages and {"TimeUS", column} <= set(messages[name].rows.dtype.names or ()):
            rows = messages[name].rows
            rows_of = zip(rows["TimeUS"], rows[column], strict=True)
            return [(1e-6 * float(t), states[int(value)]) for t, value in rows_of if int(value) in states]
    return []
