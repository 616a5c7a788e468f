"""What a mosaic looks like to people: red, green and blue of its spectra."""

import numpy as np
from jaxtyping import Bool, Float, UInt8

RANGES = ((590.0, 660.0), (520.0, 580.0), (445.0, 500.0))  # red, green, blue [nm]
_GAMMA, _BRIGHT, _DARK = 1.9, 99.0, 0.5  # of the picture; percentiles that become white and black


def colour_bands(wavelengths: Float[np.ndarray, " band"]) -> list[np.ndarray]:
    """Numbers of the bands whose means are red, green and blue; the nearest one where none lies within."""
    found = []
    for low, high in RANGES:
        within = np.flatnonzero((wavelengths >= low) & (wavelengths <= high))
        nearest = np.array([int(np.argmin(np.abs(wavelengths - 0.5 * (low + high))))])
        found.append(within if len(within) else nearest)
    return found


def picture(
    rgb: Float[np.ndarray, "row column 3"], seen: Bool[np.ndarray, "row column"], alike: bool
) -> UInt8[np.ndarray, "row column 4"]:
    """Eight bits and opacity; a colour that is full, and so no number, is white as in a photograph.

    Args:
        rgb: Means of the bands of each colour.
        seen: Where there is anything.
        alike: One scale for the three, as true to colour as reflectances are; else each its own, for radiances.
    """
    rgb = np.where((seen & ~np.isfinite(rgb).all(-1))[..., None], np.inf, rgb)
    known = seen & np.isfinite(rgb).all(-1)
    out = np.zeros((*seen.shape, 4), np.uint8)
    if not known.any():
        return out
    values = rgb[known]
    axis = None if alike else 0
    low, high = (np.percentile(values, p, axis=axis) for p in (_DARK, _BRIGHT))
    low = np.minimum(low, 0.5 * high) if alike else low
    scaled = np.clip((rgb[seen] - low) / np.maximum(high - low, 1e-12), 0.0, 1.0) ** (1.0 / _GAMMA)
    out[seen] = np.column_stack([np.rint(255.0 * scaled), np.full(len(scaled), 255)]).astype(np.uint8)
    return out
