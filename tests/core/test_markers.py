"""Where markers hang, and what is printed on them."""

import sys

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.core.markers import Layout, Marker, pattern
from rovtwin.core.user_files.config import parse


def marker(**changed):
    return Marker(**{"id": 3, "size": 0.2, "position": [5.0, 1.0, 2.0], "faces": [-1.0, 0.0, 0.0]} | changed)


def test_a_marker_on_the_north_wall_is_upright_for_who_looks_north():
    top_left, top_right, bottom_right, bottom_left = marker().corners
    assert np.allclose(top_left, [5.0, 0.9, 1.9])  # left of who looks north is west, up is less depth
    assert np.allclose(top_right, [5.0, 1.1, 1.9])
    assert np.allclose(bottom_right, [5.0, 1.1, 2.1])
    assert np.allclose(bottom_left, [5.0, 0.9, 2.1])


def test_on_the_floor_its_top_points_north():
    top_left, top_right, _, bottom_left = marker(faces=[0.0, 0.0, -1.0]).corners
    assert np.allclose(top_left, [5.1, 0.9, 2.0])
    assert np.allclose(top_right, [5.1, 1.1, 2.0])  # looking down with north up, east is right
    assert np.allclose(bottom_left, [4.9, 0.9, 2.0])


@pytest.mark.parametrize("faces", [[-1, 0, 0], [0, 3, 0], [0, 0, -1], [0, 0, 1], [1, 2, -2]])
@pytest.mark.parametrize("roll", [0.0, 90.0, -37.0])
def test_its_frame_is_right_handed_with_z_out_of_the_face(faces, roll):
    R = marker(faces=[float(x) for x in faces], roll_deg=roll).R_nm
    assert np.allclose(R.T @ R, np.eye(3), atol=1e-14)
    assert np.linalg.det(R) == pytest.approx(1.0)
    assert np.allclose(R[:, 2], np.array(faces) / np.linalg.norm(faces))


def test_roll_turns_counter_clockwise_for_who_looks_at_it():
    upright, turned = marker().corners, marker(roll_deg=90.0).corners
    assert np.allclose(turned[0], upright[3])  # top left goes to where bottom left was


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"dictionary": "DICT_4X4_51"}, "expected one of DICT_4X4_50"),
        ({"markers": [{"id": 50, "size": 0.1, "position": [0, 0, 0], "faces": [1, 0, 0]}]}, "ends with 49"),
        ({"markers": [{"id": 1, "size": 0.1, "position": [0, 0, 0], "faces": [1, 0, 0]}] * 2}, "each id once"),
        ({"markers": [{"id": 1, "size": 0.1, "position": [0, 0, 0], "faces": [0, 0, 0]}]}, "expected a direction"),
    ],
)
def test_what_cannot_be_is_named(data, message):
    with pytest.raises(ConfigError, match=message):
        parse(Layout, data, "pool.yaml")


def test_a_pattern_has_a_black_border_and_is_read_as_its_number():
    cv2 = pytest.importorskip("cv2")
    black = pattern("DICT_5X5_100", 42)
    assert black.shape == (7, 7) and black[[0, -1]].all() and black[:, [0, -1]].all()
    picture = np.kron(np.pad(~black, 1, constant_values=True), np.ones((20, 20))).astype(np.uint8) * 255
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100))
    assert detector.detectMarkers(picture)[1].ravel().tolist() == [42]


def test_without_opencv_the_message_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(ConfigError, match=r"pip install 'rovtwin\[vision\]'"):
        pattern("DICT_4X4_50", 0)
