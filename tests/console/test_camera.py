"""The camera's process: what it shows, how it keeps up, what it says when there is nothing to see."""

import os
import signal
import time

import numpy as np
import pytest

from rovtwin.console.camera import PATIENCE, STILL, WINDOW, Drawn, Eye, Sizes, section_of, watch
from rovtwin.console.pictures import Picture, PictureProcess
from rovtwin.core.errors import ConfigError, LinkError
from rovtwin.scenario.files import load_scenario
from rovtwin.simulation.scene import load_scene
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.description.cameras import cameras_of
from rovtwin.vehicle.physics.camera import project

cv2 = pytest.importorskip("cv2", reason="the camera's view needs OpenCV")

PLACE = np.array([3.0, 0.1, 0.9, 0.02, -0.03, 0.1])  # before the pool's wall with markers


@pytest.fixture(scope="module")
def vehicle():
    return load_vehicle("double_blueye")


@pytest.fixture(scope="module")
def picture(vehicle):
    section = section_of(load_scenario("lawnmower_calm"), vehicle, "pool")
    return Eye(section, vehicle).picture(1.5, PLACE)


def projected(vehicle, size):
    """Pixels of the corners of the pool's markers, by id, as the lens has them."""
    from rovtwin.core.frames import rotation_from_euler

    camera, R_nb = cameras_of(vehicle)[0], np.asarray(rotation_from_euler(PLACE[3:]))
    lens = camera.lens.scaled(size[0] / camera.lens.size[0])
    eye, R_nc = PLACE[:3] + R_nb @ camera.position, R_nb @ camera.R_bc
    return {m.id: np.asarray(project(lens, (m.corners - eye) @ R_nc)) for m in load_scene("pool").layout.markers}


def test_markers_are_found_where_they_are(picture, vehicle):
    true = projected(vehicle, picture.size)
    found = {marker["id"]: np.array(marker["corners"]) for marker in picture.markers}
    width, height = picture.size

    def large_and_whole(corners):
        side = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).min()
        return side > 18 and (corners > 8).all() and (corners < np.array([width - 9, height - 9])).all()

    must = {number for number, corners in true.items() if large_and_whole(corners)}
    assert len(must) >= 2, "the pose shows too little to test"
    assert must <= set(found)
    assert max(np.abs(found[number] - true[number]).max() for number in must) < 1.5


def test_picture_is_a_jpeg_of_its_size(picture):
    image = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert image.shape == (picture.size[1], picture.size[0], 3)
    assert picture.size[0] * 9 == pytest.approx(picture.size[1] * 16, abs=16)
    assert picture.t == 1.5


def test_without_a_camera_or_a_scene_it_says_so(vehicle):
    scenario = load_scenario("lawnmower_calm")
    with pytest.raises(ConfigError, match=r"cameras: \[\{scene: pool\}\]"):
        section_of(scenario, vehicle)
    with pytest.raises(ConfigError, match="bluerov2 has no camera"):
        section_of(scenario, load_vehicle("bluerov2"), "pool")
    assert section_of(load_scenario("free_running_surge"), vehicle).camera == "port.camera"


def run(sizes, cost_of, time_of, pictures):
    for _ in range(pictures):
        sizes.took(cost_of(sizes.width), time_of(sizes.width))
    return sizes.width


def test_pictures_shrink_until_the_machine_keeps_up_and_grow_again():
    def pixels(width):
        return (width / 320) ** 2

    sizes = Sizes(0.03, 0.09)
    assert run(sizes, lambda w: 0.025 * pixels(w), lambda w: 0.025 * pixels(w), 40 * PATIENCE) == 320
    assert run(sizes, lambda w: 0.025 * pixels(w), lambda w: 0.2 * pixels(w), 3 * WINDOW) == 192
    assert run(sizes, lambda w: 0.002, lambda w: 0.003, 40 * PATIENCE) == 640


def test_size_that_does_not_last_is_tried_ever_more_seldom():
    sizes, tried = Sizes(0.03, 0.09), []
    for _ in range(60 * PATIENCE):
        before = sizes.width
        # What pixels alone would not say: 384 is too much.
        sizes.took(0.05 if sizes.width > 320 else 0.015, 0.02)
        tried.append(sizes.width > 320 and before <= 320)
    assert 2 <= sum(tried) <= 7


def watched(poses):
    """Times of the poses that were drawn and of the pictures that were given; a source without more is over."""
    drawn, given, waits = [], [], []

    class Drawer:
        def picture(self, t, eta):
            drawn.append(t)
            return Picture(t, b"", (1, 1), [])

    left = iter(poses)
    newest = [None]

    def source():
        newest[0] = next(left, newest[0])
        return newest[0]

    def wait(seconds):
        waits.append(seconds)
        return len(waits) > len(poses)

    watch(Drawer(), source, lambda picture: given.append(picture.t), wait)  # type: ignore[arg-type]
    return drawn, given


def test_only_what_is_new_is_drawn():
    moved = PLACE + 2 * STILL
    drawn, given = watched([None, (0.0, PLACE), (0.0, PLACE), (0.1, PLACE), (0.2, moved), (0.3, moved + 0.1 * STILL)])
    assert drawn == [0.0, 0.2]
    assert given == [0.0, 0.1, 0.2, 0.3], "what stands still is shown with its new time"


def test_slow_drift_is_drawn():
    drawn, _ = watched([(0.1 * k, PLACE + 0.4 * STILL * k) for k in range(10)])
    assert len(drawn) == 4, "0, 3, 6 and 9 steps: compared with what was drawn, not with the pose before"


class Gone:
    """A source: the vehicle hangs before the wall, then the engine is gone."""

    def __init__(self, many):
        self.left = many

    def __call__(self):
        self.left -= 1
        if self.left < 0:
            raise LinkError("engine: found nothing, expected poses")
        return -float(self.left), PLACE


def newest(camera):
    until = time.monotonic() + 60.0
    while time.monotonic() < until:
        picture = camera.newest()
        if picture is not None or camera.why:
            return picture
        time.sleep(0.01)
    raise AssertionError("neither a picture nor a reason in 60 s")


@pytest.mark.system
def test_process_gives_pictures_and_says_why_there_are_no_more(vehicle):
    section = section_of(load_scenario("lawnmower_calm"), vehicle, "pool")
    with PictureProcess(Drawn(section, vehicle, Gone(5))) as camera:
        first = newest(camera)
        assert {marker["id"] for marker in first.markers} >= {1, 2}
        second = newest(camera)
        assert second.t > first.t
        while newest(camera) is not None:
            pass
        assert camera.why == "engine: found nothing, expected poses"


def test_process_that_is_killed_is_reported(vehicle):
    section = section_of(load_scenario("lawnmower_calm"), vehicle, "pool")
    with PictureProcess(Drawn(section, vehicle, Gone(5))) as camera:
        os.kill(camera.pid, signal.SIGKILL)
        assert newest(camera) is None
        assert "ended, or was killed" in camera.why
