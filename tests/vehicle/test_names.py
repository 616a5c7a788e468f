"""Names of what is mounted in a vehicle that another file holds as a part: they stay what they were."""

import pytest

from rovtwin.live.serving.vehicle import drones_of
from rovtwin.runs.compose.faults import units_of
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.analysis.urdf import urdf

DVL = {"name": "dvl", "mass": 0.17, "volume": 1e-4, "sensors": [{"name": "dvl", "kind": "dvl"}]}
THRUSTER = {"name": "surge", "direction": [1, 0, 0], "force": 10.0}
KINDS = ("thrusters", "cameras", "sensors", "tethers")


def holding(part, *others, **more):
    return vehicle_from_dict({"name": "my", "parts": [{"name": "rov", "part": part}, *others], **more})


def names(vehicle, kind):
    return [item.name for item in getattr(vehicle.assembly, kind)]


@pytest.mark.parametrize("library", ["double_blueye", "double_blueye_thesis", "blueye_pioneer", "bluerov2_heavy"])
def test_names_stay_what_they_were(library):
    alone, held = load_vehicle(library), holding(library, DVL)
    for kind in KINDS:
        assert names(held, kind)[: len(names(alone, kind))] == names(alone, kind)
    assert names(held, "sensors")[-1] == "dvl.dvl"
    assert held.power_sources == alone.power_sources
    assert units_of(held.thruster_names) == units_of(alone.thruster_names)
    assert list(drones_of(held)) == list(drones_of(alone))


def test_frames_keep_their_names_too():
    text = urdf(holding("double_blueye", DVL))
    assert all(f'link name="{name}"' in text for name in ("port_camera_optical", "starboard_imu", "dvl_dvl"))


def test_at_any_depth_and_again_from_what_a_log_holds(tmp_path):
    (tmp_path / "my.yaml").write_text("name: my\nparts: [{name: rov, part: double_blueye}, {name: lead, mass: 1}]\n")
    (tmp_path / "again.yaml").write_text(
        "name: again\nparts:\n- {name: was, water_density: 1000, parts: [{name: vehicle, part: my}]}\n"
        "- {name: more, mass: 1}\n"
    )
    twice = load_vehicle(tmp_path / "again.yaml")
    assert twice.thruster_names == load_vehicle("double_blueye").thruster_names
    assert vehicle_from_dict(twice.to_dict()).thruster_names == twice.thruster_names
    apart = load_vehicle("double_blueye").with_pairs_apart()
    assert twice.with_pairs_apart().thruster_names == apart.thruster_names


def test_two_vehicles_or_a_body_with_its_own_thrusters_need_the_long_names():
    two = holding("blueye_pioneer", {"name": "second", "part": "blueye_pioneer", "pose": {"position": [0, 0.5, 0]}})
    assert two.thruster_names[0] == "rov.surge" and two.thruster_names[-1] == "second.heave"
    own = holding("blueye_pioneer", thrusters=[THRUSTER])
    assert own.thruster_names == ["surge", "rov.surge", "rov.sway", "rov.heave"]
    inline = vehicle_from_dict({"name": "v", "parts": [{"name": "hull", "mass": 1.0, "thrusters": [THRUSTER]}]})
    assert inline.thruster_names == ["hull.surge"]  # no vehicle of its own: nobody knows its thruster by another name


def test_a_file_may_say_otherwise():
    text = {"name": "my", "parts": [{"name": "rov", "part": "blueye_pioneer", "keeps_names": False}]}
    assert vehicle_from_dict(text).thruster_names[0] == "rov.surge"
    booster = {"name": "booster", "mass": 1.0, "thrusters": [THRUSTER]}
    text = {"name": "my", "parts": [{"name": "rov", "part": "blueye_pioneer", "keeps_names": True}, booster]}
    assert vehicle_from_dict(text).thruster_names == ["surge", "sway", "heave", "booster.surge"]


def test_where_two_would_have_one_name_the_inner_keeps_the_long_one():
    port = {"name": "port", "mass": 0.3, "sensors": [{"name": "imu", "kind": "imu"}], "battery": {"capacity_wh": 50}}
    held = holding("double_blueye", port)
    assert held.thruster_names == load_vehicle("double_blueye").thruster_names
    assert {"port.imu", "rov.port.imu", "starboard.imu"} <= set(names(held, "sensors"))
    assert [source.name for source in held.power_sources] == ["rov.port", "starboard", "port"]
    assert [source.feeds for source in held.power_sources] == [(0, 1, 2), (3, 4, 5), ()]


def test_what_was_identified_with_the_long_names_is_still_read():
    """A file written before has all parts in place, and its thrusters' names with the part's."""
    held = holding("double_blueye", DVL).to_dict()
    for part in held["parts"]:
        part.pop("keeps_names", None)
    assert vehicle_from_dict(held).thruster_names[0] == "rov.port.surge"
