"""Logs of rovtwin itself, of the twin or of a vehicle: commands and sensors, with the noise that was declared."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.arrays.rotations import euler_from_rotation
from rovtwin.core.errors import IdentificationError, RovtwinError
from rovtwin.core.log import Log
from rovtwin.core.sensors import SENSORS, kind_of
from rovtwin.identification.logs.log_spec import CommandSpec, SignalSpec
from rovtwin.identification.logs.readers.raw import Raw, Table, spec
from rovtwin.vehicle import Vehicle

COMMANDS = "autopilot/command"


def read_rovtwin(path: Path, vehicle: Vehicle) -> Raw:
    """Tables of a log's commands and sensors; readings are timed by `t_valid`, when they were true.

    Noise, levers and mountings are those that the log's metadata declare.

    Raises:
        IdentificationError: Thrusters that the vehicle does not have, no readings, or commands that were never sent.
    """
    try:
        log = Log.read(path)
    except RovtwinError as error:
        raise IdentificationError(str(error)) from None
    if COMMANDS not in log:
        raise IdentificationError(f"{path}: no channel {COMMANDS}; found {', '.join(log) or 'none'}")
    if log.metadata.get("thrust") == "false":
        raise IdentificationError(
            f"{path}: flown with --no-thrust: found commands that were never sent, expected those that moved the "
            "vehicle. Fly it with thrust"
        )
    commands = log[COMMANDS]
    # A log has _ where a vehicle has the dots between parts.
    spelt = {name.replace(".", "_"): name for name in vehicle.thruster_names}
    fields = tuple(spelt.get(field, field) for field in commands.channel.fields)
    _check_thrusters(path, fields, vehicle)
    tables = {COMMANDS: Table(commands.values, fields, commands.t)}
    signals: dict[str, SignalSpec] = {}
    datasheets = _datasheets(log)
    for sensor, name in ((sensor, kind.signal) for sensor, kind in SENSORS.items() if kind.signal):
        channel = f"sensor/{sensor}"
        if channel not in log or not len(log[channel]):
            continue
        series, columns = log[channel], log[channel].channel.fields[:-1]
        tables[channel] = Table(series.values[:, :-1], columns, series["t_valid"])
        signals[name] = spec(table=channel, columns=list(columns), **datasheets.get(sensor, {}))
    if not signals:
        raise IdentificationError(f"{path}: no readings; fly with log.sensors: true")
    command_spec = CommandSpec.model_validate({"from": COMMANDS})
    scale = _number(log, "track_scale_std") or 0.0
    length = _tether_length(log)
    notes = (*log.notes, *_left_out(log))
    return Raw(path, tables, signals, command_spec, _number(log, "water_density"), length, scale, notes, _touched(log))


def _left_out(log: Log) -> list[str]:
    """A note on each sensor that is the second of its kind: two levers, noises and biases are not one signal."""
    names = [name.removeprefix("sensor/") for name in log if name.startswith("sensor/") and len(log[name])]
    second = [name for name in names if name not in SENSORS and kind_of(name) in SENSORS]
    return [f"sensor/{name}: left out, of several of a kind the first is used" for name in second]


def _check_thrusters(path: Path, found: tuple[str, ...], vehicle: Vehicle) -> None:
    expected = vehicle.thruster_names
    if set(found) != set(expected):
        other = sorted(set(found) - set(expected)) or sorted(set(expected) - set(found))
        raise IdentificationError(
            f"{path}: commands of {', '.join(found)}, but {vehicle.where} has {', '.join(expected)} ({other[0]!r} is "
            "not in both). Give the vehicle that flew"
        )


def _datasheets(log: Log) -> dict[str, dict[str, Any]]:
    """Noise, lever and mounting of the sensors, where the log says them."""
    try:
        datasheets = json.loads(log.metadata.get("sensors", "{}"))
    except ValueError:
        return {}
    sheets = {}
    for sensor, sheet in datasheets.items():
        angles = np.degrees(euler_from_rotation(np.array(sheet["rotation"])[None])[0])
        sheets[sensor] = {"sigma": sheet["noise"], "lever": sheet["lever"], "mounting_deg": angles.tolist()}
    return sheets


def _number(log: Log, name: str) -> float | None:
    """Of the metadata, or None where they do not say it."""
    try:
        return float(log.metadata.get(name, ""))
    except ValueError:
        return None


def _tether_length(log: Log) -> float | None:
    """All that is paid out, on average [m]; a winch would count it."""
    lengths = [log[name]["paid_out"] for name in log if name.startswith("truth/tether/")]
    if lengths:
        return float(sum(np.mean(length) for length in lengths))
    return _number(log, "tether_length")


def _touched(log: Log) -> tuple[tuple[float, float], ...]:
    """When a hand tilted the vehicle before a decay test."""
    try:
        spans = json.loads(log.metadata.get("test", "") or "[]")
    except ValueError:
        return ()
    return tuple((float(span["start"]), float(span["end"])) for span in spans if span["hand"])
