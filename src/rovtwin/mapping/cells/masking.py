"""Bands that noise hides: where, and which of them everywhere."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import convolve1d

AROUND = 11  # cells a side over which signal and noise are averaged before a band is masked
DARKEST = 0.05  # reflectance below which a band is not masked because the floor is dark
HIDDEN = 0.99  # share of the cells seen from which on a band is masked in all of them


def masked(
    value: Float[np.ndarray, "row column band"],
    sigma: Float[np.ndarray, "row column band"],
    seen: Bool[np.ndarray, "row column"],
    smallest: float,
) -> Bool[np.ndarray, "row column band"]:
    """Where noise is too much for a signal: sigma above 1 / `smallest` of the value, or of `DARKEST` if that is more.

    A dark floor in good light is no reason to mask. Nor is a value that noise made small while its neighbours are
    kept: what is left would be brighter than what is there. So both are means over the cells about each, of those
    that were seen and have a number. A cell's mask depends on the `AROUND` // 2 rows on either side of it and on no
    others: sums are taken in one order wherever they begin.
    """
    hidden = np.zeros(value.shape, bool)
    for band in range(value.shape[-1]):
        known = seen & np.isfinite(value[..., band]) & np.isfinite(sigma[..., band])
        spread = np.where(known, sigma[..., band], 0.0)
        if float(spread.max(initial=0.0)) * smallest <= 0.999 * DARKEST:
            continue  # so is its mean, everywhere
        weight = np.maximum(_sums(known.astype(float)), 1.0)
        near, far = _sums(np.where(known, value[..., band], 0.0)) / weight, _sums(spread) / weight
        hidden[..., band] = far * smallest > np.maximum(np.abs(near), DARKEST)
    return hidden


def _sums(x: Float[np.ndarray, "row column"]) -> Float[np.ndarray, "row column"]:
    """Over the cells about each; nothing lies beyond the edge. A running sum would round by where it began."""
    ones = np.ones(AROUND)
    return convolve1d(convolve1d(x, ones, axis=0, mode="constant"), ones, axis=1, mode="constant")


def without_signal(share: Float[np.ndarray, " band"]) -> Bool[np.ndarray, " band"]:
    """Bands to be masked whole, by the share of the cells seen in which each is hidden.

    The few cells that are left there are those whose range is wrong, such as things that stand above the floor.
    """
    return share >= HIDDEN
