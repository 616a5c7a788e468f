"""What a rehearsal gives reason to say, from figures of flights: grades, way-points and words."""

from dataclasses import replace

import numpy as np
import pytest

from rovtwin.runs.ensemble.rehearsal import Figures
from rovtwin.runs.ensemble.remarks import remarks

GOOD = Figures(
    times=np.arange(12.0).reshape(3, 4),
    curves=np.zeros((9, 3)),
    place=np.zeros((9, 2)),
    clearance=np.ones(9),
    margin=np.array([0.5, 0.4, 0.6]),
    used=np.array([1.0, 2.0, 3.0]),
    left=np.array([0.9, 0.8, 0.7]),
    whole=3.0,
    remains=0.7,
    lasting=12.0,
    effort=np.ones(6),
    aimed=2,
    ended="",
    touched=[],
    unmet=[],
    nearest={"the floor": 1.0},
)


def changed(**more):
    return replace(GOOD, **more)


def only(nominal, drawn=(GOOD, GOOD)):
    (remark,) = remarks(nominal, drawn)
    return remark


def test_where_nothing_is_wrong_one_remark_says_so():
    assert only(GOOD, []).what == "the vehicle as it is known completes it, and touches nothing"
    assert only(GOOD).level == "ok" and "all 2 drawn vehicles complete it" in only(GOOD).what


def test_a_mission_that_is_not_completed_is_an_error_at_its_way_point():
    remark = only(changed(ended="time out after 90 s, on its way to way-point 2 of 3", aimed=1))
    assert (remark.level, remark.points) == ("error", [1]) and "time out" in remark.what


def test_drawn_vehicles_that_fail_are_counted_with_the_first_ones_reason():
    remark = only(GOOD, [GOOD, changed(ended="off course after 12 s", aimed=0), changed(ended="other", aimed=2)])
    assert (remark.level, remark.points) == ("warning", [0, 2])
    assert remark.what.startswith("2 of 3 drawn vehicles do not complete it, at way-points 1, 3; the first")


@pytest.mark.parametrize(("known", "least", "whose"), [(0.05, 5, ""), (0.4, 3, " with a drawn vehicle")])
def test_little_thrust_is_a_warning_on_its_rows(known, least, whose):
    weak = changed(margin=np.array([0.5, 0.03 if whose else 0.05, 0.6]))
    remark = only(changed(margin=np.array([0.5, known, 0.6])), [GOOD, weak])
    assert (remark.level, remark.points) == ("warning", [1])
    assert remark.what.startswith(f"way-point 2: a thruster has {least} % of its force left{whose}, expected 10 %")


def test_what_the_hull_touches():
    assert only(changed(touched=["touched the floor at 3.0 s for 0.2 s"], nearest={"the floor": -0.1})).level == "error"
    remark = only(GOOD, [GOOD, changed(nearest={"the floor": -0.1})])
    assert (remark.level, remark.what) == ("warning", "1 of 2 drawn vehicles touch the floor")


def test_an_empty_battery_is_an_error_where_it_is_empty_and_a_low_one_a_warning():
    empty = only(changed(left=np.array([0.3, -0.1, -0.4]), remains=-0.4))
    assert (empty.level, empty.points) == ("error", [1]) and "before way-point 2" in empty.what
    assert only(GOOD, [GOOD, changed(remains=0.12)]).what.startswith("12 % of the battery may be left, expected 20 %")
    assert only(changed(left=None, remains=None)).level == "ok"


def test_the_gravest_comes_first():
    several = remarks(changed(ended="lost", unmet=["heading 90 deg not met at way-point 3"]), [GOOD])
    assert [one.level for one in several] == ["error", "warning"] and several[1].points == [2]
