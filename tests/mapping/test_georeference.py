"""Where pixels lie: against a closed form by Snell's law alone, and on a slope."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.mapping.helper import DOWN, LEVER, imager, mount, moving

from rovtwin.imaging.floor import Plane
from rovtwin.mapping.georeference import LONGEST, Georeference


def by_snell(file, pixel):
    """Where a pixel's ray leaves the port, and its direction in the water, of the imager's frame s."""
    focal = 0.5 * file.pixels / np.tan(np.radians(0.5 * file.lens.field_of_view_deg))
    air = np.arctan((pixel - 0.5 * (file.pixels - 1)) / focal)
    port = file.port
    glass, water = (np.arcsin(np.sin(air) / n) for n in (port.glass, port.water))
    right = port.distance * np.tan(air) + port.thickness * np.tan(glass)
    return np.array([port.distance + port.thickness, right, 0.0]), np.array([np.cos(water), np.sin(water), 0.0])


@pytest.mark.parametrize("euler", [(0.0, 0.0, 0.0), (0.1, -0.15, 0.7), (-0.2, 0.1, -2.5)])
@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.2, -0.1)])
def test_points_are_those_of_snells_law_to_a_nanometre(euler, slope):
    navigation, small = moving(euler), imager()
    t = np.array([0.513, 2.171, 3.9])
    found = Georeference(small, mount(), navigation, Plane(5.0, slope)).locate(t)
    R = Rotation.from_euler("ZYX", euler[::-1]).as_matrix()
    course, normal = np.array([np.cos(euler[2]), np.sin(euler[2]), 0.0]), np.array([*slope, -1.0])
    for i, at in enumerate(t):
        place = np.array([0.0, 0.3, 3.4]) + 0.2 * at * course
        for pixel in (0, 5, 11):
            leaves, along = by_snell(small.file, pixel)
            origin, along = place + R @ (LEVER + DOWN @ leaves), R @ DOWN @ along
            way = (-5.0 - normal @ origin) / (normal @ along)
            assert np.abs(found.point[i, pixel] - (origin + way * along)).max() < 1e-9
            assert found.way[i, pixel] == pytest.approx(way, abs=1e-9)
            cosine = -along @ normal / np.linalg.norm(normal)
            assert found.cosine[i, pixel] == pytest.approx(cosine, abs=1e-9)
    assert found.valid.all()


def test_a_part_of_the_pixels_lies_where_all_of_them_do():
    model = Georeference(imager(), mount(), moving((0.1, 0.0, 0.3)), Plane(5.0))
    t = np.array([1.0, 2.0])
    assert (model.locate(t, slice(2, 9, 3)).point == model.locate(t).point[:, 2:9:3]).all()


def test_what_has_no_pose_or_no_floor_is_not_valid():
    t = np.array([-0.1, 1.0, 5.0])
    assert (Georeference(imager(), mount(), moving(), Plane(5.0)).locate(t).valid == [[False], [True], [False]]).all()
    upward = Georeference(imager(), mount(), moving((2.0, 0.0, 0.0)), Plane(5.0)).locate(t)
    assert not upward.valid.any() and np.isnan(upward.point).all()
    assert not Georeference(imager(), mount(), moving(), Plane(4.0 + LONGEST)).locate(t).valid.any()
