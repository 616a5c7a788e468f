"""Which lines of a file make a map: placed, asked for, and taken on the lines of the survey."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.errors import LogError
from rovtwin.mapping.georeference import Georeference
from rovtwin.runs.mapping.request import COURSE
from rovtwin.runs.mapping.sources import Inputs

_SHORT, _FAR = 3.0, 1.8  # shortest stretch of lines [s]; longest way over the usual one


@dataclass(frozen=True)
class Lines:
    """Which lines count, and why others do not."""

    use: Bool[np.ndarray, " line"]
    remarks: list[str]


def lines_to_use(inputs: Inputs) -> Lines:
    """Lines within the navigation and the time asked for, not taken in a turn.

    Raises:
        LogError: None is left.
    """
    t, request, navigation = inputs.times, inputs.request, inputs.navigation
    asked = (t >= request.begin) & (t <= request.end)
    posed = navigation.at(t).valid
    turning = np.abs(np.nan_to_num(navigation.turn_rates(t, COURSE))) > request.turn
    remarks = []
    if outside := int((asked & ~posed).sum()):
        gaps = f", which has {len(navigation.gaps)} gaps" if navigation.gaps else ""
        remarks.append(
            f"{outside} lines lie outside the navigation of {navigation.t[0]:.1f} to {navigation.t[-1]:.1f} s{gaps}"
        )
    if turns := int((asked & posed & turning).sum()):
        remarks.append(f"{turns} lines taken in turns faster than {np.degrees(request.turn):g} deg/s are left out")
    if inputs.lines.gaps:
        remarks.append(f"lines are missing {len(inputs.lines.gaps)} times for more than 0.2 s")
    use = asked & posed & ~turning
    far = use & too_far(inputs, use)
    short = use & ~far & short_stretches(t, use & ~far)
    if dropped := int(far.sum() + short.sum()):
        remarks.append(f"{dropped} lines on the way down or between two turns are left out")
    use &= ~far & ~short
    if not use.any():
        raise LogError(
            f"{inputs.lines.path}: no line of {len(t)} can be placed: they are of {t[0]:.1f} to {t[-1]:.1f} s, "
            f"navigation is of {navigation.t[0]:.1f} to {navigation.t[-1]:.1f} s. Do both clocks count from one start? "
            "See --clock-offset"
        )
    return Lines(use, remarks)


def too_far(inputs: Inputs, use: Bool[np.ndarray, " line"]) -> Bool[np.ndarray, " line"]:
    """Lines whose middle is far beyond what is usual for this survey, as on the way down."""
    middle = inputs.lines.shape[1] // 2
    model = Georeference(inputs.lines.imager, inputs.mount, inputs.navigation, inputs.first_floor())
    way = model.locate(inputs.times, slice(middle, middle + 1)).way[:, 0]
    if not np.isfinite(way[use]).any():
        return np.zeros(len(use), bool)
    return np.nan_to_num(way) > _FAR * float(np.nanmedian(way[use]))


def short_stretches(t: Float[np.ndarray, " line"], use: Bool[np.ndarray, " line"]) -> Bool[np.ndarray, " line"]:
    """Lines in stretches that are over before a map is worth it, and have something left out on either side."""
    edges = np.flatnonzero(np.diff(np.r_[False, use, False].astype(int)))
    short = np.zeros(len(use), bool)
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        if t[b - 1] - t[a] < _SHORT and a > 0 and b < len(use):
            short[a:b] = True
    return short
