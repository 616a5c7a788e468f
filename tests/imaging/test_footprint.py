"""What an imager sees of a flat floor, in closed form."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rovtwin.core.errors import ConfigError
from rovtwin.imaging.footprint import footprint_of
from rovtwin.imaging.imager import Imager, Mount, load_imager

DOWN = np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])


def dry(**changes):
    """The library's without its port: a pinhole of 60 degrees."""
    file = load_imager("uhi").file
    return Imager(file.model_copy(update={"port": None} | changes))


def half_angle(imager):
    """Of the outermost pixels' middles [rad]."""
    return np.arctan(np.tan(np.radians(30.0)) * (1 - 1 / imager.pixels))


def test_a_pinhole_sees_height_times_tangent():
    imager, mount = dry(), Mount(np.array([0.1, 0.2, 0.3]), DOWN)
    seen = footprint_of(imager, mount, 1.8)
    assert seen.height == 1.5
    assert seen.width == seen.level_width == pytest.approx(2 * 1.5 * np.tan(half_angle(imager)), rel=1e-9)
    assert seen.middle == pytest.approx([0.1, 0.2], abs=1e-9) and seen.place == pytest.approx([0.1, 0.2])
    assert seen.across[0] == pytest.approx(2 * 1.5 * np.tan(np.radians(30)) / imager.pixels, rel=1e-9)
    optics = imager.file.optics
    along = 1.5 * (1e-3 * optics.slit_um / optics.focal_length_mm)
    assert seen.along == pytest.approx(along, rel=1e-6)
    assert seen.square_speed(20.0, 8) == pytest.approx(8 * 20 * seen.across[0])
    assert seen.gapless_speed(20.0, 0.025) == pytest.approx(along / 0.025, rel=1e-6)
    assert seen.gapless_speed(20.0, 0.05) == np.inf


@pytest.mark.parametrize("roll", [2.0, 10.0])
def test_roll_takes_from_both_sides(roll):
    """What is seen at every roll is what both ends of it see; the lever turns, too."""
    imager, mount = dry(), Mount(np.array([0.0, 0.0, 0.2]), DOWN)
    seen = footprint_of(imager, mount, 1.7, np.radians(roll))
    angle, turn = half_angle(imager), np.radians(roll)
    height = 1.7 - 0.2 * np.cos(turn)
    inner = height * np.tan(angle - turn) - 0.2 * np.sin(turn)
    assert 0.5 * seen.width == pytest.approx(inner, rel=1e-9)
    assert seen.middle[1] == pytest.approx(0.0, abs=1e-9) and seen.width < seen.level_width


def test_the_port_takes_from_the_swath_as_snell_says():
    with_port = footprint_of(load_imager("uhi"), Mount(np.zeros(3), DOWN), 1.5)
    port = load_imager("uhi").file.port
    angle = half_angle(dry())
    glass, water = (np.arcsin(np.sin(angle) / n) for n in (port.glass, port.water))
    half = port.distance * np.tan(angle) + port.thickness * np.tan(glass)
    half += (1.5 - port.distance - port.thickness) * np.tan(water)
    assert 0.5 * with_port.width == pytest.approx(half, rel=1e-9)


def test_a_tilted_imager_sees_beside_the_vehicle():
    mount = Mount(np.zeros(3), Rotation.from_euler("x", 10, degrees=True).as_matrix() @ DOWN)
    seen = footprint_of(dry(), mount, 1.5)
    angle = half_angle(dry())
    left, right = (1.5 * np.tan(np.radians(-10) + side * angle) for side in (-1, 1))
    assert seen.middle[1] == pytest.approx(0.5 * (left + right)) and seen.width == pytest.approx(right - left)
    assert seen.across[1] > seen.across[0]


BAD = {
    "in the floor": (Mount(np.array([0, 0, 1.6]), DOWN), 0.0, "it would be in the floor"),
    "ahead": (Mount(np.zeros(3), np.eye(3)), 0.0, "looks past the floor"),
    "rolled away": (Mount(np.zeros(3), DOWN), 0.6, "leave nothing of|looks past"),
    "along": (
        Mount(np.zeros(3), Rotation.from_euler("z", 90, degrees=True).as_matrix() @ DOWN),
        0.0,
        "it sweeps no swath",
    ),
}


@pytest.mark.parametrize("mount, roll, message", BAD.values(), ids=BAD)
def test_what_sees_no_swath_is_named(mount, roll, message):
    with pytest.raises(ConfigError, match=message):
        footprint_of(dry(), mount, 1.5, roll)
