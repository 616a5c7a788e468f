"""Efforts: what drag makes of them, and how seldom a true model is called untrue."""

import numpy as np
import pytest

from rovtwin.runs.ensemble.efforts import agrees, effort, foreseen


def test_the_effort_of_quadratic_drag_is_its_coefficient():
    nu = np.random.default_rng(1).standard_normal((200, 6))
    drag = np.arange(1.0, 7.0)
    assert effort(nu, drag * np.abs(nu) * nu) == pytest.approx(drag)


def test_interval_and_chance_are_those_of_one_more_flight():
    rng = np.random.default_rng(2)
    inside, alarms = [], []
    for _ in range(400):
        logs = 0.05 * rng.standard_normal((80, 6))
        one = foreseen(list(np.exp(logs[:-1])))[0]
        low, high = one.ratio()
        flown = float(np.exp(logs[-1, 0]))
        inside.append(low < flown / one.middle < high)
        alarms.append(not agrees(one, flown, 1))
        assert one.chance(one.middle * high) == pytest.approx(0.05)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.03)
    assert np.mean(alarms) < 0.03


def test_axes_that_drawn_flights_disagree_about_are_left_out():
    rng = np.random.default_rng(3)
    drawn = np.exp(rng.standard_normal((79, 6)) * [0.05, 0.5, 0.05, 0.05, 0.05, 0.05])
    drawn[3, 3] = -1.0
    assert [one.axis for one in foreseen(list(drawn))] == ["surge", "heave", "pitch", "yaw"]


def test_thirty_percent_more_drag_is_seen():
    drawn = np.exp(0.06 * np.random.default_rng(4).standard_normal((79, 6)))
    one = foreseen(list(drawn))[0]
    assert agrees(one, one.middle, 4) and not agrees(one, 1.3 * one.middle, 4) and not agrees(one, -1.0, 4)
