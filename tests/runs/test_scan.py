"""Lines of a run already flown: from its log to a file, broken off and gone on with, and what is wrong with it."""

import json
from dataclasses import replace

import numpy as np
import pytest
import typer
import yaml
from tests.imaging.helper import data, imager
from typer.testing import CliRunner

from rovtwin.cli.cameras.scan import scan
from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError, LogError
from rovtwin.core.log import Channel, Log
from rovtwin.imaging.lines import LinesFile
from rovtwin.runs.recording.channels import ETA, ETA_UNITS
from rovtwin.runs.recording.scan import ScanRequest, scan_run
from rovtwin.scenario.files import dump_scenario, load_scenario

DATUM = Datum(59.0, 5.0, 40.0, "2024-05-01T08:00:00Z")
REQUEST = ScanRequest(imager(), "shoal", navigation="truth")
LINES = 78  # of 3.9 s at 20 Hz, exposures whole
pytestmark = pytest.mark.system  # a dozen scans
app = typer.Typer()
app.command("scan")(scan)
app.command("other")(lambda: None)


def recorded(folder, channels=("truth/eta", "autopilot/eta"), keep=slice(None)):
    """A run of 3.9 s at 0.2 m/s over a slope, as if it had been flown."""
    t = np.arange(0.0, 4.0, 0.1)
    eta = np.column_stack([0.2 * t, 1.0 + 0 * t, 3.2 + 0 * t, 0.02 * np.sin(t), 0 * t, 0.1 + 0 * t])
    shift = {"truth/eta": 0.0, "autopilot/eta": 0.05}
    log = Log.from_arrays(
        [Channel(name, ETA, ETA_UNITS, "n") for name in channels],
        {name: (t[keep], (eta + [shift[name], 0, 0, 0, 0, 0])[keep]) for name in channels},
        {"datum": DATUM.metadata()},
    )
    log.write(folder / "log.mcap")
    scenario = load_scenario("lawnmower_calm", ["world.floor=4.6", "world.relief={slope: [0.1, 0.0]}"])
    (folder / "scenario.yaml").write_text(dump_scenario(scenario))
    return folder


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("run"))


def cube(path):
    with LinesFile(path) as found:
        return found.read(0, found.shape[0])


@pytest.fixture(scope="module")
def made(run):
    return scan_run(run, REQUEST, run / "made.h5")


def test_a_file_has_lines_where_the_vehicle_truly_was_over_the_runs_own_floor(made):
    assert made.lines == LINES and made.resumed == 0 and made.unseen == 0
    with LinesFile(made.path) as found:
        truth = found.truth
        assert truth is not None and found.shape == (LINES, 12, 5) and found.datum == DATUM
        assert np.allclose(truth.t, 0.0125 + 0.05 * np.arange(LINES)) and np.abs(found.t - truth.t).max() < 2e-3
        assert np.allclose(truth.position[:, 0], 0.2 * truth.t, atol=1e-6)
        # The middle pixel looks down: the floor is 0.1 deeper per metre north.
        assert np.abs(truth.floor - (4.6 + 0.1 * truth.position[:, 0])).max() < 0.02
        assert found.mount and found.mount.name == "uhi.camera" and "shoal" in truth.scene
        t, place, _ = found.navigation() or pytest.fail("no navigation")
        assert len(t) == 40 and np.allclose(place[0], DATUM.ecef([0.0, 1.0, 3.2]), atol=1e-6)


def test_what_is_broken_off_goes_on_to_the_same_file(run, made, tmp_path):
    out = tmp_path / "lines.h5"

    def stop(done, count):
        if done > 40:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        scan_run(run, REQUEST, out, progress=stop)
    kept = tmp_path / ".lines.h5.lines"
    assert not out.exists() and kept.stat().st_size == 48 * 12 * 5 * 2
    kept.write_bytes(kept.read_bytes()[:-7])  # a kill in the middle of a line
    seen = []
    again = scan_run(run, REQUEST, out, progress=lambda done, count: seen.append(done))
    assert again.resumed == 32 and seen == [48, 64, LINES]
    assert (cube(out) == cube(made.path)).all() and [p.name for p in tmp_path.iterdir()] == ["lines.h5"]


def test_what_was_made_of_something_else_is_thrown_away(run, made, tmp_path):
    out = tmp_path / "lines.h5"

    def stop(done, count):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        scan_run(run, REQUEST, out, progress=stop)
    other = scan_run(run, replace(REQUEST, seed=77), out)
    assert other.resumed == 0 and (cube(out) != cube(made.path)).any()


def test_where_it_truly_sits_is_the_stated_place_and_its_error(run, made, tmp_path):
    turned = replace(REQUEST, misalignment=(0.0, 0.0, 0.1), displacement=(0.2, 0.0, 0.0))
    with LinesFile(scan_run(run, turned, tmp_path / "l.h5").path) as found, LinesFile(made.path) as straight:
        assert found.mount and straight.mount and found.truth
        assert (found.mount.rotation == straight.mount.rotation).all()
        assert np.allclose(found.truth.mount.position, found.mount.position + [0.2, 0.0, 0.0])
        pixels = found.truth.mount.rotation @ [0.0, 1.0, 0.0]  # turned to starboard about down
        assert np.allclose(pixels, [-np.sin(0.1), np.cos(0.1), 0.0])
    assert (cube(tmp_path / "l.h5") != cube(made.path)).any()


def test_lines_of_a_part_of_the_run_are_those_within(run, tmp_path):
    part = scan_run(run, replace(REQUEST, begin=1.0, end=2.0), tmp_path / "l.h5")
    with LinesFile(part.path) as found:
        assert found.truth and found.truth.t[0] == pytest.approx(1.0125) and found.truth.t[-1] <= 1.9875 + 1e-9
    with pytest.raises(ConfigError, match="no time for two lines"):
        scan_run(run, replace(REQUEST, begin=3.9), tmp_path / "none.h5")


def test_what_is_missing_is_named(run, made, tmp_path):
    with pytest.raises(ConfigError, match="names no scene; say --scene, one of .*shoal"):
        scan_run(run, replace(REQUEST, scene=None), tmp_path / "l.h5")
    with pytest.raises(ConfigError, match="rovtwin smooth"):
        scan_run(run, replace(REQUEST, navigation="smoothed"), tmp_path / "l.h5")
    with pytest.raises(LogError, match="exists already"):
        scan_run(run, REQUEST, made.path)
    for name in ("real", "gap"):
        (tmp_path / name).mkdir()
    with pytest.raises(LogError, match="no truth/eta"):
        scan_run(recorded(tmp_path / "real", ("autopilot/eta",)), REQUEST, tmp_path / "l.h5")
    with pytest.raises(LogError, match="no pose from"):
        scan_run(recorded(tmp_path / "gap", keep=np.r_[0:10, 20:40]), REQUEST, tmp_path / "l.h5")
    (tmp_path / "gap" / "scenario.yaml").unlink()
    with pytest.raises(ConfigError, match="scenario beside a log"):
        scan_run(tmp_path / "gap", REQUEST, tmp_path / "l.h5")


def test_a_disk_without_room_is_named_before_the_work(run, tmp_path, monkeypatch):
    class Little:
        free = 10_000

    monkeypatch.setattr("rovtwin.runs.recording.scan.shutil.disk_usage", lambda path: Little)
    with pytest.raises(ConfigError, match="the disk has 0.0 GB free"):
        scan_run(run, REQUEST, tmp_path / "l.h5")
    assert not list(tmp_path.iterdir())


def test_the_command_writes_a_file_and_says_what_is_in_it(run, tmp_path):
    (tmp_path / "small.yaml").write_text(yaml.safe_dump(data()))
    words = ["scan", run, "--imager", tmp_path / "small.yaml", "--scene", "shoal", "-o", tmp_path / "l.h5"]
    words += ["--from", 1, "--to", 2, "--misalignment", "1,0,-1", "--json"]
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert found["lines"] == 20 and found["out"] == str(tmp_path / "l.h5") and found["unseen"] == 0
    for option, value, message in (
        ("--navigation", "gps", "expected estimate, truth, smoothed"),
        ("--misalignment", "1,2", "expected three numbers"),
        ("--displacement", "0,0,99", "between -10 and 10"),
    ):
        bad = CliRunner().invoke(app, [*[str(word) for word in words], "--overwrite", option, value])
        assert isinstance(bad.exception, ConfigError) and message in str(bad.exception)
