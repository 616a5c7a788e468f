"""A mosaic put together from its own overlaps, in one call: strips, ties, registration, what is left unsure."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.key_frames import KeyFrames
from rovtwin.core.errors import LogError
from rovtwin.mapping.alignment.calibration import CalibrationFinding, calibration_findings
from rovtwin.mapping.alignment.joint import JointErrors
from rovtwin.mapping.alignment.matching import USUAL, Matching, match_strips
from rovtwin.mapping.alignment.registration import Registration, register
from rovtwin.mapping.alignment.sights import sights
from rovtwin.mapping.alignment.strips import straight_runs, strip_of
from rovtwin.mapping.alignment.ties import ControlPoints, Observations, Ties, observe
from rovtwin.mapping.alignment.uncertainty import PointUncertainty, point_uncertainty
from rovtwin.mapping.georeference import Georeference


@dataclass(frozen=True)
class Alignment:
    """A registered mosaic.

    Attributes:
        where: Poses and mount with their errors taken out; imager and floor as they were.
        clock: To be added to the stamps of the lines [s].
        registration: What was used, and how well it agrees.
        ties: Found between lines.
        observed: Ties and control points as measured.
        findings: Of the imager's calibration, where it was free.
    """

    where: Georeference
    clock: float
    registration: Registration
    ties: Ties
    observed: Observations
    findings: list[CalibrationFinding]

    @property
    def joint(self) -> JointErrors:
        """Errors that are left, and their covariance."""
        return self.registration.joint

    def uncertainty(
        self, t: Float[np.ndarray, " m"], pixel: Float[np.ndarray, " m"], depth_std: float = 0.0
    ) -> PointUncertainty:
        """Of points that lines at stamps [s] saw, absolutely and within the mosaic that they make up."""
        return point_uncertainty(self.joint, sights(self.where, t + self.clock, pixel), depth_std)


def align(
    where: Georeference,
    keys: KeyFrames,
    t: Float[np.ndarray, " line"],
    bright: Float[np.ndarray, "line pixel"],
    *,
    control: ControlPoints | None = None,
    std: Mapping[str, float] | None = None,
    depth_std: float = 0.0,
    cell: float = 0.015,
    how: Matching = USUAL,
    rounds: int = 2,
    progress: Callable[[str], None] | None = None,
) -> Alignment:
    """Register a mosaic by its pictures.

    From the second round on strips are gridded by the track of the round before, so that patches that were torn or out
    of reach are found; each round's update begins from the track as it was stated, whose covariance is known.

    Args:
        where: Imager, mount, smoothed poses and floor, as stated.
        keys: Of the same smoothed track.
        t: Stamps of the lines [s].
        bright: Brightness of their pixels, such as a mean over bands; no number where not to be trusted.
        control: Known points.
        std: Of the calibration before; see `JointErrors.of`.
        depth_std: Of the floor's depth [m].
        cell: Of the grid of pictures [m].
        how: Patches are matched.
        rounds: Of matching.
        progress: Is called with what is done.

    Raises:
        LogError: Lines and track do not belong together, no two lines overlap and there are no control points, or what
            they say contradicts itself.
    """
    runs = straight_runs(where.navigation, t)
    if not runs:
        raise LogError("registration: no straight run of lines, expected such as a survey has")
    before = JointErrors.of(keys, max(t.min(), keys.t[0]), min(t.max(), keys.t[-1]), std)
    within = [run[(t[run] >= before.t[0]) & (t[run] <= before.t[-1])] for run in runs]
    current, clock = where, 0.0
    found: tuple[Registration, Ties, Observations] | None = None
    for number in range(rounds):
        if progress is not None:
            progress(f"matching overlaps, round {number + 1} of {rounds}")
        strips = [strip_of(current, t[run] + clock, bright[run], cell) for run in within if len(run)]
        ties = match_strips(strips, how)
        ties = replace(ties, t=ties.t - clock)
        observed = observe(before, where, ties, control, depth_std)
        result = register(before, observed)
        found = result, ties, observed
        mount, clock = result.joint.mounted(where.mount)
        current = replace(where, navigation=result.joint.applied(where.navigation), mount=mount)
    if found is None:
        raise ValueError(f"rounds: found {rounds}, expected 1 or more")
    return Alignment(current, clock, *found, calibration_findings(before, found[0].joint))
