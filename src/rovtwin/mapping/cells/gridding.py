"""From pixels to cells: sums over the pixels of some lines that fall into each cell, with their noise."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_matrix

LAYERS = ("range", "incidence", "time", "depth", "slant_x", "slant_y")  # means that parts keep beside their values


@dataclass(frozen=True)
class Part:
    """Sums over pixels of some lines, for each cell that they fall into.

    Attributes:
        cells: Their numbers, increasing.
        weight: Sum of weights.
        count: Of pixels.
        quality: Mean of weights: how well the cell was seen.
        layers: Weighted means of `LAYERS`, and of what else was asked for.
        value: Weighted mean by band.
        variance: Of the noise of that mean.
    """

    cells: Int[np.ndarray, " n"]
    weight: Float[np.ndarray, " n"]
    count: Float[np.ndarray, " n"]
    quality: Float[np.ndarray, " n"]
    layers: Float[np.ndarray, "n layer"]
    value: Float[np.ndarray, "n band"]
    variance: Float[np.ndarray, "n band"]

    def some(self, cells: slice) -> "Part":
        """Of some of the cells; the arrays are the same ones."""
        return Part(*(getattr(self, one.name)[cells] for one in fields(self)))


def gridded(
    number: Int[np.ndarray, " pixel"],
    weight: Float[np.ndarray, " pixel"],
    layers: Float[np.ndarray, "pixel layer"],
    value: Float[np.ndarray, "pixel band"],
    variance: Float[np.ndarray, "pixel band"],
) -> Part:
    """Of pixels; those whose number is -1 or whose weight is none fall out.

    A pixel without a number in a band does not count in that band of its cell, which is none where no pixel has one.
    """
    use = np.flatnonzero((number >= 0) & (weight > 0))
    cells, row = np.unique(number[use], return_inverse=True)
    shape, w = (len(cells), len(number)), weight[use].astype(np.float32)

    def summing(data: np.ndarray) -> Any:
        return csr_matrix((data, (row.ravel(), use)), shape)

    total = np.bincount(row.ravel(), w, len(cells)).astype(np.float32)
    count = np.bincount(row.ravel(), minlength=len(cells)).astype(np.float32)
    shares = w / total[row.ravel()]
    mean, squares = summing(shares), summing(np.square(shares))
    found, spread = mean @ value, squares @ variance
    holes = np.flatnonzero(~np.isfinite(found).all(axis=0))  # a band of a pixel that is full
    if len(holes):
        known = np.isfinite(value[:, holes])
        share = mean @ known.astype(np.float32)
        share[share <= 0] = np.nan
        found[:, holes] = (mean @ np.where(known, value[:, holes], np.float32(0))) / share
        spread[:, holes] = (squares @ np.where(known, variance[:, holes], np.float32(0))) / np.square(share)
    return Part(
        cells,
        total,
        count,
        total / np.maximum(count, 1.0),
        (mean @ layers).astype(np.float32),
        found,
        spread,
    )
