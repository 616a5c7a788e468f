"""What vehicles look like, and their URDF."""

from xml.etree import ElementTree

import numpy as np
import pytest

from rovtwin.core.arrays.rotations import rotation_from_euler
from rovtwin.core.errors import ConfigError
from rovtwin.vehicle import list_library, load_vehicle, vehicle_from_dict
from rovtwin.vehicle.analysis.urdf import urdf
from rovtwin.vehicle.analysis.visuals import pieces_of
from rovtwin.vehicle.description.identified import fingerprint

FLU = np.diag([1.0, -1.0, -1.0])
PART = {
    "name": "v",
    "mass": 2.0,
    "center_of_gravity": [0.1, 0.2, 0.3],
    "inertia": [0.2, 0.25, 0.3, 0.01, 0.02, 0.03],
    "visuals": [
        {"cylinder": {"radius": 0.1, "length": 0.5}, "center": [0.1, 0.2, 0.3], "attitude_deg": [0, 30, 40]},
        {"sphere": 0.2, "colour": "#ff8000"},
        {"ellipsoid": [0.1, 0.2, 0.3]},
    ],
    "cameras": [{"name": "eye", "pose": {"position": [0.3, 0.1, -0.2], "attitude_deg": [0, -20, 10]}}],
}


def numbers(text):
    return np.array([float(x) for x in text.split()])


def rotation(element):
    return rotation_from_euler(numbers(element.find("origin").get("rpy")))


@pytest.mark.parametrize("name", list_library())
def test_every_vehicle_of_the_library_has_valid_urdf(name):
    vehicle = load_vehicle(name)
    robot = ElementTree.fromstring(urdf(vehicle))
    links = {link.get("name") for link in robot.iter("link")}
    assert len(links) == len(list(robot.iter("link")))
    for joint in robot.iter("joint"):
        assert joint.find("parent").get("link") == "base_link" and joint.find("child").get("link") in links
    assert float(robot.find("link/inertial/mass").get("value")) == pytest.approx(vehicle.assembly.solid.mass)
    assert len(list(robot.iter("visual"))) == len(pieces_of(vehicle))


def test_the_double_blueye_is_two_pioneers_an_imager_and_beams():
    pieces = pieces_of(load_vehicle("double_blueye"))
    sides = [
        np.sign(round(p.placement.position[1], 6)) for p in pieces if "_port_" in p.name or "_starboard_" in p.name
    ]
    port = {p.name.split("_")[2] for p in pieces}
    assert port == {"port", "starboard", "uhi", "frame"}
    assert sides.count(-1.0) == sides.count(1.0) > 8
    # It is as large as its file says: 2 x 0.28 m and a hull's width across.
    across = [p.placement.position[1] + s * 0.5 * p.size[1] for p in pieces if p.kind == "ellipsoid" for s in (-1, 1)]
    assert np.ptp(across) == pytest.approx(0.56 + 0.21, abs=0.02)


def test_urdf_turns_everything_to_forward_left_up():
    vehicle = vehicle_from_dict(PART)
    robot = ElementTree.fromstring(urdf(vehicle))
    cylinder, sphere, box = robot.findall("link/visual")
    assert np.allclose(numbers(cylinder.find("origin").get("xyz")), [0.1, -0.2, -0.3])
    axis = rotation_from_euler(np.radians([0, 30, 40])) @ [1, 0, 0]  # ours along x, URDF's along z
    assert np.allclose(rotation(cylinder) @ [0, 0, 1], FLU @ axis)
    assert sphere.find("geometry/sphere").get("radius") == "0.2"
    assert np.allclose(numbers(sphere.find("material/color").get("rgba")), [1.0, 128 / 255, 0.0, 1.0])
    assert box.find("geometry/box").get("size") == "0.2 0.4 0.6"
    I = {key: float(value) for key, value in robot.find("link/inertial/inertia").items()}
    ours = FLU @ vehicle.assembly.solid.inertia @ FLU
    assert [I["ixx"], I["ixy"], I["ixz"], I["iyz"]] == pytest.approx([ours[0, 0], ours[0, 1], ours[0, 2], ours[1, 2]])
    (joint,) = robot.findall("joint")
    looks = rotation_from_euler(np.radians([0, -20, 10])) @ [1, 0, 0]  # the camera's x is OpenCV's z
    assert np.allclose(rotation(joint) @ [0, 0, 1], FLU @ looks)
    assert np.allclose(numbers(joint.find("origin").get("xyz")), [0.3, -0.1, 0.2])


@pytest.mark.parametrize("pitch", [90, -90])
def test_urdf_angles_hold_straight_up_and_down(pitch):
    part = PART | {"visuals": [{"box": [1, 2, 3], "attitude_deg": [25, pitch, 40]}]}
    (visual,) = ElementTree.fromstring(urdf(vehicle_from_dict(part))).findall("link/visual")
    assert np.allclose(rotation(visual), FLU @ rotation_from_euler(np.radians([25, pitch, 40])) @ FLU, atol=1e-7)


def test_looks_leave_an_identification_valid():
    plain = {key: value for key, value in PART.items() if key != "visuals"}
    assert fingerprint(vehicle_from_dict(PART).file) == fingerprint(vehicle_from_dict(plain).file)


def test_a_part_without_looks_shows_its_shape():
    (piece,) = pieces_of(vehicle_from_dict({"name": "v", "mass": 1.0, "shape": {"box": [0.4, 0.2, 0.1]}}))
    assert piece.kind == "box" and np.allclose(piece.size, [0.4, 0.2, 0.1])


def test_a_mesh_is_found_beside_the_file_that_names_it(tmp_path):
    (tmp_path / "hull.stl").write_text("solid hull\nendsolid hull\n")
    (piece,) = pieces_of(vehicle_from_dict({"name": "v", "visuals": [{"mesh": "hull.stl"}]}, folder=tmp_path))
    assert piece.mesh == str((tmp_path / "hull.stl").resolve())
    with pytest.raises(ConfigError, match=r"visuals\[0\].mesh: found no.stl, but there is no file"):
        vehicle_from_dict({"name": "v", "visuals": [{"mesh": "no.stl"}]}, folder=tmp_path)


@pytest.mark.parametrize(
    ("visual", "message"),
    [
        ({}, "found none, expected one of box"),
        ({"sphere": 0.1, "box": [1, 1, 1]}, "found box and sphere"),
        ({"sphere": 0.1, "colour": "blue"}, "expected a colour such as"),
        ({"sphere": 0.1, "colour": [1, 2, 3]}, "each 0 to 1"),
    ],
)
def test_looks_that_cannot_be_are_named(visual, message):
    with pytest.raises(ConfigError, match=message):
        vehicle_from_dict({"name": "v", "visuals": [visual]})
