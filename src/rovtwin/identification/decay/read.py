"""The angle of a decay test, from a table or any log that has an attitude."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import IdentificationError
from rovtwin.core.log import Log
from rovtwin.identification.logs.log_spec import SourceSpec
from rovtwin.identification.logs.readers.assemble import part_of
from rovtwin.identification.logs.readers.reading import detect, read_raw
from rovtwin.identification.logs.readers.tables import read_csv
from rovtwin.vehicle import Vehicle

ATTITUDE = "sensor/attitude"
AXES = {"roll": ("roll", "phi"), "pitch": ("pitch", "theta")}


def read_angle(
    path: str | Path, axis: str, *, column: str | None = None, vehicle: Vehicle | None = None
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Times [s] and angle [rad] of a test.

    Args:
        path: CSV with a column of time (t or time) and one of the angle (phi, roll, theta, pitch or angle; with `_deg`
            in degrees), or a log of any format that gives an attitude.
        axis: roll or pitch.
        column: Of a CSV, where it has another name; ending in `deg` it is in degrees.
        vehicle: The one tested; logs other than CSV and rovtwin's own need it.

    Raises:
        IdentificationError: No such file, column or attitude.
    """
    path = Path(path)
    if axis not in AXES:
        raise IdentificationError(f"axis: found {axis!r}, expected roll or pitch")
    kind = detect(path)
    if kind == "csv":
        return _of_table(path, axis, column)
    if kind == "rovtwin":
        return _of_log(path, axis)
    if vehicle is None:
        raise IdentificationError(f"{path}: to read this log its vehicle is needed; give --vehicle NAME")
    source = SourceSpec.model_validate({"file": path.name})
    part = part_of(read_raw(path, source, vehicle), source, vehicle.thruster_names, None)
    if "attitude" not in part.signals:
        found = ", ".join(part.signals) or "none"
        raise IdentificationError(f"{path}: no attitude; found {found}")
    signal = part.signals["attitude"]
    return signal.t, np.unwrap(signal.value[:, 0 if axis == "roll" else 1])


def _of_log(path: Path, axis: str) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """rovtwin's own log: its attitude sensor, timed by when a reading was true."""
    log = Log.read(path)
    if ATTITUDE not in log or not len(log[ATTITUDE]):
        raise IdentificationError(f"{path}: no channel {ATTITUDE}; found {', '.join(log) or 'none'}")
    series = log[ATTITUDE]
    return series["t_valid"], np.unwrap(series[AXES[axis][1]])


def _of_table(path: Path, axis: str, column: str | None) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    (table,) = read_csv(path, []).tables.values()
    names = {_plain(name): name for name in table.columns}
    expected = [*(f"{word}{unit}" for word in (*AXES[axis], "angle") for unit in ("", "deg", "rad"))]
    found = column if column is not None else next((names[w] for w in expected if w in names), None)
    if found is None:
        raise IdentificationError(
            f"{path}: found columns {', '.join(table.columns)}; which one is the {axis} angle? Give --column NAME"
        )
    angle = table.values[:, table.index(found, str(path))]
    time = next((names[w] for w in ("t", "ts", "time", "times", "seconds") if w in names), None)
    t = table.clock(time, str(path))
    keep = np.isfinite(t) & np.isfinite(angle)
    in_degrees = _plain(found).endswith("deg")
    return t[keep], np.radians(angle[keep]) if in_degrees else angle[keep]


def _plain(name: str) -> str:
    """A column's name without what people put around units: 'Roll [deg]' is rolldeg."""
    return "".join(c for c in name.lower() if c.isalnum())
