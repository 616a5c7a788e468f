"""ENVI: a cube of numbers line by line (BIL) or a map of classes, with a header of text.

GDAL, QGIS, ENVI and SPy read them. Reference: L3Harris, ENVI Header Files: fields of the header.
 `coordinate system string` is WKT as ESRI writes it.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from rovtwin.core.log.files import write_error
from rovtwin.core.user_files.files import write_text
from rovtwin.mapping.cells.grid import Grid
from rovtwin.mapping.formats.class_colours import ClassMap

NO_DATA = -9999.0


def header(grid: Grid, wavelengths: Float[np.ndarray, " band"], fwhm: Float[np.ndarray, " band"], what: str) -> str:
    """Text of the header of a cube of float32, BIL.

    Args:
        grid: Where its cells lie.
        wavelengths: Of the bands [nm].
        fwhm: Of the bands [nm].
        what: It holds.
    """
    return _text(
        grid,
        {
            "description": "{ " + what + " }",
            "bands": len(wavelengths),
            "file type": "ENVI Standard",
            "data type": 4,
            "interleave": "bil",
            "data ignore value": f"{NO_DATA:g}",
            "wavelength units": "Nanometers",
            "wavelength": _row(wavelengths),
            "fwhm": _row(fwhm),
            "band names": "{ " + ", ".join(f"{w:.1f} nm" for w in wavelengths) + " }",
        },
    )


def write_classes(path: Path, grid: Grid, classes: ClassMap) -> Path:
    """A map of classes with its header.

    Args:
        path: Of the numbers, by custom with the ending `.img`.
        grid: Where the cells lie.
        classes: Of them.

    Raises:
        LogError: It cannot be written.
    """
    lookup = ", ".join(str(part) for colour in classes.colours for part in colour)
    fields = {
        "bands": 1,
        "file type": "ENVI Classification",
        "data type": 1,
        "interleave": "bsq",
        "data ignore value": classes.no_data,
        "classes": len(classes.names),
        "class names": "{ " + ", ".join(name.replace(",", ";") for name in classes.names) + " }",
        "class lookup": "{ " + lookup + " }",
    }
    try:
        classes.value.tofile(path)
        write_text(path.with_suffix(".hdr"), _text(grid, fields))
    except OSError as error:
        raise write_error(path, error) from error
    return path


def _text(grid: Grid, fields: Mapping[str, object]) -> str:
    """Of a header: size, order and place of the cells, and other fields."""
    name = "Arbitrary"
    info = [name, "1", "1", f"{grid.left:.6f}", f"{grid.top:.6f}", f"{grid.cell:.9g}", f"{grid.cell:.9g}"]
    code = grid.crs.to_epsg() or 0
    if 32600 < code <= 32660 or 32700 < code <= 32760:
        info[0] = "UTM"
        info += [str(code % 100), "North" if code < 32700 else "South"]
    info += ["WGS-84", "units=Meters"] if info[0] == "UTM" else ["units=Meters"]
    place = {
        "samples": grid.columns,
        "lines": grid.rows,
        "header offset": 0,
        "byte order": 0,
        "map info": "{ " + ", ".join(info) + " }",
        "coordinate system string": "{ " + grid.crs.to_wkt(version="WKT1_ESRI") + " }",
    }
    return "ENVI\n" + "".join(f"{key} = {value}\n" for key, value in {**place, **fields}.items())


def _row(values: Float[np.ndarray, " band"]) -> str:
    return "{ " + ", ".join(f"{x:.4f}" for x in values) + " }"


class EnviCube:
    """A cube that is being written, some rows at a time.

    Args:
        path: Of the numbers, by custom with the ending `.img`; the header lies beside it.
        grid: Where its cells lie.
        wavelengths: Of the bands [nm].
        fwhm: Of the bands [nm].
        what: It holds.

    Raises:
        LogError: It cannot be written.
    """

    def __init__(
        self,
        path: Path,
        grid: Grid,
        wavelengths: Float[np.ndarray, " band"],
        fwhm: Float[np.ndarray, " band"],
        what: str,
    ) -> None:
        self.path, self._grid = path, grid
        try:
            self._stream = path.open("wb")
            write_text(path.with_suffix(".hdr"), header(grid, wavelengths, fwhm, what))
        except OSError as error:
            raise write_error(path, error) from error

    def append(self, rows: Float[np.ndarray, "row column band"]) -> None:
        """The next rows; no number is written as `NO_DATA`.

        Raises:
            LogError: They cannot be written, such as on a full disk.
        """
        data = np.nan_to_num(np.swapaxes(rows, 1, 2), nan=NO_DATA, posinf=NO_DATA, neginf=NO_DATA)
        try:
            self._stream.write(np.ascontiguousarray(data, "<f4").data)
        except OSError as error:
            raise write_error(self.path, error) from error

    def close(self) -> None:
        """No more rows."""
        self._stream.close()


def opened(path: Path, shape: tuple[int, int, int], mode: Literal["r", "r+"] = "r") -> np.memmap:
    """A cube of this module as it lies on the disk, (row, band, column), read as it is looked at; r+: and written."""
    rows, columns, bands = shape
    return np.memmap(path, "<f4", mode, shape=(rows, bands, columns))
