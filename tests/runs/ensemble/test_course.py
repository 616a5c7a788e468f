"""Missions way-point by way-point: times from what was logged, and flights that differ in time alone sampled alike."""

import numpy as np
import pytest

from rovtwin.core.flow import DIVE, FINISHED, GO, HOLD, TURN
from rovtwin.runs.ensemble.course import AXES, FEWEST, Course, headings_near, times_of

PLACES = np.array([[0.0, 0.0, 1.0], [4.0, 0.0, 2.0], [4.0, 3.0, 2.0]])


def logged(stretches, dt=0.1):
    """Times and modes of (phase, way-point, seconds) one after the other, then the end."""
    rows = [[phase, 0, aimed, phase == GO] for phase, aimed, lasts in stretches for _ in range(round(lasts / dt))]
    rows.append([FINISHED, 0, stretches[-1][1], 0])
    return dt * np.arange(len(rows)), np.array(rows, float)


def test_way_points_are_turned_to_gone_to_reached_and_left():
    t, mode = logged([(DIVE, 0, 2.0), (GO, 0, 8.0), (HOLD, 0, 5.0), (TURN, 1, 1.0), (GO, 1, 6.0)])
    assert times_of(t, mode, 2) == pytest.approx(np.array([[0.0, 2.0, 10.0, 15.0], [15.0, 16.0, 22.0, 22.0]]))


def test_a_way_point_that_was_not_left_has_no_times():
    t, mode = logged([(GO, 0, 8.0), (GO, 1, 6.0)])
    times = times_of(t[:-1], mode[:-1], 2)
    assert np.isfinite(times[0]).all() and np.isnan(times[1]).all()
    assert np.isnan(times_of(t[:50], mode[:50], 2)).all()


def test_a_place_that_is_reached_by_diving_alone_has_no_leg():
    t, mode = logged([(DIVE, 0, 9.0), (GO, 1, 6.0)])
    assert times_of(t, mode, 2)[0] == pytest.approx([0.0, 9.0, 9.0, 9.0])


def poses(t, times):
    """Along both legs at constant speed between its times, 0.1 m to starboard of them."""
    eta = np.zeros((len(t), 6))
    eta[:, 0] = np.interp(t, times[0, [1, 2]], [0.0, 4.0])
    eta[:, 1] = np.interp(t, times[1, [1, 2]], [0.0, 3.0]) + 0.1 * (t < times[1, 1])
    eta[:, 0] -= 0.1 * (t >= times[1, 1])
    eta[:, 2] = np.interp(t, times[0, [0, 1]], [1.0, 2.0])
    eta[:, 5] = np.interp(t, times[1, [0, 1]], [0.0, 0.5 * np.pi])
    return eta


def test_flights_that_differ_in_time_alone_are_sampled_alike():
    course, curves = Course.of(PLACES, 0.0), []
    for pace in (1.0, 1.7):
        times = pace * np.array([[0.0, 2.0, 10.0, 10.0], [10.0, 12.0, 18.0, 18.0]])
        t = np.arange(0.0, pace * 18.0, 0.02)
        curves.append(course.sampled(t, poses(t, times), times))
    assert curves[0].shape == (2 * course.each, len(AXES))
    assert curves[0] == pytest.approx(curves[1], abs=0.03)
    on_legs = np.concatenate([np.arange(2) * course.each + 10, np.arange(2) * course.each + 20])
    assert curves[0][on_legs, 0] == pytest.approx(0.1, abs=0.01)  # to starboard on both


def test_edges_lie_beside_the_legs():
    course = Course.of(PLACES, 0.0)
    along = np.repeat([[2.0, 5.0], [7.0, 1.0]], course.each, axis=0)
    beside = course.beside(along, np.full(len(along), 0.5))
    assert beside[0] == pytest.approx([2.0, 0.5]) and beside[-1] == pytest.approx([3.5, 1.0])


def test_a_dive_on_the_spot_has_the_direction_of_the_heading():
    course = Course.of(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 3.0]]), 0.5 * np.pi)
    assert course.ahead[0] == pytest.approx([0.0, 1.0], abs=1e-12)


def test_a_long_plan_is_sampled_less_but_everywhere():
    places = np.column_stack([np.arange(513.0), np.zeros(513), np.zeros(513)])
    course = Course.of(places, 0.0)
    assert course.each == FEWEST and min(course.samples) >= 1 and course.count == 512


def test_headings_a_whole_turn_apart_are_the_same():
    reference = np.column_stack([np.zeros(3), np.zeros(3), [170.0, 180.0, 190.0]])
    turned = reference - [0.0, 0.0, 360.0]
    assert headings_near(turned[None], reference)[0] == pytest.approx(reference)
