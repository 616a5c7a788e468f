"""Errors of poses and calibration: how unsure a mosaic's places are, and what overlaps and known points take away."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import distance_transform_edt

from rovtwin.core.arrays.key_frames import KeyFrames
from rovtwin.core.errors import LogError
from rovtwin.imaging.lines import LinesHead
from rovtwin.mapping.alignment.calibration import CalibrationFinding, calibration_findings
from rovtwin.mapping.alignment.ground_points import CALIBRATION, ground_points
from rovtwin.mapping.alignment.joint import JointErrors
from rovtwin.mapping.alignment.matching import USUAL, match_strips
from rovtwin.mapping.alignment.registration import Registration, register
from rovtwin.mapping.alignment.strips import SHORTEST, short_runs, straight_runs, strip_of
from rovtwin.mapping.alignment.ties import Ties, observe
from rovtwin.mapping.alignment.uncertainty import point_uncertainty
from rovtwin.mapping.georeference import Georeference, Located
from rovtwin.runs.mapping.control import read_control
from rovtwin.runs.mapping.residuals import Residuals
from rovtwin.runs.mapping.sources import Inputs

UNITS = {"sigma": "m", "sigma_within": "m"}  # of the place, as a whole and within the mosaic
_SHOWN = (500.0, 620.0)  # whose mean is the brightness that is matched [nm]
FEW = 10  # ties and control points below which NIS says little
_LINES, _PIXELS = 24, 9  # lines from one whose uncertainty is computed to the next; pixels of each
_READ = 128  # lines read at once
_EXACT: dict[str, float] = dict.fromkeys(CALIBRATION, 0.0)


@dataclass(frozen=True)
class Registered:
    """What became of a mosaic's poses.

    Attributes:
        georeference: With poses and mount put right.
        delay: To be added to the stamps [s].
        joint: Errors that are left, and their covariance.
        residuals: Of ties and control points, with what was done.
        figures: For the note of a mosaic: ties, NIS, and each parameter of calibration, refused or not.
        remarks: For people.
    """

    georeference: Georeference
    delay: float
    joint: JointErrors
    residuals: Residuals
    figures: dict[str, Any]
    remarks: list[str]


def errors_before(inputs: Inputs, t: Float[np.ndarray, " line"], use: Bool[np.ndarray, " line"]) -> JointErrors | None:
    """As the smoother knows them; None where the poses are no smoothed track with key frames beside it.

    Raises:
        LogError: The file of key frames cannot be used.
    """
    if inputs.run is None or inputs.navigation.source != "smoothed":
        return None
    path = inputs.run / "smoothed_keys.nc"
    if not path.is_file():
        return None
    keys = KeyFrames.load(path)
    within = use & (t >= keys.t[0]) & (t <= keys.t[-1])
    if within.sum() < 2:
        return None
    return JointErrors.of(keys, t[within][0], t[within][-1], _EXACT if inputs.request.calibrated else None)


def registered(
    inputs: Inputs,
    georeference: Georeference,
    t: Float[np.ndarray, " line"],
    use: Bool[np.ndarray, " line"],
    joint: JointErrors,
    height: float,
) -> Registered:
    """Update poses and calibration from overlaps of strips and from control points, where these are asked for.

    Only lines that are used count: those of turns and outside the time asked for have no part in the mosaic.

    Raises:
        ConfigError: The control points' file is wrong.
        LogError: There is nothing to go by, or it contradicts itself.
    """
    request = inputs.request
    ties = _ties(inputs, georeference, t, use) if request.register else _no_ties()
    control, unused = (None, []) if request.control is None else read_control(request.control, inputs, t, use)
    observed = observe(joint, georeference, ties, control, height)
    if not len(observed.d):
        why = " ".join(unused) or "fly lines with more overlap"
        raise LogError(f"--register, --control: found no overlap in which two lines could be tied, nor a point; {why}")
    done = register(joint, observed)
    low, high = done.interval
    remarks = [
        f"registered by {int(done.used.sum())} of {len(done.used)} ties and control points ({done.dropped} false): "
        f"{1e3 * done.before:.0f} mm rms before, {1e3 * done.after:.0f} mm after; NIS {done.nis:.2f} "
        f"(95 %: {low:.2f} to {high:.2f})",
        *unused,
        *_untried(ties),
        *_doubts(done),
    ]
    calibration = calibration_findings(joint, done.joint)
    for one in calibration:
        if not one.refused:
            value, sd, unit = _shown(one.name, one.value, one.std)
            remarks.append(f"{one.name.replace('_', ' ')}: {value:+.2f} {unit} (sd {sd:.2f})")
    mount, delay = done.joint.mounted(georeference.mount)
    better = replace(georeference, navigation=done.joint.applied(georeference.navigation), mount=mount)
    numbers = np.interp(observed.t, t, np.arange(len(t)))
    numbers[np.isnan(observed.t)] = np.nan
    depth = float(inputs.first_floor().depth)
    residuals = Residuals(observed, done, numbers, depth, tuple(one.shape[0] for one in inputs.lines.files),
                          tuple(one.path.name for one in inputs.lines.files))  # fmt: skip
    return Registered(better, delay, done.joint, residuals, _figures(done, calibration), remarks)


def _untried(ties: Ties) -> list[str]:
    """A remark where overlaps have more patches than are tried."""
    if not ties.untried:
        return []
    return [
        f"of {USUAL.most + ties.untried} patches of the overlaps {USUAL.most}, spread evenly, were looked for; "
        "for all of them map the survey in parts (--from, --to)"
    ]


def _doubts(done: Registration) -> list[str]:
    """What makes the standard deviations of places doubtful."""
    low, high = done.interval
    remarks = []
    if done.nis > high:
        remarks.append("NIS is above its 95 %: places are less sure than sigma says (poses, floor, mount or clock)")
    if done.nis < low:
        remarks.append("NIS is below its 95 %: lines agree better than sigma says; it is too large")
    if (count := int(done.used.sum())) < FEW:
        remarks.append(f"only {count} ties and control points: too few to judge sigma by NIS (expected {FEW} or more)")
    return remarks


def _figures(what: Registration, findings: list[CalibrationFinding]) -> dict[str, Any]:
    calibration = {
        one.name: {
            "value": one.value, "sd": one.std, "sd_before": one.prior, "correlation": one.correlation,
            "unit": _unit(one.name), "refused": one.refused,
        }
        for one in findings
    }  # fmt: skip
    return {
        "ties_used": int(what.used.sum()), "ties_dropped": what.dropped, "rms_before_m": what.before,
        "rms_after_m": what.after, "nis": what.nis, "nis_95": list(what.interval), "calibration": calibration,
    }  # fmt: skip


def _unit(name: str) -> str:
    return "rad" if name.startswith("boresight") else "m" if name.startswith("lever") else "s"


def _shown(name: str, value: float, sd: float) -> tuple[float, float, str]:
    """An angle in degrees, a lever in mm, a clock in ms."""
    if name.startswith("boresight"):
        return float(np.degrees(value)), float(np.degrees(sd)), "deg"
    return 1e3 * value, 1e3 * sd, "mm" if name.startswith("lever") else "ms"


def _no_ties() -> Ties:
    return Ties(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0))


def _ties(
    inputs: Inputs, georeference: Georeference, t: Float[np.ndarray, " line"], use: Bool[np.ndarray, " line"]
) -> Ties:
    """Between all straight runs of lines that are used, by their brightness."""
    w = inputs.lines.wavelengths
    bands = np.flatnonzero((w >= _SHOWN[0]) & (w <= _SHOWN[1]))
    bands = bands if len(bands) else np.arange(len(w))
    strips = []
    runs = used_runs(straight_runs(georeference.navigation, t), t, use)
    for run in short_runs(georeference.navigation, t, runs):
        bright = np.concatenate(
            [
                _bright(*piece, bands)
                for a in range(run[0], run[-1] + 1, _READ)
                for piece in inputs.lines.pieces(a, min(a + _READ, run[-1] + 1))
            ]
        )
        strips.append(strip_of(georeference, t[run[0] : run[-1] + 1], bright))
    return match_strips(strips)


def used_runs(
    runs: list[Int[np.ndarray, " n"]], t: Float[np.ndarray, " line"], use: Bool[np.ndarray, " line"]
) -> list[Int[np.ndarray, " n"]]:
    """Runs of lines without those that are not used; cut where some are left out, short ones dropped."""
    kept = []
    for run in runs:
        at = run[use[run]]
        pieces = np.split(at, np.flatnonzero(np.diff(at) > 1) + 1)
        kept += [one for one in pieces if len(one) and t[one[-1]] - t[one[0]] >= SHORTEST]
    return kept


def _bright(file: LinesHead, first: int, last: int, bands: np.ndarray) -> Float[np.ndarray, "line pixel"]:
    cube = file.read(first, last)[..., bands]
    full = (cube >= file.saturation).any(axis=-1)
    if file.counts:
        cube = cube - file.frames[0][:, bands]
    return np.where(full, np.nan, cube.mean(axis=-1, dtype=float))


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
    seen = ground_points(where, when, which)
    found = point_uncertainty(joint, seen, height)
    shape = (len(some), len(pixels))
    tables = {
        name: RegularGridInterpolator(
            (some, pixels), filled(found.sigma(kind).reshape(shape), seen.valid.reshape(shape))
        )
        for name, kind in (("sigma", "absolute"), ("sigma_within", "within"))
    }
    numbers = np.arange(where.imager.pixels, dtype=float)

    def layers(at: Float[np.ndarray, " line"], located: Located) -> dict[str, Any]:
        lines = np.clip(at, some[0], some[-1])
        place = np.stack(np.broadcast_arrays(lines[:, None], numbers[None]), axis=-1)
        return {name: table(place) for name, table in tables.items()}

    return layers


def filled(table: Float[np.ndarray, "n m"], valid: Bool[np.ndarray, "n m"]) -> Float[np.ndarray, "n m"]:
    """Of nodes that see no floor, whose derivatives are zero and say nothing: the value of the nearest that does."""
    if not valid.any():
        return np.full(table.shape, np.nan)
    nearest: Any = distance_transform_edt(~valid, return_distances=False, return_indices=True)
    return table[tuple(nearest)]
