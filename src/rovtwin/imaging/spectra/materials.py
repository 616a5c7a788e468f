"""How materials of the seabed look by wavelength: shapes of reflectance made here, not measured.

A shape is a line or a step and bumps and dips upon it, placed where the literature has the features; heights are such
as papers show. They are for simulation: whoever classifies real lines needs spectra taken in the field.

References: brown, red and green algae, corals and sand Hochberg, Atkinson and Andrefouet (2003), Remote Sensing of
Environment 85(2): peaks of corals and brown algae at 575, 600 and 650 nm, phycoerythrin's bands at 495, 545 and 570 nm,
chlorophyll a at 675 nm, rise beyond 700 nm. Iron oxides Cornell and Schwertmann (2003), The Iron Oxides: the edge near
570 nm, a band at 860 nm.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from jaxtyping import Float

_Shape = Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, " n"]]


def _line(wavelength: np.ndarray, at_400: float, at_700: float) -> np.ndarray:
    return at_400 + (at_700 - at_400) * (wavelength - 400.0) / 300.0


def _step(wavelength: np.ndarray, middle: float, wide: float) -> np.ndarray:
    """From 0 to 1 about a wavelength, in `wide` [nm] from 12 to 88 %."""
    return 1.0 / (1.0 + np.exp(-4.0 * (wavelength - middle) / wide))


def _bump(wavelength: np.ndarray, middle: float, sigma: float) -> np.ndarray:
    return np.exp(-0.5 * ((wavelength - middle) / sigma) ** 2)


def _sand(w: np.ndarray) -> np.ndarray:
    return 0.18 + 0.30 * (1.0 - np.exp(-np.maximum(w - 350.0, 0.0) / 170.0)) - 0.035 * _bump(w, 675.0, 12.0)


def _mud(w: np.ndarray) -> np.ndarray:
    return _line(w, 0.05, 0.13) - 0.02 * _bump(w, 675.0, 14.0) - 0.012 * _bump(w, 500.0, 40.0)


def _rock(w: np.ndarray) -> np.ndarray:
    return _line(w, 0.09, 0.15) + 0.01 * _step(w, 560.0, 80.0)


def _kelp(w: np.ndarray) -> np.ndarray:
    peaks = 0.028 * _bump(w, 575.0, 16.0) + 0.032 * _bump(w, 602.0, 12.0) + 0.036 * _bump(w, 648.0, 14.0)
    return 0.018 + peaks + 0.26 * _step(w, 712.0, 30.0)


def _maerl(w: np.ndarray) -> np.ndarray:
    bands = 0.05 * _bump(w, 495.0, 14.0) + 0.055 * _bump(w, 545.0, 13.0) + 0.06 * _bump(w, 570.0, 11.0)
    red = 0.20 * _step(w, 590.0, 24.0) - 0.13 * _bump(w, 675.0, 14.0) + 0.20 * _step(w, 712.0, 28.0)
    return np.maximum(0.085 + _line(w, -0.02, 0.05) - 0.5 * bands + red, 0.01)


def _coral(w: np.ndarray) -> np.ndarray:
    peaks = 0.07 * _bump(w, 575.0, 12.0) + 0.08 * _bump(w, 604.0, 13.0) + 0.075 * _bump(w, 650.0, 12.0)
    return 0.05 + 0.06 * _step(w, 540.0, 60.0) + peaks - 0.05 * _bump(w, 675.0, 11.0) + 0.30 * _step(w, 708.0, 28.0)


def _green_algae(w: np.ndarray) -> np.ndarray:
    green = 0.11 * _bump(w, 553.0, 28.0) + 0.04 * _bump(w, 620.0, 22.0)
    return 0.03 + green - 0.01 * _bump(w, 675.0, 13.0) + 0.32 * _step(w, 710.0, 26.0)


def _rust(w: np.ndarray) -> np.ndarray:
    return 0.03 + 0.20 * _step(w, 578.0, 60.0) + 0.06 * _step(w, 720.0, 90.0) - 0.05 * _bump(w, 860.0, 50.0)


def _paint(w: np.ndarray, base: float, high: float, edge: float, wide: float) -> np.ndarray:
    return base + (high - base) * _step(w, edge, wide)


def _flat(w: np.ndarray, value: float) -> np.ndarray:
    return np.full_like(w, value)


MATERIALS: dict[str, _Shape] = {
    "sand": _sand,
    "mud": _mud,
    "rock": _rock,
    "kelp": _kelp,
    "maerl": _maerl,
    "coral": _coral,
    "green_algae": _green_algae,
    "rust": _rust,
    "paint_white": partial(_paint, base=0.35, high=0.85, edge=405.0, wide=30.0),
    "paint_yellow": partial(_paint, base=0.05, high=0.70, edge=505.0, wide=45.0),
    "paint_red": partial(_paint, base=0.04, high=0.60, edge=600.0, wide=40.0),
    "white_50": partial(_flat, value=0.50),
    "grey_20": partial(_flat, value=0.20),
    "black_3": partial(_flat, value=0.03),
}


def reflectance(material: str, wavelength: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Of a material of `MATERIALS` at wavelengths [nm]."""
    return MATERIALS[material](np.asarray(wavelength, float))


def reflectance_of_colour(
    colour: Float[np.ndarray, "3"], bands: Float[np.ndarray, "3"], wavelength: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Of a surface of which only a colour is known: linear between three bands [nm], held beyond them."""
    order = np.argsort(bands)
    return np.interp(wavelength, np.asarray(bands)[order], np.asarray(colour)[order])
