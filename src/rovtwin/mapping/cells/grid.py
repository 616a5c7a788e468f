"""Square cells of a map."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from rovtwin.core.errors import ConfigError

_HELD = 44  # bytes a cell of a mosaic's layers and picture, which are held whole, float32
_MOST_HELD = 6e9  # bytes of them


@dataclass(frozen=True)
class Grid:
    """Square cells of a map; row 0 is the northernmost, column 0 the westernmost.

    Attributes:
        crs: Of the map, of rasterio.
        left: x of the western edge [m].
        top: y of the northern edge [m].
        cell: Side of a cell [m].
        rows: How many.
        columns: How many.
    """

    crs: Any
    left: float
    top: float
    cell: float
    rows: int
    columns: int

    @classmethod
    def over(cls, crs: Any, xy: Float[np.ndarray, "n 2"], cell: float) -> "Grid":
        """That holds all of these places, edges at whole cells.

        Raises:
            ConfigError: There would be too many cells.
        """
        low, high = np.floor(xy.min(0) / cell), np.floor(xy.max(0) / cell) + 1.0
        columns, rows = (int(n) for n in high - low)
        if _HELD * rows * columns > _MOST_HELD:
            raise ConfigError(
                f"--resolution {cell:g}: makes {rows} x {columns} cells of {np.ptp(xy, axis=0).round(1)} m; their "
                f"layers take {1e-9 * _HELD * rows * columns:.3g} GB of memory, expected at most "
                f"{1e-9 * _MOST_HELD:g}. Say a larger one, or map a part (--from, --to)"
            )
        return cls(crs, float(low[0] * cell), float(high[1] * cell), cell, rows, columns)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows, self.columns

    @property
    def transform(self) -> Any:
        """Of columns and rows to x and y, as rasterio has it."""
        from rasterio.transform import from_origin

        return from_origin(self.left, self.top, self.cell, self.cell)

    @property
    def x(self) -> Float[np.ndarray, " columns"]:
        """Of the cells' middles [m]."""
        return self.left + self.cell * (np.arange(self.columns) + 0.5)

    @property
    def y(self) -> Float[np.ndarray, " rows"]:
        """Of the cells' middles [m]."""
        return self.top - self.cell * (np.arange(self.rows) + 0.5)

    def number(self, xy: Float[np.ndarray, "*n 2"]) -> Int[np.ndarray, "*n"]:
        """Of the cells that places fall into, row by row; -1 outside and for no number."""
        with np.errstate(invalid="ignore"):
            column = np.floor((xy[..., 0] - self.left) / self.cell)
            row = np.floor((self.top - xy[..., 1]) / self.cell)
            inside = (column >= 0) & (column < self.columns) & (row >= 0) & (row < self.rows)
        return np.where(inside, np.nan_to_num(row) * self.columns + np.nan_to_num(column), -1).astype(np.int64)
