"""Speeds, acceptances and the time limit that a mission leaves out."""

import pytest
from tests.runs.test_stalls import NO_SWAY
from typer.testing import CliRunner

from rovtwin.cli import app
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.compose.fitting import assumptions, fitted, own_values
from rovtwin.runs.feasibility.mission import foreseen
from rovtwin.runs.limits import Limits
from rovtwin.scenario.files import list_missions, load_mission, load_scenario
from rovtwin.vehicle import load_vehicle, vehicle_from_dict


def values(scenario):
    return [(w.speed, w.acceptance) for w in scenario.waypoints]


@pytest.mark.parametrize("vehicle", ["double_blueye", "double_blueye_thesis"])
@pytest.mark.parametrize("mission", list_missions())
def test_the_reference_scenarios_are_what_they_were(vehicle, mission):
    scenario = load_scenario("lawnmower_calm", [f"mission={mission}", f"vehicle={vehicle}"])
    made = fitted(scenario, load_vehicle(vehicle).model())
    assert set(values(made)) == {(0.2, 0.2)} and made.duration == 1500 and assumptions(scenario, made) == []


def test_another_vehicle_has_its_own_by_froude_s_law():
    scenario, small = load_scenario("square"), load_vehicle("blueye_pioneer").model()
    made = fitted(scenario, small)
    ratio = Limits.of(small).length / Limits.of(load_vehicle("double_blueye").model()).length
    speed, acceptance = values(made)[0]
    # Both vehicles' values are rounded to the centimetre.
    assert speed == pytest.approx(0.2 * ratio**0.5, abs=0.01) and acceptance == pytest.approx(0.2 * ratio, abs=0.01)
    taken = f"speed {speed:g} m/s, acceptance {acceptance:g} m"
    assert assumptions(scenario, made) == [
        f"the mission gives no speed and no acceptance; taken from the vehicle: {taken}"
    ]


def test_what_comes_after_the_end_is_reported_never_to_happen():
    late = ["faults=[{fault: leak, at: 3000}, {fault: leak, at: 30}]", "operator=[{ask: pause, at: 1500}]"]
    scenario = load_scenario("lawnmower_calm", late)
    fault, request = assumptions(scenario, fitted(scenario, load_vehicle("double_blueye").model()))
    assert fault.startswith("faults[0], leak at 3000 s, never happens: the run ends at 1500 s at the latest")
    assert request.startswith("operator[0], pause at 1500 s, never happens")
    shown = CliRunner().invoke(app, ["scenario", "check", "lawnmower_calm", "--set", late[0]])
    assert "faults[0], leak at 3000 s, never happens" in shown.output


def test_without_sway_a_way_point_is_twice_as_wide():
    limits = Limits.of(vehicle_from_dict(NO_SWAY, "no_sway").model())
    assert own_values(limits)["acceptance"] == pytest.approx(2 * 0.65 * limits.length, abs=0.005)


def slow_turner(lever):
    thruster = {"direction": [1, 0, 0], "force": {"ahead": 12, "astern": 9}, "time_constant": 0.15}
    sides = [thruster | {"name": n, "position": [-0.4, y, 0]} for n, y in (("port", -lever), ("starboard", lever))]
    ends = [{"name": n, "position": [x, 0, 0], "direction": [0, 0, 1]} for n, x in (("bow", 0.3), ("stern", -0.3))]
    hull = {"name": "slow", "mass": 14.0, "inertia": [0.1, 0.9, 0.9], "volume": 0.01415}
    hull |= {"center_of_buoyancy": [0, 0, -0.03], "shape": {"cylinder": {"length": 0.9, "radius": 0.075}}}
    return hull | {"thrusters": sides + [thruster | one for one in ends]}


@pytest.mark.parametrize("lever, slower", [(0.02, False), (0.005, True)])
@pytest.mark.parametrize("speed", [None, 0.3])
def test_what_is_taken_leaves_room_to_turn(lever, slower, speed):
    """The check said "raise the acceptance" of the one that it had taken itself."""
    point = "{position: [8, 0, 3]" + ("}" if speed is None else f", speed: {speed}}}")
    scenario = load_scenario("square", [f"mission.waypoints=[{point}]"])
    model = vehicle_from_dict(slow_turner(lever), "slow").model()
    made = fitted(scenario, model)
    assert not any("turns within" in line for line in foreseen(made, vehicle_from_dict(slow_turner(lever), "s"), model))
    limits, ((flown, acceptance),) = Limits.of(model), values(made)
    length = limits.length
    assert acceptance > 2 * 0.65 * length + 0.05 and (speed or acceptance <= 4 * 0.65 * length + 0.02)
    assert flown == speed or (flown < round(0.115 * (9.81 * length) ** 0.5, 2)) == slower


def test_what_is_stated_counts():
    points = (
        "mission.waypoints=[{position: [3, 0, 3], speed: 0.3, acceptance: 0.5}, {position: [3, 3, 3], speed: 0.25}]"
    )
    scenario = load_scenario("square", [points, "vehicle=bluerov2", "duration=90"])
    made = compose(scenario).scenario
    assert values(made)[0] == (0.3, 0.5) and made.waypoints[1].speed == 0.25 and made.duration == 90
    assert values(fitted(made, load_vehicle("double_blueye").model())) == values(made)  # a run's own file, flown again


def test_a_long_mission_gets_the_time_it_takes():
    far = "mission.waypoints=[{position: [200, 0, 3]}]"
    scenario = load_scenario("square", [far])
    made = fitted(scenario, load_vehicle("double_blueye").model())
    assert made.duration == 4100 and "duration 4100 s" in assumptions(scenario, made)[0]


def test_changes_made_to_an_experiment_for_the_vehicle_are_reported():
    scenario = load_scenario("test_mixed", ["vehicle=minerva"])
    made = compose(scenario).scenario
    *notes, limit = assumptions(scenario, made)
    assert notes == made.test.notes and notes[-1].startswith("written for double_blueye: pulls of minerva take")
    assert limit == f"the test's time limit is {made.duration:g} s, in place of 120 s"
    assert assumptions(made, compose(made).scenario) == [], "it was said"
    assert notes[-1] in CliRunner().invoke(app, ["scenario", "check", "test_mixed", "--set", "vehicle=minerva"]).output


def test_missions_say_only_what_they_say():
    for waypoint in (*load_mission("square").waypoints, *load_scenario("square").waypoints):
        assert not {"speed", "acceptance"} & waypoint.model_fields_set
