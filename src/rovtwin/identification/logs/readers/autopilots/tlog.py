"""Telemetry logs of ground stations (.tlog), through pymavlink: every message of the autopilot becomes a table.

Numbers come in SI where MAVLink has them in mG, mrad/s, hPa, mm or 1e-7 deg: accelerations m/s2, rates rad/s, pressure
Pa, lengths m, places deg. Angles and body vectors are FRD in NED. Times are those of the autopilot since it started;
messages without one get the time of arrival less the shortest way that any message took.

A ground station asks for servo outputs a few times a second: see `command_interval`.

Reference: MAVLink, common.xml and ardupilotmega.xml (units of every field).
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import IdentificationError
from rovtwin.core.extras import require
from rovtwin.identification.logs.log_spec import SignalSpec
from rovtwin.identification.logs.readers.autopilots.motors import NoCommands, command, drives
from rovtwin.identification.logs.readers.autopilots.places import gps_table, speed_table
from rovtwin.identification.logs.readers.autopilots.servo_outputs import (
    Flight,
    armed_changes,
    board_deg,
    listed,
    raw_of,
)
from rovtwin.identification.logs.readers.raw import Raw, Table, spec
from rovtwin.vehicle import Vehicle

OUTPUTS = "SERVO_OUTPUT_RAW"
NOBODY, ARMED = 8, 128  # MAV_AUTOPILOT_INVALID; MAV_MODE_FLAG_SAFETY_ARMED
RESTART = 5.0  # by how much the autopilot's clock must go back for a restart [s]

# To SI, by the unit that MAVLink says; others stay as they are.
_SI = {
    **{"mG": 9.80665e-3, "mrad/s": 1e-3, "hPa": 100.0, "mm": 1e-3, "cm": 1e-2, "cm/s": 1e-2, "mm/s": 1e-3},
    **{"degE7": 1e-7, "cdeg": 1e-2, "cdegC": 1e-2},
}
WRAPS = 2**32 * 1e-6  # after which a clock of 32 bits of microseconds begins again [s]
_CLOCKS = {"time_boot_ms": 1e-3, "time_usec": 1e-6}
_FROM_OTHERS = ("VISION_POSITION_DELTA",)  # said to the autopilot by a computer on board
_TURNS = ["rollspeed", "pitchspeed", "yawspeed"]
_SIGNALS: dict[str, list[tuple[str, list[str]]]] = {
    "attitude": [("ATTITUDE", ["roll", "pitch", "yaw"]), ("ATTITUDE_QUATERNION", ["q1", "q2", "q3", "q4"])],
    "gyro": [
        *(("ATTITUDE", _TURNS), ("ATTITUDE_QUATERNION", _TURNS)),
        *((name, ["xgyro", "ygyro", "zgyro"]) for name in ("RAW_IMU", "SCALED_IMU", "SCALED_IMU2")),
    ],
    "accelerometer": [(name, ["xacc", "yacc", "zacc"]) for name in ("RAW_IMU", "SCALED_IMU", "SCALED_IMU2")],
    "velocity": [("VISION velocity", ["u", "v", "w"])],
    "horizontal": [("GPS place", ["north", "east"])],
}
_HEIGHTS = [("VFR_HUD", "alt"), ("GLOBAL_POSITION_INT", "relative_alt")]


@dataclass
class _Component:
    """What one component said.

    Attributes:
        rows: Numbers of each message by its name, the time of arrival [s] first.
        columns: Their names, without that time.
        scales: What they are multiplied by to be SI.
        parameters: By name.
        flies: Whether it is an autopilot.
    """

    rows: dict[str, list[tuple[float, ...]]] = field(default_factory=dict)
    columns: dict[str, tuple[str, ...]] = field(default_factory=dict)
    scales: dict[str, np.ndarray] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
    flies: bool = False


def read_tlog(path: Path, vehicle: Vehicle) -> Raw:
    """Tables of the autopilot's messages, the signals that ArduSub sends, and commands from its servo outputs.

    Raises:
        IdentificationError: No telemetry log, no autopilot in it, or pymavlink is missing.
    """
    require("pymavlink", "mavlink", f"{path}: a telemetry log")
    components, notes = _listen(path)
    autopilot = _autopilot(components, path, notes)
    tables = _tables(autopilot, path, notes)
    armed = _armed(tables)
    _derive(tables, autopilot.parameters)
    commands, why = None, ""
    try:
        commands, more = _commands(tables, autopilot.parameters, vehicle)
        notes += more
    except NoCommands as error:
        why = str(error)
    gravity = autopilot.parameters.get("BARO_SPEC_GRAV")
    density = round(1000.0 * gravity, 3) if gravity else None
    signals = _signals(tables, autopilot.parameters, notes)
    return raw_of(Flight(path, tables, signals, commands, why, armed, density, tuple(notes)))


def _autopilot(components: dict[tuple[int, int], _Component], path: Path, notes: list[str]) -> _Component:
    """The autopilot that sent most, with what other computers of its vehicle sent it."""
    autopilots = {who: autopilot for who, autopilot in components.items() if autopilot.flies}
    if not autopilots:
        kinds = {name for autopilot in components.values() for name in autopilot.rows}
        raise IdentificationError(f"{path}: found no heartbeat of an autopilot; it has {listed(kinds)}")
    who = max(autopilots, key=lambda w: sum(len(rows) for rows in autopilots[w].rows.values()))
    if len(autopilots) > 1:
        others = ", ".join(f"{system}/{part}" for system, part in autopilots if (system, part) != who)
        notes.append(f"{path}: autopilot {who[0]}/{who[1]} taken, not {others}")
    autopilot = autopilots[who]
    for (system, _), other in components.items():
        for name in _FROM_OTHERS:
            if system == who[0] and other is not autopilot and name in other.rows and name not in autopilot.rows:
                autopilot.rows[name], autopilot.scales[name] = other.rows[name], other.scales[name]
                # Their clock is not the autopilot's: times are those of arrival.
                autopilot.columns[name] = tuple(f"sender_{c}" if c in _CLOCKS else c for c in other.columns[name])
    return autopilot


def _listen(path: Path) -> tuple[dict[tuple[int, int], _Component], list[str]]:
    """What each component said, by system and component."""
    from pymavlink import mavutil

    components: dict[tuple[int, int], _Component] = {}
    garbage: Counter[str] = Counter()
    last, notes = None, []
    try:
        size = path.stat().st_size
        log: Any = mavutil.mavlogfile(str(path), robust_parsing=True)
        while (message := log.recv_match()) is not None:
            if message.get_type() == "BAD_DATA":
                garbage["bad"] += 1
                continue
            last = float(message._timestamp)
            _take(
                components.setdefault((message.get_srcSystem(), message.get_srcComponent()), _Component()),
                message,
                last,
            )
        log.close()
    except Exception as error:  # a damaged log makes the library raise anything
        if last is None:
            raise IdentificationError(f"{path}: cannot be read as a telemetry log ({error})") from None
        notes.append(f"{path}: damaged: read to {last:.3f} s of its clock, then {type(error).__name__}")
    if last is None:
        raise IdentificationError(
            f"{path}: found no messages in {size} bytes, expected a telemetry log of QGroundControl, MAVProxy or "
            "mavlink-router (.tlog)"
        )
    if garbage["bad"]:
        notes.append(f"{path}: {garbage['bad']} damaged messages left out")
    return components, notes


def _take(autopilot: _Component, message: Any, arrival: float) -> None:
    """Keep the numbers of one message."""
    name = message.get_type()
    if name == "PARAM_VALUE":
        autopilot.parameters[str(message.param_id)] = float(message.param_value)
        return
    if name == "HEARTBEAT":
        autopilot.flies |= message.autopilot != NOBODY
    if name not in autopilot.columns:
        _describe(autopilot, message, name)
    row = [arrival]
    for column in message.fieldnames:
        value = getattr(message, column)
        if isinstance(value, (int, float)):
            row.append(value)
        elif isinstance(value, (list, tuple)) and value and isinstance(value[0], (int, float)):
            row += value
    if len(row) == len(autopilot.columns[name]) + 1:
        autopilot.rows.setdefault(name, []).append(tuple(row))


def _describe(autopilot: _Component, message: Any, name: str) -> None:
    """Columns of a message and what they are multiplied by."""
    units = getattr(type(message), "fieldunits_by_name", {})
    columns: list[str] = []
    scales: list[float] = []
    for column in message.fieldnames:
        value, scale = getattr(message, column), _SI.get(units.get(column, ""), 1.0)
        if isinstance(value, (int, float)):
            columns.append(column)
            scales.append(scale)
        elif isinstance(value, (list, tuple)) and value and isinstance(value[0], (int, float)):
            columns += [f"{column}.{i}" for i in range(len(value))]
            scales += [scale] * len(value)
    autopilot.columns[name], autopilot.scales[name] = tuple(columns), np.array(scales)


def _tables(autopilot: _Component, path: Path, notes: list[str]) -> dict[str, Table]:
    """Messages over the autopilot's clock, in SI."""
    blocks = {name: np.array(rows, dtype=float) for name, rows in autopilot.rows.items() if autopilot.columns[name]}
    clocks = _on_one_epoch(blocks, {name: _own_clock(block, autopilot.columns[name]) for name, block in blocks.items()})
    lags = [block[:, 0] - clocks[name] for name, block in blocks.items() if clocks[name] is not None]
    restarted = any(t is not None and len(t) and (np.diff(t) < -RESTART).any() for t in clocks.values())
    if restarted:
        notes.append(f"{path}: the autopilot started again: times are those of arrival, late by what the link takes")
    shortest = 0.0 if restarted or not lags else float(min(lag.min() for lag in lags))
    tables = {}
    for name, block in blocks.items():
        own = clocks[name]
        t = block[:, 0] - shortest if restarted or own is None else own
        tables[name] = Table(block[:, 1:] * autopilot.scales[name], autopilot.columns[name], t)
    return tables


def _own_clock(block: Float[np.ndarray, "n k"], columns: tuple[str, ...]) -> Float[np.ndarray, " n"] | None:
    """Time since the autopilot started [s], where the message has it."""
    for name, scale in _CLOCKS.items():
        if name in columns:
            t = block[:, 1 + columns.index(name)] * scale
            # Unix time instead, or nothing at all, is not that clock.
            return t if len(t) and 0.0 < np.median(t) < 1e8 else None
    return None


def _on_one_epoch(
    blocks: Mapping[str, Float[np.ndarray, "_ _"]], clocks: Mapping[str, Float[np.ndarray, " _"] | None]
) -> dict[str, Float[np.ndarray, " _"] | None]:
    """Clocks of 32 bits of microseconds, which begin again every 71.6 minutes, go on, and begin with the longest one.

    The one that began earliest before its messages arrived has the most bits: it has not begun again.
    """
    known: dict[str, np.ndarray] = {name: t for name, t in clocks.items() if t is not None}
    for name, t in known.items():
        back = np.abs(np.diff(t) + WRAPS) < 0.01 * WRAPS
        known[name] = t + WRAPS * np.concatenate([[0], np.cumsum(back)])
    lags = {name: float(np.median(blocks[name][:, 0] - t)) for name, t in known.items()}
    least = min(lags.values(), default=0.0)
    found = dict(clocks)
    for name, t in known.items():
        found[name] = t + WRAPS * round((lags[name] - least) / WRAPS)
    return found


def _armed(tables: dict[str, Table]) -> list[tuple[float, bool]]:
    table = tables["HEARTBEAT"]
    assert table.t is not None
    return armed_changes(table.t, (table.column("base_mode").astype(int) & ARMED) > 0)


def _derive(tables: dict[str, Table], parameters: dict[str, float]) -> None:
    """Add tables that are made of others: depth of the pressure in the water, velocity, places in metres."""
    number = int(parameters.get("BARO_PRIMARY", 1)) + 1
    pressure = tables.get("SCALED_PRESSURE" + (str(number) if number > 1 else ""))
    zero = parameters.get(f"BARO{number}_GND_PRESS")
    if pressure is not None and zero:
        density = 1000.0 * (parameters.get("BARO_SPEC_GRAV") or 1.0)
        depth = (pressure.column("press_abs") - zero) / (density * 9.81)
        tables["pressure depth"] = Table(depth[:, None], ("depth",), pressure.t)
    moved = tables.get("VISION_POSITION_DELTA")
    if moved is not None and moved.t is not None:
        step = np.stack([moved.column(f"position_delta.{i}") for i in range(3)], axis=1)
        tables["VISION velocity"] = speed_table(moved.t, 1e-6 * moved.column("time_delta_usec"), step)
    gps = tables.get("GPS_RAW_INT")
    if gps is not None and (places := gps_table(gps, "fix_type", "lat", "lon")) is not None:
        tables["GPS place"] = places


def _signals(tables: dict[str, Table], parameters: dict[str, float], notes: list[str]) -> dict[str, SignalSpec]:
    found = {}
    for name, ways in _SIGNALS.items():
        for table, columns in ways:
            # An IMU that is not there is sent as zeros.
            if table in tables and any(tables[table].column(column).any() for column in columns):
                more = {"repeats": "drop"} if name == "horizontal" else {}
                more |= {"mounting_deg": board_deg(parameters)} if table.endswith(("IMU", "IMU2")) else {}
                found[name] = spec(table=table, columns=columns, **more)
                break
    if "pressure depth" in tables:
        found["depth"] = spec(table="pressure depth", columns=["depth"])
        notes.append("depth: of the pressure in the water, from where it was zeroed")
        return found
    for table, column in _HEIGHTS:
        if table in tables:
            found["depth"] = spec(table=table, columns=[column], frame="up")
            notes.append(f"depth: {table}.{column}, the autopilot's estimate: its zero and its lag are not known")
            break
    return found


def _commands(tables: dict[str, Table], parameters: dict[str, float], vehicle: Vehicle) -> tuple[Table, list[str]]:
    if OUTPUTS not in tables:
        raise NoCommands(f"no {OUTPUTS} messages; it has {listed(tables)}")
    table = tables[OUTPUTS]
    assert table.t is not None
    first = table.column("port") == 0
    outputs = [n for n in range(1, 17) if f"servo{n}_raw" in table.columns]
    configuration = np.asarray(vehicle.model().thrusters.configuration, dtype=float)
    found, notes = drives(parameters, configuration, vehicle.thruster_names, outputs)
    u = [command(table.column(f"servo{drive.output}_raw")[first], drive.sign) for drive in found.values()]
    return Table(np.stack(u, axis=1), tuple(found), table.t[first]), notes
