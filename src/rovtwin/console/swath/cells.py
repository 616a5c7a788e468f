"""Cells of the floor, and when each was seen for the first and for the second time; never more of them than MOST."""

import base64
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

CELL = 0.05  # side of a cell, until there are too many [m]
MOST = 1_000_000  # cells: 12 MB
MARGIN = 64  # cells beyond what has to be held: growing copies all of them
RETURN = 5.0  # a cell that was out of sight for so long is seen a second time [s]
NEVER = np.float32(np.inf)


class Cells:
    """A grid along north and east that grows as it is painted; where it would get too large, cells are put together.

    Attributes:
        cell: Side of a cell [m].
        low: Row and column of the first cell, counted from the origin of n.
        first: When each was seen first [s]; inf: never. Rows go north, columns east.
        second: When each was seen again after it had been out of sight for RETURN [s].
        last: When each was seen last [s].
    """

    def __init__(self, cell: float = CELL):
        self.cell = cell
        self.low = np.zeros(2, int)
        self.first, self.second, self.last = (np.zeros((0, 0), np.float32) for _ in range(3))

    @property
    def passes(self) -> np.ndarray:
        """How often each was seen: 0, 1, or 2 for more than once."""
        return np.isfinite(self.first).astype(np.uint8) + np.isfinite(self.second)

    @property
    def seen_m2(self) -> float:
        """Area of what was seen [m2]."""
        return float(np.isfinite(self.first).sum()) * self.cell**2

    def paint(self, hull: Float[np.ndarray, "k 2"], t: float) -> None:
        """See at a time [s] the cells with their middle in a convex polygon [m]; its corners go from north to east."""
        box = self._held(hull.min(axis=0), hull.max(axis=0))
        middles = [(self.low[i] + np.arange(box[i].start, box[i].stop) + 0.5) * self.cell for i in (0, 1)]
        inside = np.ones((len(middles[0]), len(middles[1])), bool)
        for (x, y), (dx, dy) in zip(hull, np.roll(hull, -1, axis=0) - hull, strict=True):
            inside &= dx * (middles[1] - y)[None, :] - dy * (middles[0] - x)[:, None] >= 0.0
        first, second, last = self.first[box], self.second[box], self.last[box]
        again = inside & np.isfinite(first) & ~np.isfinite(second) & (t - last > RETURN)
        second[again] = t
        first[inside & ~np.isfinite(first)] = t
        last[inside] = t

    def window(
        self, low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"]
    ) -> tuple[Float[np.ndarray, "n m"], Int[np.ndarray, "2"], float]:
        """Share seen of each cell of a box [m], row and column of the first of them, and their side [m].

        They are the cells of the grid, or, where the box has more than MOST of these, 2 x 2, 4 x 4, ... of them
        together. The grid stays as it is.
        """
        side = 1  # of the box's cells, in cells of the grid
        while int(np.prod(np.diff(_range(low, high, side * self.cell), axis=0))) > MOST:
            side *= 2
        begin, end = _range(low, high, side * self.cell)
        first, last = np.maximum(begin * side, self.low), np.minimum(end * side, self.low + self.first.shape)
        shares = np.zeros(end - begin, np.float32)
        if (first < last).all():
            (row, column), (row_end, column_end) = first - self.low, last - self.low
            seen = np.isfinite(self.first[row:row_end, column:column_end])
            padded = np.pad(seen, np.stack([first % side, -last % side], axis=1))
            rows, columns = np.array(padded.shape) // side
            row, column = first // side - begin
            together = padded.reshape(rows, side, columns, side).mean(axis=(1, 3), dtype=np.float32)
            shares[row : row + rows, column : column + columns] = together
        return shares, begin, side * self.cell

    def message(self, *, times: bool = False) -> dict[str, Any] | None:
        """For pages: the painted box, rows from the south, columns from the west; None where nothing was seen.

        `data`, packed by zlib and in base64, has `passes` as bytes. With `times` it has in their place two blocks of
        uint16, little endian: when each cell was seen first and again, in steps of `step` [s] from `begin` [s], 65535
        for never.
        """
        seen = np.isfinite(self.first)
        if not seen.any():
            return None
        rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
        box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        north, east = ((self.low + [rows[0], columns[0]]) * self.cell).tolist()
        about = {"cell": self.cell, "north": north, "east": east}
        about |= {"rows": int(np.ptp(rows)) + 1, "columns": int(np.ptp(columns)) + 1}
        if not times:
            return about | {"data": _packed(self.passes[box])}
        begin, end = float(self.first[seen].min()), float(self.last[seen].max())
        step = max(end - begin, 1.0) / 65534
        steps = [np.ceil((x[box] - begin) / step) for x in (self.first, self.second)]  # never earlier than it was seen
        counted = [np.where(np.isfinite(x), np.minimum(x, 65534), 65535).astype("<u2") for x in steps]
        return about | {"begin": begin, "step": step, "data": _packed(np.stack(counted))}

    def _held(self, low: Sequence[float] | np.ndarray, high: Sequence[float] | np.ndarray) -> tuple[slice, slice]:
        """Slices of the cells of a box [m], which the grid grows to hold."""
        while True:
            a, b = _range(low, high, self.cell)
            size = np.array(self.first.shape)
            if size.all() and (a >= self.low).all() and (b <= self.low + size).all():
                begin, end = a - self.low, b - self.low
                return slice(begin[0], end[0]), slice(begin[1], end[1])
            at, to = (np.minimum(a, self.low), np.maximum(b, self.low + size)) if size.all() else (a, b)
            if int(np.prod(to - at)) > MOST:
                self._put_together()
            else:
                self._grow(at, to)

    def _grow(self, at: np.ndarray, to: np.ndarray) -> None:
        wide = np.prod(to - at + 2 * MARGIN) <= MOST
        at, to = (at - MARGIN, to + MARGIN) if wide else (at, to)
        begin = self.low - at
        for name in ("first", "second", "last"):
            old = getattr(self, name)
            new = np.full(to - at, NEVER, np.float32)
            if old.size:
                new[begin[0] : begin[0] + old.shape[0], begin[1] : begin[1] + old.shape[1]] = old
            setattr(self, name, new)
        self.low = at

    def _put_together(self) -> None:
        """Four cells become one, which was seen when the south-western of them was: areas stay what they are."""
        self.cell *= 2.0
        before = self.low % 2
        for name in ("first", "second", "last"):
            padded = np.pad(getattr(self, name), [(before[0], 0), (before[1], 0)], constant_values=NEVER)
            setattr(self, name, np.ascontiguousarray(padded[::2, ::2]))
        self.low = (self.low - before) // 2


def _range(low: Sequence[float] | np.ndarray, high: Sequence[float] | np.ndarray, cell: float) -> np.ndarray:
    """Row and column of the first cell of a box [m], and those behind its last, (2, 2)."""
    begin = np.floor(np.asarray(low) / cell).astype(int)
    return np.stack([begin, np.maximum(np.ceil(np.asarray(high) / cell).astype(int), begin + 1)])


def _packed(values: np.ndarray) -> str:
    return base64.b64encode(zlib.compress(values.tobytes(), 1)).decode()
