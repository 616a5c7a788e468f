"""Towing records from CSV files: one file per run, or one file with a column `run`."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import IdentificationError
from rovtwin.core.user_files import files as given
from rovtwin.core.user_files.config import near

UNITS = {"t": ("s",), "speed": ("m/s", "rad/s"), "force": ("N", "Nm", "N m")}
NAMES = {"t": ("t", "time"), "speed": ("speed", "velocity", "v", "u"), "force": ("force", "drag", "f")}
FASTEST = 5.0  # no small ROV is towed faster [m/s]; above it the unit is something else


@dataclass(frozen=True, eq=False)
class TowRun:
    """One tow: what the carriage did and what the rig felt.

    Attributes:
        name: For people.
        t: [s], increasing.
        speed: Of the carriage, positive ahead [m/s].
        force: Sum of the force sensors [N], with the tare still in it.
        source: File it came from, for messages.
    """

    name: str
    t: Float[np.ndarray, " n"]
    speed: Float[np.ndarray, " n"]
    force: Float[np.ndarray, " n"]
    source: str = "tow"

    @property
    def rate(self) -> float:
        """Of the readings [1/s]."""
        return 1.0 / float(np.median(np.diff(self.t)))


def read_towing(paths: Sequence[str | Path]) -> list[TowRun]:
    """All runs of some files.

    Columns are found by name: t (or time), speed (or velocity), force; several columns whose names begin with force
    are added up, as of a rig with several sensors. A column `run` tells the runs of one file apart. Units may stand
    behind a name, in brackets, and must be s, m/s and N.

    Raises:
        IdentificationError: File, line, what was found, what was expected, the fix.
    """
    return [run for path in paths for run in _read(Path(path))]


def _read(path: Path) -> list[TowRun]:
    header, rows = _rows(path)
    columns, forces, run = _columns(path, header)
    needed = [columns["t"], columns["speed"], *forces]
    values, names = [], []
    for line, row in rows:
        try:
            values.append([float(row[c]) for c in needed])
            names.append(row[run].strip() if run is not None else path.stem)
        except (ValueError, IndexError):
            found = ",".join(row)
            raise IdentificationError(
                f"{path}: line {line}: found {found!r}, expected a number in each column"
            ) from None
    data, labels = np.array(values), np.array(names)
    runs = []
    for label in dict.fromkeys(names):
        part = data[labels == label]
        name = label if run is None else f"{path.stem}:{label}"
        runs.append(_checked(TowRun(name, part[:, 0], part[:, 1], part[:, 2:].sum(axis=1), str(path))))
    return runs


def _rows(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Header, and rows with their line numbers."""
    try:
        text = given.read_text(path)
    except FileNotFoundError:
        known = [p.name for p in path.parent.glob("*.csv")] if path.parent.is_dir() else []
        raise IdentificationError(f"{path}: no such file.{near(path.name, known)}") from None
    except UnicodeDecodeError:
        raise IdentificationError(f"{path}: is not text, expected CSV") from None
    except OSError as error:
        raise IdentificationError(f"{path}: cannot be read ({error.strerror})") from None
    lines = text.splitlines()
    first = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    delimiter = max(",;\t", key=first.count)
    try:
        rows = [
            (number, row)
            for number, line in enumerate(lines, start=1)
            if line.strip() and not line.startswith("#")
            for row in csv.reader([line], delimiter=delimiter)
        ]
    except csv.Error as error:
        raise IdentificationError(f"{path}: is no table of numbers ({error})") from None
    if len(rows) < 2:
        raise IdentificationError(f"{path}: found {len(rows)} lines, expected a header t,speed,force and readings")
    return [cell.strip() for cell in rows[0][1]], rows[1:]


def _columns(path: Path, header: list[str]) -> tuple[dict[str, int], list[int], int | None]:
    """Column of time and speed, those of the forces, and that of the run if there is one."""
    plain = [re.split(r"[\[(]", cell)[0].strip().lower() for cell in header]
    columns = {}
    for kind, names in NAMES.items():
        found = [i for i, name in enumerate(plain) if name in names or (kind == "force" and name.startswith("force"))]
        if not found:
            raise IdentificationError(
                f"{path}: no column {names[0]!r}; found {', '.join(header)}; expected t,speed,force and perhaps run"
            )
        if len(found) > 1 and kind != "force":
            raise IdentificationError(f"{path}: columns {', '.join(header[i] for i in found)} all say {kind}; keep one")
        for i in found:
            _check_unit(path, header[i], UNITS[kind])
        columns[kind] = found
    run = plain.index("run") if "run" in plain else None
    return {kind: columns[kind][0] for kind in ("t", "speed")}, columns["force"], run


def _check_unit(path: Path, cell: str, expected: tuple[str, ...]) -> None:
    unit = re.search(r"[\[(]([^\])]*)[\])]", cell)
    if unit and unit.group(1).strip() not in expected:
        raise IdentificationError(f"{path}: column {cell!r} is not in {expected[0]}; convert it and change its name")


def _checked(run: TowRun) -> TowRun:
    where = f"{run.source}: run {run.name}"
    if not all(np.all(np.isfinite(x)) for x in (run.t, run.speed, run.force)):
        raise IdentificationError(f"{where}: holds values that are not finite; leave those lines out")
    back = np.flatnonzero(np.diff(run.t) <= 0)
    if len(back):
        raise IdentificationError(
            f"{where}: time does not increase after {run.t[back[0]]:g} s; several runs in one file need a column 'run'"
        )
    if len(run.t) < 20:
        raise IdentificationError(f"{where}: found {len(run.t)} readings, expected a record of the tow, at least 20")
    fastest = float(np.quantile(np.abs(run.speed), 0.95))
    if fastest > FASTEST:
        raise IdentificationError(f"{where}: speed reaches {fastest:.3g} m/s; it looks like mm/s or cm/s, expected m/s")
    return run
