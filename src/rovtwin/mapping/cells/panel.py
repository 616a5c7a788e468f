"""A panel of known reflectance in the scene: what radiances are multiplied by, band by band, to make it read as it is.

    f = sum (rho gain + veil) / sum L,    rho of a pixel = (f L - veil) / gain

over the panel's pixels. So the light of the lamps and the calibration of the imager drop out, as they scale gain and
veil alike; of the water what drops out is its error at the panel's range, seen against the panel's brightness. Where
no model of lamps and water is at hand, gain is 1 and veil 0: the panel alone says what light there is.

Reference: Smith and Milton (1999), The use of the empirical line method to calibrate remotely sensed data to
reflectance, Int. J. Remote Sensing 20(13), for panels; the form with a veil that is known is ours.
"""

import warnings
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from rovtwin.core.errors import ConfigError
from rovtwin.mapping.cells.radiometry import Calibrated, Correction, lowered
from rovtwin.mapping.georeference import Georeference, Located

FEWEST = 20  # pixels on a panel for it to be used
_MOST_FULL = 0.1  # share of a panel's pixels that may be full in a band
_NODES, _BLOCK = 9, 64  # pixels of each line that are located to find those near the panel; lines at once


@dataclass(frozen=True)
class Panel:
    """A level panel.

    Attributes:
        name: For people.
        place: North and east of its middle [m].
        radius: Of the circle in it that counts [m].
        height: Of its face above the floor that the map is made with [m].
        reflectance: By band.
        sd: Standard deviation of that, relative.
    """

    name: str
    place: Float[np.ndarray, "2"]
    radius: float
    height: float
    reflectance: Float[np.ndarray, " band"]
    sd: float


@dataclass(frozen=True)
class PanelPixels:
    """A panel as lines saw it.

    Attributes:
        panel: Which one.
        lines: Numbers of the lines, one for each of `located`.
        located: The pixels of each line, on the panel's face.
        on: Which of them lie on the panel.
        radiance: Of these [W/(m2 sr nm)], no number where full.
        variance: Of their noise.
    """

    panel: Panel
    lines: list[int]
    located: list[Located]
    on: list[Bool[np.ndarray, " pixel"]]
    radiance: Float[np.ndarray, "k band"]
    variance: Float[np.ndarray, "k band"]

    @property
    def ways(self) -> Float[np.ndarray, " k"]:
        """Through the water to each pixel [m]."""
        return np.concatenate([one.way[0][on] for one, on in zip(self.located, self.on, strict=True)])

    def factor(self, correction: Correction, deeper: float = 0.0) -> Float[np.ndarray, " band"]:
        """What radiances are to be multiplied by, for a correction that knows nothing of the panel.

        Args:
            correction: To what.
            deeper: By how much the panel's face lies deeper than was taken [m].
        """
        expected = self._expected(correction, deeper)
        known = np.isfinite(self.radiance)
        total = np.where(known, self.radiance, 0.0).sum(axis=0, dtype=float)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(total > 0, np.where(known, expected, 0.0).sum(axis=0, dtype=float) / total, np.nan)

    def noise(self) -> Float[np.ndarray, " band"]:
        """Standard deviation of the mean radiance, relative."""
        known = np.isfinite(self.radiance)
        total = np.where(known, self.radiance, 0.0).sum(axis=0, dtype=float)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.sqrt(np.where(known, self.variance, 0.0).sum(axis=0, dtype=float)) / np.abs(total)

    def unsure(self) -> Float[np.ndarray, " band"]:
        """Standard deviation of the factor by the panel's own and by noise, relative."""
        return np.hypot(self.panel.sd, self.noise())

    def spread(self, correction: Correction) -> Float[np.ndarray, " band"]:
        """By how much pixels differ from what they should be, beside the factor and noise, rms, relative."""
        ratio = self.radiance / self._expected(correction, 0.0) * self.factor(correction)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # bands without a number have no spread
            own = np.nanmean(self.variance / np.square(self.radiance), axis=0)
            return np.sqrt(np.maximum(np.nanvar(ratio, axis=0) - own, 0.0))

    def _expected(self, correction: Correction, deeper: float) -> Float[np.ndarray, "k band"]:
        """Radiance of each pixel, as the model has it."""
        rows = []
        for located, on in zip(self.located, self.on, strict=True):
            gain, veil = correction.gain_and_veil(lowered(located, deeper), 0)
            shape = (len(on), len(self.panel.reflectance))
            expected = gain * self.panel.reflectance.astype(np.float32) + veil
            rows.append(np.broadcast_to(expected, shape)[on])
        return np.concatenate(rows)


def look_at(
    panel: Panel,
    calibrated: Calibrated,
    where: Georeference,
    t: Float[np.ndarray, " line"],
    use: Bool[np.ndarray, " line"],
) -> PanelPixels:
    """Find a panel's pixels in the lines that are used, and read them.

    Args:
        panel: Which one.
        calibrated: The lines.
        where: They lie.
        t: Of all lines [s].
        use: Which count.

    Raises:
        ConfigError: No line saw it, too few pixels lie on it, or too many of them are full.
    """
    plain = Calibrated(calibrated.lines, replace(calibrated.correction, model=None))
    numbers, nearest = _near(panel, where, t, np.flatnonzero(use))
    lines, places, masks, values, variances, full = [], [], [], [], [], []
    for number in numbers:
        located = lowered(where.locate(t[number : number + 1]), -panel.height)
        away = np.hypot(*(located.point[0, :, :2] - panel.place).T)
        on = located.valid[0] & (np.nan_to_num(away, nan=np.inf) <= panel.radius)
        if not on.any():
            continue
        cube = calibrated.lines.read(number, number + 1)
        full.append(cube[0][on] >= calibrated.lines.saturation)
        value, variance, _ = plain.values(cube, number, located)
        lines.append(int(number))
        places.append(located)
        masks.append(on)
        values.append(value[0][on])
        variances.append(variance[0][on])
    count = sum(int(on.sum()) for on in masks)
    if count < FEWEST:
        raise ConfigError(
            f"--panel {panel.name}: found {count} pixels within {panel.radius:g} m of north {panel.place[0]:.3f}, east "
            f"{panel.place[1]:.3f}, expected {FEWEST} or more; the nearest line that is used comes within "
            f"{nearest:.2f} m. Is it where the mosaic has it (make one without the panel, and look)?"
        )
    found = PanelPixels(panel, lines, places, masks, np.concatenate(values), np.concatenate(variances))
    _require_light(panel, np.concatenate(full), calibrated)
    return found


def _near(
    panel: Panel, where: Georeference, t: Float[np.ndarray, " line"], numbers: Int[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " m"], float]:
    """Lines that may have seen a panel, and how near any of them comes to it [m]."""
    step = max((where.imager.pixels - 1) // (_NODES - 1), 1)
    near, least = [], np.inf
    for begin in range(0, len(numbers), _BLOCK):
        some = numbers[begin : begin + _BLOCK]
        point = where.locate(t[some], slice(0, None, step)).point[..., :2]
        away = np.linalg.norm(point - panel.place, axis=-1)
        wide = np.linalg.norm(np.diff(point, axis=1), axis=-1)
        reach = panel.radius + np.nanmax(wide, axis=1, initial=0.0) + 2.0 * abs(panel.height)
        away = np.nanmin(away, axis=1, initial=np.inf)
        near.append(some[away <= reach])
        least = min(least, float(away.min(initial=np.inf)))
    return np.concatenate(near) if near else numbers[:0], least


def _require_light(panel: Panel, pixels: Bool[np.ndarray, "k band"], calibrated: Calibrated) -> None:
    """Not too many full ones. Bands without a number, for want of a response or by dead pixels, are masked later."""
    full = pixels.mean(axis=0)
    if (full > _MOST_FULL).any():
        w = calibrated.lines.wavelengths[full > _MOST_FULL]
        raise ConfigError(
            f"--panel {panel.name}: of its pixels up to {full.max():.0%} are full, in {len(w)} "
            f"bands from {w[0]:.0f} to {w[-1]:.0f} nm, expected at most {_MOST_FULL:.0%}. Take a darker panel, a "
            "shorter exposure, or fly higher over it"
        )
