"""What a vehicle cannot do of a mission, said before it is flown, with the numbers."""

import numpy as np
import pytest
import yaml
from tests.runs.test_stalls import NO_SWAY

from rovtwin.core.errors import ConfigError
from rovtwin.runs.batch import score_batch, score_seeds
from rovtwin.runs.feasibility.mission import baseline_of_another, foreseen, judge, require_feasible
from rovtwin.runs.fly import fly
from rovtwin.runs.limits import Limits, compass_point
from rovtwin.scenario.files import load_scenario
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.analysis.performance import performance

NO_HEAVE = NO_SWAY | {"thrusters": NO_SWAY["thrusters"][:2], "volume": 0.0065}
ONE_ROW = {"name": "row", "thrusters": [NO_SWAY["thrusters"][2], NO_SWAY["thrusters"][0] | {"position": [0, 0, 0]}]}


def lines(vehicle, *changes, name="square", **options):
    """What is said: refused, then noted."""
    model = load_vehicle(vehicle).model() if isinstance(vehicle, str) else vehicle_from_dict(vehicle, "made up").model()
    found = judge(load_scenario(name, changes), model, **options)
    return [f.line for f in found if f.refused], [f.line for f in found if not f.refused]


def test_limits_are_those_of_the_table_of_performance():
    model = load_vehicle("bluerov2").model()
    table, limits = performance(model), Limits.of(model)
    for axis, (one, other) in {0: ("ahead", "astern"), 1: ("starboard", "port"), 2: ("down", "up")}.items():
        name = ("surge", "sway", "heave")[axis]
        assert limits.top[axis, 1] == pytest.approx(table[name][one].top_speed, rel=1e-9)
        assert limits.top[axis, 0] == pytest.approx(table[name][other].top_speed, rel=1e-9)
    assert limits.stopping(1.0) == pytest.approx(0.5 * limits.mass[0] / limits.force[0, 0])


@pytest.mark.parametrize("vehicle", ["double_blueye", "bluerov2_heavy"])
@pytest.mark.parametrize("name", ["square", "lawnmower_hard"])
def test_there_is_no_finding_on_what_can_be_flown(vehicle, name):
    assert lines(vehicle, name=name) == ([], [])


@pytest.mark.parametrize("vehicle", ["bluerov2", NO_SWAY])
@pytest.mark.parametrize("name", ["square", "lawnmower_hard"])
def test_the_only_finding_on_what_can_be_flown_is_pitch_in_a_dive_that_was_asked_for(vehicle, name):
    """Said: 20 degrees. Flown, calm, seeds 1 to 3: 13, 19 and 6; that without sway 16, 31 and 19."""
    assert lines(vehicle, name=name) == ([], [])  # at the speed that the autopilot takes
    refused, noted = lines(vehicle, "autopilot.control.dive_speed=0.9", name=name)
    assert refused == [] and len(noted) == 1 and "expected to" in noted[0] and "pitch by up to 20 deg" in noted[0]


def test_a_place_and_heading_in_a_cross_current_without_sway():
    """It turns into the current, and that is said."""
    refused, noted = lines(NO_SWAY, "world.current=[0, 0.1, 0]", name="station_keeping")
    assert refused == [] and len(noted) == 1
    assert "a current of 0.1 m/s to the east cannot be stemmed heading 0 deg" in noted[0]
    assert "no thrust in sway" in noted[0] and "it looks into the current (270 deg)" in noted[0]
    assert lines("double_blueye", "world.current=[0, 0.1, 0]", name="station_keeping") == ([], [])


FORCE, HEAVE = {"ahead": 16, "astern": 13}, [0, 0, 1]
DISC = {
    "name": "disc",
    "mass": 12.0,
    "volume": 0.01203,
    "inertia": [0.18, 0.18, 0.32],
    "center_of_buoyancy": [0, 0, -0.03],
    "shape": {"ellipsoid": [0.23, 0.23, 0.08]},
    "thrusters": [
        {"name": "bow", "position": [0.2, 0, 0], "direction": [0, 1, 0], "force": FORCE},
        {"name": "right", "position": [-0.1, 0.1732, 0], "direction": [-0.866, -0.5, 0], "force": FORCE},
        {"name": "left", "position": [-0.1, -0.1732, 0], "direction": [0.866, -0.5, 0], "force": FORCE},
        {"name": "fore", "position": [0.14, 0, 0], "direction": HEAVE, "force": {"ahead": 12, "astern": 10}},
        {"name": "aft", "position": [-0.14, 0, 0], "direction": HEAVE, "force": {"ahead": 8, "astern": 6}},
    ],
    "sensors": [{"name": kind, "kind": kind} for kind in ("imu", "attitude", "pressure")],
}


def test_what_it_does_not_stem_sideways_it_meets_with_its_bow():
    """What rights the disc in roll, not thrust, is what it lacks; with a heading of its own it is another matter."""
    refused, noted = lines(DISC, "world.current=[0, 0.34, 0]")
    assert refused == [] and noted[0].startswith(
        "the leg to way-point 1: 0.34 m/s of a current of 0.34 m/s to the east"
    )
    assert "that it stems sideways and stays level; it turns its bow into the current" in noted[0]
    _, kept = lines(DISC, "world.current=[0, 0.34, 0]", "autopilot=thesis")
    assert any("swept off" in line for line in kept)


@pytest.mark.slow
def test_a_disc_flies_a_square_in_a_current_that_it_does_not_stem_sideways(tmp_path):
    """It was swept off by 29 m, rolling by 20 degrees."""
    path = tmp_path / "disc.yaml"
    path.write_text(yaml.safe_dump(DISC))
    scores = score_seeds(load_scenario("square", [f"vehicle={path}", "world.current=[0, 0.34, 0]"]), [1, 2])
    assert all(score["completed"] for score in scores)


@pytest.mark.slow
def test_a_disc_that_a_pilot_leaves_alone_meets_the_current_with_its_bow(tmp_path):
    """It kept its heading, rolled by 19 degrees and was swept off."""
    path = tmp_path / "disc.yaml"
    path.write_text(yaml.safe_dump(DISC))
    left = ["operator=[{at: 0, ask: pilot}]", "start.position=[0, 0, 3]", "duration=90", "log.rate=10"]
    eta = fly(load_scenario("square", [f"vehicle={path}", "world.current=[0, 0.34, 0]", *left])).log["truth/eta"]
    last = eta.t > 60.0
    assert np.degrees(np.abs(eta["phi"][last]).max()) < 3.0
    assert np.hypot(eta["x"], eta["y"])[last].max() < 2.0


@pytest.mark.system
def test_a_current_faster_than_the_vehicle_is_refused_with_both_numbers(capsys):
    model, scenario = load_vehicle("double_blueye").model(), load_scenario("square", ["world.current=[0, 2, 0]"])
    with pytest.raises(ConfigError) as error:
        require_feasible(scenario, model)
    assert "a current of 2 m/s to the east is more than its top speed of 0.34 m/s" in str(error.value)
    assert "carried off at 1.7 m/s or more" in str(error.value) and "more thrust" in str(error.value)
    with pytest.raises(ConfigError, match="is more than its top speed"):
        fly(scenario)
    for score in (score_seeds, score_batch):  # side by side it was flown for 1500 s
        with pytest.raises(ConfigError, match="is more than its top speed"):
            score(scenario, [1])
    assert foreseen(scenario, load_vehicle("double_blueye"), model, known_world=False) == []  # it is elsewhere


def test_a_current_through_which_it_cannot_go_level_is_refused_and_one_that_it_meets_with_its_side_is_not():
    """Flown: a sparus_ii in 0.66 m/s ended at the attitude limit; a bluerov2 turned aside completes in 0.85 m/s."""
    refused, _ = lines("sparus_ii", "world.current=[0, 0.66, 0]")
    assert "0.66 m/s to the east would tip it over: it stays level up to 0.29 m/s through the water" in refused[0]
    assert "in pitch" in refused[0] and "raise BG" in refused[0]
    assert lines("sparus_ii", "world.current=[0, 0.66, 0]", known_world=False)[0] == []
    assert lines("bluerov2", "world.current=[0, 0.85, 0]")[0] == []
    for vehicle in ("double_blueye", "double_blueye_thesis", "minerva"):
        assert lines(vehicle, "world.current=[0, 0.1, 0]")[0] == []


def test_a_leg_faster_than_keeps_it_level_is_reported_to_be_slower():
    fast = "mission.waypoints=[{position: [9, 0, 3], speed: 0.2, acceptance: 0.2}]"
    _, noted = lines("double_blueye_thesis", fast)
    assert "0.2 m/s are requested, and it stays level up to 0.12 m/s over ground" in noted[0]
    assert lines("double_blueye", fast) == ([], [])


def test_a_sheared_current_counts_at_the_mission_s_depth():
    sheared = "world.current={type: sheared, depths: [0, 2.9], velocities: [[0, 2, 0], [0, 0, 0]]}"
    assert lines("double_blueye", sheared) == ([], [])


def test_legs_that_are_slower_than_asked():
    refused, noted = lines("double_blueye", "mission.waypoints=[{position: [9, 0, 3], speed: 0.6, acceptance: 0.2}]")
    assert refused == [] and "0.6 m/s are requested, and the thrusters give 0.34 m/s over ground" in noted[0]
    assert "it is flown at about 0.3 m/s" in noted[0]
    upstream = "mission.waypoints=[{position: [-9, 0, 3], speed: 0.2, acceptance: 0.2}]"
    _, noted = lines("double_blueye", upstream, "world.current=[0.2, 0, 0]")
    assert (
        "0.2 m/s are requested, and the thrusters give 0.14 m/s over ground in a current of 0.2 m/s to the north"
        in noted[0]
    )


def test_a_cross_current_that_sway_cannot_stem():
    _, noted = lines("double_blueye", "world.current=[0, 0.3, 0]")
    assert any("more than the 0.25 m/s that thrust in sway can stem" in line for line in noted)


def test_a_turn_wider_than_the_acceptance():
    fast = "mission.waypoints=[{position: [9, 0, 3], speed: 0.8, acceptance: 0.1}]"
    _, noted = lines(NO_SWAY, fast)
    assert any("without thrust in sway it turns within" in line and "raise the acceptance to" in line for line in noted)


def test_no_thrust_in_heave():
    deeper, level = "start.position=[0, 0, 0.5]", "start.position=[0, 0, 3]"
    refused, _ = lines(NO_HEAVE, deeper)
    assert "no thrust in heave, and way-point 1 lies 2.5 m deeper" in refused[0]
    assert lines(NO_HEAVE, level)[0] == []
    heavy, _ = lines(NO_HEAVE | {"volume": 0.0066}, level)
    assert "thrusters cannot hold the depth: weight and buoyancy leave 0.98 N upwards" in heavy[0]
    assert "rovtwin vehicle ballast" in heavy[0]


def test_a_vehicle_that_floats_more_than_it_can_push_says_what_its_thrusters_give():
    """36.92 l of fresh water and 6.5 kg: 298 N upwards, against 16 N each way."""
    heave = NO_SWAY["thrusters"][2] | {"force": 16}
    refused, _ = lines(NO_SWAY | {"volume": 0.03692, "thrusters": [*NO_SWAY["thrusters"][:2], heave]})
    assert "weight and buoyancy leave 298 N upwards, and thrusters give 16 N down and 16 N up" in refused[0]


def test_no_moment_in_yaw_and_no_thrust_aside():
    refused, _ = lines(NO_SWAY | ONE_ROW)
    assert "its heading cannot be controlled" in refused[0]


def test_a_tank_too_short_to_stop_in():
    tank = "world.tank={north: [-1, 2], east: [-1, 2]}"
    fast = "mission.waypoints=[{position: [1, 0, 3], speed: 2.5, acceptance: 0.2}]"
    slow = NO_SWAY | {"mass": 65.0, "volume": 0.0655, "inertia": [0.6, 1.1, 1.2]}
    texts = [[line for line in lines(one, tank, fast)[1] if "the tank is 3 m long" in line] for one in (NO_SWAY, slow)]
    assert texts[0] == [] and len(texts[1]) == 1


def test_the_baseline_on_another_vehicle_is_one_line():
    for name, vehicle, message in (
        ("thesis", "bluerov2", True), ("thesis_as_printed", "bluerov2", True), ("thesis_placed", "bluerov2", False),
        ("thesis", "double_blueye", False), ("thesis", "double_blueye_thesis", False),
        ("model_based", "bluerov2", False),
    ):  # fmt: skip
        line = baseline_of_another(load_scenario("square", [f"autopilot={name}"]), load_vehicle(vehicle))
        assert (line is not None) is message, name
        assert line is None or "gains of the Double Blueye, not of bluerov2" in line


def test_points_of_the_compass():
    assert [compass_point(x) for x in (0.0, 0.8, 1.5, 3.2, -1.57, -0.1, 6.2)] == [
        "north", "north-east", "east", "south", "west", "north", "north",
    ]  # fmt: skip


@pytest.mark.parametrize("flown", ["autopilot=thesis", "autopilot.guidance.steering=crab"])
def test_an_autopilot_that_keeps_its_heading_is_not_reported_to_give_it_up(flown):
    refused, noted = lines(NO_SWAY, "world.current=[0, 0.1, 0]", flown, name="station_keeping")
    assert any("keeps its heading and is carried off" in line for line in refused)
    assert not any("given up" in line for line in [*refused, *noted])


def test_a_heading_that_staying_level_forbids_is_reported_with_what_thrust_would_give():
    """It was called a top speed, and a flight with model_based was reported to fly with model_based."""
    there = "mission.waypoints=[{position: [3, 0, 3], heading_deg: 0, hold_time: 30, acceptance: 0.2}]"
    for current, bow in (("[0, 0.34, 0]", 270), ("[0, -0.34, 0]", 90)):
        refused, _ = lines(DISC, f"world.current={current}", there)
        assert "it stays level up to 0.32 m/s in sway (Munk's moment in roll); thrust would give 1." in refused[0]
        assert f"ask for a heading near {bow} deg, into the current, or leave it out, or wait for less" in refused[0]
        assert "raise BG" in refused[0] and "model_based" not in refused[0]
    refused, _ = lines(DISC, "world.current=[0, 0.34, 0]", there, "autopilot=thesis")
    assert "fly it with model_based, steering los, or ask for a heading near 270 deg" in refused[0]
    refused, _ = lines("double_blueye", "world.current=[0, 0.3, 0]", there)
    assert "its top speed in sway is 0.25 m/s" in refused[0] and "level" not in refused[0]


def test_a_current_that_turns_it_across_is_reported_and_refused_where_the_bow_never_comes_round():
    """A slender body turns across the flow. Flown: 0.5 m/s completes, 0.8 and 1.4 m/s end at the attitude limit."""
    pair = [
        {"name": n, "position": [-1.0, y, 0], "direction": [1, 0, 0], "force": 18}
        for n, y in (("p", -0.12), ("s", 0.12))
    ]
    heave = [
        {"name": n, "position": [x, 0, 0], "direction": [0, 0, 1], "force": 12} for n, x in (("b", 0.7), ("a", -0.7))
    ]
    auv = {
        "name": "auv",
        "mass": 48,
        "volume": 0.048,
        "center_of_gravity": [0, 0, 0.012],
        "center_of_buoyancy": [0, 0, 0],
    }
    hull = {"inertia": [0.18, 15.5, 15.5], "shape": {"cylinder": {"radius": 0.085, "length": 2.1}}}
    model = vehicle_from_dict(auv | hull | {"thrusters": pair + heave}, "auv").model()
    turns = Limits.of(model).turns_in
    assert 0.4 < turns < 0.5
    texts = [judge(load_scenario("square", [f"world.current=[0, {k * turns}, 0]"]), model)[0] for k in (0.9, 1.2, 1.8)]
    assert "Munk's moment" not in texts[0].line
    assert "turns it across itself with up to" in texts[1].line and not texts[1].refused
    assert "wait for less current, or give it fins" in texts[2].line and texts[2].refused
