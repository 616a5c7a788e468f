"""A small imager, and a file of its lines."""

from typing import Any

import numpy as np

from rovtwin.core.datum import Datum
from rovtwin.core.user_files.config import parse
from rovtwin.imaging.files import imager_as_data, load_imager_file
from rovtwin.imaging.imager import Imager, Mount
from rovtwin.imaging.lines import Truth
from rovtwin.imaging.lines_writer import Head, Navigation
from rovtwin.imaging.schema import ImagerFile

DOWN = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # R_bs of an imager that looks down


def data(pixels: int = 12, band_count: int = 5, **changed: Any) -> dict[str, Any]:
    """Of the library's imager with fewer pixels and bands, and less light, as these take in more of the spectrum."""
    return (
        imager_as_data(load_imager_file("uhi"))
        | {"pixels": pixels, "bands": {"first": 450.0, "last": 650.0, "count": band_count, "fwhm": 4.0}}
        | {"optics": {"f_number": 4.8, "focal_length_mm": 9.83, "slit_um": 40.0, "transmission": 0.35}}
        | changed
    )


def imager(**given: Any) -> Imager:
    return Imager(parse(ImagerFile, data(**given), "small"))


def head(lines: int = 7, truth: bool = False, **given: Any) -> Head:
    small = imager(**given)
    shape, t = (small.pixels, len(small.wavelengths)), 1.0 + 0.05 * np.arange(lines)
    mount = Mount(np.array([0.1, 0.0, 0.11]), DOWN, "uhi.camera")
    place, euler = np.outer(t, [0.2, 0.0, 0.0]) + [0.0, 0.0, 3.0], np.zeros((lines, 3)) + [0.01, -0.02, 0.5]
    known = Truth(t, place, np.tile([1.0, 0, 0, 0], (lines, 1)), mount, "name: flat\n", np.full(lines, 5.0))
    return Head(
        small,
        mount,
        Datum(),
        t,
        np.full(lines, 0.04),
        np.full(shape, 64.0),
        np.full(shape, 2e6),
        4095.0,
        Navigation(t, place, euler, "estimate"),
        known if truth else None,
    )
