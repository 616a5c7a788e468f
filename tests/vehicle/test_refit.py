"""Devices bolted onto vehicles and taken off again: the file that comes out, and what it amounts to."""

import numpy as np
import pytest
import trimesh
import yaml
from typer.testing import CliRunner

from rovtwin.cli import app
from rovtwin.core.errors import ConfigError
from rovtwin.vehicle import list_library, load_vehicle, vehicle_from_dict
from rovtwin.vehicle.analysis.hydrostatics import floating_of
from rovtwin.vehicle.analysis.overlap import overlaps
from rovtwin.vehicle.description.identified import fingerprint
from rovtwin.vehicle.outfitting.ballast import BallastTarget, Piece
from rovtwin.vehicle.outfitting.ballasted import Materials, ballast
from rovtwin.vehicle.outfitting.refit import add, remove, signed, trimming, with_ballast

OWN = """# mine
name: own
parts:
  - {name: rov, part: bluerov2}  # the ROV
"""


@pytest.fixture
def own(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text(OWN)
    return path


@pytest.mark.parametrize("name", list_library())
@pytest.mark.parametrize("device", ["dvl_a50", "imaging_sonar", "gripper", "battery_pod"])
def test_a_device_adds_what_it_is_to_any_vehicle(name, device, tmp_path):
    change = add(name, device, [0.0, 0.0, 0.5], out=tmp_path / "new.yaml")
    before, after, part = load_vehicle(name).assembly, change.after.assembly, load_vehicle(device).assembly
    assert after.solid.mass == pytest.approx(before.solid.mass + part.solid.mass)
    assert after.volume == pytest.approx(before.volume + part.volume)
    assert np.all(np.diag(after.added_mass) >= np.diag(before.added_mass))
    assert after.added_mass[0, 0] == pytest.approx(before.added_mass[0, 0] + part.added_mass[0, 0])
    assert change.after.thruster_names == change.before.thruster_names
    (tmp_path / "new.yaml").write_text(change.text)
    again = load_vehicle(tmp_path / "new.yaml")
    assert again.to_dict() == change.after.to_dict()
    # Taken off again it is what it was.
    bare = remove(tmp_path / "new.yaml", device).after.assembly
    np.testing.assert_allclose(bare.added_mass, before.added_mass, rtol=1e-12)
    assert bare.solid.mass == before.solid.mass


def test_a_vehicle_of_the_library_is_held_as_a_part():
    change = add("double_blueye", "dvl_a50", [-0.2, 0, 0.16], name="dvl")
    data = yaml.safe_load(change.text)
    assert data["parts"] == [
        {"name": "double_blueye", "part": "double_blueye"},
        {"name": "dvl", "part": "dvl_a50", "pose": {"position": [-0.2, 0, 0.16]}},
    ]
    assert change.notes == ()


def test_a_file_of_ones_own_keeps_its_comments(own, tmp_path):
    change = add(own, "ping360", [0.2, 0, 0.15], [0, 0, 90], out=tmp_path / "new.yaml")
    line = "  - {name: ping360, part: ping360, pose: {position: [0.2, 0, 0.15], attitude_deg: [0, 0, 90]}}\n"
    assert change.text == OWN + line
    own.write_text(change.text)
    assert "name: ping360_2" in add(own, "ping360", [0.2, 0, 0.3], out=own).text
    assert remove(own, "ping360", own).text == OWN


def test_a_file_with_totals_of_the_whole_is_held_as_a_part(own, tmp_path):
    own.write_text(OWN + "restoring: {buoyancy: neutral}\n")
    change = add(own, "lead_500g", [0, 0, 0.2], out=tmp_path / "new.yaml")
    assert yaml.safe_load(change.text)["parts"][0] == {"name": "own", "part": "own.yaml"}
    assert floating_of(change.after.assembly).net_buoyancy == pytest.approx(-9.81 * (0.5 - 0.04409))
    with pytest.raises(ConfigError, match="gives restoring of the whole"):
        add(own, "lead_500g", [0, 0, 0.2], out=own)


def test_into_another_folder_the_file_is_referred_to(own, tmp_path):
    (tmp_path / "sub").mkdir()
    change = add(own, "lead_500g", [0, 0, 0.2], out=tmp_path / "sub" / "new.yaml")
    assert yaml.safe_load(change.text)["parts"][0]["part"] == "../own.yaml"


def test_removing_from_given_totals_says_that_they_stay():
    change = remove("double_blueye", "uhi")
    assert change.after.assembly.solid.mass == pytest.approx(26.0)
    assert [note.split()[2] for note in change.notes] == ["restoring", "hydrodynamics"]


def test_a_part_goes_with_its_spare_sensors():
    """Of one Pioneer alone the names are shorter, so that those of the other were said to be unknown."""
    change = remove("double_blueye", "starboard")
    assert yaml.safe_load(change.text)["spare_sensors"] == []
    assert [s.name for s in change.after.sensors if not s.spare][:2] == ["imu", "compass"]
    assert "# One Pioneer's instruments fly the whole" in change.text
    other = remove("double_blueye", "port")
    assert "spare_sensors: [imu, compass, pressure]\n" in other.text
    assert "none is read" in other.notes[-1] and not any("none is read" in note for note in change.notes)


def test_names_of_spare_sensors_follow_a_part_with_thrusters(own):
    own.write_text(OWN.replace("bluerov2", "blueye_pioneer") + "spare_sensors:\n  # two are enough\n  - imu  # noisy\n")
    text = add(own, "blueye_pioneer", [0, 0, 0.5], name="second", out=own).text
    assert "  # two are enough\n  - rov.imu  # noisy\n" in text
    own.write_text(text)
    assert "  - imu  # noisy\n" in remove(own, "second", own).text


def test_what_lies_inside_the_hull_is_reported():
    (note,) = add("double_blueye", "imaging_sonar", [0, 0.28, 0]).notes
    assert note.startswith("'imaging_sonar' and 'double_blueye.starboard' overlap: 100 % of 'imaging_sonar', 176 mm")
    assert note.endswith("is free 176 mm further to starboard, at 0,0.456,0")
    assert not add("double_blueye", "imaging_sonar", [0, 0.28, 0.25]).notes


@pytest.mark.parametrize("name", ["double_blueye", "blueye_pioneer", "bluerov2", "bluerov2_heavy", "gladius_mini"])
def test_ballast_trims_it_again(name):
    """Also a vehicle without shapes: at the corners of the box around its thrusters."""
    change = add(name, "imaging_sonar", [0.2, 0.1, 0.2])
    before = floating_of(change.before.assembly)
    off = floating_of(change.after.assembly)
    assert abs(off.net_buoyancy - before.net_buoyancy) > 3 and np.abs(off.trim).max() > np.radians(1)
    trimmed = with_ballast(change, trimming(change.before, change.after))
    rest = floating_of(trimmed.after.assembly)
    assert rest.net_buoyancy == pytest.approx(before.net_buoyancy, abs=0.03)  # pieces are rounded to the gram
    assert np.abs(rest.trim).max() < np.radians(0.1) and rest.stiffness[0] > 0


BRACKET = """name: stoat
parts:
  - {name: hull, mass: 11.0, volume: 0.0113, shape: {box: [0.5, 0.3, 0.2]}, center_of_buoyancy: [0, 0, -0.02]}
  - {name: dvl, part: dvl_a50, pose: {position: [0.33, 0, 0.14]}}
"""


@pytest.fixture
def bracket(tmp_path):
    """A hull with a device 80 mm ahead of it and below it."""
    path = tmp_path / "stoat.yaml"
    path.write_text(BRACKET)
    return path


def test_ballast_sits_on_the_hull_and_not_in_open_water(bracket):
    pieces = ballast(bracket, BallastTarget(1.0, level=True))["pieces"]
    assert pieces
    for piece in pieces:
        assert np.all(np.abs(piece["position_m"]) <= [0.25, 0.15, 0.1])
    change = add(bracket, "gripper", [0.4, 0, 0.05])
    assert all(np.all(np.abs(p.position) <= [0.25, 0.15, 0.1]) for p in trimming(change.before, change.after))


def test_ballast_lies_clear_of_earlier_ballast(bracket, tmp_path):
    first, second = tmp_path / "first.yaml", tmp_path / "second.yaml"
    change = add(bracket, "gripper", [0.4, 0, 0.05], out=first)
    trimmed = with_ballast(change, trimming(change.before, change.after), first)
    first.write_text(trimmed.text)
    change = add(first, "imaging_sonar", [0.4, 0, -0.05], out=second)
    trimmed = with_ballast(change, trimming(change.before, change.after), second)
    foam = [part for part in trimmed.after.file.parts if part.name.startswith("foam")]
    assert len(foam) == 2 and foam[0].pose.position != foam[1].pose.position
    assert not overlaps(trimmed.after.file, "v", [part.name for part in foam]) and not trimmed.notes
    rest, before = floating_of(trimmed.after.assembly), floating_of(change.before.assembly)
    assert rest.net_buoyancy == pytest.approx(before.net_buoyancy, abs=0.03) and np.abs(rest.trim).max() < 2e-3
    # Places that somebody names are kept, and the overlap is remarked.
    at = [list(foam[0].pose.position)] * 2
    notes = ballast(first, BallastTarget(4.0), Materials(places=at))["notes"]
    assert any("overlap" in note for note in notes)


def test_the_head_of_a_file_is_that_of_the_last_command(bracket, tmp_path):
    """`add` to what `ballast` wrote left the old command, name and description in it."""
    first, second = tmp_path / "first.yaml", tmp_path / "second.yaml"
    ballast(bracket, BallastTarget(1.0, level=True), out=first, command="rovtwin vehicle ballast stoat.yaml")
    change = add(first, "gripper", [0.4, 0, 0.05], out=second)
    pieces = [Piece("foam", 0.1, 200.0, (0.0, 0.0, -0.12))]
    text = signed(with_ballast(change, pieces, second), "rovtwin vehicle add ..", second, pieces).text
    data = yaml.safe_load(text)
    assert text.startswith("# Made by `rovtwin vehicle add ..`.\nname: second\n") and "vehicle ballast" not in text
    assert data["description"] == "stoat_ballasted with gripper, 100 g of foam added"
    assert [part["name"] for part in data["parts"]][-2:] == ["gripper", "foam_2"]
    second.write_text(text)
    text = signed(remove(second, "gripper", first), "rovtwin vehicle remove ..", first).text
    assert text.startswith("# Made by `rovtwin vehicle remove ..`.\nname: first\ndescription: second without gripper\n")
    # What a person wrote stays.
    assert signed(add(bracket, "gripper", [0.4, 0, 0.05], out=second), "rovtwin x", second).text.startswith(BRACKET)


def test_foam_that_could_come_off_is_named(bracket, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    args = ["vehicle", "add", "stoat.yaml", "gripper", "--at", "0.4,0,0.05", "--ballast", "-o", "claw.yaml"]
    assert CliRunner().invoke(app, args, catch_exceptions=False).exit_code == 0
    shown = CliRunner().invoke(app, ["vehicle", "remove", "claw.yaml", "gripper"], catch_exceptions=False).stdout
    assert "without more ballast it floats with" in shown
    assert "foam of earlier ballast lifts it: foam_1 (" in shown and "vehicle remove claw.yaml foam_1 -o FILE" in shown


def test_a_file_that_is_wrong_is_named_as_it_was_typed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "key.yaml").write_text("name: key\nmas: 3\n")
    error = CliRunner().invoke(app, ["vehicle", "check", "bad/key.yaml"]).exception
    assert isinstance(error, ConfigError) and str(error).startswith("bad/key.yaml: ")


@pytest.mark.system
def test_an_identified_vehicle_is_held_as_what_it_was_identified_from(tmp_path):
    data = load_vehicle("double_blueye").to_dict() | {"name": "found"}
    made_with = fingerprint(vehicle_from_dict(data).file)
    data["identified"] = {
        "made_with": made_with,
        "hydrodynamics": {"added_mass": [40.0, 60.0, 50.0, 2.5, 0.9, 2.6]},
        "restoring": {"net_buoyancy": 1.0},
        "estimate": {"parameters": [], "covariance": []},
    }
    path = tmp_path / "found.yaml"
    path.write_text(yaml.safe_dump(data))
    assert load_vehicle(path).assembly.added_mass[0, 0] == 40.0
    change = add(path, "dvl_a50", [-0.2, 0, 0.16], out=tmp_path / "new.yaml")
    assert yaml.safe_load(change.text)["parts"][0] == {"name": "found", "part": "double_blueye"}
    assert f"rovtwin identify {tmp_path / 'new.yaml'} --prior {path}" in change.notes[0]
    assert change.before.assembly.added_mass[0, 0] == 31.3
    # Of a vehicle that is not in the library the description itself is held.
    data["parts"][0]["mass"] = 9.5
    data["identified"]["made_with"] = fingerprint(vehicle_from_dict({**data, "identified": None}).file)
    path.write_text(yaml.safe_dump(data))
    change = add(path, "dvl_a50", [-0.2, 0, 0.16], out=tmp_path / "new.yaml")
    assert change.after.assembly.solid.mass == pytest.approx(30.5 + 0.17)
    assert change.after.thruster_names == change.before.thruster_names
    assert "identified" not in yaml.safe_load(remove(path, "uhi").text)


@pytest.mark.parametrize(
    "asked, message",
    [
        (("double_blue", "dvl_a50", [0, 0, 0]), "Did you mean 'double_blueye'"),
        (("double_blueye", "dvl_a5", [0, 0, 0]), "Did you mean 'dvl_a50'"),
        (("double_blueye", "dvl_a50", [0, 0, 0], [0, 0, 0], "double_blueye"), "there is a part of that name already"),
        (("double_blueye", "dvl_a50", [0, 0, 0], [0, 0, 0], "2nd"), "parts[1].name"),
        (("double_blueye", "dvl_a50", [-200, 0, 160]), "expected its place in metres, -0.2,0,0.16"),
    ],
)
def test_mistakes_are_reported_with_the_fix(asked, message):
    with pytest.raises(ConfigError) as error:
        add(*asked)
    assert message in str(error.value)


def test_a_part_that_is_not_there(own):
    with pytest.raises(ConfigError, match="no part 'dvl': its parts are rov"):
        remove(own, "dvl")


@pytest.fixture
def far(tmp_path, monkeypatch):
    """A file that names others beside it, one of them as the library does, and a current folder that is elsewhere."""
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    monkeypatch.chdir(tmp_path / "b")
    (tmp_path / "a" / "hull.yaml").write_text("name: hull\nmass: 7.0\nshape: {box: [0.4, 0.3, 0.2]}\n")
    (tmp_path / "a" / "gripper.yaml").write_text("name: gripper\nmass: 3.0\nshape: {sphere: 0.05}\n")
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "a" / "pod.stl")
    (tmp_path / "a" / "t.txt").write_text("command force\n-1 -20\n0 0\n1 30\n")
    path = tmp_path / "a" / "veh.yaml"
    path.write_text(
        "name: veh  # mine\nparts:\n  - {name: hull, part: ./hull.yaml}\n  - {name: claw, part: gripper}\n"
        "  - {name: dvl, part: dvl_a50}\n  - name: pod\n    mass: 1.0\n    shape: {mesh: pod.stl}  # CAD\n"
        "    thrusters:\n      - {name: t, direction: [1, 0, 0], curve: {table: t.txt}}\n"
        "  - {name: lamp, mass: 0.1}\n"
    )
    return path


def test_a_part_is_taken_off_a_file_in_another_folder(far, tmp_path):
    whole = load_vehicle(far).assembly
    looked = remove(far, "lamp")
    assert "./hull.yaml" in looked.text and "lamp" not in looked.text
    out = tmp_path / "b" / "new.yaml"
    out.write_text(remove(far, "lamp", out).text)
    for after in (looked.after.assembly, load_vehicle(out).assembly):
        assert after.solid.mass == pytest.approx(whole.solid.mass - 0.1)  # with the claw beside the file, of 3 kg
        assert after.volume == pytest.approx(whole.volume)
    parts = yaml.safe_load(out.read_text())["parts"]
    assert [part.get("part") for part in parts] == ["../a/hull.yaml", "../a/gripper.yaml", "dvl_a50", None]
    assert parts[3]["shape"]["mesh"] == "../a/pod.stl"
    assert parts[3]["thrusters"][0]["curve"]["table"] == "../a/t.txt"
    assert "# mine" in out.read_text() and "# CAD" in out.read_text()


def test_ballast_for_a_file_in_another_folder(far):
    """What is only looked at is read against the folder of its file with ballast too."""
    change = remove(far, "lamp")
    block = Piece("lead", 0.2, 11340.0, (0.0, 0.0, 0.1))
    assert with_ballast(change, [block]).after.assembly.solid.mass > change.after.assembly.solid.mass
    assert add(far, "dvl_a50", [0, 0, 0.3], name="second").after.assembly.solid.mass > change.after.assembly.solid.mass
