"""Spectra that a page shows where one clicks: a mosaic in coarser cells and bands, as text inside the page."""

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

MOST = 2.1e6  # bytes of all numbers, before they become text
BANDS = 60  # at most
_PICTURE = 800  # pixels a side at most
_TRUTH, _ALONE = 5, 3  # bytes of a number with its spread, with the truth and without


@dataclass(frozen=True)
class Viewer:
    """Of a mosaic; row 0 is the northernmost.

    Attributes:
        quantity: For the axis, with its unit.
        wavelengths: Of the coarser bands [nm].
        value: Means; no number where masked or not seen.
        spread: Standard deviation over the mosaic's cells in each.
        truth: None where nobody knows it.
        rgb: Picture with opacity, of the whole mosaic.
        cell: Side of a coarser cell [m].
        size: Width and height of the mosaic [m].
        corner: x and y of its lower left corner [m].
        crs: Of the map.
        to_place: Rows of north and of east: of the corner, and their change per metre of x and of y.
        places: Named, with x and y from the corner [m].
    """

    quantity: str
    wavelengths: Float[np.ndarray, " band"]
    value: Float[np.ndarray, "row column band"]
    spread: Float[np.ndarray, "row column band"]
    truth: Float[np.ndarray, "row column band"] | None
    rgb: UInt8[np.ndarray, "high wide 4"]
    cell: float
    size: tuple[float, float]
    corner: tuple[float, float]
    crs: str
    to_place: Float[np.ndarray, "2 3"]
    places: Sequence[tuple[str, tuple[float, float]]]

    def data(self) -> dict[str, Any]:
        """As the page's script takes it; numbers of 16 bits, of the spread 8, 0 for none."""
        both = [self.value] if self.truth is None else [self.value, self.truth]
        known = np.concatenate([x[np.isfinite(x)] for x in both])
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
        high = high if high > low else low + 1.0
        most = float(np.nanmax(self.spread)) if np.isfinite(self.spread).any() else 1.0
        return {
            "quantity": self.quantity, "shape": list(self.value.shape), "low": low, "high": high, "most": most or 1.0,
            "wavelengths": [round(float(w), 2) for w in self.wavelengths], "cell": self.cell, "size": list(self.size),
            "left": self.corner[0], "bottom": self.corner[1], "crs": self.crs, "to_place": self.to_place.tolist(),
            "places": [{"name": name, "x": round(x, 4), "y": round(y, 4)} for name, (x, y) in self.places],
            "value": _whole((self.value - low) / (high - low), np.uint16),
            "spread": _whole(np.sqrt(self.spread / (most or 1.0)), np.uint8),
            "truth": None if self.truth is None else _whole((self.truth - low) / (high - low), np.uint16),
            "picture": self._picture(),
        }  # fmt: skip

    @property
    def picture_size(self) -> tuple[int, int]:
        """Width and height [pixels]."""
        share = min(_PICTURE / max(self.rgb.shape[:2]), 1.0)
        return max(round(self.rgb.shape[1] * share), 1), max(round(self.rgb.shape[0] * share), 1)

    def _picture(self) -> str:
        stream = io.BytesIO()
        Image.fromarray(self.rgb, "RGBA").resize(self.picture_size).save(stream, "WEBP", quality=80)
        return "data:image/webp;base64," + base64.b64encode(stream.getvalue()).decode()


def coarser(rows: int, columns: int, bands: int, truth: bool) -> tuple[int, int]:
    """How many cells a side, and how many bands, become one, so that a page stays light."""
    together = -(-bands // BANDS)
    least = rows * columns * -(-bands // together) * (_TRUTH if truth else _ALONE) / MOST
    return max(int(np.ceil(np.sqrt(least))), 1), together


def _whole(share: Float[np.ndarray, "..."], kind: Any) -> str:
    """Shares from 0 to 1 as whole numbers from 1 on, 0 for none, as text."""
    most = np.iinfo(kind).max - 1
    with np.errstate(invalid="ignore"):
        numbers = np.where(np.isfinite(share), 1 + np.rint(np.clip(share, 0.0, 1.0) * most), 0)
    return base64.b64encode(numbers.astype(np.dtype(kind).newbyteorder("<")).tobytes()).decode()
