"""A classification as it lies in its folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rovtwin.core.notebook import Result, axes_of
from rovtwin.core.notebook.face import Row
from rovtwin.runs.mapping.result import read_note

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

NOTE = "classes.json"


@dataclass(frozen=True, eq=False, repr=False)
class Classification(Result):
    """What lies where on a mosaic: a folder of files, and areas.

    Attributes:
        folder: That holds `classes.tif`, `abundance.tif`, `angle.tif`, `areas.csv` and more.
        about: What `classes.json` says: areas, angles between classes, accuracy, remarks.

    Example:
        >>> rovtwin.map_classify("mosaic")  # doctest: +SKIP
        <Classification: 8 classes on 63.0 m2, 6.5 % mixed, 1.6 % not of this library>
    """

    folder: Path
    about: dict[str, Any]

    @classmethod
    def read(cls, folder: str | Path) -> "Classification":
        """That of a folder.

        Raises:
            LogError: There is none.
        """
        return cls(Path(folder), read_note(Path(folder) / NOTE, "rovtwin map-classify"))

    def __repr__(self) -> str:
        """One line, as a notebook shows it."""
        f = self.about["figures"]
        return (
            f"<Classification: {len(self.about['areas'])} classes on {f['classified_m2']:.1f} m2, "
            f"{100.0 * f['mixed_m2'] / f['classified_m2']:.1f} % mixed, "
            f"{100.0 * f['not_of_library_m2'] / f['classified_m2']:.1f} % not of this library>"
        )

    def figures_table(self) -> list[Row]:
        """Area of each class with its interval, then what is of no class.

        Example:
            >>> rovtwin.map_classify("mosaic").figures_table()[0]  # doctest: +SKIP
            ('sand', [17.4, 15.1, 20.2], 'm2')
        """
        rows: list[Row] = [
            (area["class"], [area["area_m2"], area["low_m2"], area["high_m2"]], "m2") for area in self.about["areas"]
        ]
        f = self.about["figures"]
        rows += [
            ("mixed cells", f["mixed_m2"], "m2"),
            ("not of this library", f["not_of_library_m2"], "m2"),
            ("classified in all", f["classified_m2"], "m2"),
        ]
        for name, label in (("accuracy", "cells mapped as what they are"), ("kappa", "kappa")):
            if name in f:
                rows.append((label, f[name], ""))
        return rows

    def remarks(self) -> list[str]:
        """What is worth knowing.

        Example:
            >>> rovtwin.map_classify("mosaic").remarks()  # doctest: +SKIP
        """
        return list(self.about["remarks"])

    def to_pandas(self) -> "pandas.DataFrame":
        """Areas, a row for each class.

        Example:
            >>> rovtwin.map_classify("mosaic").to_pandas()["area_m2"]  # doctest: +SKIP
        """
        from rovtwin.core.extras import require

        require("pandas", "notebook", "Classification.to_pandas")
        import pandas

        return pandas.DataFrame(self.about["areas"]).set_index("class")

    def plot(self) -> "Axes":
        """The map in the classes' colours.

        Example:
            >>> rovtwin.map_classify("mosaic").plot().figure.savefig("classes.png")  # doctest: +SKIP
        """
        import rasterio

        with rasterio.open(self.folder / "classes.tif") as file:
            value, table, box, crs = file.read(1), file.colormap(1), file.bounds, str(file.crs)
        colours = np.array([table.get(k, (0, 0, 0, 0)) for k in range(256)], np.uint8)
        colours[255] = 0
        axes = axes_of("x [m]", "y [m]", equal=True)
        axes.imshow(colours[value], extent=(0.0, box.right - box.left, 0.0, box.top - box.bottom))
        axes.set_title(f"from x {box.left:.2f}, y {box.bottom:.2f}, {crs}", fontsize=8)
        return axes
