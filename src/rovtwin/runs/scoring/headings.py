"""Headings that a mission asks for and that were not met, in words: for the decisions and the summary of a run."""

import math
from dataclasses import dataclass

import numpy as np

from rovtwin.core.flow import FINISHED, HEADING_GIVEN_UP
from rovtwin.runs.limits import Limits
from rovtwin.runs.scoring.scores import Flown, headings
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Model

MET = 15.0  # a heading within this is met [deg]
SWAY = 1


@dataclass(frozen=True)
class Unmet:
    """A heading that was not met at its way-point.

    Attributes:
        t: When it was given up, or else when the way-point was left [s].
        waypoint: Its number, from 1.
        asked, off: Heading asked for and error when the way-point was left, or at the end [deg].
        given_up: Whether guidance gave it up for the place.
    """

    t: float
    waypoint: int
    asked: float
    off: float
    given_up: bool

    @property
    def what(self) -> str:
        """As words."""
        return f"heading {self.asked:g} deg {'given up' if self.given_up else 'not met'} at way-point {self.waypoint}"

    @property
    def line(self) -> str:
        """With the error, as words."""
        return f"{self.what}: {self.off:.0f} deg off when it was left"


def unmet_headings(flown: Flown, scenario: Scenario) -> list[Unmet]:
    """Of way-points that were reached, in order; the heading is the true one where it is known."""
    found, at = [], flown.mode[:, 2].astype(int)
    for i, point in enumerate(scenario.waypoints):
        rows = np.flatnonzero(at == i)
        if point.heading_deg is None or not rows.size:
            continue
        last = int(rows[-1])
        if last == len(at) - 1 and int(flown.mode[last, 0]) != FINISHED:
            continue  # it was still on its way
        off = abs((math.degrees(headings(flown.eta[last:])[0]) - point.heading_deg + 180.0) % 360.0 - 180.0)
        if off > MET:
            up = np.zeros(0, int) if flown.progress is None else rows[flown.progress[rows] == HEADING_GIVEN_UP]
            t = float(flown.t[up[0] if up.size else last])
            found.append(Unmet(t, i + 1, point.heading_deg, off, bool(up.size)))
    return found


def reason_for(unmet: Unmet, model: Model) -> str:
    """Why, as far as the vehicle and guidance tell it, with the error."""
    error = f"{unmet.off:.0f} deg off when the way-point was left"
    if not unmet.given_up:
        return error
    weak = Limits.of(model).can(SWAY)
    sway = "is more than thrust in sway can hold against" if weak else "there is no thrust in sway to hold against it"
    return f"the current comes from the side and {sway}: it turned its bow into the current to hold its place; {error}"
