"""Spectral radiance that comes to the port along each ray: floor under lamps and daylight, water between, its veil.

With rho the reflectance of a matt floor, s the way to it, lamps k at distances r_k, z its depth, all by wavelength:

    L = rho (sum_k I_k cos^m(theta_k) cos(alpha_k) / (pi r_k^2) e^(-c r_k) + E_0 e^(-K z) day / pi) e^(-c s)
        + sum_k integral_0^s b_b / (2 pi) I_k cos^m(theta_k) / r_k^2 e^(-c (r_k + s')) ds'
        + E_0 e^(-K z_port) 0.33 b_b / (a + b_b) / pi (1 - e^(-c s))

Light is scattered once: what comes back out of lamps' beams goes evenly into the backward half; what is scattered
forward by small angles counts as lost. Daylight's own veil is that of deep water seen from above.

References: Jaffe (1990), Computer modeling and the design of optimal underwater imaging systems, IEEE J. Oceanic Eng.
15(2). Reflectance of deep water Morel and Prieur (1977), Limnology and Oceanography 22(4): 0.33 b_b / a.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from rovtwin.imaging.floor import FloorHits
from rovtwin.imaging.imager import Imager
from rovtwin.imaging.spectra.light import daylight, lamp_exponent, lamp_intensity
from rovtwin.imaging.spectra.water import SpectralWater

FINE = 1.0  # step of wavelengths of which bands take their means [nm]
_DEEP = 0.33  # reflectance of deep water over b_b / (a + b_b)
_CLOSEST = 0.05  # to a lamp, for its veil: the square law ends at its face [m]
_NODES, _ACROSS, _WITHIN = 40, 33, 4  # of the table of lamps' veil: along a ray, along the line, sums between nodes


def fine_wavelengths(imager: Imager) -> Float[np.ndarray, " fine"]:
    """Wavelengths of which the bands of an imager take their means [nm]."""
    bands, wide = imager.wavelengths, 3.0 * imager.fwhm
    return np.arange(bands[0] - wide[0], bands[-1] + wide[-1] + FINE, FINE)


@dataclass(frozen=True)
class Radiometry:
    """An imager and its lamps in a water.

    Attributes:
        imager: With its lamps.
        at_fine: The water at `fine_wavelengths` of the imager.
        longest: Way beyond which nothing is seen [m].
        surface: Share of a clear noon's daylight below the surface.
        below: Share of that light that falls on a face whichever way it leans.
        sun: Unit vector towards where the rest comes from, n.
    """

    imager: Imager
    at_fine: SpectralWater
    longest: float
    surface: float = 0.0
    below: float = 1.0
    sun: tuple[float, float, float] = (0.0, 0.0, -1.0)

    @property
    def fine(self) -> Float[np.ndarray, " fine"]:
        """Wavelengths of which bands take their means [nm]."""
        return fine_wavelengths(self.imager)

    def _band(self, spectrum: np.ndarray) -> np.ndarray:
        return self.imager.in_bands(spectrum, self.fine).astype(np.float32)

    @cached_property
    def water(self) -> SpectralWater:
        """In the bands, means over their responses."""
        fine = self.at_fine
        return SpectralWater(*(self._band(x) for x in (fine.absorption, fine.scattering, fine.backscattering)))

    @cached_property
    def intensities(self) -> Float[np.ndarray, "lamp band"]:
        """Of the lamps on their axes [W/(sr nm)]."""
        rows = [self._band(lamp_intensity(lamp, self.fine)) for lamp in self.imager.file.lamps]
        return np.array(rows, np.float32).reshape(len(rows), len(self.imager.wavelengths))

    @cached_property
    def day(self) -> Float[np.ndarray, " band"]:
        """Daylight below the surface [W/(m2 nm)]."""
        return self._band(self.surface * daylight(self.fine))

    def prepare(self) -> None:
        """Computes what all lines share, before threads do it each for itself."""
        _ = self.water, self.day, self.intensities
        if self.imager.file.lamps:
            _ = self._veils

    def radiance(
        self,
        albedo: Float[np.ndarray, "pixel band"],
        hits: FloorHits,
        position: Float[np.ndarray, "3"],
        R_ns: Float[np.ndarray, "3 3"],
    ) -> Float[np.ndarray, "pixel band"]:
        """Of one line [W/(m2 sr nm)], float32.

        Args:
            albedo: Reflectance of what each pixel sees.
            hits: Where its rays end.
            position: Of the centre of projection, n [m].
            R_ns: Maps the imager's frame to n.
        """
        gain, veil = self.gain_and_veil(hits, position, R_ns)
        gain *= albedo
        gain += veil
        return gain

    def gain_and_veil(
        self,
        hits: FloorHits,
        position: Float[np.ndarray, "3"],
        R_ns: Float[np.ndarray, "3 3"],
        pixels: Int[np.ndarray, " pixel"] | None = None,
    ) -> tuple[Float[np.ndarray, "pixel band"], Float[np.ndarray, "pixel band"]]:
        """Radiance of a floor of reflectance 1 as it comes to the port, and what the water adds, float32.

        Args:
            hits: Where rays of a line end.
            position: Of the centre of projection, n [m].
            R_ns: Maps the imager's frame to n.
            pixels: Numbers of the pixels whose rays these are; None: all.
        """
        beam, seen = self.water.beam, np.isfinite(hits.way)
        way = np.where(seen, hits.way, self.longest).astype(np.float32)
        through = _decay(way, beam)
        gain = self._lamplight(hits, position, R_ns)
        if self.surface > 0:
            gain += self._daylight(hits)
        gain[~seen] = 0.0
        gain *= through
        veil = self._veil(way, pixels)
        if self.surface > 0:
            a, b_b = self.water.absorption, self.water.backscattering
            day = self.day * np.exp(-self.water.diffuse * max(float(position[2]), 0.0))
            deep = np.subtract(1.0, through, out=through)
            deep *= (day * _DEEP * b_b / (a + b_b) / np.pi).astype(np.float32)
            veil += deep
        return gain, veil

    def _lamplight(
        self, hits: FloorHits, position: Float[np.ndarray, "3"], R_ns: Float[np.ndarray, "3 3"]
    ) -> Float[np.ndarray, "pixel band"]:
        """Irradiance of the lamps over pi."""
        total = np.zeros((len(hits.way), len(self.imager.wavelengths)), np.float32)
        for lamp, intensity in zip(self.imager.file.lamps, self.intensities, strict=True):
            axis = R_ns @ _unit(lamp.direction)
            to = np.nan_to_num(hits.point) - (position + R_ns @ np.array(lamp.position))
            far = np.maximum(np.linalg.norm(to, axis=1), _CLOSEST)
            beam = np.maximum(to @ axis / far, 0.0) ** lamp_exponent(lamp)
            facing = np.maximum(-np.sum(to * hits.normal, axis=1) / far, 0.0)
            share = (beam * facing / (np.pi * far**2)).astype(np.float32)
            lost = _decay(far.astype(np.float32), self.water.beam)
            lost *= intensity
            lost *= share[:, None]
            total += lost
        return total

    def _daylight(self, hits: FloorHits) -> Float[np.ndarray, "pixel band"]:
        """Irradiance of daylight over pi, on a face that leans as cameras have it."""
        below, n = self.below, hits.normal
        facing = below + (1.0 - below) * 0.5 * (1.0 + n @ np.array(self.sun))
        depth = np.maximum(np.nan_to_num(hits.point[:, 2]), 0.0).astype(np.float32)
        found = _decay(depth, self.water.diffuse.astype(np.float32))
        found *= self.day / np.float32(np.pi)
        found *= facing.astype(np.float32)[:, None]
        return found

    def _veil(
        self, way: Float[np.ndarray, " pixel"], pixels: Int[np.ndarray, " pixel"] | None
    ) -> Float[np.ndarray, "pixel band"]:
        """What the water scatters back of the lamps along rays of these lengths [m]."""
        if not self.imager.file.lamps:
            return np.zeros((len(way), len(self.imager.wavelengths)), np.float32)
        at = np.sqrt(np.clip(way / self.longest, 0.0, 1.0)) * (_NODES - 1)
        low = np.minimum(at.astype(int), _NODES - 2)
        part, pixel = (at - low).astype(np.float32)[:, None], np.arange(len(way)) if pixels is None else pixels
        found = self._veils[pixel, low]
        found += part * (self._veils[pixel, low + 1] - found)
        return found

    @cached_property
    def _veils(self) -> Float[np.ndarray, "pixel node band"]:
        """The integral up to nodes along each ray, closer together near the port; the same for every line.

        Lamps and rays move together. It is summed for some pixels and linear between them.
        """
        point, direction = self.imager.rays()
        some = np.linspace(0, self.imager.pixels - 1, min(_ACROSS, self.imager.pixels))
        whole = np.arange(self.imager.pixels)
        origin, along = (np.stack([np.interp(some, whole, x[:, i]) for i in range(3)], 1) for x in (point, direction))
        nodes = self.longest * (np.arange(_NODES) / (_NODES - 1)) ** 2
        table = np.zeros((len(some), _NODES, len(self.imager.wavelengths)))
        back = self.water.backscattering / (2.0 * np.pi)
        for k in range(1, _NODES):
            step = (nodes[k] - nodes[k - 1]) / _WITHIN
            table[:, k] = table[:, k - 1]
            for j in range(_WITHIN):
                table[:, k] += step * back * self._lit_water(origin, along, nodes[k - 1] + (j + 0.5) * step)
        index = np.searchsorted(some, whole, side="right").clip(1, len(some) - 1)
        part = (whole - some[index - 1]) / (some[index] - some[index - 1])
        return (table[index - 1] + part[:, None, None] * (table[index] - table[index - 1])).astype(np.float32)

    def _lit_water(
        self, origin: Float[np.ndarray, "some 3"], along: Float[np.ndarray, "some 3"], at: float
    ) -> Float[np.ndarray, "some band"]:
        """Light of the lamps on water at a way along rays, less what is lost on both ways."""
        total = np.zeros((len(origin), len(self.imager.wavelengths)))
        for lamp, intensity in zip(self.imager.file.lamps, self.intensities, strict=True):
            to = origin + at * along - np.array(lamp.position)
            far = np.maximum(np.linalg.norm(to, axis=1), _CLOSEST)
            beam = np.maximum(to @ _unit(lamp.direction) / far, 0.0) ** lamp_exponent(lamp) / far**2
            total += beam[:, None] * intensity * np.exp(-np.multiply.outer(far + at, self.water.beam))
        return total


def _decay(way: Float[np.ndarray, " pixel"], rate: Float[np.ndarray, " band"]) -> Float[np.ndarray, "pixel band"]:
    """exp(-rate way)."""
    found = np.multiply.outer(way, -rate)
    return np.exp(found, out=found)


def _unit(vector: list[float]) -> Float[np.ndarray, "3"]:
    return np.array(vector) / np.linalg.norm(vector)
