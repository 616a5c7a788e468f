"""Way-points that were passed at another depth than theirs: guidance asks for the depth of a dive, not of a leg."""

import numpy as np

from rovtwin.core.flow import FINISHED, GO, HOLD
from rovtwin.runs.limits import Limits
from rovtwin.runs.scoring.scores import Flown
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Model


def not_at_depth(flown: Flown, scenario: Scenario, model: Model) -> str:
    """The first way-point to whose depth the vehicle never came, in words; empty where there is none.

    It came there if on the second half of the leg, or holding, it was once within the way-point's acceptance of its
    depth, or within a length of the vehicle.
    """
    aimed, points = flown.mode[:, 2].astype(int), scenario.waypoints
    arriving = np.isin(flown.mode[:, 0], (GO, HOLD, FINISHED))
    left = np.hypot(*(flown.eta[:, :2] - flown.leg[:, 3:5]).T)
    arriving &= left <= 0.5 * np.hypot(*(flown.leg[:, :2] - flown.leg[:, 3:5]).T) + Limits.of(model).length
    off = flown.eta[:, 2] - flown.leg[:, 5]
    for i, point in enumerate(points):
        rows = np.flatnonzero(arriving & (aimed == i))
        if not rows.size:
            continue
        nearest = rows[np.argmin(np.abs(off[rows]))]
        if abs(off[nearest]) > max(point.acceptance or 0.0, Limits.of(model).length):
            deep, asked = flown.eta[nearest, 2], flown.leg[nearest, 5]
            return (
                f"way-point {i + 1} of {len(points)} was passed at a depth of {deep:.2g} m, and {asked:.2g} m were "
                "asked for: look at the thrust in heave, buoyancy and trim (rovtwin vehicle show)"
            )
    return ""
