"""Recorded video: films, folders of pictures, their times, and all that can be wrong with them."""

import numpy as np
import pytest
from tests.positioning.pictures import picture
from tests.positioning.tracks import camera, rotations, wall

from rovtwin.core.errors import ConfigError, LogError
from rovtwin.core.log import Channel, Log
from rovtwin.positioning.images.detection import Detections, Detector
from rovtwin.positioning.images.video import Video
from rovtwin.positioning.recording import Attitude, _instants, record
from rovtwin.vehicle.physics.camera import lens_from

cv2 = pytest.importorskip("cv2")
SIZE = (160, 120)


def frames(n=6, size=SIZE):
    return [np.full((size[1], size[0], 3), 20 * k, np.uint8) for k in range(n)]


def film(path, images, rate=10.0):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), rate, images[0].shape[1::-1])
    for image in images:
        writer.write(image)
    writer.release()
    return path


def folder(path, images, names):
    path.mkdir()
    for image, name in zip(images, names, strict=True):
        cv2.imwrite(str(path / name), image)
    return path


def read(video):
    pairs = list(video)
    return [t for t, _ in pairs], [image for _, image in pairs]


def test_a_film_runs_at_its_own_rate_from_its_start(tmp_path):
    times, images = read(Video(film(tmp_path / "a.mp4", frames()), SIZE, start=3.0))
    assert np.allclose(times, 3.0 + 0.1 * np.arange(6))
    assert [round(float(image.mean()) / 20) for image in images] == list(range(6))
    assert images[0].shape == (120, 160)


def test_a_table_beside_a_film_says_its_times_and_frames_out_of_order_are_left_out(tmp_path):
    path = film(tmp_path / "a.mp4", frames())
    (tmp_path / "a.csv").write_text("t\n1.0\n1.1\n1.3\n1.2\n1.25\n1.4\n")
    video = Video(path, SIZE)
    assert read(video)[0] == [1.0, 1.1, 1.3, 1.4]
    assert video.notes == [f"{path}: 2 frames out of order left out, the first at 1.2 s after 1.3 s"]


def test_a_table_that_is_shorter_than_the_film_is_not_reported_as_damage(tmp_path):
    path = film(tmp_path / "a.mp4", frames())
    (tmp_path / "a.csv").write_text("t\n1.0\n1.1\n1.2\n")
    video = Video(path, SIZE)
    assert read(video)[0] == [1.0, 1.1, 1.2]
    assert video.notes == [f"{tmp_path / 'a.csv'}: has times of 3 of 6 frames; the frames after them are left out"]
    (tmp_path / "a.csv").write_text("t\n")
    with pytest.raises(ConfigError, match=r"a\.csv: found no times in it"):
        read(video)


def test_a_folder_of_pictures_by_names_or_by_a_table(tmp_path):
    path = folder(tmp_path / "a", frames(3), ["2.5.png", "10.0.png", "9.25.png"])
    assert read(Video(path))[0] == [2.5, 9.25, 10.0]
    (path / "times.csv").write_text("file,t\n10.0.png,0.5\n9.25.png,0.75\n")
    assert read(Video(path))[0] == [0.5, 0.75]


def test_a_picture_that_cannot_be_read_is_left_out_and_reported(tmp_path):
    path = folder(tmp_path / "a", frames(3), ["1.png", "2.png", "3.png"])
    (path / "2.png").write_bytes(b"\x89PNG broken")
    video = Video(path)
    assert read(video)[0] == [1.0, 3.0]
    assert video.notes == [f"{path}: 1 of 3 pictures cannot be read, the first 2.png"]


def test_a_film_that_is_cut_gives_what_is_left_or_says_that_it_cannot_be_read(tmp_path):
    path = film(
        tmp_path / "a.avi", [np.random.default_rng(k).integers(0, 255, (120, 160, 3), np.uint8) for k in range(20)]
    )
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    video = Video(path, SIZE)
    times, _ = read(video)
    assert 0 < len(times) < 20
    (tmp_path / "b.mp4").write_bytes(b"not a film at all" * 100)
    with pytest.raises(ConfigError, match=r"b\.mp4: cannot be read as video; the file is damaged"):
        read(Video(tmp_path / "b.mp4", SIZE))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda p: p / "none.mp4", "no such video; expected MCAP, a film"),
        (lambda p: folder(p / "empty", [], []), "found no pictures in it"),
        (lambda p: folder(p / "names", frames(1), ["frame.png"]), "found no time; name pictures by their time"),
        (lambda p: film(p / "big.mp4", frames(2, (320, 240))), "found frames of 320 x 240 pixels, but the camera is"),
    ],
)
def test_what_cannot_be_used_is_named(tmp_path, make, message):
    with pytest.raises(ConfigError, match=message):
        read(Video(make(tmp_path), SIZE))


def test_a_table_with_something_else_in_it_is_named(tmp_path):
    path = film(tmp_path / "a.mp4", frames())
    (tmp_path / "a.csv").write_text("time\n1.0\n")
    with pytest.raises(ConfigError, match="line 2: found time=1.0; expected the columns t"):
        read(Video(path, SIZE))


# -- video and log joined


LENS = lens_from([500, 501], [319, 241], (640, 480), [0.1, 0.0, 0.0, 0.0, 0.0])
LAYOUT = wall([(-0.2, 0.7), (0.2, 0.8)], north=2.5)


def attitude_log(t, psi=0.05, name="sensor/attitude"):
    values = np.zeros((len(t), 4))
    values[:, 2], values[:, 3] = psi, t
    fields, units = ("phi", "theta", "psi", "t_valid"), ("rad",) * 3 + ("s",)
    return Log.from_arrays([Channel(name, fields, units, "n")], {name: (t, values)})


def marked(path, n=4):
    """Pictures of the wall from a vehicle that moves ahead, with the tone curve of a camera."""
    eye, R = camera(LENS, y=0.0), rotations(np.array([[0, 0, 0.05]]))[0]
    images = [
        picture(LAYOUT, LENS, np.array([0.02 * k, 0.01, 0.75]) + R @ eye.position, R @ eye.R_bc, k) for k in range(n)
    ]
    images = [np.round(255.0 * (image / 255.0) ** (1 / 2.2)).astype(np.uint8) for image in images]
    return folder(path, images, [f"{1 + 0.1 * k:.2f}.png" for k in range(n)]), eye


def test_a_recording_joins_video_and_attitude(tmp_path):
    path, eye = marked(tmp_path / "a")
    found = record(
        attitude_log(np.arange(0, 3, 0.01)), [Video(path, LENS.size)], [eye], Detector(), np.full(1000, 0.15)
    )
    assert np.allclose(found.frames.t, [1.0, 1.1, 1.2, 1.3])
    assert np.asarray(found.frames.sightings.valid).sum() == 8
    assert np.allclose(found.frames.attitude, [np.cos(0.025), 0, 0, np.sin(0.025)])
    assert found.notes == ()


def test_frames_without_attitude_are_left_out_and_none_at_all_is_an_error(tmp_path):
    path, eye = marked(tmp_path / "a")
    arguments = [Video(path, LENS.size)], [eye], Detector(), np.full(1000, 0.15)
    found = record(attitude_log(np.arange(1.05, 3, 0.01)), *arguments)
    assert len(found.frames) == 3 and found.notes == ("1 of 4 frames without attitude left out",)
    with pytest.raises(LogError, match="has readings from 20 to .* frames from 1 to 1.3 s. Give the time of the first"):
        record(attitude_log(np.arange(20, 21, 0.1)), *arguments)
    with pytest.raises(LogError, match="found no attitude; expected a channel sensor/attitude or autopilot/eta"):
        record(attitude_log(np.arange(3.0), name="sensor/other"), *arguments)


def test_attitude_that_is_read_less_often_than_frames_come_is_reported(tmp_path):
    path, eye = marked(tmp_path / "a")
    arguments = [Video(path, LENS.size)], [eye], Detector(), np.full(1000, 0.15)
    (note,) = record(attitude_log(np.arange(0, 3, 0.15)), *arguments).notes
    assert note.startswith("sensor/attitude is read every 0.15 s, frames come every 0.1 s: frames between two readings")


def test_frames_of_two_cameras_are_one_instant_only_where_they_were_taken_together():
    none = Detections.none()
    together, apart = [(1.0, 0, none), (1.0002, 1, none)], [(2.0, 0, none), (2.015, 1, none)]
    times, found = _instants(together + apart, 2)
    assert times.tolist() == [1.0, 2.0, 2.015] and all(len(one) == 2 for one in found)


def test_attitude_turns_the_short_way_between_readings():
    t = np.array([0.0, 0.2])
    values = np.array([[0, 0, 3.1, 0.0], [0, 0, -3.1, 0.2]])
    channel = Channel("sensor/attitude", ("phi", "theta", "psi", "t_valid"), ("rad",) * 3 + ("s",), "n")
    q, inside = Attitude.of(Log.from_arrays([channel], {channel.name: (t, values)})).at(np.array([0.1, 0.3]))
    assert np.allclose(np.abs(q[0]), [0, 0, 0, 1], atol=1e-9) and inside.tolist() == [True, False]
