"""Tables of places that a map is given: names and finite numbers by columns of a CSV file."""

import csv
from pathlib import Path

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.files import read_text

POINTS = (("name", "north", "east"), ("name", "latitude", "longitude"))
CONTROL = ("name", "line", "pixel", "north", "east", "sd")


def columns_of(
    option: str, path: Path, *kinds: tuple[str, ...]
) -> tuple[list[str], Float[np.ndarray, "row column"], tuple[str, ...]]:
    """Names and numbers of a CSV file whose head is one of these, the first column the name; and which head it is.

    Raises:
        ConfigError: It cannot be read, has other columns, or something in it is no finite number.
    """
    rows = _rows(option, path)
    kind = next((k for k in kinds if rows and all(name in rows[0] for name in k)), None)
    if kind is None:
        found = ", ".join(str(name) for name in rows[0]) if rows else "no rows"
        raise ConfigError(f"{option} {path}: found {found}, expected {' or '.join(','.join(k) for k in kinds)}")
    table = np.array([[_number(row[name]) for name in kind[1:]] for row in rows])
    names = [row[kind[0]] or f"row {number}" for number, row in enumerate(rows, 2)]
    if (wrong := np.argwhere(~np.isfinite(table))).size:
        k, column = (int(i) for i in wrong[0])
        raise ConfigError(
            f"{option} {path}: row {k + 2} ({names[k]}): found '{rows[k][kind[column + 1]]}' for "
            f"{kind[column + 1]}, expected a finite number. Write one, or take the row out"
        )
    return names, table, kind


def column_of(option: str, path: Path, name: str) -> list[str]:
    """Texts of one more column of such a file; empty where there is none.

    Raises:
        ConfigError: It cannot be read.
    """
    return [(row.get(name) or "").strip() for row in _rows(option, path)]


def _rows(option: str, path: Path) -> list[dict[str, str]]:
    try:
        return list(csv.DictReader(read_text(path).splitlines(), skipinitialspace=True))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{option} {path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None


def _number(text: str | None) -> float:
    try:
        return float(text or "")
    except ValueError:
        return float("nan")
