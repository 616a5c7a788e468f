"""Roll and pitch that are said before a dive, and that a flight of the made-up disc comes near them."""

import numpy as np
import pytest
import yaml
from tests.runs.test_feasibility import DISC, lines

from rovtwin.gnc.guidance.level_speed import TILT
from rovtwin.runs.feasibility.mission import foreseen
from rovtwin.runs.feasibility.tilting import tilts
from rovtwin.runs.fly import fly
from rovtwin.scenario.files import load_scenario
from rovtwin.vehicle import load_vehicle, vehicle_from_dict

STABLE = DISC | {"center_of_buoyancy": [0, 0, -0.07]}  # what rights it is more than what its dive takes away
ABEAM = "world.current=[0, 0.34, 0]"
DIVE = "autopilot.control.dive_speed=0.43"  # its own, asked for


def warnings_of(vehicle, *changes):
    return [line for line in lines(vehicle, *changes)[1] if "expected to" in line]


def test_a_dive_that_rolls_the_disc_is_reported_with_the_angle_and_what_helps():
    """Nothing was said; it rolled by 21 degrees in the current, and by 14 to 18 in calm water."""
    (line,) = warnings_of(DISC, ABEAM, DIVE)
    assert "at 0.43 m/s in a current of 0.34 m/s it is expected to roll by up to 20 deg" in line
    assert "attitude limit 60 deg" in line and "autopilot.control.dive_speed" in line
    assert "roll by up to 20 deg" in warnings_of(DISC, DIVE)[0]
    assert warnings_of(DISC, "autopilot.control.dive_speed=0.05") == []
    assert (
        "roll by up to"
        in warnings_of(DISC, "autopilot.supervisor.attitude_limit_deg=10", "sensors.position.noise=0.2")[0]
    )


@pytest.mark.parametrize("vehicle", [DISC, "bluerov2", "gladius_mini", "lbv300", "sparus_ii", "tilt_six"])
def test_a_speed_that_the_autopilot_chose_itself_is_not_warned_of_unless_a_limit_is_near(vehicle):
    """`fly` chose a dive's speed and then advised to dive slower."""
    assert warnings_of(vehicle) == []
    assert "attitude limit 20 deg" in warnings_of(vehicle, "autopilot.supervisor.attitude_limit_deg=20")[0]


def test_one_that_thrusters_keep_level_and_a_baseline_hear_nothing_of_it():
    assert warnings_of("bluerov2_heavy", "world.current=[0, 0.3, 0]") == [] and warnings_of("double_blueye") == []
    assert warnings_of(DISC, ABEAM, "autopilot=thesis") == []


def test_with_a_doppler_log_no_fix_pulls_it_aside_in_calm_water():
    """A made-up one was said to roll by 20 degrees and rolled by 0.6; this disc by 0.2, without it by 14 to 18."""
    vehicle = vehicle_from_dict(DISC | {"sensors": [*DISC["sensors"], {"name": "dvl", "kind": "dvl"}]}, "disc")
    bare, model = vehicle_from_dict(DISC, "disc"), vehicle.model()
    calm, abeam = load_scenario("square", [DIVE]), load_scenario("square", [ABEAM, DIVE])
    assert [line for line in foreseen(calm, vehicle, model) if "expected to" in line] == []
    assert "roll by up to 20 deg" in foreseen(abeam, vehicle, model)[-1]
    assert "roll by up to 20 deg" in foreseen(calm, bare, model)[0]


def test_the_noise_of_the_fixes_is_that_of_the_vehicle_s_own_sensor():
    """One of the blueye's size in steps of a fix: the usual 0.5 m counted, whatever was on board."""
    angles, scenario = [], load_scenario("square", ["autopilot.control.dive_speed=0.43"])
    for noise in (0.02, 0.5):
        fixes = {"name": "usbl", "kind": "position", "noise": [noise, noise]}
        vehicle = vehicle_from_dict(STABLE | {"sensors": [*DISC["sensors"], fixes]}, "stable")
        angles.append([line for line in foreseen(scenario, vehicle, vehicle.model()) if "expected" in line])
    assert angles[0] == [] and "expected to roll by up to" in angles[1][0]


def test_the_angle_is_that_of_munks_moment():
    """A slow dive in a weak current: between what the moment holds it at and twice of that."""
    model = load_vehicle("blueye_x3").model()
    flow, dive = 0.05, 0.05
    added = np.diagonal(np.asarray(model.added_mass))
    rights = float(model.weight * model.center_of_gravity[2] - model.buoyancy * model.center_of_buoyancy[2])
    held = abs(added[2] - added[1]) * flow * dive / rights
    roll, pitch = tilts(model, np.array([0.0, flow]), dive, 0.0)
    assert 0.7 * held < roll < 2.0 * held and pitch < 1e-6
    assert tilts(model, np.array([0.0, 1.0]), 0.3, 0.0)[0] == TILT


@pytest.mark.slow
def test_the_disc_rolls_about_as_far_as_was_predicted(tmp_path):
    path = tmp_path / "disc.yaml"
    path.write_text(yaml.safe_dump(DISC))
    summary = fly(load_scenario("square", [f"vehicle={path}", ABEAM, "duration=15"])).figures
    assert 15.0 < summary["roll_max_deg"] < 1.3 * np.degrees(TILT)
