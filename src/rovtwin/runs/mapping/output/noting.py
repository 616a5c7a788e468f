"""What a mosaic's note says it was made of, and the files of an older one that would lie beside it."""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.log.files import write_error
from rovtwin.core.user_files.files import is_file
from rovtwin.runs.mapping.panel import spectrum_file
from rovtwin.runs.mapping.sources import Inputs

WHAT = {
    "cube.img": "all bands: ENVI, BIL, float32, with header cube.hdr",
    "cube.tif": "all bands: cloud-optimised GeoTIFF",
    "mosaic.nc": "all bands and layers: netCDF by the CF conventions",
    "rgb.tif": "picture: cloud-optimised GeoTIFF with opacity",
    "rgb.png": "picture",
    "layers.tif": "range, incidence, time, depth, slants, sigmas of places, coverage, noise: cloud-optimised GeoTIFF",
    "gaps.geojson": "what was not seen inside the area",
    "ties.geojson": "ties and control points of the registration: residuals before and after, kept or dropped",
    "navigation.csv": "poses as Immersion reads them",
    "spectra.csv": "spectra of places",
    "uncertainty.csv": "how unsure reflectance is by band, and by what",
    "map.json": "figures, settings, hashes",
}
_BESIDE = ("cube.hdr", "report.html", *(f"{name}.aux.xml" for name in WHAT if name.endswith((".img", ".tif", ".png"))))


def remove_old(out: Path) -> None:
    """Remove the files of an older mosaic, which would count as parts of the new one.

    Raises:
        LogError: One cannot be removed.
    """
    for name in (*reversed(WHAT), *_BESIDE):  # the note first: without it no mosaic is there
        try:
            (out / name).unlink(missing_ok=True)
        except OSError as error:
            raise write_error(out / name, error) from error


def settings_of(inputs: Inputs, source: str) -> dict[str, Any]:
    """All that was asked for; `source` is whose poses were taken."""
    request, names = inputs.request, [one.path.name for one in inputs.lines.files]
    return {
        "lines": names[0] if len(names) == 1 else names,
        "run": None if inputs.run is None else inputs.run.resolve().name,
        "navigation": source,
        "floor": request.floor,
        "floor_crs": request.floor_crs,
        "floor_std": request.floor_std,
        "depth_m": request.depth,
        "dem_values": "height" if request.heights else "depth",
        "resolution_m": request.resolution,
        "crs": request.crs,
        "blend": "best" if request.best else "mean",
        "radiance": request.radiance,
        "water": request.water,
        "panel": _text(request.panel),
        "turn_deg_s": float(np.degrees(request.turn)),
        "clock_offset_s": request.clock_offset,
        "from_s": _finite(request.begin),
        "to_s": _finite(request.end),
        "area": _text(request.area),
        "points": _text(request.points),
        "register": request.register,
        "control": _text(request.control),
        "calibrated": request.calibrated,
        "formats": list(request.formats),
        "imager": inputs.lines.imager.file.name,
    }


def hashes_of(inputs: Inputs, source: str) -> dict[str, str]:
    """SHA-256 of the files that a mosaic was made of: lines, track and key frames or log, floor, water, panel,
    points.
    """
    request = inputs.request
    paths = [*(one.path for one in inputs.lines.files), request.control, request.area, request.points, request.panel]
    paths += [None if text is None else Path(text) for text in (request.water, request.floor)]
    if inputs.run is not None:
        names = ("log.mcap", "scenario.yaml") + (("smoothed.mcap", "smoothed_keys.nc") if source == "smoothed" else ())
        paths += [inputs.run / name for name in names]
    if request.panel is not None:
        paths.append(spectrum_file(request.panel))
    there = list({path.absolute(): None for path in paths if path is not None and is_file(path)})
    return {_short(path, there): _digest(path) for path in there}


def _short(path: Path, among: list[Path]) -> str:
    """The last parts of a path, as many as tell it from others."""
    for count in range(1, len(path.parts)):
        end = path.parts[-count:]
        if sum(other.parts[-count:] == end for other in among) == 1:
            return "/".join(end)
    return str(path)


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _text(path: Path | None) -> str | None:
    return None if path is None else str(path)
