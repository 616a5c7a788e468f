"""Known points: features of lines whose place was surveyed, from a file."""

from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from rovtwin.core.errors import ConfigError
from rovtwin.imaging.lines import LinesHead
from rovtwin.mapping.alignment.ties import ControlPoints
from rovtwin.runs.mapping.columns import CONTROL, column_of, columns_of
from rovtwin.runs.mapping.sources import Inputs


def read_control(
    path: Path, inputs: Inputs, t: Float[np.ndarray, " line"], use: Bool[np.ndarray, " line"]
) -> tuple[ControlPoints | None, list[str]]:
    """Of a CSV file: name, number of the line and pixel that saw it, north and east [m], standard deviation [m].

    Lines count through all files; in a row with a name under `file`, in that one.

    Points that only lines saw that are not used are left out, and named in a remark.

    Raises:
        ConfigError: It cannot be read, or has other columns, no numbers, or lines and pixels that there are not.
    """
    names, table, _ = columns_of("--control", path, CONTROL)
    lines, pixels, _ = inputs.lines.shape
    begins, counts = _files_of(path, names, inputs.lines)
    wrong = (table[:, 0] < 0) | (table[:, 0] > counts - 1) | (table[:, 1] < 0) | (table[:, 1] > pixels - 1)
    if (wrong := wrong | ~(table[:, 4] > 0)).any():
        k = int(np.argmax(wrong))
        raise ConfigError(
            f"--control {path}: row {k + 2} ({names[k]}): found line {table[k, 0]:g}, pixel {table[k, 1]:g}, sd "
            f"{table[k, 4]:g}; expected lines from 0 to {counts[k] - 1}, pixels from 0 to {pixels - 1}, and sd above 0"
        )
    table[:, 0] += begins
    kept = use[np.rint(table[:, 0]).astype(int)]
    left = [name for name, there in zip(names, kept, strict=True) if not there]
    remarks = [f"control points in lines that are not used are left out: {', '.join(left)}"] if left else []
    if not kept.any():
        return None, remarks
    when = np.interp(table[kept, 0], np.arange(lines), t)
    some = tuple(name for name, there in zip(names, kept, strict=True) if there)
    return ControlPoints(when, table[kept, 1], table[kept, 2:4], table[kept, 4], some), remarks


def _files_of(
    path: Path, names: list[str], lines: LinesHead
) -> tuple[Int[np.ndarray, " row"], Int[np.ndarray, " row"]]:
    """Of each row of a file of control points: the number from which its line counts, and how many there are.

    Raises:
        ConfigError: A row names a file that there is not, or several.
    """
    given = column_of("--control", path, "file")
    sizes = [one.shape[0] for one in lines.files]
    begins, counts = np.zeros(len(names), int), np.full(len(names), lines.shape[0])
    for k, text in enumerate(given):
        there = [i for i, one in enumerate(lines.files) if text and text in (one.path.name, str(one.path))]
        if text and len(there) != 1:
            raise ConfigError(
                f"--control {path}: row {k + 2} ({names[k]}): found the file '{text}', which is {len(there)} of the "
                f"files of lines; expected one of {', '.join(str(one.path) for one in lines.files)}"
            )
        if there:
            begins[k], counts[k] = sum(sizes[: there[0]]), sizes[there[0]]
    return begins, counts
