"""Missions that begin and end at the surface, in a tank."""

import numpy as np
import pytest

from rovtwin.core.flow import FINISHED
from rovtwin.scenario import compose, fly, load_scenario
from rovtwin.vehicle.trim import afloat

SET = (
    "start.position=[0, 0, 0]",
    "world.floor=2.0",
    "world.tank={north: [-2, 4], east: [-3, 3]}",
    "world.net_buoyancy=2",
    "autopilot=thesis_placed",
    "mission={waypoints: [{position: [0, 0, 1]}, {position: [2, 0, 0]}]}",
    "duration=200",
)


def test_from_the_surface_and_back():
    flight = fly(load_scenario("square", SET, seed=2))
    assert flight.completed, flight.summary["reason"]
    depth = flight.log["truth/eta"].values[:, 2]
    model = compose(load_scenario("square", SET)).model
    assert depth[0] == pytest.approx(afloat(model), abs=0.02) and depth.max() > 0.8
    assert flight.log["autopilot/mode"].values[-1, 0] == FINISHED
    assert abs(depth[-1] - afloat(model)) < 0.2
    assert np.all(depth > afloat(model) - 0.1)


def test_afloat_is_where_it_comes_to_rest():
    run = compose(load_scenario("square", ("start.position=[0, 0, 0]", "world.net_buoyancy=20")))
    plant = run.loop.twin.model
    draught = 0.1595 - afloat(plant)  # how much of the Pioneers' hull, 0.319 m high, is dry
    assert float(run.start.position[2]) == afloat(plant)
    assert 0.005 < draught < 0.05


def test_a_floor_above_the_vehicle_s_own_way_point_is_found_by_the_vehicle():
    """The tank holds it: a way-point below the floor is never reached, and nothing breaks."""
    changes = ("mission={waypoints: [{position: [0, 0, 3]}]}", "duration=40")
    flight = fly(load_scenario("square", (*SET[:-2], *changes)))
    assert not flight.completed
    assert flight.log["truth/eta"].values[:, 2].max() < 2.0 - 0.1595 + 0.01
