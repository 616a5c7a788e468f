"""The reference panel of a map: its file, and what came of it in words."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import NonNegative, Number, Positive, Share, Strict, parse, read_yaml
from rovtwin.mapping.cells.panel import Panel, PanelPixels, look_at
from rovtwin.mapping.cells.radiometry import Calibrated
from rovtwin.mapping.classes.library import read_library
from rovtwin.mapping.georeference import Georeference

_UNEVEN = 0.10  # by how much a panel's pixels may differ without a remark
_FAR_OFF = 2.0  # times by which radiances may be off without a remark


class PanelFile(Strict):
    """A reference panel, for `--panel`."""

    name: str = "reference"
    north: Number | None = Field(None, description="of its middle [m]; or latitude and longitude")
    east: Number | None = Field(None, description="[m]")
    latitude: Number | None = Field(None, description="[deg]")
    longitude: Number | None = Field(None, description="[deg]")
    radius: Positive = Field(description="of the circle about its middle that counts [m], well inside its edge")
    height: Number = Field(0.0, description="of its face above the map's floor [m]")
    reflectance: Share | str = Field(description="one number, or a CSV file wavelength,reflectance beside this one")
    sd: NonNegative = Field(0.02, description="standard deviation of it, relative, all bands alike")


@dataclass(frozen=True)
class Seen:
    """What a panel did.

    Attributes:
        pixels: On it.
        factor: What radiances are multiplied by, by band; no number where noise hides the panel.
        figures: For the note of a mosaic.
        remarks: For people.
    """

    pixels: PanelPixels
    factor: Float[np.ndarray, " band"]
    figures: dict[str, Any]
    remarks: list[str]


def read_panel(
    path: Path, datum: Datum | None, wavelengths: Float[np.ndarray, " band"], fwhm: Float[np.ndarray, " band"]
) -> Panel:
    """Of its file; without a datum its place is not looked at.

    Raises:
        ConfigError: It cannot be used, or its spectrum does not cover the bands.
    """
    given = parse(PanelFile, read_yaml(path), path.name)
    places = [(given.north, given.east), (given.latitude, given.longitude)]
    whole = [None not in pair for pair in places]
    if sum(whole) != 1 or any(value is not None for value in places[whole.index(False)]):
        raise ConfigError(f"{path.name}: expected north and east [m], or latitude and longitude [deg], and not both")
    place = np.array(places[0], float) if whole[0] else np.zeros(2)
    if given.latitude is not None and given.longitude is not None and datum is not None:
        place = datum.position(given.latitude, given.longitude, 0.0)[:2]
    if isinstance(given.reflectance, str):
        spectrum = _spectrum(path.parent / given.reflectance, wavelengths, fwhm)
    else:
        spectrum = np.full(len(wavelengths), float(given.reflectance))
    if not (spectrum > 0).all():
        raise ConfigError(f"{path.name}: reflectance: found {spectrum.min():g}, expected more than 0 in all bands")
    return Panel(given.name, place, given.radius, given.height, spectrum, given.sd)


def spectrum_file(path: Path) -> Path | None:
    """The file of a panel's reflectance, where that is no number.

    Raises:
        ConfigError: The panel's file cannot be used.
    """
    given = parse(PanelFile, read_yaml(path), path.name).reflectance
    return path.parent / given if isinstance(given, str) else None


def _spectrum(
    path: Path, wavelengths: Float[np.ndarray, " band"], fwhm: Float[np.ndarray, " band"]
) -> Float[np.ndarray, " band"]:
    """Means over the bands; at the ends, where a band reaches beyond the file, the number at its middle."""
    try:
        library = read_library(path)
    except ConfigError as error:
        raise ConfigError(str(error).replace("--library", "--panel: reflectance", 1)) from None
    if len(library.names) != 1:
        raise ConfigError(
            f"--panel: reflectance {path}: has {len(library.names)} spectra, expected one: wavelength,reflectance"
        )
    found = library.resampled(wavelengths, fwhm)[0]
    known = np.isfinite(library.spectra[0])
    middles = np.interp(wavelengths, library.wavelengths[known], library.spectra[0][known], np.nan, np.nan)
    found = np.where(np.isfinite(found), found, middles)
    if not np.isfinite(found).all():
        w = library.wavelengths[known]
        raise ConfigError(
            f"--panel: reflectance {path}: has {w[0]:.0f} to {w[-1]:.0f} nm, expected those of the bands, "
            f"{wavelengths[0]:.0f} to {wavelengths[-1]:.0f} nm"
        )
    return found


def seen_panel(
    path: Path | None,
    datum: Datum,
    calibrated: Calibrated,
    where: Georeference,
    t: Float[np.ndarray, " line"],
    use: Bool[np.ndarray, " line"],
) -> Seen | None:
    """What the panel that is asked for says of the light; None where none is.

    Raises:
        ConfigError: It cannot be used, was not seen, or is full, or hidden by noise in all bands.
    """
    if path is None:
        return None
    lines = calibrated.lines
    panel = read_panel(path, datum, lines.wavelengths, lines.fwhm)
    pixels = look_at(panel, calibrated, where, t, use)
    noise, largest = pixels.noise(), 1.0 / lines.imager.file.smallest_snr
    factor = pixels.factor(calibrated.correction)
    hidden = ~(noise <= largest) | ~(factor > 0)
    if hidden.all():
        raise ConfigError(
            f"--panel {panel.name}: noise hides it, or it has no number, in all bands; expected light on it"
        )
    factor[hidden] = np.nan
    spread = pixels.spread(calibrated.correction)
    return Seen(
        pixels,
        factor,
        _figures(pixels, factor, spread),
        _remarks(pixels, factor, spread, calibrated),
    )


def _figures(pixels: PanelPixels, factor: np.ndarray, spread: np.ndarray) -> dict[str, Any]:
    return {
        "name": pixels.panel.name,
        "pixels": len(pixels.radiance),
        "lines": len(pixels.lines),
        "range_m": float(np.mean(pixels.ways)),
        "spread": float(np.nanmedian(spread[np.isfinite(factor)])),
        "reflectance": pixels.panel.reflectance.tolist(),
        "factor": [float(x) if np.isfinite(x) else None for x in factor],
    }


def _remarks(pixels: PanelPixels, factor: np.ndarray, spread: np.ndarray, calibrated: Calibrated) -> list[str]:
    panel, known = pixels.panel, np.isfinite(factor)
    middle, low, high = (float(q) for q in np.nanpercentile(factor, [50.0, 0.0, 100.0]))
    count, way = len(pixels.radiance), float(np.mean(pixels.ways))
    words = [f"panel {panel.name}: {count} pixels of {len(pixels.lines)} lines at {way:.2f} m"]
    if calibrated.correction.model is not None:
        words[0] += f"; radiances are multiplied by {middle:.3f} ({low:.3f} to {high:.3f} by band)"
        if max(middle, 1.0 / middle) > _FAR_OFF:
            words.append(f"panel {panel.name}: the model is off by a factor of {middle:.2f}. Does the panel lie there?")
    if not known.all():
        w = calibrated.lines.wavelengths[~known]
        words.append(
            f"panel {panel.name}: noise hides it, or it has no number, in {len(w)} bands from {w[0]:.0f} to "
            f"{w[-1]:.0f} nm, which are masked"
        )
    if (uneven := float(np.nanmedian(spread[known]))) > _UNEVEN:
        words.append(
            f"panel {panel.name}: its pixels differ by {uneven:.0%} beside noise. Does its radius of "
            f"{panel.radius:g} m reach over its edge, or is its place off?"
        )
    return words


def about_range(seen: Seen, ways: Float[np.ndarray, "row column"], modelled: bool, given: bool) -> str:
    """A remark on what the panel cannot put right: water between its range and that of the scene."""
    low, high = (float(q) for q in np.nanpercentile(ways, [5.0, 95.0]))
    here = float(np.mean(seen.pixels.ways))
    begin = f"panel at {here:.2f} m, the mosaic at {low:.2f} to {high:.2f} m (5 %, 95 %)"
    if not modelled:
        return f"{begin}: nothing corrects for range, lamps' beams or lean; all is taken to be lit as the panel is"
    if not given:
        return f"{begin}: between them light is that of a usual water, a guess; say --water for that of the dive"
    return f"{begin}: between them light is that of the water as stated; uncertainty.csv says what its error leaves"
