"""What `serve` says at the start: from which share of the stick on a vehicle tips, and the command that flies it."""

import shlex

import numpy as np
import pytest

from rovtwin.links.blueye.server import BlueyeServer
from rovtwin.links.mavlink.mixing import mixer
from rovtwin.links.mavlink.server import MavlinkServer
from rovtwin.links.waterlinked.dvl_server import DvlServer
from rovtwin.links.waterlinked.ugps_server import UgpsServer
from rovtwin.live.serving.beforehand import command_line, linear, stick_of, tipping, warnings
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.analysis.stability import reach, stability, steady_speed


def model_and_largest(name):
    model = load_vehicle(name).model()
    return model, np.abs(reach(model)).min(axis=1)


@pytest.mark.system
@pytest.mark.parametrize("name", ["bluerov2", "bluerov2_heavy", "gladius_mini", "orca", "tilt_six"])
def test_it_tips_where_a_held_stick_comes_to_the_speed_from_which_pitch_grows(name):
    model, largest = model_and_largest(name)
    ahead = next(one for one in tipping(model, largest) if one.axis == 0)
    level = min(stability(model).pitch_depth_held, stability(model).pitch_free)
    assert 0.0 < ahead.share < 1.0 and (ahead.leans or ahead.speed > level)
    assert steady_speed(model, 0, (ahead.share - 0.01) * largest[0]) <= level
    assert f"held at {100 * ahead.share:.0f} % of the stick ahead" in warnings(model, {"": largest})[0]


@pytest.mark.parametrize("name", ["blueye_pioneer", "double_blueye", "minerva", "sf30k"])
def test_one_that_stays_level_at_full_stick_hears_nothing(name):
    model, largest = model_and_largest(name)
    assert warnings(model, {"": largest}) == []


def test_thrust_beside_cg_tips_it_too():
    model, largest = model_and_largest("bluerov2")
    still = model.replace(added_mass=0.0 * model.added_mass)  # no moment of Munk's is left
    ahead = next(one for one in tipping(still, largest) if one.axis == 0)
    assert ahead.leans and 0.2 < ahead.share < 0.5  # all of it pitches it by 49 degrees: a third by 20


def test_a_stick_of_mavlink_is_linear_in_the_command():
    model, largest = model_and_largest("bluerov2")
    mixed = stick_of([MavlinkServer(mixer=mixer(model.thrusters), gain=1.0)])
    by_command, by_force = (next(tipping(model, largest, given)) for given in (mixed, linear))
    assert by_command.share > by_force.share + 0.05 and mixed(0, 1.0) == pytest.approx(1.0)
    assert mixed(0, by_command.share) == pytest.approx(by_force.share, abs=0.02)
    as_shipped = stick_of([MavlinkServer(mixer=mixer(model.thrusters))])
    assert as_shipped(0, 1.0) == pytest.approx(mixed(0, 0.5)), "full stick is half the command at ArduSub's gain"


def test_the_command_names_the_vehicle_its_link_and_its_instruments():
    line = command_line("my rov.yaml", True, {"mavlink": MavlinkServer(), "ugps": UgpsServer(), "dvl": DvlServer()})
    words = shlex.split(line)
    assert words[:5] == ["rovtwin", "console", "lawnmower_calm", "--set", "vehicle=my rov.yaml"]
    assert words[5:] == ["--link", "mavlink://udpin:127.0.0.1:14550", "--sensor", "ugps://127.0.0.1:8080",
                         "--sensor", "dvl://127.0.0.1:16171"]  # fmt: skip


def test_without_positions_it_says_what_is_missing_and_without_orders_nothing():
    line = command_line("square", False, {"blueye": BlueyeServer(["127.0.0.2", "127.0.0.3"], http_port=8090)})
    assert line.startswith(
        "http_proxy=http://127.0.0.2:8090 rovtwin console square --link blueye://127.0.0.2,127.0.0.3"
    )
    assert "add --protocol ugps" in line
    assert command_line("square", False, {"dvl": DvlServer()}) == ""
