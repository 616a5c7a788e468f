"""A small imager, and a file of its lines."""

from collections.abc import Callable, Sequence
from pathlib import Path
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


def cut(path: Path, folder: Path, edges: Sequence[int], change: Callable[[Any, int], None] | None = None) -> list[Path]:
    """A file of lines cut at some lines into files of their own, as instruments do; each keeps the whole navigation."""
    import netCDF4

    folder.mkdir(exist_ok=True)
    found = []
    with netCDF4.Dataset(path) as source:
        source.set_auto_maskandscale(False)
        ends = [0, *edges, len(source.dimensions["line"])]
        for k, (a, b) in enumerate(zip(ends[:-1], ends[1:], strict=True)):
            found.append(folder / f"dive_transectnr_0_chunknr_{k}.h5")
            with netCDF4.Dataset(found[-1], "w") as target:
                target.set_auto_maskandscale(False)
                _copy(source, target, slice(a, b))
                if change is not None:
                    change(target, k)
    return found


def _copy(source: Any, target: Any, part: slice) -> None:
    for name, dimension in source.dimensions.items():
        target.createDimension(name, part.stop - part.start if name == "line" else len(dimension))
    for name, variable in source.variables.items():
        kind = str if variable.dtype is str else variable.dtype
        new = target.createVariable(name, kind, variable.dimensions, fill_value=False if kind is not str else None)
        of_lines = variable.dimensions[:1] == ("line",)
        new[...] = variable[part] if of_lines else variable[...]
        new.setncatts({key: variable.getncattr(key) for key in variable.ncattrs() if key != "_FillValue"})
    for name, group in source.groups.items():
        _copy(group, target.createGroup(name), part)
