"""Missions way-point by way-point: when each was reached, and flights sampled alike however fast they were.

Flights of one mission differ in time. Sampled by the share of each part of a leg (diving and turning, going, staying),
they are compared where they are in the plan and not when: what a flight is late by shows in its times alone.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Real

from rovtwin.core.flow import DIVE, FINISHED, GO, HOLD, TURN
from rovtwin.runs.ensemble.bands import Axis, unwrapped_to

UNDER_WAY = (DIVE, TURN, GO, HOLD)
BEGINS, GOES, REACHED, LEFT = range(4)  # columns of the times of a way-point
MOST = 1200  # samples of a mission, unless it has so many way-points that each has the fewest
FEWEST, ENOUGH = 5, 36  # samples of a way-point
SHORT = 0.05  # a leg that is shorter has no direction of its own [m]
# Beyond its band by no more than that a flight is near it: as for the four corners of a commissioning.
AXES = (Axis("across", "m", 0.05), Axis("depth", "m", 0.05), Axis("heading", "deg", 5.0))


def times_of(t: Float[np.ndarray, " n"], mode: Real[np.ndarray, "n 4"], count: int) -> Float[np.ndarray, "count 4"]:
    """When each way-point is turned to, its leg begun, it is reached, and left [s]; NaN of those that were not left.

    Args:
        t: Of the samples [s].
        mode: phase, reason, waypoint, on_leg, as logged.
        count: Way-points of the mission.
    """
    phase, aimed = mode[:, 0].astype(int), mode[:, 2].astype(int)
    flies, times = np.isin(phase, UNDER_WAY), np.full((count, 4), np.nan)
    for k in range(count):
        rows = np.flatnonzero(flies & (aimed == k))
        after = np.flatnonzero((flies & (aimed > k)) | (phase == FINISHED))
        if not rows.size or not after.size:
            break
        going, staying = rows[phase[rows] == GO], rows[phase[rows] == HOLD]
        begins, left = t[rows[0]], t[after[0]]
        reached = t[staying[0]] if staying.size else left
        times[k] = begins, min(t[going[0]] if going.size else reached, reached), reached, left
    return times


@dataclass(frozen=True)
class Course:
    """The legs of a plan, and how flights along them are sampled.

    Attributes:
        places: Where it begins, and the way-points [m], n.
        ahead: Unit vector along each leg, horizontal.
        samples: Of a way-point: before its leg, on it, at its end.
    """

    places: Float[np.ndarray, "legs+1 3"]
    ahead: Float[np.ndarray, "legs 2"]
    samples: tuple[int, int, int]

    @classmethod
    def of(cls, places: Float[np.ndarray, "legs+1 3"], heading: float) -> "Course":
        """Of places in order; `heading` [rad] is that at the first, for a dive there."""
        ahead, before = [], np.array([np.cos(heading), np.sin(heading)])
        for leg in np.diff(places[:, :2], axis=0):
            length = float(np.hypot(*leg))
            before = leg / length if length > SHORT else before
            ahead.append(before)
        each = int(np.clip(MOST // len(ahead), FEWEST, ENOUGH))
        beside = max(each // 6, 1)
        return cls(places, np.array(ahead), (beside, each - 2 * beside, beside))

    @property
    def count(self) -> int:
        """Way-points."""
        return len(self.ahead)

    @property
    def each(self) -> int:
        """Samples of a way-point."""
        return sum(self.samples)

    def instants(self, times: Float[np.ndarray, "count 4"]) -> Float[np.ndarray, " n"]:
        """When a flight is sampled [s], from the times of its way-points, NaN where these are."""
        shares = [np.arange(many) / many for many in self.samples]
        parts = [
            times[:, i, None] + shares[i] * (times[:, i + 1] - times[:, i])[:, None] for i in (BEGINS, GOES, REACHED)
        ]
        return np.concatenate(parts, axis=1).ravel()

    def sampled(
        self, t: Float[np.ndarray, " m"], eta: Float[np.ndarray, "m 6"], times: Float[np.ndarray, "count 4"]
    ) -> Float[np.ndarray, "n 3"]:
        """What AXES has of poses: off its leg to starboard [m], depth [m], heading [deg], unwrapped.

        Args:
            t: Of the poses [s].
            eta: Poses [m, rad].
            times: Of the way-points.
        """
        at = self.instants(times)
        north, east, depth = (np.interp(at, t, eta[:, i]) for i in range(3))
        leg = np.repeat(np.arange(self.count), self.each)
        off = np.column_stack([north, east]) - self.places[1:][leg, :2]
        ahead = self.ahead[leg]
        heading = np.degrees(np.interp(at, t, np.unwrap(eta[:, 5])))
        curves = np.column_stack([ahead[:, 0] * off[:, 1] - ahead[:, 1] * off[:, 0], depth, heading])
        curves[np.isnan(at)] = np.nan
        return curves

    def beside(self, along: Float[np.ndarray, "n 2"], across: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 2"]:
        """Places [m] so far off the legs to starboard where places `along` are along them."""
        leg = np.repeat(np.arange(self.count), self.each)[: len(along)]
        ahead, target = self.ahead[leg], self.places[1:][leg, :2]
        starboard = np.column_stack([-ahead[:, 1], ahead[:, 0]])
        done = np.sum((along - target) * ahead, axis=1)
        return target + done[:, None] * ahead + across[:, None] * starboard


def headings_near(
    curves: Float[np.ndarray, "*N n 3"], reference: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "*N n 3"]:
    """Curves of AXES with whole turns added to headings, to lie within half a turn of those of a reference."""
    turned = curves.copy()
    turned[..., 2] = unwrapped_to(curves[..., 2], reference[:, 2])
    return turned
