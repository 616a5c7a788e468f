"""The tolerances of ArduSub's own tests, with its vehicle and the model-based autopilot."""

import numpy as np
import pytest

from rovtwin.runs.fly import fly
from rovtwin.scenario.files import load_scenario
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.analysis.performance import performance


def flown(name, seed, *changes):
    return fly(load_scenario(name, changes, seed=seed))


@pytest.mark.slow
def test_depth_is_held_to_03_m_under_10_n_of_buoyancy():
    run = flown("ardusub_depth_hold", 1)
    assert run.completed and np.abs(run.log["truth/eta"]["z"] - 3.0).max() < 0.3


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 6))
def test_place_is_held_to_1_m_in_05_m_per_s(seed):
    run = flown("ardusub_position_hold_dvl", seed)
    away = np.hypot(*run.log["truth/eta"].values[:, :2].T)
    assert run.completed and away.max() < 1.0


def test_1_m_per_s_is_more_than_the_vehicle_can_push_against():
    assert 0.7 < performance(load_vehicle("bluerov2_heavy").model())["surge"]["ahead"].top_speed < 0.8


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 6))
def test_way_points_are_reached_to_05_m(seed):
    run = flown("ardusub_waypoint_dvl", seed)
    places = run.log["truth/eta"].values[:, :3]
    for expected in ([5, 0, 3], [5, 5, 5], [0, 0, 3]):
        assert np.linalg.norm(places - expected, axis=1).min() < 0.5
    assert run.completed
