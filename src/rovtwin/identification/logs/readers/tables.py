"""CSV and npz: columns that the user names."""

import csv
import errno
import tokenize
import zipfile
import zlib
from pathlib import Path

import numpy as np

from rovtwin.core.errors import IdentificationError
from rovtwin.core.user_files import files as given
from rovtwin.identification.logs.log_spec import CommandSpec, SignalSpec
from rovtwin.identification.logs.readers.clocks import clocks
from rovtwin.identification.logs.readers.raw import Raw, Table, spec
from rovtwin.identification.logs.record import SIGNALS

_TIME = ("t", "time", "t_s", "time_s", "seconds")


def read_csv(path: Path, thrusters: list[str]) -> Raw:
    """A CSV file with a header: comma, semicolon or tab; an empty cell is a missing reading.

    Columns named as the components of `SIGNALS` (phi, theta, psi; p, q, r; u, v, w; north, east, down; depth), as the
    vehicle's thrusters, and `t` or `time` need no map; nor do they in capitals (`P`, `Time`).
    """
    try:
        return _parse_csv(path, read_text(path), thrusters)
    except csv.Error as error:
        raise IdentificationError(f"{path}: is no table of numbers ({error})") from None


def _parse_csv(path: Path, text: str, thrusters: list[str]) -> Raw:
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if len(lines) < 3:
        raise IdentificationError(f"{path}: found {len(lines)} lines, expected a header and readings")
    dialect = max(",;\t", key=lines[0].count)
    header = tuple(cell.strip() for cell in next(csv.reader(lines[:1], delimiter=dialect)))
    if all(_number(cell) is not None for cell in header):
        raise IdentificationError(f"{path}: line 1: found numbers, expected a header with the names of the columns")
    values = np.full((len(lines) - 1, len(header)), np.nan)
    for row, cells in enumerate(csv.reader(lines[1:], delimiter=dialect)):
        if len(cells) > len(header) and any(cell.strip() for cell in cells[len(header) :]):
            raise IdentificationError(f"{path}: row {row + 2}: found {len(cells)} cells, expected {len(header)}")
        for column, cell in enumerate(cells[: len(header)]):
            number = _number(cell) if cell.strip() else np.nan
            values[row, column] = np.nan if number is None else number
    time = next((_spelled(name, header) for name in _TIME if _spelled(name, header)), None)
    table = Table(values, header, None if time is None else values[:, header.index(time)])
    commands = CommandSpec.model_validate({}) if thrusters and all(name in header for name in thrusters) else None
    return Raw(path, {path.stem: table}, _known_columns(header), commands)


def _known_columns(header: tuple[str, ...]) -> dict[str, SignalSpec]:
    named = {name: components for name, (components, _, _) in SIGNALS.items() if name != "accelerometer"}
    spelled = {name: [_spelled(component, header) for component in c] for name, c in named.items()}
    found = {name: spec(columns=columns) for name, columns in spelled.items() if all(columns)}
    if "position" in found:
        found.pop("horizontal", None)
    return found


def _spelled(name: str, header: tuple[str, ...]) -> str | None:
    """How the header writes a name, in capitals or not; None where it has none, or several."""
    if name in header:
        return name
    alike = [column for column in header if column.lower() == name.lower()]
    return alike[0] if len(alike) == 1 else None


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def read_text(path: Path) -> str:
    """The text of a file; an IdentificationError where there is none."""
    try:
        return given.read_text(path, given.MOST_LOG)
    except UnicodeDecodeError:
        raise IdentificationError(f"{path}: is not text; give the right format") from None
    except OSError as error:
        raise IdentificationError(f"{path}: cannot be read ({error.strerror})") from None


# RuntimeError: zipfile of an encrypted file, and of one that is packed by a method it does not know; TokenError: NumPy
# of a header that is cut.
_BROKEN = (OSError, ValueError, EOFError, KeyError, MemoryError, RuntimeError)
_BROKEN += (zipfile.BadZipFile, zlib.error, tokenize.TokenError)


def _require_room(path: Path) -> None:
    """Raises OSError where what is packed has no room: a few bytes may stand for many."""
    with zipfile.ZipFile(path) as packed:
        size = sum(one.file_size for one in packed.infolist())
    if size > given.MOST_LOG:
        raise OSError(errno.EFBIG, f"it holds {size / 1e6:,.0f} MB, expected at most {given.MOST_LOG / 1e6:,.0f} MB")


def read_npz(path: Path) -> Raw:
    """Arrays of an npz file, one table each; an array of one dimension is one column. Columns have numbers only.

    Arrays of times beside them are found by their names, see `clocks`.
    """
    try:
        _require_room(given.checked(path, given.MOST_LOG))
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name]) for name in file.files}
    except _BROKEN as error:
        raise IdentificationError(f"{path}: cannot be read as npz ({error})") from None
    columns, notes = {}, []
    for name, array in arrays.items():
        if array.ndim in (1, 2) and array.dtype.kind in "fiub" and array.size:
            columns[name] = np.atleast_2d(array.astype(float).T).T
        else:
            notes.append(f"{path}: {name}: left out, {array.ndim} dimensions of {array.dtype}")
    own = clocks(columns)
    notes += [f"{path}: times of {name} are {clock}" for name, clock in own.items()]
    tables = {name: Table(a, t=columns[own[name]][:, 0] if name in own else None) for name, a in columns.items()}
    return Raw(path, tables, notes=tuple(notes))
