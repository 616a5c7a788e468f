"""From radiance to counts: optics, quantum efficiency, dark current, shot and read noise, full well, rounding.

    N = R L t + D t + noise,    count = round(offset + min(N, full well) / g)
    R = A Omega dlambda tau q lambda / (h c) / n^2 cos^4(theta)

A is the pixel on the slit, Omega = pi / (4 F^2 + 1) the cone of the lens, n that of the water: radiance in the air
behind the port is that in the water over n^2. theta is a pixel's angle in air: natural vignetting.

Reference: EMVA Standard 1288, release 4.0, for noise of a linear camera.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, UInt16

from rovtwin.imaging.imager import Imager

_PHOTON = 1.98644586e-16  # h c [J nm]
_DARKS = 200  # dark lines of which a dark frame is the mean
_FIXED, _DARK, _LINES = 0xF1, 0xDA, 0x11  # keep draws of one seed apart


@dataclass(frozen=True)
class DetectorModel:
    """An imager's detector.

    Attributes:
        imager: Whose.
        seed: Of its own pattern and of the noise.
    """

    imager: Imager
    seed: int

    @property
    def full(self) -> float:
        """Count of a pixel that is full."""
        return float(2**self.imager.file.detector.bits - 1)

    @cached_property
    def gain(self) -> float:
        """Electrons a count."""
        given = self.imager.file.detector
        return given.full_well / (self.full - given.offset)

    @cached_property
    def response(self) -> Float[np.ndarray, "pixel band"]:
        """R, electrons a second for a radiance in the water of 1 W/(m2 sr nm), pixels' own pattern included."""
        file, w = self.imager.file, self.imager.wavelengths
        area = 1e-12 * file.detector.pixel_um * file.optics.slit_um
        cone = np.pi / (4.0 * file.optics.f_number**2 + 1.0)
        rows = np.array(file.detector.quantum_efficiency)
        efficiency = np.interp(w, rows[:, 0], rows[:, 1])
        index = 1.0 if file.port is None else file.port.water
        band = area * cone * self.imager.widths * file.optics.transmission * efficiency * w / _PHOTON / index**2
        sine = np.sin(self.imager.view_angles) * (1.0 if file.port is None else file.port.water)
        across = (1.0 - sine**2) ** 2
        return (across[:, None] * band * self._pattern[0]).astype(np.float32)

    @cached_property
    def dark_rate(self) -> Float[np.ndarray, "pixel band"]:
        """D, electrons a second."""
        return (self.imager.file.detector.dark_current * self._pattern[1]).astype(np.float32)

    @cached_property
    def _pattern(self) -> Float[np.ndarray, "2 pixel band"]:
        """Of response and dark current, about 1."""
        rng = np.random.default_rng([self.seed, _FIXED])
        draws = rng.standard_normal((2, self.imager.pixels, len(self.imager.wavelengths)))
        return np.maximum(1.0 + self.imager.file.detector.uniformity * draws, 0.0)

    def counts(self, radiance: Float[np.ndarray, "pixel band"], line: int) -> UInt16[np.ndarray, "pixel band"]:
        """Of a line: the same for the same seed and number of the line."""
        given = self.imager.file
        electrons = radiance * self.response
        electrons += self.dark_rate
        electrons *= np.float32(given.exposure)
        rng = np.random.default_rng([self.seed, _LINES, line])
        noise = rng.standard_normal(electrons.shape, dtype=np.float32)
        noise *= np.sqrt(electrons + np.float32(given.detector.read_noise**2))
        electrons += noise
        np.minimum(electrons, np.float32(given.detector.full_well), out=electrons)
        electrons *= np.float32(1.0 / self.gain)
        electrons += np.float32(given.detector.offset)
        return np.clip(np.rint(electrons, out=electrons), 0.0, self.full).astype(np.uint16)

    @cached_property
    def dark_frame(self) -> Float[np.ndarray, "pixel band"]:
        """As a calibration finds it: the mean of some lines with the port covered [counts]."""
        given = self.imager.file
        dark = self.dark_rate * given.exposure
        std = np.sqrt((dark + given.detector.read_noise**2) / _DARKS)
        rng = np.random.default_rng([self.seed, _DARK])
        return given.detector.offset + (dark + std * rng.standard_normal(dark.shape)) / self.gain

    @property
    def response_frame(self) -> Float[np.ndarray, "pixel band"]:
        """Counts a second for a radiance of 1, as a perfect calibration finds it."""
        return self.response.astype(float) / self.gain
