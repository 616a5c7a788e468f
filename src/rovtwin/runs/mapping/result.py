"""A mosaic as it lies in its folder."""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import LogError
from rovtwin.core.notebook import Result, axes_of
from rovtwin.core.notebook.face import Row
from rovtwin.core.user_files.files import checked
from rovtwin.mapping.formats.envi import NO_DATA, opened

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

CUBE, NOTE, PAGE = "cube.img", "map.json", "report.html"
_ROWS = 50  # of which it is taken how many cells know a band


def read_note(path: Path, maker: str) -> dict[str, Any]:
    """What stands in the note of a result.

    Args:
        path: Of the note.
        maker: Command that makes such results.

    Raises:
        LogError: There is none, or it cannot be read.
    """
    try:
        return json.loads(checked(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror or error}. `{maker}` makes it") from None
    except ValueError:
        raise LogError(f"{path}: is no text that `{maker}` wrote; make it again") from None


@dataclass(frozen=True, eq=False, repr=False)
class Mosaic(Result):
    """A mosaic of an imager's lines: a folder of files, and figures of it.

    Attributes:
        folder: That holds `cube.img` (ENVI), `layers.tif`, `rgb.tif`, `map.json` and more.
        about: What `map.json` says: figures, settings, hashes, remarks.

    Example:
        >>> rovtwin.map("runs/survey", "lines.h5")  # doctest: +SKIP
        <Mosaic: 12.1 x 8.4 m, 169 bands, 61.2 m2 seen>
    """

    folder: Path
    about: dict[str, Any]

    @classmethod
    def read(cls, folder: str | Path) -> "Mosaic":
        """That of a folder.

        Raises:
            LogError: There is none.
        """
        return cls(Path(folder), read_note(Path(folder) / NOTE, "rovtwin map"))

    def __repr__(self) -> str:
        """One line, as a notebook shows it."""
        rows, columns, bands = self.shape
        cell = self.about["grid"]["cell_m"]
        seen = self.about["figures"]["seen_m2"]
        return f"<Mosaic: {columns * cell:.1f} x {rows * cell:.1f} m, {bands} bands, {seen:.1f} m2 seen>"

    @property
    def shape(self) -> tuple[int, int, int]:
        """Rows, columns, bands."""
        grid = self.about["grid"]
        return grid["rows"], grid["columns"], len(self.about["wavelengths_nm"])

    @cached_property
    def cube(self) -> np.ndarray:
        """Reflectance or radiance as it lies on the disk, (row, band, column); `envi.NO_DATA` for no number."""
        return opened(self.folder / CUBE, self.shape)

    @property
    def wavelengths(self) -> Float[np.ndarray, " band"]:
        """Of the bands [nm]."""
        return np.array(self.about["wavelengths_nm"])

    def share_known(self) -> Float[np.ndarray, " band"]:
        """Of the cells that have any number, those that know a band, by band; of some fifty rows."""
        some = np.asarray(self.cube[:: max(self.shape[0] // _ROWS, 1)]) != np.float32(NO_DATA)
        seen = some.any(axis=1)
        return np.moveaxis(some, 1, 2)[seen].mean(axis=0) if seen.any() else np.zeros(self.shape[2])

    def layer(self, name: str) -> Float[np.ndarray, "row column"] | None:
        """Of `layers.tif`; None where it has none of that name.

        Raises:
            LogError: The file cannot be read.
        """
        import rasterio

        path = self.folder / "layers.tif"
        try:
            with rasterio.open(path) as file:
                names = list(file.descriptions)
                return file.read(names.index(name) + 1) if name in names else None
        except rasterio.RasterioIOError as error:
            raise LogError(f"{path}: cannot be read: {error}") from None

    def budget(self, name: str, later: bool = False) -> Float[np.ndarray, " band"] | None:
        """A column of `uncertainty.csv`, relative standard deviations by band; None without.

        Args:
            name: Of the column.
            later: Whether it came later than the file, so that older mosaics are without.

        Raises:
            LogError: The file is not of this mosaic.
        """
        path = self.folder / "uncertainty.csv"
        if not path.is_file():
            return None
        table = np.atleast_1d(np.genfromtxt(path, delimiter=",", names=True))
        if later and name not in (table.dtype.names or ()):
            return None
        if name not in (table.dtype.names or ()) or len(table) != self.shape[2]:
            raise LogError(f"{path}: expected a column {name} with a row for each of {self.shape[2]} bands")
        return table[name]

    def spectrum(self, x: float, y: float, radius: float = 0.05) -> Float[np.ndarray, " band"]:
        """Mean of the cells about a place of the map, no number in bands that none of them has.

        Args:
            x: Of the map [m].
            y: Of the map [m].
            radius: Of the circle of cells [m].
        """
        cells = self.cells_about(x, y, radius)
        known = np.isfinite(cells)
        total = np.where(known, cells, 0.0).sum(axis=0)
        return np.where(known.any(axis=0), total / np.maximum(known.sum(axis=0), 1), np.nan)

    def cells_about(self, x: float, y: float, radius: float) -> Float[np.ndarray, "n band"]:
        """Spectra of the cells within a circle about a place of the map [m]; of its own cell at least."""
        grid = self.about["grid"]
        row, column = (grid["top_m"] - y) / grid["cell_m"] - 0.5, (x - grid["left_m"]) / grid["cell_m"] - 0.5
        reach = max(radius / grid["cell_m"], 0.71)
        rows = np.arange(max(int(row - reach), 0), min(int(row + reach) + 2, self.shape[0]))
        columns = np.arange(max(int(column - reach), 0), min(int(column + reach) + 2, self.shape[1]))
        if not len(rows) or not len(columns):
            return np.empty((0, self.shape[2]), np.float32)
        near = np.hypot(rows[:, None] - row, columns[None] - column) <= reach
        block = np.moveaxis(np.array(self.cube[rows[0] : rows[-1] + 1, :, columns[0] : columns[-1] + 1]), 1, -1)[near]
        block[block == np.float32(NO_DATA)] = np.nan
        return block[np.isfinite(block).any(axis=1)]

    def figures_table(self) -> list[Row]:
        """Size, what was seen, how unsure it is.

        Example:
            >>> rovtwin.map("runs/survey", "lines.h5").figures_table()[0]  # doctest: +SKIP
            ('lines', 6548, '')
        """
        f = self.about["figures"]
        rows: list[Row] = [
            ("lines used", f["lines_used"], ""),
            ("seen", f["seen_m2"], "m2"),
            ("gaps inside", f["gaps_m2"], "m2"),
            ("range, median", f["range_m"], "m"),
            ("bands masked, share", f["masked"], ""),
            ("time to make it", f["seconds"], "s"),
        ]
        for name, label, unit in (
            ("error_median", "reflectance error against the truth, median", ""),
            ("angle_deg", "spectral angle to the truth, median", "deg"),
        ):
            if f.get(name) is not None:
                rows.append((label, f[name], unit))
        if (ties := f.get("registration")) is not None:
            rows.append(("ties and control points used", ties["ties_used"], ""))
            rows.append(("NIS of them (95 %: {:.2f} to {:.2f})".format(*ties["nis_95"]), ties["nis"], ""))
        return rows

    def remarks(self) -> list[str]:
        """What is worth knowing.

        Example:
            >>> rovtwin.map("runs/survey", "lines.h5").remarks()  # doctest: +SKIP
        """
        return list(self.about["remarks"])

    def to_xarray(self) -> "xarray.Dataset":
        """The cube and its layers by `wavelength`, `y`, `x`; read from the disk as it is looked at.

        Example:
            >>> rovtwin.map("runs/survey", "lines.h5").to_xarray()["reflectance"]  # doctest: +SKIP
        """
        from rovtwin.core.extras import require

        require("xarray", "notebook", "Mosaic.to_xarray")
        import rasterio
        import xarray

        grid = self.about["grid"]
        x = grid["left_m"] + grid["cell_m"] * (np.arange(grid["columns"]) + 0.5)
        y = grid["top_m"] - grid["cell_m"] * (np.arange(grid["rows"]) + 0.5)
        values = np.moveaxis(np.array(self.cube), 1, 0)
        values = np.where(values == np.float32(NO_DATA), np.float32(np.nan), values)
        name = self.about["quantity"]
        data: dict[str, Any] = {name: (("wavelength", "y", "x"), values, {"units": self.about["unit"]})}
        with rasterio.open(self.folder / "layers.tif") as file:
            for band, layer in enumerate(file.descriptions, 1):
                data[layer] = (("y", "x"), file.read(band), {"units": file.tags(band).get("units", "")})
        return xarray.Dataset(data, {"wavelength": self.wavelengths, "y": y, "x": x}, {"crs": grid["crs"]})

    def plot(self) -> "Axes":
        """Its picture in red, green and blue.

        Example:
            >>> rovtwin.map("runs/survey", "lines.h5").plot().figure.savefig("rgb.png")  # doctest: +SKIP
        """
        import rasterio

        grid = self.about["grid"]
        with rasterio.open(self.folder / "rgb.tif") as file:
            rgb = np.moveaxis(file.read(), 0, -1)
        axes = axes_of("x [m]", "y [m]", equal=True)
        wide, high = grid["columns"] * grid["cell_m"], grid["rows"] * grid["cell_m"]
        axes.imshow(rgb, extent=(0.0, wide, 0.0, high))
        axes.set_title(f"from x {grid['left_m']:.2f}, y {grid['top_m'] - high:.2f}, {grid['crs']}", fontsize=8)
        return axes
