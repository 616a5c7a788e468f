"""A second survey of the same area, across the first: each place is seen on two courses."""

from dataclasses import replace
from typing import Any

import numpy as np

from rovtwin.survey.library import shapely_library
from rovtwin.survey.plan import SurveyPlan, plan_survey
from rovtwin.survey.route import Network, Path


def crosshatched(first: SurveyPlan, area: Any, clearance: float, acceptance: float = 0.0) -> SurveyPlan:
    """A plan, and after it a second one with lines a right angle from its own.

    Args:
        first: The plan.
        area: That it covers, a shapely MultiPolygon.
        clearance: As in `plan_survey` [m].
        acceptance: The same [m].

    Raises:
        ConfigError: As `plan_survey`.
    """
    across = first.lines.heading + 0.5 * np.pi
    second = plan_survey(area, first.room.swath, first.pace, clearance, across, first.room.inside, acceptance)
    path = Path.joined([first.path, second.path], Network(first.room))
    seen = shapely_library().union_all([first.seen, second.seen])
    return replace(first, path=path, seen=seen, crossing=second.lines)
