"""When pictures are taken and delivered, which camera, and the commands that draw."""

from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from rovtwin.cli.cameras.markers import markers
from rovtwin.cli.cameras.render import render
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import parse
from rovtwin.simulation.camera.sensor import CameraSection, camera_named, camera_renderer, frames
from rovtwin.simulation.scene import load_scene
from rovtwin.vehicle import load_vehicle, vehicle_from_dict


def section(**changed):
    return CameraSection(scene="pool", **changed)


def test_pictures_come_at_their_rate_and_late_by_the_latency():
    got = frames(section(rate_hz=12.5, latency=0.08), 10.0)
    assert len(got.taken) == 125
    assert np.allclose(got.taken, (np.arange(125) + 1) / 12.5)
    assert np.allclose(got.delivered - got.taken, 0.08)


def test_a_share_is_lost_the_same_for_the_same_seed_and_a_longer_run_begins_alike():
    lossy = section(rate_hz=20.0, dropped=0.2, jitter=0.01)
    one, other, longer = frames(lossy, 100.0, 1), frames(lossy, 100.0, 2), frames(lossy, 150.0, 1)
    assert len(one.taken) / 2000 == pytest.approx(0.8, abs=0.03)
    assert not np.array_equal(one.number[:50], other.number[:50])
    assert np.array_equal(one.delivered, longer.delivered[: len(one.delivered)])
    assert np.allclose(one.taken, (one.number + 1) / 20.0)


def test_two_cameras_lose_pictures_of_their_own():
    port, starboard = (
        frames(section(rate_hz=20.0, dropped=0.3, jitter=0.01, camera=f"{side}.camera"), 100.0, 1)
        for side in ("port", "starboard")
    )
    both = len(set(port.number) & set(starboard.number)) / 2000
    assert both == pytest.approx(0.7 * 0.7, abs=0.04)


def test_latency_varies_as_much_as_asked_and_pictures_stay_in_order():
    late = frames(section(rate_hz=5.0, latency=0.1, jitter=0.02), 1000.0)
    assert (late.delivered - late.taken).std() == pytest.approx(0.02, rel=0.05)
    quick = frames(section(rate_hz=100.0, latency=0.0, jitter=0.05), 20.0)
    assert (np.diff(quick.delivered) >= 0).all() and (quick.delivered >= quick.taken).all()


def test_no_picture_in_a_run_that_is_too_short():
    assert len(frames(section(rate_hz=2.0), 0.4).taken) == 0


@pytest.mark.parametrize(
    ("key", "value"), [("rate_hz", 0), ("dropped", 1.5), ("latency", -0.1), ("renderer", "vulkan")]
)
def test_a_camera_section_says_what_it_cannot_take(key, value):
    with pytest.raises(ConfigError, match=key):
        parse(CameraSection, {"scene": "pool", key: value}, "run.yaml")


def test_cameras_are_found_by_name_and_scaled():
    vehicle = load_vehicle("double_blueye")
    assert camera_named(vehicle).name == "port.camera"
    assert camera_named(vehicle, "starboard.camera", 0.25).lens.size == (480, 270)
    with pytest.raises(ConfigError, match=r"no camera 'port\.camra'\. Did you mean 'port\.camera'"):
        camera_named(vehicle, "port.camra")
    with pytest.raises(ConfigError, match="has no camera"):
        camera_named(vehicle_from_dict({"name": "v", "mass": 1.0, "shape": {"sphere": 0.1}}))


@pytest.mark.system
def test_a_section_makes_its_renderer():
    asked = section(camera="starboard.camera", resolution_scale=0.1, exposure=0.02, noise=1.0, renderer="raycast")
    made = camera_renderer(asked, load_scene("pool"), load_vehicle("double_blueye"))
    assert (made.kind, made.exposure, made.noise, made.camera.name) == ("raycast", 0.02, 1.0, "starboard.camera")
    assert made.image([0.0, 0.0, 1.0], np.eye(3)).shape == (108, 192, 3)


def run(command, *words):
    app = typer.Typer()
    app.command()(command)
    return CliRunner().invoke(app, list(words))


@pytest.mark.parametrize("view", ["camera", "third-person"])
def test_render_writes_a_picture(tmp_path, view):
    out = tmp_path / "seen.png"
    if view == "third-person":
        pytest.importorskip("moderngl")
    done = run(render, "pool", "--at", "1,0,1,10", "--scale", "0.1", "--view", view, "-o", str(out), "--json")
    if isinstance(done.exception, ConfigError) and "OpenGL" in str(done.exception):
        pytest.skip("no OpenGL over EGL here")
    assert done.exit_code == 0, done.exception
    from matplotlib.image import imread

    picture = imread(out)
    assert picture.shape[:2] == ((108, 192) if view == "camera" else (72, 128))
    assert picture[..., :3].std() > 0.03  # something is to be seen


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["pool", "--at", "1,2"], "expected x,y,z,heading"),
        (["pool", "--at", "1,2,nan,0"], "expected finite numbers"),
        (["pool", "--view", "above"], "expected camera or third-person"),
        (["pol"], "Did you mean 'pool'"),
        (["pool", "--scale", "0.05", "-o", "x.gif"], "ends in .png or .jpg"),
    ],
)
def test_render_says_what_it_cannot_take(words, message):
    done = run(render, *words)
    assert isinstance(done.exception, ConfigError) and message in str(done.exception)


def test_markers_writes_its_pages(tmp_path):
    out = tmp_path / "markers.pdf"
    done = run(markers, "--ids", "0-11", "--size", "150mm", "-o", str(out))
    assert done.exit_code == 0, done.exception
    assert "12 pages of a4" in done.output and Path(out).read_bytes().startswith(b"%PDF")
    again = run(markers, "--ids", "0", "-o", str(out))
    assert "exists already. Choose another name, or replace it with --overwrite" in str(again.exception)
    assert run(markers, "--ids", "0", "-o", str(out), "--overwrite").exit_code == 0
