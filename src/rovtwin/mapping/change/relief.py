"""Which changes are places that both mosaics show, only elsewhere: things standing or moved.

A thing h higher than the floor that pixels were laid on lies h s farther out, s the slant under which it was seen
(horizontal way from the imager over the vertical one). Two mosaics that saw it under s_A and s_B show it
h (s_B - s_A) apart: on a line that is known, at a height that is not. So about each named cell all heights within what
is asked for are tried, each with what registration may have left, e, and a cell is no change if both hold:

    what the first shows there is in the second:    B(x + u + h (s_B - s_A) + e) - A(x)    is little,
    what the second shows there is in the first:    B(x + u) - A(x - h (s_B - s_A) - e)    is little.

Each place finds its own h and e, those of the least squares in a window about it, as at an edge there are two heights.
What remains, as a mean over the least thing, must be less than half of the difference and less than what is named. What
is new, gone or painted over is in one mosaic only and fails one of the two. What was moved by no more than this cannot
be told from what stands on the floor.

Reference: relief displacement as in Kraus (2007), Photogrammetry, 2nd ed.; the search along a line and both ways, as
stereo matching does it, Fua (1993), Machine Vision and Applications 6(1).
"""

from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import binary_dilation, find_objects, label, map_coordinates

from rovtwin.mapping.change.channels import Channels, box_mean, box_means
from rovtwin.mapping.change.detect import Test
from rovtwin.mapping.change.displacement import Displacement

_LEFT = 0.2  # of the statistic, what may remain: 0.45 of the difference
_STEP, _MOST = 2.0, 40  # cells from one height that is tried to the next, and heights each way
_WINDOW = 0.5  # of the least thing, in which a displacement must fit
_REST = 0.25  # of the least thing: how far registration may be off there

Slant = Float[np.ndarray, "row column 2"]


def explained(
    test: Test,
    first: Channels,
    second: Channels,
    moved: Displacement,
    slants: tuple[Slant, Slant],
    cell: float,
    least: float,
    relief: float,
) -> Bool[np.ndarray, "row column"]:
    """Cells about the named ones whose difference a height explains.

    Args:
        test: Of the cells.
        first: Of the first mosaic.
        second: Of the second, on the same grid.
        moved: From the first to the second.
        slants: Of each mosaic's cells: rows and columns that a thing one cell higher lies farther out.
        cell: Size of a cell [m].
        least: Size of the smallest thing that is looked for [m].
        relief: Greatest height over or depth under the floor that pixels were laid on [m]; 0: nothing is explained.
    """
    box, found = max(round(least / cell), 1), np.zeros(test.changed.shape, bool)
    if relief == 0:
        return found
    shapes, window = test.scale.shapes, max(round(_WINDOW * least / cell), 1)
    A, B = (one.value @ shapes for one in (first, second))
    trend, rest = test.trend @ shapes, _REST * least / cell
    at = np.stack(np.meshgrid(*(np.arange(n, dtype=float) for n in found.shape), indexing="ij"), axis=-1)
    labelled: Any = label(binary_dilation(test.changed, iterations=box))
    for place in find_objects(labelled[0]):
        wide = tuple(slice(max(one.start - box, 0), one.stop + box) for one in place)
        here, there = at[wide], at[wide] + moved.shift[wide]
        apart = _at(slants[1], there, order=0) - slants[0][wide]
        reach = relief / cell * float(np.nanmax(np.linalg.norm(apart, axis=2), initial=0.0))
        steps = int(np.clip(np.ceil(reach / _STEP), 1, _MOST))
        onto, back = (_Least(A[wide].shape, window) for _ in range(2))
        a, b = A[wide] + trend[wide], _at(B, there) - trend[wide]
        for height, i, j in product(np.linspace(-relief, relief, 2 * steps + 1) / cell, (-1, 0, 1), (-1, 0, 1)):
            way = height * apart + rest * np.array([i, j])
            onto.take(_at(B, there + way) - a)
            back.take(b - _at(A, here - way))
        left = np.maximum(*(test.scale.statistic(box_means(one.value, box), wide) for one in (onto, back)))
        found[wide] |= (left < test.unchanged.limit) & (left < _LEFT * test.statistic[wide])
    return found


class _Least:
    """The least of differences that were tried, place by place: that of the least squares in a window about it."""

    def __init__(self, shape: tuple[int, ...], window: int) -> None:
        self.value, self._size, self._window = np.full(shape, np.nan), np.full(shape[:2], np.inf), window

    def take(self, d: Float[np.ndarray, "row column shape"]) -> None:
        size = box_mean(np.sum(d**2, axis=2), self._window)[0]
        less = size < self._size
        self.value[less], self._size[less] = d[less], size[less]


def _at(
    image: Float[np.ndarray, "row column k"], at: Float[np.ndarray, "r c 2"], order: int = 1
) -> Float[np.ndarray, "r c k"]:
    """Image at rows and columns; no number beyond it."""
    places = [at[:, :, 0], at[:, :, 1]]
    return np.stack(
        [map_coordinates(one, places, order=order, cval=np.nan) for one in np.moveaxis(image, 2, 0)], axis=-1
    )
