"""Missions of a commissioning: they fit their water."""

import numpy as np
import pytest

from rovtwin.commission.proving.missions import FIRST, in_tank, open_water, sea
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import parse
from rovtwin.planning.tank import Tank
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import load_vehicle


@pytest.mark.parametrize("name", ["double_blueye", "bluerov2_heavy"])
def test_the_hull_stays_off_the_walls_whichever_way_it_is_turned(name):
    vehicle, tank = load_vehicle(name), Tank.parse("6x3x1.5")
    made = in_tank(vehicle, tank, 0.05)
    corners = np.array([point["position"] for point in made["mission"]["waypoints"]])
    hull = np.asarray(vehicle.model().hull.corners)
    around = np.hypot(*hull[:, :2].T).max()
    assert np.all(np.abs(corners[:, 0]) + around < 3.0) and np.all(np.abs(corners[:, 1]) + around < 1.5)
    assert np.all(corners[:, 2] - np.abs(hull[:, 2]).max() > 0.0)
    assert np.all(corners[:, 2] + np.abs(hull[:, 2]).max() < 1.5)
    assert len({tuple(corner) for corner in corners}) == 4 and np.ptp(corners[:, 2]) > 0.05
    stays = [i for i, point in enumerate(made["mission"]["waypoints"]) if "hold_time" in point]
    assert stays == [FIRST, len(corners) - 1] and np.all(corners[FIRST] == corners[-1])
    along = corners[FIRST] - corners[FIRST - 1]
    assert along[0] > 1.0 and along[1] == along[2] == 0.0, "it comes to the first corner in one way, also its heading"
    parse(Scenario, {"vehicle": name} | made, "made")


def test_a_tank_without_room_says_which_has():
    vehicle = load_vehicle("double_blueye")
    with pytest.raises(ConfigError, match="no room for four corners") as error:
        in_tank(vehicle, Tank.parse("1.4x1.3x1.5"), 0.05)
    in_tank(vehicle, Tank.parse(str(error.value).split()[-1]), 0.05)


def test_poor_positions_make_a_smaller_box():
    vehicle, tank = load_vehicle("double_blueye"), Tank.parse("6x3x1.5")
    good, poor = (
        np.array(in_tank(vehicle, tank, sigma)["mission"]["waypoints"][0]["position"]) for sigma in (0.03, 0.16)
    )
    assert abs(poor[1]) < abs(good[1]) - 0.3


def test_a_vehicle_that_strays_gets_a_smaller_box():
    vehicle, tank = load_vehicle("double_blueye"), Tank.parse("6x3x1.5")
    usual, inwards = (np.array(in_tank(vehicle, tank, 0.03, strays)["mission"]["waypoints"][0]["position"])
                      for strays in (0.0, 0.1))  # fmt: skip
    assert abs(usual[1]) - abs(inwards[1]) == pytest.approx(0.1, abs=0.011)


def test_the_square_is_sized_by_the_vehicle():
    sides = {}
    for name in ("double_blueye", "bluerov2_heavy"):
        model = load_vehicle(name).model()
        made = open_water(model)
        sides[name] = made["mission"]["waypoints"][0]["position"][0] / float(model.displaced_mass) ** (1 / 3)
    assert sides["double_blueye"] == pytest.approx(sides["bluerov2_heavy"], rel=0.03)


def test_seas_are_fully_developed_and_calm_is_none():
    assert sea(0.0, 10.0) is None
    made = sea(0.25, 10.0)
    assert made is not None and made["peak_period"] == pytest.approx(2.5)
    parse(Scenario, {"world": {"waves": made}, "mission": {"waypoints": [{"position": [1, 0, 3]}]}}, "made")
