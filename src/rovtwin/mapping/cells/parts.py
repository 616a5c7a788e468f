"""Cells of a mosaic: sums over the pixels that fall into each, a block of lines at a time, kept on the disk.

Each block leaves its sums for the cells that it touches as a folder, written whole or not at all: what was broken off
goes on with the blocks that are missing. They are joined at the end, some rows of the mosaic at a time: their
spectra take no memory that grows with the survey.
"""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float

from rovtwin.core.log.files import write_error
from rovtwin.core.user_files.files import write_text
from rovtwin.mapping.cells.grid import Grid
from rovtwin.mapping.cells.gridding import Part

_AT_ONCE = 96e6  # bytes of values of the rows joined at once
_NEIGHBOURS = 5  # of eight that must be seen for an empty cell between them to be filled


class Parts:
    """Parts of a mosaic on the disk, by number.

    Args:
        folder: Of them; it is made.
        key: Of all that they depend on: those of another one are thrown away.
    """

    NAMES = ("cells", "weight", "count", "quality", "layers", "value", "variance")

    def __init__(self, folder: Path, key: str) -> None:
        self.folder = folder
        note = folder / "key.json"
        try:
            known = note.is_file() and json.loads(note.read_text(encoding="utf-8")).get("key") == key
        except (OSError, ValueError, AttributeError):
            known = False
        try:
            if not known:
                self.remove()
                folder.mkdir(parents=True)
                write_text(note, json.dumps({"key": key}))
            for left in folder.glob("*.half"):
                shutil.rmtree(left)
        except OSError as error:
            raise write_error(folder, error) from error

    def has(self, number: int) -> bool:
        """Whether a part is there."""
        return self._path(number).is_dir()

    def add(self, number: int, part: Part, notes: dict[str, int]) -> None:
        """Keep a part, and counts of what was left out of it.

        Raises:
            LogError: It cannot be written, such as on a full disk.
        """
        half = self._path(number).with_suffix(".half")
        try:
            half.mkdir()
            for name in self.NAMES:
                np.save(half / f"{name}.npy", getattr(part, name))
            write_text(half / "notes.json", json.dumps(notes))
            half.rename(self._path(number))
        except OSError as error:
            raise write_error(self.folder, error) from error

    def notes(self, numbers: range) -> dict[str, int]:
        """Sums of the counts of parts."""
        total: dict[str, int] = {}
        for number in numbers:
            for name, count in json.loads((self._path(number) / "notes.json").read_text(encoding="utf-8")).items():
                total[name] = total.get(name, 0) + count
        return total

    def remove(self) -> None:
        """Keep nothing any more."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _path(self, number: int) -> Path:
        return self.folder / f"part_{number:05d}"

    def joined(
        self, numbers: range, grid: Grid, bands: int, layers: int, best: bool, margin: int = 0
    ) -> Iterator[tuple[range, slice, Part]]:
        """The mosaic some rows at a time, from the top: which rows, and their cells as a dense part.

        What is computed of a cell does not depend on how many rows are joined at once, to the last bit.

        Args:
            numbers: Of the parts.
            grid: Whose cells these are.
            bands: How many.
            layers: How many.
            best: Whether a cell is taken from the lines that saw it best; else the mean of all, weighted.
            margin: Rows more on either side, where the mosaic has them.

        Yields:
            Rows of the mosaic; the cells of the part that lie in them; the part, margin included.
        """
        opened = [_Opened(self._path(number)) for number in numbers]
        high = int(np.clip(_AT_ONCE / (8.0 * bands * grid.columns), 8, grid.rows))
        for row in range(0, grid.rows, high):
            last = min(row + high, grid.rows)
            wide = max(row - margin, 0), min(last + margin, grid.rows)
            begin, end = max(wide[0] - 1, 0), min(wide[1] + 1, grid.rows)  # a row more, for what is filled
            dense = _empty((end - begin) * grid.columns, bands, layers)
            known = np.zeros_like(dense.value)  # by band: best quality, or sum of weights, of what has a number
            for part in opened:
                if (piece := part.between(begin * grid.columns, end * grid.columns)) is not None:
                    (_put_best if best else _add)(dense, known, piece, begin * grid.columns)
            if not best:
                _divide(dense, known)
            for array in (dense.value, dense.variance):
                array[known <= 0] = np.nan
            _fill(dense, (end - begin, grid.columns))
            keep = slice((wide[0] - begin) * grid.columns, (wide[1] - begin) * grid.columns)
            own = slice((row - wide[0]) * grid.columns, (last - wide[0]) * grid.columns)
            yield range(row, last), own, Part(*(getattr(dense, name)[keep] for name in self.NAMES))


class _Opened:
    """A part on the disk; its values are read as they are needed."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.cells = np.load(path / "cells.npy")

    def between(self, first: int, last: int) -> Part | None:
        """Of the cells from one number up to another."""
        a, b = np.searchsorted(self.cells, [first, last])
        if a == b:
            return None
        arrays = [np.load(self.path / f"{name}.npy", mmap_mode="r")[a:b] for name in Parts.NAMES]
        return Part(*(np.array(array) for array in arrays))


def _empty(cells: int, bands: int, layers: int) -> Part:
    zeros = [np.zeros(cells, np.float32) for _ in range(3)]
    wide = [np.zeros((cells, n), np.float32) for n in (layers, bands, bands)]
    return Part(np.arange(cells), *zeros, *wide)


def _put_best(dense: Part, known: np.ndarray, piece: Part, first: int) -> None:
    """Bands apart: one that is full in the best lines is taken from the best of the others."""
    at = piece.cells - first
    quality = np.where(np.isfinite(piece.value), piece.quality[:, None], np.float32(0))
    ahead = quality > known[at]
    for name, new in (("value", piece.value), ("variance", piece.variance)):
        array = getattr(dense, name)
        array[at] = np.where(ahead, new, array[at])
    known[at] = np.maximum(known[at], quality)
    better = piece.quality > dense.quality[at]
    for name in ("weight", "quality", "layers"):
        getattr(dense, name)[at[better]] = getattr(piece, name)[better]
    dense.count[at] += piece.count


def _add(dense: Part, known: np.ndarray, piece: Part, first: int) -> None:
    at, w = piece.cells - first, piece.weight[:, None]
    own = np.where(np.isfinite(piece.value), w, np.float32(0))  # what has no number in a band does not count there
    dense.layers[at] += w * piece.layers
    dense.value[at] += np.where(own > 0, own * piece.value, np.float32(0))
    dense.variance[at] += np.where(own > 0, own * own * piece.variance, np.float32(0))
    known[at] += own
    dense.quality[at] = np.maximum(dense.quality[at], piece.quality)
    dense.weight[at] += piece.weight
    dense.count[at] += piece.count


def _divide(dense: Part, known: np.ndarray) -> None:
    w = np.where(dense.weight > 0, dense.weight, 1.0)[:, None]
    own = np.where(known > 0, known, np.float32(1))
    for array, factor in ((dense.layers, w), (dense.value, own), (dense.variance, own * own)):
        array /= factor


def _fill(dense: Part, shape: tuple[int, int]) -> None:
    """Cells that fell between two lines, from their neighbours; their count stays 0, their weight becomes positive."""
    seen = dense.weight.reshape(shape) > 0
    padded = np.pad(seen, 1)
    around = sum(
        padded[1 + i : shape[0] + 1 + i, 1 + j : shape[1] + 1 + j].astype(int)
        for i in (-1, 0, 1)
        for j in (-1, 0, 1)
        if i or j
    )
    rows, columns = np.nonzero(~seen & (np.asarray(around) >= _NEIGHBOURS))
    if not len(rows):
        return
    at = rows * shape[1] + columns
    total = np.zeros(len(at), np.float32)
    sums = {name: np.zeros((len(at), getattr(dense, name).shape[1]), np.float32) for name in ("layers", "value")}
    spread = np.zeros((len(at), dense.variance.shape[1]), np.float32)
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            r, c = np.clip(rows + i, 0, shape[0] - 1), np.clip(columns + j, 0, shape[1] - 1)
            known = (seen[r, c] & (rows + i == r) & (columns + j == c)).astype(np.float32)
            near = r * shape[1] + c
            total += known
            for name, array in sums.items():
                array += np.where(known[:, None] > 0, getattr(dense, name)[near], 0.0)
            spread += np.where(known[:, None] > 0, dense.variance[near], 0.0)
    for name, array in sums.items():
        getattr(dense, name)[at] = array / total[:, None]
    dense.variance[at] = spread / total[:, None]  # neighbours of one line share their light: no gain is claimed
    dense.weight[at] = 1e-12


def masked_layers(part: Part, noise: Float[np.ndarray, " n"], columns: int) -> Float[np.ndarray, "row column layer"]:
    """Layers of a dense part with its count and noise behind them; no number where nothing was seen."""
    together = np.column_stack([part.layers, part.count, noise])
    together[part.weight <= 0] = np.nan
    return together.reshape(-1, columns, together.shape[1])
