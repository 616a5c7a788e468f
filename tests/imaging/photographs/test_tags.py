"""Angles of pictures, and tags in JPEG files."""

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from rovtwin.core.errors import ConfigError
from rovtwin.imaging.photographs.jpeg import jpeg_of, tagged, taken_at
from rovtwin.imaging.photographs.tags import Shot, direction_of, exif_of, picture_angles, xmp_of

DOWN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # R_bc: top of the picture ahead
AHEAD = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
SHOT = Shot(np.datetime64("2026-05-01T23:59:59.999999900"), -0.0000001, -179.9999999999, 0.5, 1.0, 2.0, 3.0, 0.1, 0.05,
            359.999, 0.8, "rovtwin", "it's \"mine\" <&>")  # fmt: skip


@pytest.mark.parametrize("angles", [(0, 0, 0), (70, 5, -3), (300, -20, 10), (180, 45, 60)])
def test_a_camera_that_looks_down_has_the_angles_of_the_vehicle(angles):
    R = Rotation.from_euler("ZYX", angles, degrees=True).as_matrix()
    yaw, pitch, roll = np.degrees(picture_angles(R @ DOWN))
    assert (yaw, pitch, roll) == pytest.approx(angles, abs=1e-9)


@pytest.mark.parametrize("heading", [0.0, 123.0, 359.0])
def test_a_camera_that_looks_ahead_has_a_pitch_of_90(heading):
    R = Rotation.from_euler("ZYX", [heading, 0, 0], degrees=True).as_matrix()
    assert np.degrees(picture_angles(R @ AHEAD)) == pytest.approx((heading, 90.0, 0.0), abs=1e-9)
    assert np.degrees(direction_of(R @ AHEAD)) == pytest.approx(heading, abs=1e-9)
    assert np.degrees(direction_of(R @ DOWN)) == pytest.approx(heading, abs=1e-9)
    nose_down = Rotation.from_euler("ZYX", [heading, -30, 0], degrees=True).as_matrix()
    assert np.degrees(picture_angles(nose_down @ AHEAD)) == pytest.approx((heading, 60.0, 0.0), abs=1e-9)


def test_any_angles_lead_back_to_the_attitude():
    for R in Rotation.random(50, rng=np.random.default_rng(3)).as_matrix():
        yaw, pitch, roll = picture_angles(R @ DOWN)
        assert np.allclose(Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix(), R, atol=1e-9)


def test_limits_do_not_spill_over():
    """60 seconds of arc or time, 360 degrees and signs of almost nothing."""
    exif = exif_of(SHOT)
    gps = exif.get_ifd(0x8825)
    assert gps[1] == "S" and gps[3] == "W" and gps[5] == b"\x00"
    assert [float(x) for x in gps[4]] == pytest.approx([180, 0, 0], abs=1e-4) and float(gps[4][2]) < 60
    assert float(gps[7][2]) < 60 and float(gps[17]) <= 360
    assert exif.get_ifd(0x8769)[0x9003] == "2026:05:01 23:59:59"


def test_tags_replace_tags_and_nothing_else():
    picture = np.random.default_rng(0).integers(0, 255, (32, 32, 3), dtype=np.uint8)
    plain = jpeg_of(picture)
    once = tagged(plain, exif_of(SHOT), xmp_of(SHOT))
    assert tagged(once, exif_of(SHOT), xmp_of(SHOT)) == once
    assert once.endswith(plain[plain.index(b"\xff\xdb") :])  # tables and scan as they were
    with pytest.raises(ConfigError, match="is no JPEG file"):
        tagged(b"GIF89a", exif_of(SHOT), b"")
    with pytest.raises(ConfigError, match="is cut off"):
        tagged(plain[:40], exif_of(SHOT), b"")
    with pytest.raises(ConfigError, match="has room for"):
        tagged(plain, exif_of(SHOT), b"x" * 70_000)


def test_times_of_cameras():
    exif = Image.Exif()
    with pytest.raises(ConfigError, match="has no DateTimeOriginal"):
        taken_at(exif, "a.jpg")
    own = exif.get_ifd(0x8769)
    own[0x9003], own[0x9291], own[0x9011] = "2026:05:01 01:30:00", "25", "+02:00"
    assert taken_at(exif, "a.jpg") == np.datetime64("2026-04-30T23:30:00.25")
    own[0x9011] = "-03:30"
    assert taken_at(exif, "a.jpg") == np.datetime64("2026-05-01T05:00:00.25")
    own[0x9003] = "0000:00:00 00:00:00"  # a camera whose clock was never set
    with pytest.raises(ConfigError, match="found '0000:00:00 00:00:00', expected"):
        taken_at(exif, "a.jpg")
