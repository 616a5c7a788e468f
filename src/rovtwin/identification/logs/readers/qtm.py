"""Qualisys QTM: the 6-DOF text export (TSV).

Its Euler angles are Rx(roll) Ry(pitch) Rz(yaw), not ours, so the rotation matrix is used; it is written column by
column and maps the body to the laboratory. Both are taken as z up (body forward-left-up); `frame` and `mounting_deg`
of a signal say otherwise. Frames in which the body was not seen are zeros or blank.

Reference: Qualisys Track Manager user manual, "TSV export", 6DOF data; checked against a public export (tests).
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import IdentificationError
from rovtwin.core.user_files.config import near
from rovtwin.identification.logs.readers.raw import Raw, Table, spec
from rovtwin.identification.logs.readers.tables import read_text

PLACE = ("X", "Y", "Z")
MATRIX = tuple(f"Rot[{i}]" for i in range(9))
COLUMNS = (*PLACE, "Roll", "Pitch", "Yaw", "Residual", *MATRIX)


def read_qtm(path: Path, body: str | None = None) -> Raw:
    """The rigid bodies of an export, one table each; signals are those of `body`, which an only one need not name."""
    lines = read_text(path).splitlines()
    start = next((i for i, line in enumerate(lines) if "Rot[0]" in line and "Residual" in line), None)
    if start is None:
        raise IdentificationError(
            f"{path}: found no line with Residual and Rot[0], expected a 6-DOF export of QTM. In QTM: File, Export, "
            "To TSV, data type 6D"
        )
    header = {words[0]: words[1:] for words in (line.split("\t") for line in lines[:start]) if words}
    bodies = [name.strip() for name in header.get("BODY_NAMES", []) if name.strip()]
    names = [cell.strip() for cell in lines[start].split("\t")]
    before = sum(name in ("Frame", "Time") for name in names[:2])
    values = _numbers(lines[start + 1 :], before + len(COLUMNS) * len(bodies), path, start + 2)
    t = values[:, 1] if before == 2 else np.arange(len(values)) / _rate(header, path)
    tables, notes = {}, []
    for i, name in enumerate(bodies):
        block = values[:, before + i * len(COLUMNS) : before + (i + 1) * len(COLUMNS)].copy()
        # Not seen: a rotation of zeros is no rotation.
        block[~(np.abs(block[:, -9:]).sum(axis=1) > 0.5)] = np.nan
        lost = int(np.isnan(block).any(axis=1).sum())
        if lost:
            notes.append(f"{path}: {name} not seen in {lost} of {len(block)} frames")
        tables[name] = Table(block, COLUMNS, t)
    return Raw(path, tables, pose_signals(path, bodies, body), notes=tuple(notes))


def pose_signals(path: Path, bodies: list[str], body: str | None) -> dict:
    """Position [mm] and attitude of one rigid body of motion capture."""
    if body is None and len(bodies) != 1:
        raise IdentificationError(f"{path}: found the bodies {', '.join(bodies) or 'none'}; say which with 'body'")
    name = bodies[0] if body is None else body
    if name not in bodies:
        raise IdentificationError(f"{path}: no body {name!r}.{near(name, bodies)}")
    return {
        "position": spec(table=name, columns=list(PLACE), unit="mm", frame="nwu"),
        "attitude": spec(table=name, columns=list(MATRIX), matrix="columns", frame="nwu"),
    }


def _numbers(lines: list[str], width: int, path: Path, first: int) -> Float[np.ndarray, "n width"]:
    rows = []
    for number, line in enumerate(lines, start=first):
        if not line.strip():
            continue
        cells = [cell.strip() for cell in line.split("\t")]
        try:
            row = [float(cell) if cell else np.nan for cell in cells[:width]]
        except ValueError:
            raise IdentificationError(f"{path}: line {number}: found text among the numbers") from None
        rows.append(row + [np.nan] * (width - len(row)))
    if not rows:
        raise IdentificationError(f"{path}: found no frames")
    return np.array(rows)


def _rate(header: dict[str, list[str]], path: Path) -> float:
    try:
        return float(header["FREQUENCY"][0])
    except (KeyError, IndexError, ValueError):
        raise IdentificationError(f"{path}: found neither a Time column nor FREQUENCY") from None
