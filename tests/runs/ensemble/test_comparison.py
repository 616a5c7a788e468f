"""A part of a way against the same part of the drawn flights', and energy of what is predicted."""

from types import SimpleNamespace

import numpy as np
import pytest

from rovtwin.runs.ensemble.bands import band_between, shares_inside
from rovtwin.runs.ensemble.comparison import Sortie, _axes, _energy
from rovtwin.runs.ensemble.course import AXES, Course
from rovtwin.runs.ensemble.forecast import _inside
from rovtwin.vehicle import load_vehicle

DRAWS = 39


@pytest.mark.parametrize(("reached", "first", "share"), [(1, 0, 0.25), (2, 1, 0.75), (2, 0, 0.5)])
def test_only_what_was_flown_of_the_drawn_flights_counts(reached, first, share):
    course = Course.of(np.array([[0.0, 0, 1], [5, 0, 1], [5, 5, 1]]), 0.0)
    half, n = course.each, 2 * course.each
    low = np.concatenate([np.full((half, 3), 1.0), np.full((half, 3), -1.0)])  # the flight is inside on the second leg
    predicted = {
        "bands": {"low": low.tolist(), "high": (low + 2.0).tolist()},
        "inside": {name: [[half // 4, 3 * half // 4]] * DRAWS for name in ("across", "depth", "heading")},
    }
    times = np.full((2, 4), np.nan)
    times[:reached] = 1.0
    rows = _axes(predicted, course, times, np.zeros((n, 3)), first)
    assert [row["least_usual"] for row in rows] == [share] * 3
    outside = {"across": "outside", "depth": "outside", "heading": "near"}
    assert [row["verdict"] for row in rows] == (
        [outside[row["axis"]] for row in rows] if not first and reached == 1 else ["inside"] * 3
    )


@pytest.mark.parametrize("has_battery", [True, False])
def test_a_gauge_is_compared_only_where_loads_beside_the_thrusters_are_predicted_too(has_battery):
    vehicle = load_vehicle("bluerov2")
    count, t, still = len(vehicle.thruster_names), np.arange(0.0, 36.0, 0.5), np.zeros((72, 6))
    flown = Sortie(t, still, still, still, np.zeros((72, 4)), np.zeros((72, count)), np.full(72, 100.0))
    sources = vehicle.power_sources if has_battery else []
    about = SimpleNamespace(power_sources=sources, specific_power=vehicle.specific_power, model=vehicle.model)
    found = _energy({"energy_wh": {"value": 1.0}}, flown, about)
    assert found["by"] == ("the battery's own power" if has_battery else "the thrusters' commands")
    assert found["flown"] == pytest.approx(100.0 * 35.5 / 3600.0 if has_battery else 0.0, abs=1e-9)


def test_counts_of_all_way_points_are_the_share_of_the_whole_way():
    drawn = np.random.default_rng(1).standard_normal((DRAWS, 72, 3)).cumsum(axis=1)
    counts = _inside(band_between(drawn, 1), 36)
    for i, axis in enumerate(AXES):
        assert np.shape(counts[axis.name]) == (DRAWS, 2)
        np.testing.assert_allclose(np.sum(counts[axis.name], axis=1) / 72, shares_inside(drawn[:, :, i], 1))
    assert _inside(None, 36) == {}
