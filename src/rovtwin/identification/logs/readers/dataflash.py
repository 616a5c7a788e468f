"""ArduPilot's on-board logs (.BIN), through pymavlink: every message becomes a table, ArduSub's are known.

Units are those of the messages after ArduPilot's own multipliers: deg, rad/s, m/s2, m. Body vectors are FRD and angles
those of FRD in NED; BARO.Alt and CTUN.BAlt are metres up, negative under water. A message of several sensors is a table
of each: `IMU` the first, `IMU[1]` the next.

Reference: ArduPilot, "Onboard message log messages for Sub", and the units that each log itself holds (FMTU).
"""

import contextlib
import io
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.logs.log_spec import SignalSpec
from rovtwin.identification.logs.readers.autopilot import Flight, listed, raw_of
from rovtwin.identification.logs.readers.motors import NoCommands, command, drives
from rovtwin.identification.logs.readers.places import place_table, speed_table
from rovtwin.identification.logs.readers.raw import Raw, Table, require, spec
from rovtwin.vehicle import Vehicle

OUTPUTS = "RCOU"
ARMED, DISARMED = 10, 11  # of EV.Id
LOCKED = 3  # GPS.Status of a fix in three dimensions

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
        IdentificationError: No dataflash log, or pymavlink is missing.
    """
    require("pymavlink", "mavlink", f"{path}: an ArduPilot log")
    messages, notes = _messages(path)
    parameters = _parameters(messages)
    tables = _tables(messages)
    _derive(tables)
    signals = _signals(tables, parameters, notes)
    commands, why = None, ""
    try:
        commands, said = _commands(tables, parameters, vehicle)
        notes += said
    except NoCommands as error:
        why = str(error)
    gravity = parameters.get("BARO_SPEC_GRAV")
    density = 1000.0 * gravity if gravity else None
    flight = Flight(path, tables, signals, commands, why, _armed(messages), density, tuple(notes))
    return raw_of(flight)


def _messages(path: Path) -> tuple[dict[str, np.ndarray], list[str]]:
    """Messages by name as structured arrays, multipliers not yet applied, and how much was read.

    Raises:
        IdentificationError: The file cannot be opened, or has no messages.
    """
    from pymavlink.DFReader import DFReader_binary

    try:
        size = path.stat().st_size
        with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
            log: Any = DFReader_binary(str(path), zero_time_base=True)
    except Exception as error:  # a damaged log makes the library raise anything
        raise IdentificationError(f"{path}: cannot be read as an ArduPilot dataflash log ({error})") from None
    data, found, read = np.frombuffer(log.data_map, np.uint8), {}, 0
    for number, fmt in log.formats.items():
        at = np.array(log.offsets[number], dtype=np.int64)
        at = at[at + fmt.len <= size]
        kind = _dtype(fmt)
        if len(at) and kind.itemsize == fmt.len - 3:
            read += fmt.len * len(at)
            body = data[at[:, None] + np.arange(3, fmt.len)]
            found[fmt.name] = _scaled(np.ascontiguousarray(body).view(kind)[:, 0], fmt)
    if "PARM" not in found and not any("TimeUS" in (m.dtype.names or ()) for m in found.values()):
        raise IdentificationError(f"{path}: found no messages, expected a dataflash log (.BIN) of ArduPilot")
    notes = []
    if read < size:
        last = max(float(m["TimeUS"].max()) for m in found.values() if "TimeUS" in (m.dtype.names or ())) * 1e-6
        notes.append(f"{path}: cut off or damaged: read to {last:.1f} s, {size - read} of {size} bytes are no messages")
    return found, notes


def _dtype(fmt: Any) -> np.dtype:
    """Of one message, from its letters."""
    from pymavlink.DFReader import FORMAT_TO_STRUCT

    codes = [FORMAT_TO_STRUCT[letter][0] for letter in fmt.msg_fmts]
    kinds = [f"S{code[:-1]}" if code.endswith("s") else f"<{code}" for code in codes]
    return np.dtype(list(zip(fmt.columns, kinds, strict=False)))


def _scaled(rows: np.ndarray, fmt: Any) -> np.ndarray:
    """Numbers times the multipliers of their letters, as floats; text stays, instances are told in the dtype."""
    multipliers = dict(zip(fmt.columns, fmt.msg_mults, strict=False))
    kinds = [
        (name, rows.dtype[name] if rows.dtype[name].kind == "S" else np.dtype(float)) for name in rows.dtype.names or ()
    ]
    scaled = np.empty(len(rows), np.dtype(kinds, metadata={"instance": fmt.instance_field}))
    for name, kind in kinds:
        scaled[name] = rows[name] if kind.kind == "S" else rows[name] * (multipliers[name] or 1.0)
    return scaled


def _parameters(messages: dict[str, np.ndarray]) -> dict[str, float]:
    """The last value of each."""
    if "PARM" not in messages:
        return {}
    rows = messages["PARM"]
    return {name.decode("ascii", "replace"): float(v) for name, v in zip(rows["Name"], rows["Value"], strict=True)}


def _tables(messages: dict[str, np.ndarray]) -> dict[str, Table]:
    """Messages that have a time, their numbers; one table for each instance."""
    tables = {}
    for name, rows in messages.items():
        columns = [c for c in rows.dtype.names or () if rows.dtype[c].kind != "S"]
        if "TimeUS" not in columns:
            continue
        columns.remove("TimeUS")
        instance = (rows.dtype.metadata or {}).get("instance")
        of = rows[instance] if instance in columns else np.zeros(len(rows))
        for i, number in enumerate(np.unique(of)):
            mine = rows[of == number]
            values = np.stack([mine[c] for c in columns], axis=1) if columns else np.empty((len(mine), 0))
            tables[name if i == 0 else f"{name}[{number:g}]"] = Table(values, tuple(columns), 1e-6 * mine["TimeUS"])
    return tables


def _column(table: Table, name: str) -> np.ndarray:
    return table.values[:, table.columns.index(name)]


def _derive(tables: dict[str, Table]) -> None:
    """Add tables that are made of others: velocity of a DVL or visual odometry, places of a GPS in metres."""
    visual = tables.get("VISO")
    if visual is not None and visual.t is not None and {"dt", "PosDX", "PosDY", "PosDZ"} <= set(visual.columns):
        moved = np.stack([_column(visual, f"PosD{axis}") for axis in "XYZ"], axis=1)
        tables["VISO velocity"] = speed_table(visual.t, _column(visual, "dt"), moved)
    gps = tables.get("GPS")
    if gps is not None and gps.t is not None and {"Status", "Lat", "Lng"} <= set(gps.columns):
        fixed = _column(gps, "Status") >= LOCKED
        if fixed.sum() > 5:
            tables["GPS place"] = place_table(gps.t[fixed], _column(gps, "Lat")[fixed], _column(gps, "Lng")[fixed])


def _signals(tables: dict[str, Table], parameters: dict[str, float], notes: list[str]) -> dict[str, SignalSpec]:
    found = {}
    for name, ways in _SIGNALS.items():
        for table, columns, more in ways:
            if table in tables and set(columns) <= set(tables[table].columns):
                found[name] = spec(table=table, columns=columns, **more)
                break
    if "velocity" in found:
        lever = [parameters.get(f"VISO_POS_{axis}", 0.0) for axis in "XYZ"]
        found["velocity"] = found["velocity"].model_copy(update={"lever": lever})
    accuracy = tables.get("GPA")
    if "horizontal" in found and accuracy is not None and "HAcc" in accuracy.columns:
        sigma = float(np.median(_column(accuracy, "HAcc")))
        found["horizontal"] = found["horizontal"].model_copy(update={"sigma": sigma} if sigma > 0 else {})
    depth = _depth(tables, parameters)
    if depth is not None:
        found["depth"] = spec(table=depth[0], columns=[depth[1]], unit="m", frame="up")
        notes.append(f"depth: {depth[0]}.{depth[1]}, metres up from where the pressure was zeroed")
    return found


def _depth(tables: dict[str, Table], parameters: dict[str, float]) -> tuple[str, str] | None:
    """The table and column of the height: of the barometer that is in the water, else of what was made of it."""
    primary = int(parameters.get("BARO_PRIMARY", 0))
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
    u = [command(_column(table, f"C{drive.output}"), drive.sign) for drive in found.values()]
    return Table(np.stack(u, axis=1), tuple(found), table.t), notes


def _armed(messages: dict[str, np.ndarray]) -> list[tuple[float, bool]]:
    """When it was armed and disarmed [s], of ARM, else of EV."""
    if "ARM" in messages:
        rows = messages["ARM"]
        return [(1e-6 * t, bool(state)) for t, state in zip(rows["TimeUS"], rows["ArmState"], strict=True)]
    if "EV" not in messages:
        return []
    events = zip(messages["EV"]["TimeUS"], messages["EV"]["Id"], strict=True)
    return [(1e-6 * t, number == ARMED) for t, number in events if number in (ARMED, DISARMED)]
