"""A natural water by wavelength: pure water, dissolved organic matter and particles together.

    a = a_water + a_cdom(440) exp(-S (lambda - 440)) + a_detritus(440) exp(-S_d (lambda - 440)) + chl a_phi
    b = b_water + b_p(550) (550 / lambda)^eta,    c = a + b,    b_b = b_water / 2 + share b_p
    K = sqrt(a^2 + 0.256 a b)

A beam loses what is absorbed and what is scattered, forward by small angles as well.

References: S of CDOM Bricaud, Morel and Prieur (1981), Limnology and Oceanography 26(1): 0.014 +- 0.003 1/nm. Detritus
Babin et al. (2003), JGR 108(C7), 3211: 0.0123 1/nm. Particles' power law and chlorophyll's two bands in the manner of
Gordon and Morel (1983), Remote assessment of ocean color; absorption of phytoplankton 0.05 and 0.023 m2/mg at 440 and
675 nm as Bricaud et al. (1995), JGR 100(C7), has it for about 1 mg/m3. Share of particles' scattering that goes back
Petzold (1972), SIO Ref. 72-78: 1.8 %. K Kirk (1984), Limnology and Oceanography 29(2), for a high sun.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from pydantic import Field

from rovtwin.core.user_files.config import NonNegative, Number, Strict
from rovtwin.imaging.spectra.pure_water import pure_absorption, pure_scattering

BACK = 0.018  # share of particles' scattering that goes backwards
KIRK = 0.256
_DETRITUS = 0.0123  # [1/nm]
_PIGMENT = ((0.05, 440.0, 28.0), (0.023, 675.0, 10.0))  # [m2/mg], centre and standard deviation [nm]


class Constituents(Strict):
    """What is in a water beside water; the defaults are a coastal water."""

    cdom_440: NonNegative = Field(0.12, description="absorption of coloured dissolved organic matter at 440 nm [1/m]")
    cdom_slope: NonNegative = Field(0.015, description="S, how it falls off with wavelength [1/nm]")
    scattering_550: NonNegative = Field(0.17, description="b_p of particles at 550 nm [1/m]")
    scattering_exponent: Number = Field(1.0, description="eta, b_p goes as (550 / wavelength)^eta; 0 for large grains")
    detritus_440: NonNegative = Field(0.0, description="absorption of dead particles at 440 nm [1/m]")
    chlorophyll: NonNegative = Field(0.0, description="[mg/m3]")


@dataclass(frozen=True)
class SpectralWater:
    """Of a water at some wavelengths [1/m].

    Attributes:
        absorption: a.
        scattering: b.
        backscattering: b_b.
    """

    absorption: Float[np.ndarray, " n"]
    scattering: Float[np.ndarray, " n"]
    backscattering: Float[np.ndarray, " n"]

    @classmethod
    def of(cls, given: Constituents, wavelength: Float[np.ndarray, " n"]) -> "SpectralWater":
        """Of what is in it, at wavelengths [nm]."""
        past = np.asarray(wavelength) - 440.0
        absorption = pure_absorption(wavelength) + given.cdom_440 * np.exp(-given.cdom_slope * past)
        absorption = absorption + given.detritus_440 * np.exp(-_DETRITUS * past)
        for size, middle, wide in _PIGMENT:
            bump = np.exp(-0.5 * ((np.asarray(wavelength) - middle) / wide) ** 2)
            absorption = absorption + given.chlorophyll * size * bump
        particles = given.scattering_550 * (550.0 / np.asarray(wavelength)) ** given.scattering_exponent
        return cls.with_particles(absorption, particles, wavelength)

    @classmethod
    def of_bands(
        cls,
        absorption: Float[np.ndarray, " m"],
        scattering: Float[np.ndarray, " m"],
        bands: Float[np.ndarray, " m"],
        wavelength: Float[np.ndarray, " n"],
    ) -> "SpectralWater":
        """Of a water that is known in some bands [nm] only, as a camera's three: exact there.

        What is absorbed beyond pure water goes exponentially from band to band, and is held beyond the last to the red;
        to the blue it goes on as between the first two. What is scattered is linear between them and held beyond.
        """
        order = np.argsort(bands)
        bands, absorption, scattering = (np.asarray(x, float)[order] for x in (bands, absorption, scattering))
        more = np.log(np.maximum(absorption - pure_absorption(bands), 1e-6))
        blue = more[0] + np.maximum(bands[0] - wavelength, 0.0) * np.maximum(more[0] - more[1], 0.0) / np.diff(bands)[0]
        extra = np.exp(np.where(wavelength < bands[0], blue, np.interp(wavelength, bands, more)))
        total = np.interp(wavelength, bands, scattering)
        particles = np.maximum(total - pure_scattering(wavelength), 0.0)
        return cls.with_particles(pure_absorption(wavelength) + extra, particles, wavelength)

    @classmethod
    def with_particles(
        cls,
        absorption: Float[np.ndarray, " n"],
        particles: Float[np.ndarray, " n"],
        wavelength: Float[np.ndarray, " n"],
    ) -> "SpectralWater":
        """Of its absorption, and what particles scatter beside the water itself."""
        pure = pure_scattering(wavelength)
        return cls(absorption, pure + particles, 0.5 * pure + BACK * particles)

    @property
    def beam(self) -> Float[np.ndarray, " n"]:
        """C = a + b: what a beam of light loses."""
        return self.absorption + self.scattering

    @property
    def diffuse(self) -> Float[np.ndarray, " n"]:
        """K: what light from above loses with depth."""
        return np.sqrt(self.absorption**2 + KIRK * self.absorption * self.scattering)
