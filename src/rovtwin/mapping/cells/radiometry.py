"""From counts to reflectance: the veil taken off, the rest over what a floor of reflectance 1 would send; with noise.

    rho = (L - veil) / gain,    var(rho) = var(L) / gain^2,    var(N) = N + read noise^2    [electrons]

Gain and veil are those of `imaging.radiance`: lamps, both ways through the water, daylight, the floor's lean. Where
lamps or water are unknown there is radiance alone, which a reference panel (`cells.panel`) scales.

Reference: EMVA Standard 1288, release 4.0, for noise of a linear camera.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np
from jaxtyping import Float, Int

from rovtwin.imaging.floor import FloorHits
from rovtwin.imaging.imager import Imager
from rovtwin.imaging.lines import LinesFile
from rovtwin.imaging.radiance import Radiometry
from rovtwin.imaging.spectra.water import SpectralWater
from rovtwin.mapping.cells.masking import DARKEST
from rovtwin.mapping.georeference import Located

_EVERY = 8  # pixels from one whose gain is computed to the next; linear between, off by less than 1e-4


@dataclass(frozen=True)
class Unsure:
    """Standard deviations of what a correction takes for known.

    Attributes:
        height: Of the floor below the imager [m].
        water: Of absorption and scattering together, relative.
        lamps: Of the lamps' light with their calibration, relative.
    """

    height: float = 0.02
    water: float = 0.10
    lamps: float = 0.05


@dataclass(frozen=True)
class Correction:
    """Of lines to reflectance; without a model of light and water to radiance.

    Attributes:
        imager: That took the lines.
        model: Its lamps in the water; None: radiance is all that is asked for, or a panel alone tells the light.
        factor: What radiances are multiplied by, by band, as a reference panel has it (`cells.panel`); None without.
    """

    imager: Imager
    model: Radiometry | None
    factor: Float[np.ndarray, " band"] | None = None

    @property
    def reflects(self) -> bool:
        """Whether reflectance comes out."""
        return self.model is not None or self.factor is not None

    @property
    def quantity(self) -> str:
        """What comes out."""
        return "reflectance" if self.reflects else "radiance"

    @property
    def unit(self) -> str:
        """Its unit."""
        return "1" if self.reflects else "W/(m2 sr nm)"

    def prepare(self) -> None:
        """Computes what all lines share."""
        if self.model is not None:
            self.model.prepare()

    @cached_property
    def _some(self) -> tuple[Int[np.ndarray, " some"], Int[np.ndarray, " pixel"], Float[np.ndarray, "pixel 1"]]:
        """Pixels that are computed; for each pixel the one before it among them, and the share of the next."""
        n = self.imager.pixels
        some = np.unique(np.r_[np.arange(0, n, _EVERY), n - 1])
        low = np.clip(np.searchsorted(some, np.arange(n), side="right") - 1, 0, len(some) - 2)
        share = (np.arange(n) - some[low]) / (some[low + 1] - some[low])
        return some, low, share.astype(np.float32)[:, None]

    def gain_and_veil(self, located: Located, line: int) -> tuple[np.ndarray, np.ndarray]:
        """Of one line's pixels, shape (pixel, band) each, a panel's factor taken off; without a model 1 and 0."""
        gain, veil = self._modelled(located, line)
        if self.factor is None:
            return gain, veil
        over = (1.0 / self.factor).astype(np.float32)
        return gain * over, veil * over

    def _modelled(self, located: Located, line: int) -> tuple[np.ndarray, np.ndarray]:
        if self.model is None:
            return np.array(1.0, np.float32), np.array(0.0, np.float32)
        some, low, share = self._some
        hits = FloorHits(located.way[line, some], located.point[line, some], located.normal[line, some])
        found = self.model.gain_and_veil(hits, located.position[line], located.rotation[line], some)
        gain, veil = (x[low] + share * (x[low + 1] - x[low]) for x in found)
        # Where a neighbour that is computed sees no floor, or no light, there is nothing to draw a line to.
        lit = located.valid[line, some] & (found[0] > 0).any(axis=-1)
        alone = np.flatnonzero(~(lit[low] & lit[low + 1]) & located.valid[line])
        if len(alone):
            hits = FloorHits(located.way[line, alone], located.point[line, alone], located.normal[line, alone])
            gain[alone], veil[alone] = self.model.gain_and_veil(
                hits, located.position[line], located.rotation[line], alone
            )
        return gain, veil


@dataclass(frozen=True)
class Calibrated:
    """Values of a file's lines with the variance of their noise.

    Attributes:
        lines: The file.
        correction: To what.
    """

    lines: LinesFile
    correction: Correction

    @cached_property
    def _per_count(self) -> dict[Path, tuple[np.ndarray, np.ndarray]]:
        """Of each file: dark frame; radiance a count over a second of exposure."""
        found = {}
        for file in self.lines.files:
            dark, response = file.frames
            with np.errstate(divide="ignore"):
                found[file.path] = dark, np.where(response > 0, 1.0 / response, np.nan).astype(np.float32)
        return found

    def _frames_of(self, first: int, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Of so many lines, those of the file that each lies in; none where the files hold radiances."""
        if not self.lines.counts:
            return []
        return [
            self._per_count[file.path] for file, a, b in self.lines.pieces(first, first + count) for _ in range(a, b)
        ]

    @property
    def has_noise(self) -> bool:
        """Whether the variance of noise is known: of counts, whose electrons are counted."""
        return self.lines.counts

    def prepare(self) -> None:
        """Computes what all lines share, before threads do it each for itself."""
        self.correction.prepare()
        _ = self.correction._some
        if self.lines.counts:
            _ = self._per_count

    def values(
        self, cube: Float[np.ndarray, "line pixel band"], first: int, located: Located
    ) -> tuple[Float[np.ndarray, "line pixel band"], Float[np.ndarray, "line pixel band"], int]:
        """Of lines as the file has them.

        Args:
            cube: Counts or radiances; it is overwritten.
            first: Number of the first line.
            located: Where their pixels lie.

        Returns:
            Values (no number where saturated, or where no light comes), the variance of their noise (0 where nobody
            knows it), and how many were saturated.
        """
        full = cube >= self.lines.saturation
        variance, frames = np.zeros_like(cube), self._frames_of(first, len(cube))
        for i in range(len(cube)):
            if not located.valid[i].any():
                continue
            gain, veil = self.correction.gain_and_veil(located, i)
            with np.errstate(invalid="ignore", divide="ignore"):
                over = np.where(gain > 0, np.float32(1.0) / gain, np.float32(np.nan))
                if self.lines.counts:
                    exposure = float(self.lines.exposure[first + i])
                    self._of_counts(cube[i], variance[i], frames[i], exposure, over, veil)
                else:
                    cube[i] -= veil
                    cube[i] *= over
        cube[full] = np.nan
        return cube, variance, int(full.sum())

    def _of_counts(
        self,
        counts: np.ndarray,
        variance: np.ndarray,
        frames: tuple[np.ndarray, np.ndarray],
        exposure: float,
        over: np.ndarray,
        veil: np.ndarray,
    ) -> None:
        """One line, in place."""
        (dark, inverse), given = frames, self.lines.imager.file.detector
        electrons = given.full_well / (2.0**given.bits - 1.0 - given.offset)  # a count
        scale = inverse * np.float32(1.0 / exposure)
        np.maximum(counts - np.float32(given.offset), 0.0, out=variance)
        variance *= np.float32(electrons)
        variance += np.float32(given.read_noise**2 + electrons**2 / 12.0)
        variance *= np.square(scale * over * np.float32(1.0 / electrons))
        counts -= dark
        counts *= scale
        counts -= veil
        counts *= over


@dataclass(frozen=True)
class Budget:
    """What a band's reflectance is unsure by, relative, rms over what was looked at.

    Attributes:
        wavelengths: [nm].
        noise: Of one pixel.
        height: Of the floor's height below the imager.
        water: Of absorption and scattering.
        lamps: Of the lamps' light.
        panel: Of a reference panel: its reflectance and its noise; 0 without.
    """

    wavelengths: Float[np.ndarray, " band"]
    noise: Float[np.ndarray, " band"]
    height: Float[np.ndarray, " band"]
    water: Float[np.ndarray, " band"]
    lamps: Float[np.ndarray, " band"]
    panel: Float[np.ndarray, " band"]

    @property
    def common(self) -> Float[np.ndarray, " band"]:
        """All but noise: no mean over pixels takes it away."""
        return np.sqrt(self.height**2 + self.water**2 + self.lamps**2 + self.panel**2)


class Reference(Protocol):
    """What a panel says of a correction: see `cells.panel.PanelPixels`."""

    def factor(self, correction: Correction, deeper: float = 0.0) -> Float[np.ndarray, " band"]:
        """What radiances are to be multiplied by."""
        ...

    def unsure(self) -> Float[np.ndarray, " band"]:
        """Standard deviation of it by the panel's reflectance and noise, relative."""
        ...


def budget(
    calibrated: Calibrated,
    lines: list[tuple[int, Located, Float[np.ndarray, "1 pixel band"]]],
    unsure: Unsure,
    panel: Reference | None = None,
) -> Budget:
    """Of some lines: their number, where they lie, their counts. Each is computed again with one thing changed.

    With a panel, lamps are no cause; water and the floor's height are as far as their error differs from that at it.
    """
    correction, model = calibrated.correction, calibrated.correction.model
    assert model is not None
    more = 1.0 + unsure.water
    fine = model.at_fine
    murky = SpectralWater(more * fine.absorption, more * fine.scattering, more * fine.backscattering)
    changed, deeper = replace(correction, model=replace(model, at_fine=murky), factor=None), calibrated
    if panel is not None:
        changed = replace(changed, factor=panel.factor(changed))
        # The panel lies on the same floor: both are lower, and the factor takes much of it away.
        below = replace(correction, factor=panel.factor(replace(correction, factor=None), unsure.height))
        deeper = Calibrated(calibrated.lines, below)
    other, lit = Calibrated(calibrated.lines, changed), 0.0 if panel is not None else unsure.lamps
    rows: list[np.ndarray] = []
    for number, located, cube in lines:
        value, variance, _ = calibrated.values(cube.copy(), number, located)
        high = deeper.values(cube.copy(), number, lowered(located, unsure.height))[0]
        water = other.values(cube.copy(), number, located)[0]
        gain, veil = correction.gain_and_veil(located, 0)
        lamps = lit * (value[0] + veil / gain)
        size = np.maximum(np.abs(value[0]), DARKEST)
        rows.append(np.stack([np.sqrt(variance[0]), high[0] - value[0], water[0] - value[0], lamps]) / size)
    seen = np.concatenate(rows, axis=1) if rows else np.full((4, 1, len(model.imager.wavelengths)), np.nan)
    with np.errstate(invalid="ignore"):
        middle = np.nanmedian(np.abs(seen), axis=1)
    return Budget(
        model.imager.wavelengths, *middle, panel=np.zeros_like(middle[0]) if panel is None else panel.unsure()
    )


def lowered(located: Located, by: float) -> Located:
    """The same pixels on a floor that lies deeper by so much [m], along their rays."""
    along = located.point - located.position[:, None]
    longer = by * np.abs(along[..., 2] / np.linalg.norm(along, axis=-1)) ** -1 if by else 0.0
    far = np.linalg.norm(along, axis=-1)
    return replace(located, way=located.way + longer, point=located.point + along * (longer / far)[..., None])
