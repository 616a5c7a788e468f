import numpy as np
import pytest
from tests.gnc.flying import LAWNMOWER, points, route

from rovtwin.core.errors import ConfigError
from rovtwin.gnc.guidance.mission import mission, total_length, waypoints


def test_rows_are_as_given_and_padding_shares_the_shape():
    short = mission([{"x": 1, "y": -2, "depth": 3}])
    long = route(LAWNMOWER)
    assert short.position.shape == long.position.shape == (16, 3)
    assert int(short.count) == 1 and int(long.count) == 7
    np.testing.assert_array_equal(waypoints(short), [[1, -2, 3]])
    np.testing.assert_array_equal(waypoints(long)[:, :2], LAWNMOWER)
    assert not np.any(long.fixed_heading) and np.all(np.asarray(long.acceptance) == 0.2)
    assert route([(i, 0) for i in range(17)]).position.shape == (32, 3)


def test_options_of_a_way_point():
    one = mission([{"x": 0, "y": 0, "depth": 3, "heading": 0.0, "hold_time": 480, "acceptance": 0.5, "speed": 0.1}])
    assert bool(one.fixed_heading[0]) and float(one.heading[0]) == 0.0
    assert [float(one.hold_time[0]), float(one.acceptance[0]), float(one.speed[0])] == [480, 0.5, 0.1]


def test_length():
    assert total_length(route(LAWNMOWER)) == pytest.approx(27.0)
    assert total_length(route(LAWNMOWER), start=(0, 0, 3)) == pytest.approx(33.0)
    assert total_length(route([(3, 4)])) == 0.0


GOOD = {"x": 0, "y": 0, "depth": 3}


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ([], "plan.yaml: has no way-points"),
        ([{"x": 0, "y": 0}], r"plan.yaml\[0\]: depth is missing"),
        ([GOOD, GOOD | {"z": 3}], r"plan.yaml\[1\].z: no such key; expected x, y, depth"),
        ([GOOD | {"depth": -1}], "depth: -1 is out of range; expected at least 0"),
        ([GOOD | {"depth": float("nan")}], "depth: nan is not a finite number"),
        ([GOOD | {"x": "6"}], "x: '6' is not a finite number"),
        ([GOOD | {"x": True}], "x: True is not"),
        ([GOOD | {"speed": None}], "speed: None is not"),
        ([GOOD | {"acceptance": 0}], "acceptance: 0 is out of range"),
        ([GOOD | {"speed": -0.1}], "speed: -0.1 is out of range"),
        ([GOOD | {"hold_time": -1}], "hold_time: -1 is out of range"),
        ([GOOD | {"heading": 90}], "heading: 90 is out of range; .* looks like degrees"),
    ],
)
def test_bad_missions_are_named(bad, message):
    with pytest.raises(ConfigError, match=message):
        mission(bad, where="plan.yaml")


def test_points_are_not_changed():
    given = points(LAWNMOWER)
    before = [dict(point) for point in given]
    mission(given)
    assert given == before
