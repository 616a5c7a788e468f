"""The things that changed: connected cells, each with its place, size, contrast and how sure it is."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import binary_dilation, find_objects, label

from rovtwin.mapping.change.detect import NAMED, Test

_CORE = 0.5  # share of the greatest change from which a cell belongs to the thing
_LARGE = 0.5  # share of the least thing's area that a thing must have


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
    found = [one for one in _connected(test, among, cell, least) if np.sqrt(np.mean(one.contrast**2)) >= contrast]
    return sorted(found, key=lambda one: one.chance)


def least_contrast(test: Test, cell: float, least: float, false_share: float) -> float:
    """Change of brightness, as a share, from which a single thing is listed over half of the floor.

    Of the mean over the least thing such a thing's middle has all of the change, cells beside it less: a triangle each
    way. As many of them as a thing must have are to reach what a place must have where nothing else has changed.
    """
    if not np.isfinite(test.unchanged.middle):
        return np.inf
    side = max(round(least / cell), 1)
    share = 1.0 - np.abs(np.arange(1 - side, side)) / side
    response = np.sort(np.outer(share, share).ravel())[-max(round(NAMED * side**2), 1)]
    alone = test.unchanged.value(false_share / test.unchanged.count)
    unit = np.zeros((*test.statistic.shape, test.scale.shapes.shape[1]))
    unit[:, :, 0] = 1.0
    return float(np.expm1(np.nanmedian(np.sqrt(alone / test.scale.statistic(unit))) / response))


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
    for one in things(test, cell, least, contrast):
        named = one.cells & test.changed
        changes += [one] if (named & taken).sum() <= 0.5 * named.sum() else []
    return sorted(changes, key=lambda one: one.chance), elsewhere


def _connected(test: Test, among: Bool[np.ndarray, "row column"], cell: float, least: float) -> list[Thing]:
    """Of connected named cells the greatest change, and what is left beside it as others: none hides a fainter one."""
    half, among, found = max(round(0.5 * least / cell), 1), among.copy(), []
    while True:
        named, some = test.changed & among, 0
        labelled: Any = label(binary_dilation(named, iterations=half))
        for k, place in enumerate(find_objects(labelled[0]), start=1):
            inside = (labelled[0][place] == k) & among[place]
            if (named[place] & inside).sum() * cell**2 < NAMED * least**2:
                continue
            thing, alike = _greatest(test, place, inside, cell, least)
            among[place] &= ~(alike & np.asarray(binary_dilation(thing.cells[place], iterations=half + 1), bool))
            found, some = [*found, thing], some + 1
        if not some:
            return [one for one in found if one.area >= _LARGE * least**2]


def _greatest(
    test: Test, place: tuple[slice, slice], inside: np.ndarray, cell: float, least: float
) -> tuple[Thing, Bool[np.ndarray, "r c"]]:
    """Of connected cells the greatest part that changed in one direction, and the cells that it was looked for in.

    What became brighter and what became darker, or bluer and redder, are two things; all is one where no part of it is
    large enough by itself.
    """
    half, rest = max(round(0.5 * least / cell), 1), inside
    while (rest & test.changed[place]).any():
        top, along = _along(test, place, rest)
        alike = rest & (along > 0)
        labelled: Any = label(binary_dilation(alike & test.changed[place], iterations=half))
        part = alike & (labelled[0] == labelled[0][top])
        thing = _thing(test, place, part, part & (along >= _CORE), top, cell)
        if (part & test.changed[place]).sum() * cell**2 >= NAMED * least**2 and thing.area >= _LARGE * least**2:
            return thing, part
        rest = rest & ~part
    top, along = _along(test, place, inside)
    return _thing(test, place, inside, inside & (np.abs(along) >= _CORE), top, cell), inside


def _cells(some: list[Thing], shape: tuple[int, ...]) -> Bool[np.ndarray, "row column"]:
    return np.any([one.cells for one in some], axis=0) if some else np.zeros(shape, bool)


def _along(
    test: Test, place: tuple[slice, slice], inside: np.ndarray
) -> tuple[tuple[int, int], Float[np.ndarray, "r c"]]:
    """Row and column of the greatest change, and each cell's change in its direction as a share of it."""
    change, named = test.difference[place], inside & test.changed[place]
    # Not the surest cell: beside an edge of the floor that may lie at the rim of what changed.
    row, column = np.unravel_index(np.argmax(np.where(named, np.sum(change**2, axis=2), -1.0)), inside.shape)
    peak = change[row, column]
    return (int(row), int(column)), np.nan_to_num(change @ peak / max(peak @ peak, 1e-30))


def _thing(
    test: Test, place: tuple[slice, slice], part: np.ndarray, core: np.ndarray, top: tuple[int, int], cell: float
) -> Thing:
    rows, columns = np.nonzero(core)
    middle = (place[0].start + rows.mean(), place[1].start + columns.mean())
    widths = (float(np.ptp(rows) + 1) * cell, float(np.ptp(columns) + 1) * cell)
    gain = np.exp(test.difference[place][top])
    whole = np.zeros(test.changed.shape, bool)
    whole[place] = core
    area, chance = float(core.sum()) * cell**2, float(test.chance[place][part & test.changed[place]].min())
    return Thing(middle, whole, area, widths, gain - 1.0, float(gain.mean() * test.sd[place][top]), chance)
