"""Lines of a survey as pictures: brightness on a grid of the floor as one straight run of lines saw it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from rovtwin.core.errors import LogError
from rovtwin.mapping.georeference import Georeference
from rovtwin.mapping.navigation import Navigation

SLOWEST_TURN = 0.05  # of the course, above which lines are those of a turn [rad/s]
SHORTEST = 3.0  # run of lines that is looked at [s]
LONGEST = 12.0  # way of a run on one grid [m]: grids lie north and east, an oblique run fills little of its own
_BLOCK = 256  # lines that are placed at once


@dataclass(frozen=True)
class Strip:
    """A straight run of lines on a grid whose axes are north and east.

    Attributes:
        corner: North and east of the middle of its first cell, a whole number of cells from the origin [m].
        cell: Side of a cell [m].
        bright: Logarithm of the brightness, less what each pixel sees on average; no number where nothing was seen.
        t: Stamp of the line that saw each cell, mean of those that did [s].
        pixel: Likewise.
    """

    corner: Float[np.ndarray, "2"]
    cell: float
    bright: Float[np.ndarray, "rows columns"]
    t: Float[np.ndarray, "rows columns"]
    pixel: Float[np.ndarray, "rows columns"]

    @property
    def seen(self) -> Bool[np.ndarray, "rows columns"]:
        """Where it saw anything."""
        return np.isfinite(self.bright)


def straight_runs(navigation: Navigation, t: Float[np.ndarray, " line"]) -> list[Int[np.ndarray, " n"]]:
    """Numbers of the lines of each run without a turn, gaps of navigation not crossed."""
    turn = navigation.turn_rates(t)
    straight = np.isfinite(turn) & (np.abs(turn) < SLOWEST_TURN)
    at = np.flatnonzero(straight)
    if not len(at):
        return []
    cuts = np.flatnonzero((np.diff(at) > 1) | (np.diff(t[at]) > 1.0)) + 1
    return [run for run in np.split(at, cuts) if t[run[-1]] - t[run[0]] >= SHORTEST]


def short_runs(
    navigation: Navigation, t: Float[np.ndarray, " line"], runs: list[Int[np.ndarray, " n"]]
) -> list[Int[np.ndarray, " n"]]:
    """The same lines in runs that are none longer than `LONGEST`."""
    pieces = []
    for run in runs:
        place = navigation.at(t[run]).position[:, :2]
        way = float(np.nansum(np.linalg.norm(np.diff(place, axis=0), axis=1)))
        pieces += [piece for piece in np.array_split(run, max(int(np.ceil(way / LONGEST)), 1)) if len(piece)]
    return pieces


def strip_of(
    where: Georeference,
    t: Float[np.ndarray, " line"],
    bright: Float[np.ndarray, "line pixel"],
    cell: float = 0.015,
) -> Strip:
    """Lines of one run on a grid.

    Args:
        where: Poses, imager and floor as they are known.
        t: Stamps of the lines [s].
        bright: Brightness of their pixels, above 0; no number: not to be used.
        cell: Side of the grid's cells [m]; not less than lines are apart.

    Raises:
        LogError: No pixel of the run lies on the floor.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        log = np.log(bright)
    log[~np.isfinite(log)] = np.nan
    flat = log - _profile(log)
    parts = []
    for begin in range(0, len(t), _BLOCK):
        some = slice(begin, begin + _BLOCK)
        found = where.locate(t[some])
        good = found.valid & np.isfinite(flat[some])
        when, pixel = np.broadcast_arrays(t[some, None], np.arange(flat.shape[1]))
        parts.append(np.column_stack([found.point[good][:, :2], flat[some][good], when[good], pixel[good]]))
    rows = np.concatenate(parts)
    if not len(rows):
        raise LogError(f"lines from {t[0]:.1f} to {t[-1]:.1f} s: none of their pixels lies on the floor")
    index = np.rint(rows[:, :2] / cell).astype(int)
    low = index.min(axis=0)
    shape = tuple(index.max(axis=0) - low + 1)
    flat_index = np.ravel_multi_index(tuple((index - low).T), shape)
    count = np.bincount(flat_index, minlength=shape[0] * shape[1])
    with np.errstate(invalid="ignore"):
        values, when, pixel = (
            (np.bincount(flat_index, rows[:, k], minlength=len(count)) / count).reshape(shape) for k in (2, 3, 4)
        )
    return Strip(low * cell, cell, values, when, pixel)


def _profile(log: Float[np.ndarray, "line pixel"]) -> Float[np.ndarray, " pixel"]:
    """What lamps and lens make of each pixel: its median over the run."""
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of pixels without any number
        return np.nanmedian(log, axis=0)
