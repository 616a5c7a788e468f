"""Outlines of pictures on a flat floor, in closed form."""

import numpy as np
import pytest

from rovtwin.core.arrays.rotations import rotation_from_euler
from rovtwin.imaging.floor import Plane
from rovtwin.imaging.photographs.overlap import length_on, overlap_of
from rovtwin.vehicle.description.cameras import Camera
from rovtwin.vehicle.physics.camera import lens_from

WIDTH, HEIGHT, FOCAL = 800, 600, 500.0
DOWN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # top of the picture ahead
LENS = lens_from([FOCAL, FOCAL], [0.5 * (WIDTH - 1), 0.5 * (HEIGHT - 1)], (WIDTH, HEIGHT))
CAMERA = Camera("down", LENS, np.zeros(3), DOWN)
LENGTH, ACROSS = 2.0 * (HEIGHT - 1) / FOCAL, 2.0 * (WIDTH - 1) / FOCAL  # two metres over the floor


def seen(*places, heading=0.0):
    position = np.array([[*place, 3.0] for place in places])
    R = np.repeat(rotation_from_euler(np.array([0.0, 0.0, heading]))[None], len(position), axis=0)
    return overlap_of(CAMERA, position, np.asarray(R), Plane(5.0))


@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_pictures_of_one_line_share_what_the_way_leaves(heading):
    along = np.array([np.cos(heading), np.sin(heading)])
    found = seen(*(0.5 * k * along for k in range(4)), heading=heading)
    assert found.forward[:3] == pytest.approx(1 - 0.5 / LENGTH, rel=1e-9) and np.isnan(found.forward[3])
    assert found.outlines[0].area == pytest.approx(LENGTH * ACROSS, rel=1e-9)
    assert (found.side == 0.0).all()  # there is no other line


def test_pictures_of_the_next_line_are_shared_sideways():
    there, back = [(0.6 * k, 0.0) for k in range(8)], [(0.6 * k, 2.0) for k in range(7, -1, -1)]
    found = seen(*there, *back)
    assert found.side[2:6] == pytest.approx(1 - 2.0 / ACROSS, rel=1e-6)
    assert found.forward[7] == pytest.approx(1 - 2.0 / ACROSS, rel=1e-6)  # the turn
    (text,) = found.words(np.arange(16.0))
    assert text.startswith("pictures 8 to 9, 7.0 to 8.0 s: as little as 37% of one")


def test_gaps_and_blind_pictures_are_named():
    found = seen((0, 0), (0.4, 0), (5, 0), (5.4, 0))
    text = found.words(np.array([0.0, 2.0, 4.0, 6.0]))
    assert any("pictures 2 to 3, 2.0 to 4.0 s: nothing of one is seen by the next" in line for line in text)
    assert any("4 of 4 pictures share less than 30%" in line for line in text)
    level = Camera("ahead", LENS, np.zeros(3), np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]))
    blind = overlap_of(level, np.array([[0.0, 0, 3], [0.4, 0, 3]]), np.repeat(np.eye(3)[None], 2, 0), Plane(5.0))
    assert blind.outlines == [None, None] and "overlaps cannot be judged" in blind.words(np.arange(2.0))[0]


def test_the_length_of_a_picture_on_the_floor():
    assert length_on(CAMERA, 2.0) == pytest.approx(LENGTH, rel=1e-9)
