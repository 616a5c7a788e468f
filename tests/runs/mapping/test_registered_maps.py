"""`rovtwin map --register` and `--control` on a whole small survey; the page's spectra, clicked in a browser."""

import json
from pathlib import Path

import numpy as np
import pytest
import rasterio
import yaml
from scipy.spatial.transform import Rotation
from tests.imaging.helper import imager
from typer.testing import CliRunner

from rovtwin.cli import app
from rovtwin.core.arrays.key_frames import KeyFrames
from rovtwin.core.datum import Datum
from rovtwin.core.log import Channel, Log
from rovtwin.imaging.floor import Plane
from rovtwin.imaging.lines import LinesFile
from rovtwin.mapping.georeference import Georeference
from rovtwin.mapping.navigation import Navigation
from rovtwin.mapping.projection import project
from rovtwin.runs.recording.channels import ETA, ETA_UNITS
from rovtwin.runs.recording.scan import ScanRequest, scan_run
from rovtwin.scenario.files import dump_scenario, load_scenario

DATUM = Datum(59.0, 5.0, 40.0, "2024-05-01T08:00:00Z")
LINE, TURN, APART, COUNT = 12.0, 4.0, 0.7, 3  # [s], [s], [m]; at 0.2 m/s
STD, PHI = np.r_[[0.04] * 2, 1e-3, [2e-3] * 3], 0.9  # of the errors of place and attitude [m, rad], a second apart
pytestmark = pytest.mark.system


def course():
    """Three lines of 2.4 m to and fro, 0.7 m apart, 1.5 m over the floor: times and poses every 0.1 s."""
    t = np.arange(0.0, COUNT * LINE + (COUNT - 1) * TURN, 0.1)
    number = np.minimum((t // (LINE + TURN)).astype(int), COUNT - 1)
    into = t - number * (LINE + TURN)
    turned = np.clip((into - LINE) / TURN, 0.0, 1.0)
    turned = turned**2 * (3.0 - 2.0 * turned)
    north = 0.2 * np.minimum(into, LINE)
    north = np.where(number % 2 == 0, north, 0.2 * LINE - north)
    east = APART * (number + turned)
    yaw = np.pi * (number + turned)
    return t, np.column_stack([north, east, 3.5 + 0 * t, 0.01 * np.sin(t), 0.01 * np.cos(t), yaw])


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run with the truth, a smoothed track that errs as its key frames say, and lines over patches of materials."""
    folder, rng = tmp_path_factory.mktemp("run"), np.random.default_rng(5)
    t, eta = course()
    at = np.arange(0.0, t[-1] + 1.0)
    error = np.empty((len(at), 6))
    error[0] = STD * rng.standard_normal(6)
    for k in range(1, len(at)):
        error[k] = PHI * error[k - 1] + np.sqrt(1 - PHI**2) * STD * rng.standard_normal(6)
    e = np.column_stack([np.interp(t, at, column) for column in error.T])
    turned = Rotation.from_euler("ZYX", eta[:, :2:-1]) * Rotation.from_rotvec(-e[:, 3:])
    stated = np.column_stack([eta[:, :3] - e[:, :3], turned.as_euler("ZYX")[:, ::-1]])
    high = 5.0 - eta[:, 2]
    channels = [Channel("truth/eta", ETA, ETA_UNITS, "n"), Channel("autopilot/eta", ETA, ETA_UNITS, "n")]
    channels.append(Channel("sensor/altimeter", ("range", "t_valid"), ("m", "s"), "sensor"))
    values = {"truth/eta": (t, eta), "autopilot/eta": (t, stated)}
    values["sensor/altimeter"] = (t, np.column_stack([high, t]))
    about = {"datum": DATUM.metadata()}
    Log.from_arrays(channels, values, about).write(folder / "log.mcap")
    track = [Channel("smoothed/eta", ETA, ETA_UNITS, "n")]
    Log.from_arrays(track, {"smoothed/eta": (t, stated)}, about).write(folder / "smoothed.mcap")
    n = len(at)
    KeyFrames(
        *(at, np.zeros((n, 3)), np.tile([1.0, 0, 0, 0], (n, 1)), np.tile(PHI * np.eye(6), (n - 1, 1, 1))),
        *(np.tile(np.diag(STD**2), (n, 1, 1)), np.eye(6), (), np.zeros((n, 6, 0))),
        *(np.zeros(0), np.zeros(0), np.zeros((0, 0)), np.zeros(0)),
    ).save(folder / "smoothed_keys.nc")
    scenario = load_scenario("lawnmower_calm", ["world.floor=5", "sensors={altimeter: true}"])
    (folder / "scenario.yaml").write_text(dump_scenario(scenario))
    cover = [
        {"material": name, "share": 0.25, "length": 0.25, "seed": k} for k, name in enumerate(("kelp", "maerl", "mud"))
    ]
    scene = {
        "name": "patches",
        "water": {"constituents": {"cdom_440": 0.12, "scattering_550": 0.17}},
        "bottom": {"depth": 5.0, "surface": {"material": "sand"}, "cover": cover},
        "light": {"surface": 0.0},
    }
    (folder / "scene.yaml").write_text(yaml.safe_dump(scene))
    wide = imager(pixels=120, port=None, lens={"field_of_view_deg": 60.0})
    scan_run(folder, ScanRequest(wide, str(folder / "scene.yaml"), navigation="truth"), folder / "lines.h5")
    return folder


def mapped(run, out, *more):
    words = ["map", run, "-o", out, "--floor", "truth", "--resolution", "0.02", "--calibrated", *more]
    done = CliRunner().invoke(app, [*[str(word) for word in words], "--json"])
    assert done.exit_code == 0, (done.output, done.exception)
    return json.loads((out / "map.json").read_text()), json.loads((out / "ties.geojson").read_text())


def errors_of(out, folder):
    """Of the poses that a mosaic was made of, on its lines: east and north on the map [m]; and of those before."""
    t, eta = course()
    crs = rasterio.crs.CRS.from_user_input("EPSG:32632")
    before = Log.read(folder / "smoothed.mcap")["smoothed/eta"].values[:, :3]
    rows = [row.split(",") for row in (out / "navigation.csv").read_text().splitlines()]
    after = np.array([[float(x) for x in row[2:4]] for row in rows])
    on_lines = t % (LINE + TURN) < LINE
    truth, stated = (project(DATUM, crs, places)[on_lines] for places in (eta[:, :3], before))
    return after[on_lines] - truth, stated - truth


def rms(errors):
    return float(np.sqrt(np.mean(np.sum(np.square(errors), axis=1))))


def test_overlaps_shrink_the_errors_within_a_mosaic_and_ties_are_written(run, tmp_path):
    about, ties = mapped(run, tmp_path / "m", "--register")
    figures = about["figures"]["registration"]
    after, before = errors_of(tmp_path / "m", run)
    assert rms(after - after.mean(0)) < 0.5 * rms(before - before.mean(0))
    assert figures["ties_used"] >= 8 and figures["rms_after_m"] < 0.4 * figures["rms_before_m"]
    points = [one["properties"] for one in ties["features"] if one["geometry"]["type"] == "Point"]
    lines = [one for one in ties["features"] if one["geometry"]["type"] == "LineString"]
    assert len(points) == len(lines) == figures["ties_used"] + figures["ties_dropped"]
    kept = [one for one in points if one["kept"]]
    assert len(kept) == figures["ties_used"] and all(one["test"] <= one["test_limit"] for one in kept)
    assert np.sqrt(np.mean([one["before_m"] ** 2 / 2 for one in kept])) == pytest.approx(
        figures["rms_before_m"], rel=1e-3
    )
    assert np.sqrt(np.mean([one["after_m"] ** 2 / 2 for one in kept])) == pytest.approx(
        figures["rms_after_m"], rel=1e-2
    )
    first, ends = points[0], lines[0]["geometry"]["coordinates"]
    assert first["kind"] == "tie" and len(first["lines"]) == len(first["pixels"]) == 2 and first["lines"][0] < 260
    place = [DATUM.position(latitude, longitude, 35.0)[:2] for longitude, latitude in ends]
    assert np.linalg.norm(place[1] - place[0]) == pytest.approx(first["before_m"], abs=1e-4)
    page = (tmp_path / "m" / "report.html").read_text()
    assert "Residuals of the overlaps" in page and "ties.geojson" in page


def points_of(run, path, count=10, std=0.005):
    """Control points: where lines truly saw the floor, with noise."""
    rng, rows = np.random.default_rng(2), ["name,line,pixel,north,east,sd"]
    with LinesFile(run / "lines.h5") as lines:
        truth = lines.truth
        assert truth is not None
        pose = Navigation(truth.t, truth.position, truth.attitude)
        where = Georeference(lines.imager, truth.mount, pose, Plane(5.0))
        t, eta = course()
        chosen = [
            k for k in np.linspace(20, lines.shape[0] - 20, 60).astype(int) if truth.t[k] % (LINE + TURN) < LINE - 0.5
        ]
        for k in np.array(chosen)[np.linspace(0, len(chosen) - 1, count).astype(int)]:
            pixel = int(rng.integers(20, 100))
            place = where.locate(truth.t[k : k + 1], slice(pixel, pixel + 1)).point[
                0, 0, :2
            ] + std * rng.standard_normal(2)
            rows.append(f"P{k},{k},{pixel},{place[0]:.4f},{place[1]:.4f},{std}")
    path.write_text("\n".join(rows) + "\n")
    return path


def test_control_points_shrink_the_errors_of_the_whole_mosaic(run, tmp_path):
    control = points_of(run, tmp_path / "c.csv")
    about, ties = mapped(run, tmp_path / "m", "--register", "--control", control)
    after, before = errors_of(tmp_path / "m", run)
    with rasterio.open(tmp_path / "m" / "layers.tif") as file:
        stated = float(np.nanmedian(file.read(file.descriptions.index("sigma") + 1)))
    assert rms(after) < 0.5 * rms(before) and rms(after) < 1.5 * stated
    known = [one["properties"] for one in ties["features"] if one["properties"]["kind"] == "control"]
    assert len(known) == 20 and {len(one["lines"]) for one in known} == {1}
    assert all(one["kept"] and one["after_m"] < 0.02 for one in known)
    assert about["settings"]["control"] == str(control) and len(about["sha256"]["c.csv"]) == 64
    alone, _ = mapped(run, tmp_path / "alone", "--control", control)
    assert alone["figures"]["registration"]["ties_used"] == 10
    assert rms(after) < rms(errors_of(tmp_path / "alone", run)[0]) < 0.7 * rms(before)


def test_a_click_on_the_page_shows_the_spectrum_of_that_place(run, tmp_path):
    api = pytest.importorskip("playwright.sync_api")
    if not Path("/usr/bin/chromium").exists():
        pytest.skip("no Chromium")
    mapped(run, tmp_path / "m", "--register")
    size = (tmp_path / "m" / "report.html").stat().st_size
    with api.sync_playwright() as tool:
        browser = tool.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        page, wrong = browser.new_page(viewport={"width": 1000, "height": 900}), []
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("request", lambda asked: asked.url.startswith(("file:", "data:")) or wrong.append(asked.url))
        page.goto((tmp_path / "m" / "report.html").as_uri())
        canvas = page.locator("#spectra-map")
        box = canvas.bounding_box()
        assert box is not None
        canvas.click(position={"x": 0.5 * box["width"], "y": 0.5 * box["height"]})
        words, drawn = page.inner_text("#spectra-words"), page.locator("#spectra-chart .value").get_attribute("d")
        assert "north 1." in words and "m of the datum" in words and drawn and drawn.count(",") >= 3
        assert page.locator("#spectra-chart .truth").get_attribute("d")
        canvas.press("ArrowRight")
        assert page.inner_text("#spectra-words") != words
        page.locator("#spectra-places button").first.click()
        assert page.locator("#spectra-places button").first.get_attribute("aria-pressed") == "true"
        browser.close()
    assert not wrong and size < 6e6
