"""Blueye's own binary logs (.bez), through blueye.sdk's reader: every telemetry message becomes a table.

Depth [m], attitude [deg] and the calibrated gyro [rad/s] are signals at once. What was commanded is in
`ControlForceTel` (surge, sway, heave [N] and yaw [N m]): `mix` turns it into commands of the thrusters, with 1 /
largest force as gains. The clock is the drone's monotonic one, set to UTC at the first message.

Reference: blueye.sdk documentation, "Logs from the drone", and blueye.protocol (units and axes of the messages).
"""

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.errors import IdentificationError
from rovtwin.core.extras import require
from rovtwin.core.user_files import files as given
from rovtwin.identification.logs.log_spec import SignalSpec
from rovtwin.identification.logs.readers.raw import Raw, Table, spec


def read_blueye(path: Path) -> Raw:
    """Tables by the name of the message, such as `DepthTel`, and the signals that they are."""
    require("blueye.sdk", "blueye", f"{path}: a Blueye log")
    from blueye.sdk.logs import LogStream

    logging.getLogger("blueye.sdk.logs").setLevel(logging.CRITICAL)  # a cut log ends where it ends
    try:
        content = given.read_bytes(path)
    except OSError as error:
        raise IdentificationError(f"{path}: cannot be read ({error.strerror})") from None
    rows: dict[str, list[dict[str, float]]] = {}
    times: dict[str, list[float]] = {}
    begin = None
    for clock, elapsed, kind, message in LogStream(content):
        begin = clock.timestamp() if begin is None else begin
        name = getattr(kind, "__name__", type(message).__name__)
        row = dict(_numbers(message, ""))
        if row:
            rows.setdefault(name, []).append(row)
            times.setdefault(name, []).append(begin + elapsed.total_seconds())
    if not rows:
        raise IdentificationError(f"{path}: found no messages, expected a .bez log of a Blueye drone")
    tables = {}
    for name, messages in rows.items():
        columns = tuple(dict.fromkeys(column for row in messages for column in row))
        values = np.array([[row.get(column, np.nan) for column in columns] for row in messages])
        tables[name] = Table(values, columns, np.array(times[name]))
    return Raw(path, tables, _signals(tables))


def _numbers(message: Any, place: str) -> Iterator[tuple[str, float]]:
    """Numbers of a protobuf message: `roll` of AttitudeTel, `gyroscope.x` of CalibratedImuTel."""
    fields = type(message).meta.fields
    for key in fields:
        value = getattr(message, key)
        # The telemetry wrapper around a single message adds nothing to its name.
        name = key if not place else f"{place}.{key}"
        if isinstance(value, (bool, int, float)):
            yield name, float(value)
        elif hasattr(type(value), "meta") and hasattr(type(value).meta, "fields"):
            yield from _numbers(value, "" if len(fields) == 1 and not place else name)


def _signals(tables: dict[str, Table]) -> dict[str, SignalSpec]:
    known = {
        "attitude": ("AttitudeTel", ("roll", "pitch", "yaw"), "deg"),
        "depth": ("DepthTel", ("value",), "m"),
        "gyro": ("CalibratedImuTel", tuple(f"gyroscope.{axis}" for axis in "xyz"), "rad/s"),
    }
    return {
        name: spec(table=table, columns=list(columns), unit=unit)
        for name, (table, columns, unit) in known.items()
        if table in tables and all(column in tables[table].columns for column in columns)
    }
