"""How far areas by unmixing may be off: the estimate repeated on cells made up from what it found.

    x* = s (sum_k a_k e*_k) (1 + sum_j z_j d_j) + noise,    e*_k = e_k (1 + q_k),    delta = mean a(x*) - mean a

Each draw has other true spectra e* (the library is off by its variability, smooth over some 60 nm), other errors d_j of
height, water and lamps, and other noise; it is unmixed with the library as it is. All of these are common to all cells,
the worst that errors can do to a sum. Spectra and heights that vary from cell to cell besides average out in a sum but
let shares grow that cannot be negative: an absent class gets some area. How much they vary nobody states; each draw
takes from none to all of it. The truth is taken to lie below or above the estimate by as much as the estimate lies
above or below what it was drawn from. What the draws are off by on average is not taken off.

Reference: Davison and Hinkley (1997), Bootstrap Methods and their Application, sec. 2.4 (basic interval).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.mapping.classes.angle import angle_between
from rovtwin.mapping.classes.unmixing import Unmixing

VARYING = "height"  # error that varies from cell to cell, too; water and lamps do not
LENGTH = 60.0  # over which spectra of one material differ alike [nm]
LEVEL = (2.5, 97.5)  # percentiles
_DARKEST = 0.05  # of what an error leaves of a value
_SHAPES = 12  # of the smooth differences
_TRIED = 200  # of which the size of a difference is taken


@dataclass(frozen=True)
class Sample:
    """Cells that stand for all.

    Attributes:
        share: Of each class.
        brightness: By which their mixture is multiplied.
        scale: Of their noise.
    """

    share: Float[np.ndarray, "n class"]
    brightness: Float[np.ndarray, " n"]
    scale: Float[np.ndarray, " n"]


def deviations(
    unmixing: Unmixing,
    sample: Sample,
    wavelengths: Float[np.ndarray, " band"],
    errors: dict[str, Float[np.ndarray, " band"]],
    variability: Float[np.ndarray, " class"],
    draws: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, "draw class"]:
    """By how much the mean share of each class is off, in draws.

    Args:
        unmixing: As the cells were unmixed.
        sample: Cells.
        wavelengths: Of the bands [nm].
        errors: Relative standard deviations of height, water and lamps by band.
        variability: Of each class [rad].
        draws: How many.
        rng: Of them.
    """
    basis = _smooth(wavelengths)
    size = _sizes(unmixing.spectra, basis, rng)
    middle, found = sample.share.mean(axis=0), []
    for _ in range(draws):
        x = _made_up(unmixing, sample, basis, size, errors, variability, rng)
        found.append(np.nanmean(unmixing.coefficients(x)[1], axis=0))
    return np.array(found) - middle


def _made_up(
    unmixing: Unmixing,
    sample: Sample,
    basis: Float[np.ndarray, "shape band"],
    size: Float[np.ndarray, " class"],
    errors: dict[str, Float[np.ndarray, " band"]],
    variability: Float[np.ndarray, " class"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "n band"]:
    n, count = sample.share.shape
    amount, varying = variability / size, rng.random()
    q = rng.standard_normal((count, len(basis))) @ basis
    spectra = unmixing.spectra * np.maximum(1.0 + amount[:, None] * q, _DARKEST)
    own = rng.standard_normal((n, len(basis)), np.float32) @ basis
    gain = 1.0 + varying * (sample.share @ amount)[:, None] * own
    for name, d in errors.items():
        local = varying * rng.standard_normal((n, 1)) if name == VARYING else 0.0
        gain = gain + (rng.standard_normal() + local) * d
    x = sample.brightness[:, None] * (sample.share @ spectra) * np.maximum(gain, _DARKEST)
    return x + sample.scale[:, None] * unmixing.noise * rng.standard_normal(x.shape, np.float32)


def _smooth(wavelengths: Float[np.ndarray, " band"]) -> Float[np.ndarray, "shape band"]:
    """Of a process of unit variance that is smooth over `LENGTH`: normal numbers times this."""
    apart = (wavelengths[:, None] - wavelengths[None]) / LENGTH
    values, vectors = np.linalg.eigh(np.exp(-0.5 * apart**2))
    most = min(_SHAPES, len(wavelengths))
    return (vectors[:, -most:] * np.sqrt(np.maximum(values[-most:], 0.0))).T


def _sizes(
    spectra: Float[np.ndarray, "class band"], basis: Float[np.ndarray, "shape band"], rng: np.random.Generator
) -> Float[np.ndarray, " class"]:
    """Root mean square angle by which differences of unit variance turn each spectrum, for small ones [rad]."""
    small = 1e-3
    q = small * rng.standard_normal((_TRIED, len(basis))) @ basis
    turned = angle_between(spectra[:, None], spectra[:, None] * (1.0 + q[None]))
    return np.sqrt(np.mean(turned**2, axis=1)) / small


def interval(
    share: Float[np.ndarray, " class"], deviation: Float[np.ndarray, "draw class"], most: float
) -> tuple[Float[np.ndarray, " class"], Float[np.ndarray, " class"]]:
    """Of shares, 95 %, between 0 and `most`; what estimates are off by on average widens it, and never narrows it."""
    low, middle, high = np.percentile(deviation, (LEVEL[0], 50.0, LEVEL[1]), axis=0)
    down, up = np.maximum(high, high - middle), np.maximum(-low, middle - low)
    return np.maximum(share - down, 0.0), np.minimum(share + up, most)
