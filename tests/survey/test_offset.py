"""A survey for an imager that does not sit at the vehicle's origin: the imager follows the lines, wherever CO goes."""

import numpy as np
import pytest
import shapely
from tests.survey.test_plan import PACE, RING, SQUARE, SWATH

from rovtwin.survey.offset import corners_of_co
from rovtwin.survey.plan import plan_survey


def seen_by(corners, lever, width):
    """What a swath about a place of the body covers while CO goes from corner to corner, the vehicle pointing along."""
    legs = np.diff(corners, axis=0)
    course = legs / np.linalg.norm(legs, axis=1, keepdims=True)
    offset = course * lever[0] + np.stack([-course[:, 1], course[:, 0]], axis=1) * lever[1]
    strips = zip(corners[:-1] + offset, corners[1:] + offset, strict=True)
    return shapely.union_all([shapely.buffer(shapely.LineString(s), 0.5 * width, cap_style="flat") for s in strips])


@pytest.mark.parametrize("area", [SQUARE, RING], ids=["square", "ring"])
@pytest.mark.parametrize("lever", [(0.0, 0.25), (0.3, -0.25)])
def test_nothing_is_missed_that_is_seen_with_the_imager_at_co(area, lever):
    plan, lever = plan_survey(area, SWATH, PACE, 0.3), np.array(lever)
    before = seen_by(plan.path.corners, np.zeros(2), SWATH.width).intersection(area).area
    moved = seen_by(corners_of_co(plan.path, lever), lever, SWATH.width).intersection(area).area
    forgotten = seen_by(plan.path.corners, lever, SWATH.width).intersection(area).area
    assert moved > before - 2e-3 * area.area, "as much as with the imager at CO"
    assert forgotten < before - 1e-2 * area.area, "way-points of CO on the imager's lines leave gaps"


def test_an_imager_at_co_changes_nothing():
    plan = plan_survey(RING, SWATH, PACE, 0.3)
    np.testing.assert_allclose(corners_of_co(plan.path, np.zeros(2)), plan.path.corners, atol=1e-12)
