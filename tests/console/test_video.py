"""A real camera's stream: what comes of it, and what is said when nothing does; what films here is a test."""

import socket
import time

import numpy as np
import pytest

pytest.importorskip("cv2", reason="the camera's view needs OpenCV")

import cv2
from tests.console.films import CAMERAS, MARKER, filming

from rovtwin.console.pictures import PictureProcess
from rovtwin.console.video import WIDEST, Filmed, camera_of, public, require_stream
from rovtwin.core.errors import ConfigError


def newest(process):
    until = time.monotonic() + 60.0
    while time.monotonic() < until:
        picture = process.newest()
        if picture is not None or process.why:
            return picture
        time.sleep(0.01)
    raise AssertionError("neither a picture nor a reason in 60 s")


@pytest.mark.system
@pytest.mark.parametrize("scheme", CAMERAS)
def test_newest_picture_fits_and_markers_are_found_until_the_camera_hangs_up(scheme):
    with filming(scheme) as film, PictureProcess(Filmed(film.url, "pool")) as process:
        corner, side, (width, height) = film.place
        share = min(WIDEST / width, 1.0)
        picture = newest(process)
        assert picture.size == (share * width, share * height)
        image = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_COLOR)
        assert image.shape == (picture.size[1], picture.size[0], 3)
        (marker,) = picture.markers
        assert marker["id"] == MARKER
        first = np.array(corner)
        assert np.abs(np.array(marker["corners"])[[0, 2]] - share * np.array([first, first + side])).max() < 1.5
        film.ended.set()
        while newest(process) is not None:
            pass
        assert "the stream ended" in process.why and "secret" not in process.why


@pytest.mark.system
def test_camera_that_is_not_there_is_reported_without_its_password():
    with socket.socket() as nobody:  # an address at which nobody answers
        nobody.bind(("127.0.0.1", 0))
        url = f"rtsp://me:secret@127.0.0.1:{nobody.getsockname()[1]}/test"
        with PictureProcess(Filmed(url)) as process:
            assert newest(process) is None
            assert "found no stream" in process.why and "secret" not in process.why


BROKEN = ("rtsp://[::1/test", "rtsp://:8554/x", "rtsp://host:port/x", "rtsp://host:99999999/x")


@pytest.mark.parametrize(
    "url", ["192.168.1.101", "file:///etc/passwd", "rtsp://", "ftp://me:secret@host/x", "rtsp:/x", *BROKEN]
)
def test_what_is_no_stream_is_refused(url):
    with pytest.raises(ConfigError, match="expected the address of a stream") as refusal:
        require_stream(url)
    assert "secret" not in str(refusal.value)


def test_stream_of_a_blueye_is_known_by_its_link():
    assert camera_of("blueye://192.168.1.101,192.168.1.102?position") == "rtsp://192.168.1.101:8554/test"
    assert camera_of("twin://") is None and camera_of("mavlink://udpin:0.0.0.0:14550") is None
    assert public("rtsp://me:secret@10.0.0.1:8554/a?b") == "rtsp://10.0.0.1:8554"
