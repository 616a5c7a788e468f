"""Spectral libraries: names and reflectances by wavelength, from a CSV file, an ENVI library, or made here.

References: L3Harris, ENVI Header Files (a spectral library has a spectrum a line, its names in `spectra names`); bands
of an imager as Gaussians of their full width at half maximum, as SPy and ENVI resample.
"""

import csv
import io
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.files import read_text
from rovtwin.imaging.spectra.materials import MATERIALS, reflectance
from rovtwin.mapping.classes.angle import angle_between

USUAL = ("sand", "mud", "rock", "kelp", "maerl", "coral", "green_algae", "rust")  # of those made here
ALIKE = float(np.radians(0.5))  # angle of spectra that no mosaic tells apart
_PERCENT = 1.5  # of reflectance: what is larger counts in percent
_FEWEST = 250.0  # nm: a wavelength below is one in micrometres
_TYPES = {"1": "u1", "2": "i2", "3": "i4", "4": "f4", "5": "f8", "12": "u2", "13": "u4"}  # of ENVI's data types
_MICROMETRES = ("micro", "um", "\u00b5m", "\u03bcm", "\ufffdm")  # micro sign, Greek letter, and one in Latin-1
_DARKEST = -0.02  # reflectance that noise may leave: what is more negative is none
_STEP, _SIGMA = 0.25, 2.3548  # of the integral over a band [nm]; widths at half maximum to standard deviations


@dataclass(frozen=True)
class Library:
    """Spectra by name.

    Attributes:
        names: Of the classes.
        wavelengths: Increasing [nm].
        spectra: Reflectances, no number where not known.
        source: Of whom, for people.
    """

    names: tuple[str, ...]
    wavelengths: Float[np.ndarray, " w"]
    spectra: Float[np.ndarray, "class w"]
    source: str

    def chosen(self, names: tuple[str, ...]) -> "Library":
        """Those of some names, in their order.

        Raises:
            ConfigError: One is not there, or is named twice.
        """
        if unknown := [name for name in names if name not in self.names]:
            raise ConfigError(
                f"--classes: found '{unknown[0]}', expected some of {', '.join(self.names)} ({self.source})"
            )
        if twice := _twice(names):
            raise ConfigError(f"--classes: names '{twice}' twice")
        rows = [self.names.index(name) for name in names]
        return Library(names, self.wavelengths, self.spectra[rows], self.source)

    def resampled(
        self, wavelengths: Float[np.ndarray, " band"], fwhm: Float[np.ndarray, " band"]
    ) -> Float[np.ndarray, "class band"]:
        """Means over the bands of an imager; no number for bands that reach beyond what is known.

        Args:
            wavelengths: Of the bands [nm].
            fwhm: Their widths [nm].
        """
        half = int(np.ceil(np.max(fwhm, initial=0.0) / _STEP))
        offset = np.arange(-half, half + 1) / max(half, 1)  # a width to each side: 98 % of a Gaussian
        at = wavelengths[:, None] + fwhm[:, None] * offset
        weight = np.exp(-0.5 * np.square(offset * _SIGMA))
        weight = weight / weight.sum()
        return np.array([self._within(row, at) @ weight for row in self.spectra])

    def _within(self, row: Float[np.ndarray, " w"], at: Float[np.ndarray, "band n"]) -> Float[np.ndarray, "band n"]:
        """Linear between the wavelengths of a spectrum, no number across a gap of its own or beyond."""
        return np.interp(at, self.wavelengths, row, np.nan, np.nan)


def made_here() -> Library:
    """Shapes of `imaging.spectra.materials`, which are no measurements."""
    w = np.arange(350.0, 1001.0, 1.0)
    return Library(tuple(MATERIALS), w, np.array([reflectance(name, w) for name in MATERIALS]), "the library made here")


def read_library(path: Path) -> Library:
    """A CSV file `wavelength,name1,name2,..` or an ENVI spectral library (its header or its numbers).

    Raises:
        ConfigError: It cannot be read, or what it holds are no reflectances by wavelength in nm.
    """
    try:
        envi = path.suffix.lower() in (".sli", ".hdr")
        found = _of_envi(path) if envi else _of_csv(path, read_text(path))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"--library {path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    _require_sound(path, found)
    order = np.argsort(found.wavelengths)
    return Library(found.names, found.wavelengths[order], found.spectra[:, order], found.source)


def _of_csv(path: Path, text: str) -> Library:
    rows = [row for row in csv.reader(io.StringIO(text), skipinitialspace=True) if any(cell.strip() for cell in row)]
    head = [name.strip() for name in rows[0]] if rows else []
    if len(head) < 2 or not head[0].lower().startswith("wavelength") or not all(head):
        found = ", ".join(head) or "no rows"
        raise ConfigError(f"--library {path}: found {found}, expected wavelength,name1,name2,.. in its first row")
    table = np.full((len(rows) - 1, len(head)), np.nan)
    for k, row in enumerate(rows[1:]):
        if len(row) != len(head):
            raise ConfigError(f"--library {path}: row {k + 2}: found {len(row)} cells, expected {len(head)}")
        for column, cell in enumerate(row):
            try:
                table[k, column] = float(cell) if cell.strip() or not column else np.nan
            except ValueError:
                raise ConfigError(
                    f"--library {path}: row {k + 2}: found '{cell}' for {head[column]}, expected a number, or nothing "
                    "where it is not known"
                ) from None
    return Library(tuple(head[1:]), table[:, 0], table[:, 1:].T, path.name)


def _of_envi(path: Path) -> Library:
    text = path if path.suffix.lower() == ".hdr" else _beside(path, (".hdr",), path.with_name(path.name + ".hdr"))
    fields = _fields(text.read_text(encoding="utf-8", errors="replace"))
    where = f"--library {text}"
    missing = [name for name in ("samples", "lines", "data type", "wavelength") if name not in fields]
    if "spectral library" not in fields.get("file type", "").lower() or missing:
        found = f"no {missing[0]}" if missing else f"file type '{fields.get('file type', 'none')}'"
        raise ConfigError(f"{where}: found {found}, expected the header of an ENVI spectral library")
    try:
        bands, count = int(fields["samples"]), int(fields["lines"])
        kind = _TYPES[fields["data type"]]
        offset, scale = int(fields.get("header offset", 0)), float(fields.get("reflectance scale factor", 1.0))
        ignored = float(fields["data ignore value"]) if "data ignore value" in fields else np.nan
        w = np.array([float(x) for x in _list(fields["wavelength"])])
    except (KeyError, ValueError) as error:
        raise ConfigError(f"{where}: a field cannot be read: {error}") from None
    names = tuple(_list(fields["spectra names"])) if "spectra names" in fields else tuple(
        f"spectrum {k + 1}" for k in range(count)
    )  # fmt: skip
    numbers = path if path.suffix.lower() != ".hdr" else _beside(path, (".sli", ".slb", ".lib", ""), path)
    if not 0 <= offset < (size := numbers.stat().st_size):
        raise ConfigError(
            f"{where}: found a header offset of {offset}, expected less than the {size} bytes of {numbers}"
        )
    if not (np.isfinite(scale) and scale > 0.0):
        raise ConfigError(f"{where}: found a reflectance scale factor of {scale:g}, expected a number above 0")
    data = np.fromfile(numbers, (">" if fields.get("byte order", "0") == "1" else "<") + kind, offset=offset)
    if len(data) < bands * count or len(w) != bands or len(names) != count:
        raise ConfigError(
            f"{where}: found {len(data)} numbers, {len(w)} wavelengths and {len(names)} names, expected {bands} x "
            f"{count}, {bands} and {count}"
        )
    if fields.get("wavelength units", "").lower().startswith(_MICROMETRES):
        w = 1e3 * w
    spectra = data[: bands * count].reshape(count, bands)
    unknown = (spectra == spectra.dtype.type(ignored)) if spectra.dtype.kind == "f" else spectra == ignored
    return Library(names, w, np.where(unknown, np.nan, spectra.astype(float) / scale), path.name)


def _beside(path: Path, endings: tuple[str, ...], other: Path) -> Path:
    """The file of the same name with one of these endings."""
    for ending in endings:
        if (there := path.with_suffix(ending)) != path and there.is_file():
            return there
    if other != path and other.is_file():
        return other
    raise ConfigError(f"--library {path}: there is no {path.stem}{endings[0]} beside it: header and numbers are two")


def _fields(text: str) -> dict[str, str]:
    """Of an ENVI header, names in small letters; lists keep their text within braces."""
    pairs = re.findall(r"^[ \t]*([^=\n{}]+?)[ \t]*=[ \t]*(\{[^}]*\}|[^\n]*)", text, re.MULTILINE)
    return {name.lower(): value.strip() for name, value in pairs}


def _list(text: str) -> list[str]:
    return [part.strip() for part in text.strip("{} \n\t").split(",")]


def _twice(names: Any) -> str | None:
    return next((name for k, name in enumerate(names) if name in names[:k]), None)


def _require_sound(path: Path, library: Library) -> None:
    where, w, spectra = f"--library {path}", library.wavelengths, library.spectra
    spectra[spectra < -1.0] = np.nan  # such as -1.23e34 of deleted bands
    if name := _twice(library.names):
        raise ConfigError(f"{where}: has '{name}' twice; give each spectrum a name of its own, or take a mean")
    if len(w) < 2 or not np.isfinite(w).all() or _twice(w.tolist()) is not None:
        raise ConfigError(f"{where}: found {len(w)} wavelengths, expected two or more numbers, each once")
    if w.max() < _FEWEST:
        raise ConfigError(f"{where}: found wavelengths of {w.min():g} to {w.max():g}, expected nm (are these um?)")
    if empty := [name for name, row in zip(library.names, spectra, strict=True) if np.isfinite(row).sum() < 2]:
        raise ConfigError(f"{where}: {empty[0]} has fewer than two numbers")
    for name, row in zip(library.names, spectra, strict=True):
        least, most = float(np.nanmin(row)), float(np.nanmax(row))
        if least < _DARKEST:
            raise ConfigError(
                f"{where}: {name} has {least:g} at {w[np.nanargmin(row)]:g} nm, expected reflectances of 0 to 1. Leave "
                "out what is not known, or give its mark as `data ignore value`"
            )
        if most > _PERCENT:
            raise ConfigError(
                f"{where}: {name} reaches {most:g}, expected reflectances of 0 to 1. Divide what is in percent by 100"
            )


def similarity(spectra: Float[np.ndarray, "class band"]) -> Float[np.ndarray, "class class"]:
    """Angles between spectra [rad]."""
    return angle_between(spectra[:, None], spectra[None])


def common_bands(spectra: Float[np.ndarray, "class band"]) -> Bool[np.ndarray, " band"]:
    """That all spectra have."""
    return np.asarray(np.isfinite(spectra).all(axis=0))
