"""Tethers in a scenario: where they run from, how long they are, what the log says of them, what cannot be."""

import numpy as np
import pytest
import yaml

from rovtwin.core.errors import ConfigError
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.fly import fly
from rovtwin.scenario.files import dump_scenario, list_scenarios, load_scenario
from rovtwin.scenario.schema import Scenario


def tethers(*overrides, name="lawnmower_calm_tether"):
    return compose(load_scenario(name, overrides)).loop.twin.tethers


@pytest.mark.parametrize("name", list_scenarios())
def test_every_scenario_comes_with_tethers_also_beside_a_doppler_log(name):
    both = load_scenario(f"{name}_dvl_tether")
    assert both.name == f"{name}_dvl_tether" and both.sensors.dvl.on_board and both.world.tethers is not None
    assert load_scenario(name).world.tethers is None
    tethered = load_scenario(f"{name}_tether")
    assert tethered.world.current == load_scenario(name).world.current
    assert Scenario.model_validate(yaml.safe_load(dump_scenario(tethered))) == tethered


def test_no_variant_twice_and_none_of_a_file():
    for name in ("square_tether_tether", "square_rope"):
        with pytest.raises(ConfigError, match="no such scenario"):
            load_scenario(name)


def test_one_for_each_unit_from_above_the_start():
    two = tethers("start.position=[1,2,3]")
    assert sorted(two) == ["port_tether", "starboard_tether"]
    assert sorted(float(t.attachment[1]) for t in two.values()) == [-0.28, 0.28]
    assert all(np.array_equal(t.anchor, [1, 2, 0]) and t.slack is not None for t in two.values())


def test_from_the_nearest_wall_of_a_tank():
    found = tethers("world.tank={north: [-1, 9], east: [-3, 12]}", "world.floor=5")
    assert all(np.array_equal(t.anchor, [-1, 0, 0]) and float(t.cable.floor) == 5.0 for t in found.values())


def test_one_tether_may_be_different():
    found = tethers("world.tethers={paid_out: 40, by_name: {port.tether: {connected: false}}}")
    assert list(found) == ["starboard_tether"]
    found = tethers("world.tethers={slack: 1.3, by_name: {port.tether: {paid_out: 40, anchor: [3, 0, 0]}}}")
    assert found["port_tether"].slack is None and float(found["port_tether"].length) == 40.0
    assert float(found["starboard_tether"].slack) == 1.3
    assert load_scenario("square", ["world.tethers=true"]).world.tethers is not None


def test_in_the_sea_a_tether_is_lighter():
    """By the weight of the water it displaces more: 25 kg/m3 on 20 mm2."""
    fresh, sea = (tethers(f"world.water={density}")["port_tether"].cable for density in (1000, 1025))
    assert (float(fresh.density), float(sea.density)) == (1000.0, 1025.0)  # its drag is that of the same water
    assert float(sea.wet_weight - fresh.wet_weight) == pytest.approx(-25 * 9.81 * np.pi / 4 * 0.005**2)


BARE = "{name: bare, mass: 1, shape: {sphere: 0.1}, thrusters: [{name: t, direction: [1, 0, 0], force: 1}]}"


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        (["vehicle=uhi"], "has no thrusters"),
        ([f"vehicle={BARE}"],
         "world.tethers: bare has no tether; add one to its file"),
        (["world.tethers={anchor: [0, 30, 0], paid_out: 20}"], "20 m is too short: the start is 30.28 m from"),
        (["world.tethers.paid_out=500"], "paid_out is 500 m, but there are 150 m on the drum"),
        (["world.tethers={anchor: [0, 0, 9]}", "world.floor=5"], "its anchor is 9 m deep, below the floor at 5 m"),
        (["world.tethers={by_name: {prot.tether: {slack: 2}}}"], "no tether 'prot.tether'; double_blueye has port"),
        (["world.tethers.slack=0.5"], "world.tethers.slack: found 0.5, expected a number of at least 1"),
        (["world.tethers.paid_out=long"], "world.tethers.paid_out: found 'long', expected"),
        (["world.tethers.lenght=5"], "no such key"),
    ],
)  # fmt: skip
def test_no_tether_like_that(overrides, expected):
    with pytest.raises(ConfigError, match=expected.replace("[", r"\[").replace("(", r"\(")):
        tethers(*overrides)


@pytest.mark.slow
def test_the_log_says_how_it_pulls_and_where_it_lies():
    """In a current of 0.3 m/s to the east, 20 m paid out, the boat 10 m to the south."""
    scenario = load_scenario(
        "lawnmower_calm_tether",
        [
            "autopilot=thesis",
            "duration=3",
            "world.current=[0,0.3,0]",
            "world.tethers={anchor: [-10, 0, 0], paid_out: 20}",
        ],
    )
    log = fly(scenario).log
    pull, shape = log["truth/tether/port_tether"], log["truth/tether_shape/port_tether"]
    values, places = np.asarray(pull.values), np.asarray(shape.values).reshape(len(shape.values), -1, 3)
    np.testing.assert_allclose(values[:, 0], np.linalg.norm(values[:, 1:4], axis=1))
    assert pull.channel.fields[-1] == "misjudged" and (values[:, 5] < 0.05).all()  # no jerk in it
    assert (values[:, 4] == 20.0).all() and 0.5 < values[0, 0] < 20.0
    assert np.array_equal(places[:, 0], np.tile([-10.0, 0.0, 0.0], (len(places), 1)))
    eta = np.asarray(log["truth/eta"].values)
    reach = np.linalg.norm(places[:, -1] - eta[:, :3], axis=1)
    np.testing.assert_allclose(reach, np.hypot(0.22, 0.28), atol=0.01)
    both = values[:, 1:4] + np.asarray(log["truth/tether/starboard_tether"].values)[:, 1:4]
    wrench = np.asarray(log["truth/external_wrench"].values)
    np.testing.assert_allclose(wrench[1:, :2], both[1:, :2], atol=0.1)  # it is level and heads north
