"""What lamps and daylight give by wavelength.

Reference: black bodies Planck (1901). Daylight is that of a black body of 5800 K, scaled to a clear noon at the
surface: 1.3 W/(m2 nm) at 550 nm, as tables of global irradiance have it (ASTM G173: 1.5 on a tilted plane).
"""

import numpy as np
from jaxtyping import Float

from rovtwin.imaging.schema import Lamp

NOON, SUN = 1.3, 5800.0  # irradiance at 550 nm [W/(m2 nm)], temperature [K]
FIRST, LAST = 380.0, 800.0  # between which a lamp's radiant flux is counted [nm]
_SECOND = 1.438777e7  # h c / k [nm K]


def black_body(wavelength: Float[np.ndarray, " n"], temperature: float) -> Float[np.ndarray, " n"]:
    """Shape of its spectrum, 1 at 550 nm."""

    def planck(w: np.ndarray) -> np.ndarray:
        return w**-5.0 / np.expm1(_SECOND / (w * temperature))

    return planck(np.asarray(wavelength, float)) / planck(np.array(550.0))


def daylight(wavelength: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Downward irradiance just below the surface on a clear noon [W/(m2 nm)]."""
    return NOON * black_body(wavelength, SUN)


def lamp_exponent(lamp: Lamp) -> float:
    """M of its beam: intensity goes as cos^m of the angle from its axis, half at half the beam."""
    return float(np.log(0.5) / np.log(np.cos(np.radians(0.5 * lamp.beam_deg))))


def lamp_intensity(lamp: Lamp, wavelength: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Spectral radiant intensity on its axis [W/(sr nm)] at wavelengths [nm].

    The flux of a beam cos^m is 2 pi / (m + 1) of the intensity on its axis.
    """

    def shape(at: np.ndarray) -> np.ndarray:
        if lamp.temperature is not None:
            return black_body(at, lamp.temperature)
        rows = np.array(lamp.spectrum)
        return np.interp(at, rows[:, 0], rows[:, 1], left=0.0, right=0.0)

    fine = np.linspace(FIRST, LAST, 841)
    whole = float(np.trapezoid(shape(fine), fine))
    flux = lamp.radiant_flux / max(whole, 1e-300)
    return flux * (lamp_exponent(lamp) + 1.0) / (2.0 * np.pi) * shape(np.asarray(wavelength, float))
