"""The things that changed: connected cells, each with its place, size, contrast and how sure it is."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import binary_dilation, find_objects, label

from rovtwin.mapping.change.detect import Test

_CORE = 0.5  # share of the greatest change from which a cell belongs to the thing
_LARGE = 0.5  # share of the least thing's area that a thing must have
_NAMED = 0.25  # share of that area that its named cells must have: a thing of that size is no single spot


@dataclass(frozen=True)
class Thing:
    """One thing that changed.

    Attributes:
        place: Row and column of its middle, as numbers of cells.
        cells: That belong to it.
        area: [m2].
        size: Its extent along rows and columns [m].
        contrast: Change of reflectance by channel, as a share: -0.3 is darker by 30 %.
        sd: Standard deviation of its mean.
        chance: Probability that one place differs so much where nothing changed.
    """

    place: tuple[float, float]
    cells: Bool[np.ndarray, "row column"]
    area: float
    size: tuple[float, float]
    contrast: Float[np.ndarray, " channel"]
    sd: float
    chance: float


def things(
    test: Test,
    cell: float,
    least: float,
    contrast: float = 0.0,
    among: Bool[np.ndarray, "row column"] | None = None,
) -> list[Thing]:
    """Connected cells that changed, the surest first.

    The test looks at squares of the least thing; a thing's cells are those about a named one where the change is at
    least half of its greatest, which for a square is its own extent.

    Args:
        test: Of the cells.
        cell: Size of a cell [m].
        least: Size of the smallest thing that was looked for [m].
        contrast: Least change of reflectance that is of interest, as a share, rms over channels.
        among: Cells that things may be made of; None: all.
    """
    among = np.ones(test.changed.shape, bool) if among is None else among
    brighter, found = test.difference.mean(axis=2) > 0, []
    for alike in (among & brighter, among & ~brighter):  # what became brighter and what became darker are two things
        found += _connected(test, alike, cell, least)
    found = [one for one in found if one.area >= _LARGE * least**2 and np.sqrt(np.mean(one.contrast**2)) >= contrast]
    return sorted(found, key=lambda one: one.chance)


def sorted_out(
    test: Test, explained: Bool[np.ndarray, "row column"], cell: float, least: float, contrast: float = 0.0
) -> tuple[list[Thing], list[Thing]]:
    """Changes, and things that a height explains; see `things` and `relief.explained`.

    What falls into parts that are too small, some of them explained and some not, counts as a change.
    """
    changes = things(test, cell, least, contrast, ~explained)
    taken = _cells(changes, explained.shape)
    elsewhere = things(test, cell, least, contrast, explained & ~taken)
    taken |= _cells(elsewhere, explained.shape)
    changes += [one for one in things(test, cell, least, contrast) if not (one.cells & taken).any()]
    return sorted(changes, key=lambda one: one.chance), elsewhere


def _connected(test: Test, among: Bool[np.ndarray, "row column"], cell: float, least: float) -> list[Thing]:
    """Of connected named cells the greatest change, and what is left beside it as others: none hides a fainter one."""
    half, found = max(round(0.5 * least / cell), 1), []
    while True:
        named = test.changed & among
        labelled: Any = label(binary_dilation(named, iterations=half))
        some = []
        for k, place in enumerate(find_objects(labelled[0]), start=1):
            inside = (labelled[0][place] == k) & among[place]
            if (named[place] & inside).sum() * cell**2 >= _NAMED * least**2:
                some.append(_thing(test, place, inside, cell))
        if not some:
            return found
        found += some
        among = among & ~np.asarray(binary_dilation(_cells(some, among.shape), iterations=half + 1), bool)


def _cells(some: list[Thing], shape: tuple[int, ...]) -> Bool[np.ndarray, "row column"]:
    return np.any([one.cells for one in some], axis=0) if some else np.zeros(shape, bool)


def _thing(test: Test, place: tuple[slice, slice], inside: np.ndarray, cell: float) -> Thing:
    change, named = test.difference[place], inside & test.changed[place]
    # Not the surest cell: beside an edge of the floor that may lie at the rim of what changed.
    top = np.argmax(np.where(named, np.sum(change**2, axis=2), -1.0))
    row, column = np.unravel_index(top, inside.shape)
    peak = change[row, column]
    along = change @ peak / max(peak @ peak, 1e-30)
    core = inside & (along >= _CORE)
    rows, columns = np.nonzero(core)
    middle = (place[0].start + rows.mean(), place[1].start + columns.mean())
    widths = (float(np.ptp(rows) + 1) * cell, float(np.ptp(columns) + 1) * cell)
    sd = test.sd[place][row, column]
    gain = np.exp(peak)
    whole = np.zeros(test.changed.shape, bool)
    whole[place] = core
    area, chance = float(core.sum()) * cell**2, float(test.chance[place][named].min())
    return Thing(middle, whole, area, widths, gain - 1.0, float(gain.mean() * sd), chance)
