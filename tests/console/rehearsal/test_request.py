"""What is rehearsed, as a scenario: the plan from here, in the water there is; and water that cannot be."""

import pytest

from rovtwin.console.rehearsal.request import Request, Water
from rovtwin.core.errors import ConfigError
from rovtwin.scenario.files import load_scenario

ROW = {"x": 3.0, "y": 1.0, "depth": 2.0, "speed": 0.2, "acceptance": 0.3, "hold_time": 4.0, "heading_deg": None}


def request(**more):
    return Request(1, (ROW,), (1.0, -2.0, 0.7), 90.0, **more)


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("lawnmower_calm", ["world.current={velocity: [0.1, 0.0, 0.0]}", "world.floor=5"])


def current(scenario, **more):
    return request(**more).scenario(scenario).world.current.velocity


def test_it_begins_where_the_vehicle_is_with_the_plan_of_the_table(scenario):
    flown = request().scenario(scenario)
    assert flown.start.position == [1.0, -2.0, 0.7] and flown.start.heading_deg == 90.0
    (point,) = flown.waypoints
    assert point.position == [3.0, 1.0, 2.0] and point.hold_time == 4.0


def test_what_the_twin_has_of_current_is_added_and_what_somebody_gives_stands_alone(scenario):
    assert current(scenario) == pytest.approx([0.1, 0.0, 0.0])
    assert current(scenario, added=(0.0, 0.2)) == pytest.approx([0.1, 0.2, 0.0])
    given = Water.of({"speed": 0.3, "toward": 90.0}, False)
    assert current(scenario, added=(0.0, 0.2), water=given) == pytest.approx([0.0, 0.3, 0.0])
    assert "0.3 m/s to the east (90 deg), as given" in request(water=given).words(scenario)


def test_a_current_that_varies_keeps_its_shape(scenario):
    sheared = "world.current={type: sheared, depths: [0, 10], velocities: [[0.2, 0, 0], [0, 0, 0]]}"
    flown = request(added=(0.0, 0.1)).scenario(load_scenario("lawnmower_calm", [sheared]))
    assert flown.world.current.velocities[0] == pytest.approx([0.2, 0.1, 0.0])
    wandering = "world.current={type: gauss_markov, mean: [0.1, 0, 0], sigma: [0.02, 0.02, 0], time_constant: 60}"
    flown = request(added=(0.0, 0.1)).scenario(load_scenario("lawnmower_calm", [wandering]))
    assert flown.world.current.mean == pytest.approx([0.1, 0.1, 0.0])


def test_of_a_real_vehicle_the_tank_is_not_known_and_the_floor_by_the_altimeter():
    scenario = load_scenario("lawnmower_calm", ["world.tank={north: [-1, 9], east: [-3, 9]}", "world.floor=5"])
    assert request(floor=8.0).scenario(scenario).world.tank is not None
    real = request(is_twin=False, floor=8.0)
    assert real.scenario(scenario).world.tank is None and real.scenario(scenario).world.floor == 8.0
    assert "altimeter" in real.floor_by(scenario) and request().floor_by(scenario) == "the scenario"


def test_the_fence_that_was_drawn_holds_in_it_and_the_batteries_are_as_full_as_the_gauge_says():
    scenario = load_scenario("lawnmower_calm", ["battery={charge: 0.9}"])
    drawn = ((-5.0, -5.0), (9.0, -5.0), (9.0, 9.0), (-5.0, 9.0))
    flown = request(fence=drawn, charge=0.3).scenario(scenario)
    polygon = flown.autopilot.supervisor.geofence.polygon
    assert [tuple(corner) for corner in polygon[:4]] == [*drawn] and {tuple(c) for c in polygon[4:]} == {drawn[-1]}
    assert flown.battery.charge == 0.3 and flown.waypoints[0].position == [3.0, 1.0, 2.0]
    as_given = request().scenario(scenario)
    assert as_given.battery.charge == 0.9 and as_given.autopilot == scenario.autopilot


@pytest.mark.parametrize(
    ("what", "why"),
    [
        ({"speed": 0.2}, "expected both"),
        ({"speed": "fast", "toward": 0.0}, "rehearse.speed: found 'fast'"),
        ({"speed": True, "toward": 0.0}, "rehearse.speed: found True"),
        ({"speed": 9.0, "toward": 0.0}, "expected 0 to 5"),
        ({"speed": float("nan"), "toward": 0.0}, "rehearse.speed"),
        ({"speed": 0.1, "toward": -1.0}, "expected 0 to 360"),
        ({"waves": 1.0}, "has no waves"),
    ],
)
def test_water_that_cannot_be_is_refused_in_words(what, why):
    with pytest.raises(ConfigError, match=why):
        Water.of(what, False)


def test_waves_have_a_height():
    assert Water.of({"waves": 0.4}, True).waves == 0.4
    with pytest.raises(ConfigError, match="more than 0 to 20"):
        Water.of({"waves": 0.0}, True)
    flown = request(water=Water(waves=0.4)).scenario(load_scenario("lawnmower_waves"))
    assert flown.world.waves.significant_height == 0.4
