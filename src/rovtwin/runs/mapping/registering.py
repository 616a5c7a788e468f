"""Errors of poses and calibration: how unsure a mosaic's places are, and what overlaps and known points take away."""

import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import RegularGridInterpolator

from rovtwin.core.arrays.key_frames import KeyFrames
from rovtwin.core.errors import ConfigError, LogError
from rovtwin.core.user_files.files import read_text
from rovtwin.mapping.alignment.calibration import calibration_findings
from rovtwin.mapping.alignment.joint import JointErrors
from rovtwin.mapping.alignment.matching import match_strips
from rovtwin.mapping.alignment.registration import Registration, register
from rovtwin.mapping.alignment.sights import CALIBRATION, sights
from rovtwin.mapping.alignment.strips import straight_runs, strip_of
from rovtwin.mapping.alignment.ties import ControlPoints, Observations, Ties, observe
from rovtwin.mapping.alignment.uncertainty import point_uncertainty
from rovtwin.mapping.georeference import Georeference, Located
from rovtwin.runs.mapping.sources import Found

UNITS = {"sigma": "m", "sigma_within": "m"}  # of the place, as a whole and within the mosaic
_SHOWN = (500.0, 620.0)  # whose mean is the brightness that is matched [nm]
_LINES, _PIXELS = 24, 9  # lines from one whose uncertainty is computed to the next; pixels of each
_READ = 128  # lines read at once
_COLUMNS = ("name", "line", "pixel", "north", "east", "sd")
_EXACT: dict[str, float] = dict.fromkeys(CALIBRATION, 0.0)


@dataclass(frozen=True)
class Registered:
    """What became of a mosaic's poses.

    Attributes:
        georeference: With poses and mount put right.
        delay: To be added to the stamps [s].
        joint: Errors that are left, and their covariance.
        registration: What was done; None where nothing was registered.
        observed: Ties and control points; None likewise.
        remarks: For people.
    """

    georeference: Georeference
    delay: float
    joint: JointErrors
    registration: Registration | None
    observed: Observations | None
    remarks: list[str]


def errors_before(found: Found, t: Float[np.ndarray, " line"], use: Bool[np.ndarray, " line"]) -> JointErrors | None:
    """As the smoother knows them; None where the poses are no smoothed track with key frames beside it.

    Raises:
        LogError: The file of key frames cannot be used.
    """
    if found.run is None or found.navigation.source != "smoothed":
        return None
    path = found.run / "smoothed_keys.nc"
    if not path.is_file():
        return None
    keys = KeyFrames.load(path)
    within = use & (t >= keys.t[0]) & (t <= keys.t[-1])
    if within.sum() < 2:
        return None
    return JointErrors.of(keys, t[within][0], t[within][-1], _EXACT if found.request.calibrated else None)


def registered(
    found: Found, georeference: Georeference, t: Float[np.ndarray, " line"], joint: JointErrors, height: float
) -> Registered:
    """Update poses and calibration from overlaps of strips and from control points, where these are asked for.

    Raises:
        ConfigError: The control points' file is wrong.
        LogError: There is nothing to go by, or it contradicts itself.
    """
    request = found.request
    ties = _ties(found, georeference, t) if request.register else _no_ties()
    control = None if request.control is None else read_control(request.control, found, t)
    observed = observe(joint, georeference, ties, control, height)
    if not len(observed.d):
        raise LogError("--register: found no overlap in which two lines could be tied; fly lines with more overlap")
    done = register(joint, observed)
    low, high = done.interval
    remarks = [
        f"registered by {int(done.used.sum())} of {len(done.used)} ties and control points ({done.dropped} false): "
        f"{1e3 * done.before:.0f} mm rms before, {1e3 * done.after:.0f} mm after; NIS {done.nis:.2f} "
        f"(95 %: {low:.2f} to {high:.2f})"
    ]
    for one in calibration_findings(joint, done.joint):
        if not one.refused:
            value, sd, unit = _shown(one.name, one.value, one.std)
            remarks.append(f"{one.name.replace('_', ' ')}: {value:+.2f} {unit} (sd {sd:.2f})")
    mount, delay = done.joint.mounted(georeference.mount)
    better = replace(georeference, navigation=done.joint.applied(georeference.navigation), mount=mount)
    return Registered(better, delay, done.joint, done, observed, remarks)


def _shown(name: str, value: float, sd: float) -> tuple[float, float, str]:
    """An angle in degrees, a lever in mm, a clock in ms."""
    if name.startswith("boresight"):
        return float(np.degrees(value)), float(np.degrees(sd)), "deg"
    return 1e3 * value, 1e3 * sd, "mm" if name.startswith("lever") else "ms"


def _no_ties() -> Ties:
    return Ties(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0))


def _ties(found: Found, georeference: Georeference, t: Float[np.ndarray, " line"]) -> Ties:
    """Between all straight runs of lines, by their brightness."""
    w = found.lines.wavelengths
    bands = np.flatnonzero((w >= _SHOWN[0]) & (w <= _SHOWN[1]))
    bands = bands if len(bands) else np.arange(len(w))
    strips = []
    for run in straight_runs(georeference.navigation, t):
        bright = np.concatenate(
            [_bright(found, a, min(a + _READ, run[-1] + 1), bands) for a in range(run[0], run[-1] + 1, _READ)]
        )
        strips.append(strip_of(georeference, t[run[0] : run[-1] + 1], bright))
    return match_strips(strips)


def _bright(found: Found, first: int, last: int, bands: np.ndarray) -> Float[np.ndarray, "line pixel"]:
    cube = found.lines.read(first, last)[..., bands]
    full = (cube >= found.lines.saturation).any(axis=-1)
    if found.lines.counts:
        cube = cube - found.lines.frames[0][:, bands]
    return np.where(full, np.nan, cube.mean(axis=-1, dtype=float))


def read_control(path: Path, found: Found, t: Float[np.ndarray, " line"]) -> ControlPoints:
    """Of a CSV file: name, number of the line and pixel that saw it, north and east [m], standard deviation [m].

    Raises:
        ConfigError: It cannot be read, or has other columns, no numbers, or lines and pixels that there are not.
    """
    try:
        rows = list(csv.DictReader(read_text(path).splitlines(), skipinitialspace=True))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"--control {path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if not rows or any(name not in rows[0] for name in _COLUMNS):
        there = ", ".join(rows[0]) if rows else "no rows"
        raise ConfigError(f"--control {path}: found {there}, expected {','.join(_COLUMNS)}")
    values = []
    for number, row in enumerate(rows, 2):
        try:
            values.append([float(row[name]) for name in _COLUMNS[1:]])
        except (TypeError, ValueError):
            raise ConfigError(f"--control {path}: line {number}: expected numbers but for the name") from None
    table = np.array(values)
    lines, pixels, _ = found.lines.shape
    wrong = (table[:, 0] < 0) | (table[:, 0] > lines - 1) | (table[:, 1] < 0) | (table[:, 1] > pixels - 1)
    if (wrong | ~(table[:, 4] > 0)).any():
        raise ConfigError(
            f"--control {path}: expected lines from 0 to {lines - 1}, pixels from 0 to {pixels - 1}, and sd above 0"
        )
    when = np.interp(table[:, 0], np.arange(lines), t)
    return ControlPoints(when, table[:, 1], table[:, 2:4], table[:, 4], tuple(row["name"] for row in rows))


def sigma_layers(
    joint: JointErrors,
    where: Georeference,
    t: Float[np.ndarray, " line"],
    use: Bool[np.ndarray, " line"],
    height: float,
) -> Callable[[Float[np.ndarray, " line"], Located], Mapping[str, Float[np.ndarray, "line pixel"]]]:
    """Standard deviations of pixels' places, computed for some and straight between them.

    Args:
        joint: Errors and covariance.
        where: Poses, imager and floor.
        t: Of all lines [s].
        use: Which count.
        height: Standard deviation of the floor's depth [m].
    """
    some = np.unique(t[use][np.linspace(0, int(use.sum()) - 1, max(int(use.sum()) // _LINES, 2)).astype(int)])
    pixels = np.linspace(0.0, where.imager.pixels - 1.0, _PIXELS)
    when, which = (x.ravel() for x in np.meshgrid(some, pixels, indexing="ij"))
    found = point_uncertainty(joint, sights(where, when, which), height)
    shape = (len(some), len(pixels))
    tables = {
        "sigma": RegularGridInterpolator((some, pixels), found.sigma("absolute").reshape(shape)),
        "sigma_within": RegularGridInterpolator((some, pixels), found.sigma("within").reshape(shape)),
    }
    numbers = np.arange(where.imager.pixels, dtype=float)

    def layers(at: Float[np.ndarray, " line"], located: Located) -> dict[str, Any]:
        lines = np.clip(at, some[0], some[-1])
        place = np.stack(np.broadcast_arrays(lines[:, None], numbers[None]), axis=-1)
        return {name: table(place) for name, table in tables.items()}

    return layers
