"""Spectral angle mapper: the class whose spectrum points where the cell's points, whatever its brightness.

    cos theta_k = x . e_k / (|x| |e_k|)

A cell is of the class of the least angle, if that is below a limit of its own:

    limit_k = F sqrt(noise^2 + common_k^2 + variability_k^2),
    noise^2 = sum_b sigma_b^2 / |x|^2,    common_k^2 = sum_j angle(e_k, e_k (1 + d_j))^2

noise is the angle by which the imager's noise turns the cell, common that by which errors d_j of height, water and
lamps turn all cells, variability how far spectra of one material lie apart. The root mean square of these angles is
the root; F = 3 of them are as improbable as three standard deviations where one direction dominates, and far less
where many do.

Reference: Kruse et al. (1993), The Spectral Image Processing System (SIPS), Remote Sensing of Environment 44.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

FACTOR = 3.0  # of the root mean square angle that is still of a class
UNCLASSIFIED = -1


@dataclass(frozen=True)
class Angles:
    """Of cells to classes.

    Attributes:
        nearest: Number of the class of the least angle; `UNCLASSIFIED` where a cell has no number.
        value: That angle [rad].
        margin: How much farther the second class is [rad].
        noise: By which the imager's noise turns the cell, root mean square [rad].
        length: |x|.
    """

    nearest: Int[np.ndarray, " n"]
    value: Float[np.ndarray, " n"]
    margin: Float[np.ndarray, " n"]
    noise: Float[np.ndarray, " n"]
    length: Float[np.ndarray, " n"]


def cosines(
    x: Float[np.ndarray, "n band"], known: Bool[np.ndarray, "n band"], spectra: Float[np.ndarray, "class band"]
) -> Float[np.ndarray, "n class"]:
    """Between cells and spectra, each over the bands that the cell has.

    Args:
        x: Of cells, 0 where not known.
        known: Bands that they have.
        spectra: Of classes.
    """
    size = np.sqrt(known.astype(np.float32) @ np.square(spectra).T.astype(np.float32))
    length = np.linalg.norm(x, axis=1)[:, None]
    with np.errstate(all="ignore"):
        return np.where((size > 0) & (length > 0), x @ spectra.T.astype(x.dtype) / (size * length), -1.0)


def angles(
    x: Float[np.ndarray, "n band"],
    known: Bool[np.ndarray, "n band"],
    spectra: Float[np.ndarray, "class band"],
    noise: Float[np.ndarray, "n band"],
) -> Angles:
    """Of cells to classes.

    Args:
        x: Of cells, 0 where not known.
        known: Bands that they have.
        spectra: Of classes.
        noise: Standard deviation of each value.
    """
    between = np.arccos(np.clip(cosines(x, known, spectra), -1.0, 1.0))
    length = np.linalg.norm(x, axis=1)
    nearest = np.argmin(between, axis=1)
    least = between[np.arange(len(x)), nearest]
    second = np.partition(between, 1, axis=1)[:, 1] if len(spectra) > 1 else np.full(len(x), np.pi)
    some = known.any(axis=1) & (length > 0)
    with np.errstate(all="ignore"):
        turned = np.sqrt(np.sum(np.where(known, noise, 0.0) ** 2, axis=1)) / length
    value, margin, turned = (np.where(some, one, np.nan) for one in (least, second - least, turned))
    return Angles(np.where(some, nearest, UNCLASSIFIED), value, margin, turned, length)


def angle_between(a: Float[np.ndarray, "*n band"], b: Float[np.ndarray, "*n band"]) -> Float[np.ndarray, "*n"]:
    """Of spectra [rad], exact for small ones."""
    u, v = (x / np.linalg.norm(x, axis=-1, keepdims=True) for x in (a, b))
    return 2.0 * np.arctan2(np.linalg.norm(u - v, axis=-1), np.linalg.norm(u + v, axis=-1))


def limits(
    noise: Float[np.ndarray, " n"],
    common: Float[np.ndarray, " class"],
    variability: Float[np.ndarray, " class"],
) -> Float[np.ndarray, "n class"]:
    """Of the angle of each cell to each class [rad]."""
    return FACTOR * np.sqrt(noise[:, None] ** 2 + (common**2 + variability**2)[None])
