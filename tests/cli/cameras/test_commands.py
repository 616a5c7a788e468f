"""`rovtwin track` and `rovtwin calibrate`, from files to files."""

import json

import numpy as np
import pytest
import typer
import yaml
from tests.positioning.calibration.test_lens import board_picture
from tests.positioning.images.test_video import LENS, attitude_log, marked
from typer.testing import CliRunner

from rovtwin.cli.cameras.calibrate import calibrate
from rovtwin.cli.cameras.track import track
from rovtwin.core.errors import ConfigError
from rovtwin.core.log import Log
from rovtwin.positioning.calibration.camera_file import as_data
from rovtwin.runs.track import TrackOptions, _layout

cv2 = pytest.importorskip("cv2")
app = typer.Typer()
app.command("track")(track)
app.command("calibrate")(calibrate)


def run(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments])


@pytest.fixture
def recorded(tmp_path):
    """A log, a folder of pictures and a camera file."""
    marked(tmp_path / "video")
    attitude_log(np.arange(0, 3, 0.01)).write(tmp_path / "log.mcap")
    (tmp_path / "lens.yaml").write_text(yaml.safe_dump(as_data("camera", LENS, "drawn")))
    return tmp_path


def arguments(folder, *more):
    video = "--video", folder / "video", "--camera", "port", "--lens", folder / "lens.yaml"
    return "track", folder / "log.mcap", "-o", folder / "track.mcap", *video, *more


@pytest.mark.slow
def test_track_writes_a_log_and_says_how_good_it_is(recorded):
    result = run(*arguments(recorded))
    assert result.exit_code == 0, result.output
    assert "4 frames from 1 to 1.3 s; 4 with a marker; 8 of 8 sightings used" in result.stdout
    log = Log.read(recorded / "track.mcap")
    assert {"track/eta", "track/std", "track/fix", "sensor/position", "sensor/attitude", "map/marker_0"} <= set(log)
    # The camera of these pictures sits in the middle, the vehicle's to port: it starts at the start all the same.
    assert np.allclose(log["track/eta"].values[0, :3], 0.0, atol=1e-6)
    assert log["track/eta"].values[-1, 0] == pytest.approx(0.06, abs=0.02)


@pytest.mark.system
def test_track_with_json_and_a_layout(recorded):
    from tests.positioning.images.test_video import LAYOUT

    (recorded / "layout.yaml").write_text(yaml.safe_dump(LAYOUT.model_dump()))
    result = run(*arguments(recorded, "--layout", recorded / "layout.yaml", "--json"))
    assert result.exit_code == 0, result.output
    data = json.loads(result.stdout)
    assert data["frames"] == 4 and [m["id"] for m in data["markers"]] == [0, 1]
    assert np.allclose(data["markers"][0]["std"], 0.0)


@pytest.mark.system
def test_without_the_layout_its_sizes_hold_all_the_same(recorded):
    """Filter and poses have one table: as if the user had measured the paper, not where it hangs."""
    from tests.positioning.images.test_video import LAYOUT

    (recorded / "layout.yaml").write_text(yaml.safe_dump(LAYOUT.model_dump()))
    more = "--layout", recorded / "layout.yaml", "--no-layout", "--size", "300mm", "--marker-scale-std", "0.01"
    more += "--acceleration", "0.05,0.05,0.01"
    result = run(*arguments(recorded, *more))
    assert "8 of 8 sightings used" in result.stdout, result.output
    assert Log.read(recorded / "track.mcap").metadata["track_scale_std"] == "0.01"


@pytest.mark.system
@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--method", "kalman"], "--method: found 'kalman', expected one of ekf, luenberger, smoother"),
        (["--camera", "starboard"], "found 1 lens files for 2 cameras"),
        (["--heading-offset", "5"], "--heading-offset: without --layout north is the compass's"),
        (["--acceleration", "0.1,0"], "--acceleration: found '0.1,0', expected one or three figures above 0"),
        (["--size", "3kg"], "--size: found the unit 'kg'"),
        (["--dictionary", "DICT_9X9"], "found 'DICT_9X9', expected one of"),
    ],
)
def test_what_cannot_be_done_is_named(recorded, more, message):
    result = run(*arguments(recorded, *more))
    assert isinstance(result.exception, ConfigError)
    assert message in str(result.exception)


def test_a_video_of_another_size_than_the_cameras_and_none_at_all_are_named(recorded):
    result = run(
        "track", recorded / "log.mcap", "-o", recorded / "t.mcap", "--video", recorded / "video", "--camera", "port"
    )
    assert "found frames of 640 x 480 pixels, but the camera is calibrated for 1920 x 1080" in str(result.exception)
    result = run("track", recorded / "log.mcap", "-o", recorded / "t.mcap")
    assert "found no video, expected port_camera.mcap, starboard_camera.mcap" in str(result.exception)


@pytest.mark.system
def test_calibrate_writes_a_camera_file_and_a_figure(tmp_path):
    poses = [([0, 0, 0], [0, 0, 0.3]), ([0.4, 0, 0], [-0.08, 0.05, 0.34]), ([-0.4, 0.1, 0.1], [0.08, -0.05, 0.34])]
    for k, (turn, shift) in enumerate(poses):
        cv2.imwrite(str(tmp_path / f"{k}.png"), board_picture(turn, np.array(shift)))
    (tmp_path / "3.png").write_bytes(b"no picture")
    images = sorted(tmp_path.glob("*.png"))
    figure, out = tmp_path / "residuals.svg", tmp_path / "camera.yaml"
    result = run("calibrate", *images, "--board", "9x6", "--square", "25mm", "-o", out, "--figure", figure)
    assert result.exit_code == 0, result.output
    assert "3 of 4 pictures" in result.stdout and "cannot be read as a picture, left out" in result.stdout
    assert yaml.safe_load(out.read_text())["resolution"] == [640, 480]
    assert figure.stat().st_size > 1000
    again = run("calibrate", *images, "--board", "9x6", "-o", out)
    assert "camera.yaml: exists already. Choose another name, or replace it with --overwrite" in str(again.exception)
    assert run("calibrate", *images, "--board", "9x6", "-o", out, "--overwrite").exit_code == 0
    bad = run("calibrate", *images, "--board", "nine", "-o", tmp_path / "other.yaml")
    assert "--board: found 'nine', expected inner corners along both sides" in str(bad.exception)


def test_a_dictionary_beside_a_layout_is_refused(tmp_path):
    """The layout says which markers it has; the option was ignored in silence."""
    (tmp_path / "layout.yaml").write_text("dictionary: DICT_4X4_50\nmarkers: []\n")
    with pytest.raises(ConfigError, match=r"--dictionary DICT_5X5_50: .*layout\.yaml says which it is"):
        _layout(tmp_path / "log.mcap", TrackOptions(dictionary="DICT_5X5_50"))
