"""How points answer to errors: every derivative against a difference, on a floor that is neither level nor plane."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.mapping.helper import moving
from tests.mapping.surveys import DOWN, LEVER, Hills, wide

from rovtwin.imaging.imager import Mount
from rovtwin.mapping.alignment.ground_points import CALIBRATION, ground_points
from rovtwin.mapping.georeference import Georeference

T, PIXEL = np.array([1.0, 1.4, 2.2, 3.05]), np.array([0.0, 52.5, 105.0, 199.0])
STEP = 1e-5


@dataclass
class Deeper:
    """A floor that lies deeper by some."""

    floor: Hills
    by: float

    def depth_and_slope(self, place):
        depth, slope = self.floor.depth_and_slope(place)
        return depth + self.by, slope


def georeference() -> Georeference:
    mount = Mount(LEVER, Rotation.from_rotvec([0.05, -0.1, 0.2]).as_matrix() @ DOWN, "uhi.camera")
    nav = moving(euler=(0.06, -0.04, 0.7), rate=20.0)
    turning = Rotation.from_quat(nav.quaternion[:, [1, 2, 3, 0]]) * Rotation.from_rotvec(
        nav.t[:, None] * [0.02, -0.03, 0.05]
    )
    return Georeference(wide(), mount, replace(nav, quaternion=turning.as_quat()[:, [3, 0, 1, 2]]), Hills())


def moved(where, name, by):
    nav, mount = where.navigation, where.mount
    axis = by * np.eye(3)
    if name.startswith("place"):
        return replace(where, navigation=replace(nav, position=nav.position + axis[int(name[-1])])), 0.0
    if name.startswith("turn"):
        q = Rotation.from_quat(nav.quaternion[:, [1, 2, 3, 0]]) * Rotation.from_rotvec(axis[int(name[-1])])
        return replace(where, navigation=replace(nav, quaternion=q.as_quat()[:, [3, 0, 1, 2]])), 0.0
    k = CALIBRATION.index(name)
    if k < 3:
        turned = replace(mount, rotation=Rotation.from_rotvec(axis[k]).as_matrix() @ mount.rotation)
        return replace(where, mount=turned), 0.0
    if k < 6:
        return replace(where, mount=replace(mount, position=mount.position + axis[k - 3])), 0.0
    return where, by


@pytest.mark.parametrize("name", [*(f"place{i}" for i in range(3)), *(f"turn{i}" for i in range(3)), *CALIBRATION])
def test_derivatives_are_those_of_differences(name):
    where = georeference()
    seen = ground_points(where, T, PIXEL)
    ends = []
    for sign in (1.0, -1.0):
        other, later = moved(where, name, sign * STEP)
        ends.append(ground_points(other, T + later, PIXEL).point[:, :2])
    found = (ends[0] - ends[1]) / (2.0 * STEP)
    if name in CALIBRATION:
        expected = seen.by_calibration[:, :, CALIBRATION.index(name)]
    else:
        expected = seen.by_pose[:, :, int(name[-1]) + 3 * name.startswith("turn")]
    assert seen.valid.all()
    np.testing.assert_allclose(found, expected, atol=2e-4 if name == "clock" else 1e-6)


def test_a_deeper_floor_is_met_farther_along_the_ray():
    where = georeference()
    seen = ground_points(where, T, PIXEL)
    ends = [ground_points(replace(where, floor=Deeper(Hills(), s * STEP)), T, PIXEL).point[:, :2] for s in (1.0, -1.0)]
    np.testing.assert_allclose((ends[0] - ends[1]) / (2 * STEP), seen.by_depth, atol=1e-6)


def test_what_sees_nothing_is_not_valid_and_counts_for_nothing():
    seen = ground_points(georeference(), np.array([-5.0, 1.0]), np.array([3.0, 3.0]))
    assert seen.valid.tolist() == [False, True]
    assert not seen.by_pose[0].any() and np.isfinite(seen.point).all()
