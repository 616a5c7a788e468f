"""A run filmed by its own camera, and its track from the pictures."""

import csv

import numpy as np
import pytest

from rovtwin.core.config import parse
from rovtwin.core.errors import ConfigError
from rovtwin.core.log import Log
from rovtwin.core.log.pictures import read_pictures
from rovtwin.core.markers import read_layout
from rovtwin.positioning.camera_file import read_lens
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.flight import fly
from rovtwin.scenario.schema import Scenario
from rovtwin.scenario.tracking import Wanted, track_run
from rovtwin.simulation.scene import load_scene
from rovtwin.vehicle import load_vehicle

pytest.importorskip("cv2")
CAMERA = {"scene": "pool", "camera": "port.camera", "rate_hz": 4, "resolution_scale": 0.4, "renderer": "raycast"}
SCENARIO = {
    "name": "filmed",
    "vehicle": "double_blueye_thesis",
    "duration": 7,
    "start": {"position": [0, 0.3, 1.0]},
    "test": {
        "name": "short",
        "manoeuvres": [{"manoeuvre": "steps", "axis": "surge", "levels": [0.6], "duration": 4, "between": 2}],
    },
    "cameras": [CAMERA | {"dropped": 0.1}],
}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("filmed") / "run"
    return fly(parse(Scenario, SCENARIO, "filmed"), folder, camera=True, film=True)


def test_a_run_leaves_pictures_lens_and_layout(run):
    taken = np.array([t for t, _ in read_pictures(run.folder / "port_camera.mcap")])
    assert 15 < len(taken) < 24  # a tenth is lost
    np.testing.assert_allclose(taken * 4, np.round(taken * 4))  # 4 Hz, on time
    assert read_lens(run.folder / "port_camera.yaml").size == (768, 432)
    assert read_layout(run.folder / "layout.yaml") == load_scene("pool").layout
    with open(run.folder / "port_camera.csv", newline="") as table:
        np.testing.assert_allclose([float(row["t"]) for row in csv.DictReader(table)], taken)


@pytest.mark.parametrize("ending", [".mcap", ".mp4"])
def test_its_track_is_where_it_was(run, ending):
    if ending == ".mp4":
        wanted = Wanted(
            videos=[run.folder / "port_camera.mp4"], cameras=["port"], lenses=[run.folder / "port_camera.yaml"]
        )
    else:
        wanted = Wanted(cameras=["port"])
    found, log = track_run(run.folder / "log.mcap", load_vehicle("double_blueye_thesis"), "ekf", wanted)
    truth = run.log["truth/eta"]
    at = [np.interp(found.t, truth.t, truth[axis]) for axis in "xyz"]
    # Markers of 0.15 and 0.3 m from 6 m away, 768 pixels wide: film costs little over pictures.
    assert np.sqrt(np.mean((found.position[:, :2] - np.stack(at[:2], axis=1)) ** 2)) < 0.02
    assert "sensor/position" in log and "autopilot/command" in log


def test_without_cameras_it_says_how_to_have_them(tmp_path):
    with pytest.raises(ConfigError, match=r"cameras=\[\{scene: pool\}\]"):
        fly(load_scenario("square"), tmp_path / "run", camera=True)


def test_a_run_without_pictures_is_named(tmp_path, run):
    Log.read(run.folder / "log.mcap").write(tmp_path / "log.mcap")
    with pytest.raises(ConfigError, match="found no video, expected port_camera.mcap"):
        track_run(tmp_path / "log.mcap", load_vehicle("double_blueye_thesis"))
