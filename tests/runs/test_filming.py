"""A run filmed by its own camera, and its track from the pictures."""

import csv

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.core.log import Log
from rovtwin.core.log.pictures import read_pictures
from rovtwin.core.markers import read_layout
from rovtwin.core.user_files.config import parse
from rovtwin.demo.camera import film_and_identify
from rovtwin.identification.logs.readers import read_records
from rovtwin.positioning.calibration.camera_file import read_lens
from rovtwin.runs.fly import fly
from rovtwin.runs.track import TrackOptions, track_run
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.scene import load_scene
from rovtwin.vehicle import load_vehicle

pytestmark = pytest.mark.system

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


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".mcap", ".mp4"])
def test_its_track_is_where_it_was(run, ending):
    if ending == ".mp4":
        expected = TrackOptions(
            videos=[run.folder / "port_camera.mp4"], cameras=["port"], lenses=[run.folder / "port_camera.yaml"]
        )
    else:
        expected = TrackOptions(cameras=["port"])
    found, log = track_run(run.folder / "log.mcap", load_vehicle("double_blueye_thesis"), "ekf", expected)
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


@pytest.mark.slow
def test_identify_reads_the_track_and_says_what_it_saw(run, capsys):
    from rovtwin.cli.identification.identify import _tracked
    from rovtwin.cli.identification.identify_logs import share_of
    from rovtwin.cli.output import console

    pytest.importorskip("gtsam")
    vehicle = load_vehicle("double_blueye_thesis")
    ((path, is_test),) = _tracked(console(False), vehicle, "aruco", [run.folder / "log.mcap"]).items()
    assert path.name == "log_aruco.mcap"
    assert "wrote" in capsys.readouterr().out
    (record,) = read_records(path, vehicle)
    assert is_test and record.scale_std == 0.005  # the layout's own: a printer and a tape
    assert record.name == f"{run.folder.name}_aruco"  # not log_aruco, as the track of every other run
    positions = record.signals["horizontal"].value
    assert len(positions) > 15 and np.ptp(positions[:, 0]) > 0.2
    with pytest.raises(ConfigError, match="--track: found 'qr', expected aruco"):
        _tracked(console(False), vehicle, "qr", [])
    # Of a test, whose last pull is the strongest, nothing is held out unless that is asked for.
    assert share_of(console(False), None, {path: is_test}, False) == 1.0
    assert "nothing is held out" in capsys.readouterr().out
    others = ((0.7, {path: True}, False), (None, {path: True}, True), (None, {path: False}, False), (None, {}, False))
    assert [share_of(console(False), *one) for one in others] == [0.7, None, None, None]


def test_two_scenes_one_camera_twice_and_the_wall_clock_are_named(tmp_path):
    for cameras, message in (
        ([CAMERA, CAMERA | {"scene": "mclab", "camera": "starboard.camera"}], "expected one for all cameras"),
        ([CAMERA, CAMERA], "found one camera twice"),
    ):
        with pytest.raises(ConfigError, match=message):
            fly(parse(Scenario, SCENARIO | {"cameras": cameras}, "filmed"), tmp_path / message, camera=True)
    with pytest.raises(ConfigError, match="leave out --realtime"):
        fly(parse(Scenario, SCENARIO, "filmed"), tmp_path / "run", camera=True, realtime=True)


@pytest.mark.slow  # renders 160 pictures, tracks, identifies: a minute
def test_the_demonstration_finds_the_parameters_from_its_pictures(tmp_path):
    pytest.importorskip("gtsam")
    done = film_and_identify(tmp_path / "camera")
    assert done.summary["track_rms_m"] < 0.01
    truth = load_vehicle("double_blueye").to_dict()["hydrodynamics"]
    found = done.summary["parameters"]
    assert found["added_mass.surge"] == pytest.approx(truth["added_mass"][0], rel=0.05)
    for v in (0.1, 0.2, 0.3):
        of = [linear * v + quadratic * v * v for linear, quadratic in (
            (found["linear_damping.surge"], found["quadratic_damping.surge"]),
            (truth["linear_damping"][0], truth["quadratic_damping"][0]),
        )]  # fmt: skip
        assert of[0] == pytest.approx(of[1], rel=0.03)
