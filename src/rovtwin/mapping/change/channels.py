"""What of two mosaics is compared: logarithms of means over groups of bands, in which a common gain is an offset."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import binary_dilation, uniform_filter

_LEAST = 1e-4  # value below which a logarithm says nothing
_BESIDE = 2  # cells beside one without a number: of their pixels, too, the brightest may have been full


@dataclass(frozen=True)
class Channels:
    """An image of few channels.

    Attributes:
        value: Logarithm of the mean over each group of bands; no number where nothing was seen, nor beside that.
        noise: Its standard deviation by noise of the imager.
        wavelengths: Middle of each group [nm].
    """

    value: Float[np.ndarray, "row column channel"]
    noise: Float[np.ndarray, "row column channel"]
    wavelengths: Float[np.ndarray, " channel"]

    @property
    def seen(self) -> Bool[np.ndarray, "row column"]:
        return np.asarray(np.isfinite(self.value).all(axis=2))


def channels_of(
    cube: Float[np.ndarray, "row column band"],
    wavelengths: Float[np.ndarray, " band"],
    usable: Bool[np.ndarray, " band"],
    count: int,
    noise: Float[np.ndarray, " band"] | None = None,
) -> Channels:
    """Group the usable bands of a mosaic.

    Args:
        cube: Reflectance or radiance; no number where it is not known.
        wavelengths: Of the bands [nm].
        usable: Bands that both mosaics can be compared in.
        count: How many channels, at most as many as there are usable bands.
        noise: Standard deviation of each band by noise, in the cube's unit; None: from neighbouring bands, see
            `noise_of`.
    """
    groups = [part for part in np.array_split(np.flatnonzero(usable), count) if part.size]
    noise = noise_of(cube) if noise is None else noise
    value = np.full((*cube.shape[:2], len(groups)), np.nan)
    sd = np.full_like(value, np.nan)
    for k, bands in enumerate(groups):
        some = cube[:, :, bands].astype(float)
        mean = some.mean(axis=2)  # no number where one band has none: a mean over others is another colour
        good = mean > _LEAST
        value[good, k] = np.log(mean[good])
        sd[good, k] = np.sqrt(np.sum(noise[bands] ** 2)) / len(bands) / mean[good]
    beside = np.asarray(binary_dilation(~np.isfinite(value).all(axis=2), iterations=_BESIDE), bool)
    value[beside] = np.nan
    middles = np.array([wavelengths[bands].mean() for bands in groups])
    return Channels(value, sd, middles)


def noise_of(cube: Float[np.ndarray, "row column band"]) -> Float[np.ndarray, " band"]:
    """Standard deviation of each band by noise alone, of a cube that does not state it.

    Spectra are smooth over three bands of some nm, noise is not: r_k - (r_(k-1) + r_(k+1)) / 2 has the variance of
    noise times 1.5. The median of its size is not moved by the few places where a spectrum bends.

    Reference: the second difference as in Immerkaer (1996), Computer Vision and Image Understanding 64(2), by band.
    """
    rough = cube[:, :, 1:-1] - 0.5 * (cube[:, :, :-2] + cube[:, :, 2:])
    with np.errstate(all="ignore"):
        sd = np.nanmedian(np.abs(rough), axis=(0, 1)) / 0.6745 / np.sqrt(1.5)
    return np.concatenate([sd[:1], sd, sd[-1:]])


def box_mean(
    image: Float[np.ndarray, "row column"], size: int, least: float = 0.5
) -> tuple[Float[np.ndarray, "row column"], Float[np.ndarray, "row column"]]:
    """Mean over a square of cells about each, of those that have a number, and how many these are.

    Args:
        image: With no number where nothing was seen.
        size: Of the square [cells].
        least: Share of its cells that must have a number, for the mean to be one.
    """
    seen = np.isfinite(image)
    share = uniform_filter(seen.astype(float), size, mode="constant")
    total = uniform_filter(np.where(seen, image, 0.0), size, mode="constant")
    with np.errstate(all="ignore"):
        mean = np.where(share >= least - 1e-9, total / share, np.nan)
    return mean, share * size**2


def box_means(image: Float[np.ndarray, "row column channel"], size: int) -> Float[np.ndarray, "row column channel"]:
    """Means about each cell, channel by channel."""
    return np.stack([box_mean(one, size)[0] for one in np.moveaxis(image, 2, 0)], axis=2)


def without_trend(image: Float[np.ndarray, "row column channel"], size: int) -> Float[np.ndarray, "row column channel"]:
    """Less the mean about each cell, formed twice: the second time without what stands out by more than three sd.

    Lamps, range and water make errors of reflectance that vary over more than half a metre; what is smaller than a
    third of `size` [cells] stays. The same cells are left out of all channels: else their trends would differ by it.
    """
    together = image.mean(axis=2)
    rest = together - box_mean(together, size, 0.05)[0]
    usual = np.abs(rest) < 3.0 * np.nanmedian(np.abs(rest)) / 0.6745
    return np.stack(
        [one - box_mean(np.where(usual, one, np.nan), size, 0.02)[0] for one in np.moveaxis(image, 2, 0)], axis=2
    )
