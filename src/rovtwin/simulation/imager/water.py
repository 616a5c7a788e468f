"""The water of a scene by wavelength: the same that its cameras see, filled up between their bands."""

import numpy as np
from jaxtyping import Float

from rovtwin.imaging.spectra.water import SpectralWater
from rovtwin.simulation.camera.water import Optics
from rovtwin.simulation.scene.schema import BANDS, Water


def spectral_water(water: Water, wavelength: Float[np.ndarray, " n"]) -> SpectralWater:
    """Of a scene's water at wavelengths [nm]."""
    if water.constituents is not None:
        return SpectralWater.of(water.constituents, wavelength)
    known = Optics.of(water)
    return SpectralWater.of_bands(known.absorption, known.scattering, BANDS, wavelength)
