"""What water does to light, in three bands: red, green and blue as a camera sees them (600, 550, 450 nm).

A ray from a surface arrives with exp(-c r) of its light; what the water scatters into the ray on its way is the veil,
which grows with 1 - exp(-c r). Light from above falls off with depth as exp(-K z). Light that is scattered forward by
small angles counts as lost, so that contrast is under-estimated rather than over-estimated, and nothing is blurred.

References: pure water Pope and Fry (1997), Applied Optics 36(33). Water types Jerlov (1976), Marine Optics, table
XXVII. K from a and b Kirk (1984), Limnology and Oceanography 29(2), K^2 = a^2 + 0.256 a b for a high sun.
Backscattering Petzold (1972), SIO Ref. 72-78: about 1.8 % of b.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.imaging.spectra.water import KIRK, SpectralWater
from rovtwin.simulation.scene.schema import BANDS, Water

PURE = np.array([0.2224, 0.0565, 0.00922])  # a of pure water [1/m]
CLEAR = 0.05  # b of a filtered tank [1/m]: an estimate
# K of downward light [1/m].
_JERLOV = {
    "I": (0.235, 0.063, 0.019),
    "IA": (0.24, 0.067, 0.026),
    "IB": (0.245, 0.072, 0.036),
    "II": (0.26, 0.089, 0.068),
    "III": (0.295, 0.12, 0.135),
    "1C": (0.30, 0.12, 0.25),
    "3C": (0.33, 0.19, 0.39),
    "5C": (0.40, 0.30, 0.56),
    "7C": (0.48, 0.46, 0.89),
    "9C": (0.60, 0.63, 1.60),
}
# b over what K in green has above pure water. The factor is ours: with it the oceanic types come out as chlorophyll
# has it (Gordon and Morel, 1983) to about a factor of 1.5.
_SCATTERING = 5.0


@dataclass(frozen=True)
class Optics:
    """Of a water, bands red, green, blue [1/m].

    Attributes:
        absorption: a.
        scattering: b.
    """

    absorption: Float[np.ndarray, "3"]
    scattering: Float[np.ndarray, "3"]

    @classmethod
    def of(cls, water: Water) -> "Optics":
        """As a scene file says it."""
        if water.constituents is not None:
            spectral = SpectralWater.of(water.constituents, BANDS)
            return cls(spectral.absorption, spectral.scattering)
        if water.type == "clear_tank":
            a, b = PURE, np.full(3, CLEAR)
        else:
            K = np.array(_JERLOV[water.type.removeprefix("jerlov_")])
            b = np.full(3, _SCATTERING * (K[1] - PURE[1]))
            a = np.sqrt((0.5 * KIRK * b) ** 2 + K**2) - 0.5 * KIRK * b  # Kirk's formula, solved for a
        a = a if water.absorption is None else np.array(water.absorption)
        b = b if water.scattering is None else np.array(water.scattering)
        if water.beam_attenuation is not None:
            b = np.full(3, max(water.beam_attenuation - a[1], 0.0))
        return cls(a, b)

    @property
    def beam(self) -> Float[np.ndarray, "3"]:
        """C = a + b: what a beam of light loses."""
        return self.absorption + self.scattering

    @property
    def diffuse(self) -> Float[np.ndarray, "3"]:
        """K: what light from above loses with depth."""
        a, b = self.absorption, self.scattering
        return np.sqrt(a**2 + KIRK * a * b)

    @property
    def veil(self) -> Float[np.ndarray, "3"]:
        """Brightness of endless water seen horizontally, over that of a white surface that faces the light.

        Half of what isotropic scattering of all light would give, as light comes mostly from above and is scattered
        mostly forward: b / (8 c). An estimate.
        """
        return 0.125 * self.scattering / np.maximum(self.beam, 1e-12)
