"""The share that the console paints of a survey is the one that `rovtwin map` finds in its mosaic."""

import json

import numpy as np
import pytest
import yaml
from tests.imaging.helper import imager

from rovtwin.console.replays.replay import Recording
from rovtwin.console.swath.eyes import eyes_of, sounders_of
from rovtwin.console.swath.gaps import Seen, share_seen
from rovtwin.console.swath.painter import Depths, Painter
from rovtwin.core.log import Channel, Log
from rovtwin.runs.fly import fly
from rovtwin.runs.mapping.make import map_run
from rovtwin.runs.mapping.request import MapRequest
from rovtwin.runs.recording.channels import ETA, ETA_UNITS
from rovtwin.runs.recording.scan import ScanRequest, scan_run
from rovtwin.scenario.files import dump_scenario, load_scenario

pytestmark = pytest.mark.system  # scans and maps

LINES, LENGTH, APART, SPEED, TURN = 3, 5.0, 1.25, 0.4, 6.0
AREA = ((0.4, 0.0), (4.6, 0.0), (4.6, 2.6), (0.4, 2.6))


def survey():
    """Times and poses: lines too far apart, which wander, half turns between them, a vehicle that rolls."""
    rng, along = np.random.default_rng(3), LENGTH / SPEED
    t = np.arange(0.0, LINES * along + (LINES - 1) * TURN, 0.1)
    line, within = np.divmod(t, along + TURN)
    ahead = np.clip(within / along, 0.0, 1.0)
    turned = np.clip((within - along) / TURN, 0.0, 1.0)
    north = np.where(line % 2 == 0, ahead, 1.0 - ahead) * LENGTH
    east = 0.6 + APART * (line + turned) + 0.06 * np.sin(0.9 * t)
    heading = np.pi * (line % 2 + np.where(line % 2 == 0, turned, -turned))
    wander = np.cumsum(rng.normal(0.0, 0.002, (len(t), 2)), axis=0)
    tilt = np.column_stack([0.05 * np.sin(1.3 * t), 0.03 * np.cos(0.8 * t)])
    return t, np.column_stack([north + wander[:, 0], east + wander[:, 1], 3.4 + 0.04 * np.sin(0.5 * t), tilt, heading])


def flown(folder):
    """A run of it over a level floor, with an altimeter that is 2 cm noisy."""
    t, eta = survey()
    names = ("truth/eta", "autopilot/eta")
    channels = [Channel(name, ETA, ETA_UNITS, "n") for name in names]
    channels.append(Channel("sensor/altimeter", ("range", "t_valid"), ("m", "s"), "sensor"))
    high = (5.0 - eta[:, 2]) / (np.cos(eta[:, 3]) * np.cos(eta[:, 4]))
    high += np.random.default_rng(4).normal(0.0, 0.02, len(t))
    values = {name: (t, eta) for name in names} | {"sensor/altimeter": (t, np.column_stack([high, t]))}
    scenario = load_scenario("lawnmower_calm", ["world.floor=5", "sensors={altimeter: true}"])
    Log.from_arrays(channels, values, {"scenario": dump_scenario(scenario)}).write(folder / "log.mcap")
    (folder / "scenario.yaml").write_text(dump_scenario(scenario))
    return scenario


def compared(folder, scenario, area, depth, resolution):
    """Share seen by the console's sums and by the map; m2 of gaps of both."""
    scene = {
        "name": "flat",
        "water": {"constituents": {"cdom_440": 0.12, "scattering_550": 0.17}},
        "bottom": {"depth": depth, "surface": {"material": "mud"}},
        "light": {"surface": 0.0},
    }
    (folder / "scene.yaml").write_text(yaml.safe_dump(scene))
    (folder / "area.yaml").write_text(yaml.safe_dump({"outline": [list(corner) for corner in area]}))
    lines = folder / "lines.h5"
    scan_run(folder, ScanRequest(imager(pixels=120), str(folder / "scene.yaml"), navigation="truth"), lines)
    request = MapRequest(lines, "estimate", resolution=resolution, area=folder / "area.yaml", formats=("envi",))
    map_run(folder, request, folder / "map")
    missing = json.loads((folder / "map" / "gaps.geojson").read_text())["area_m2"]

    recording, depths = Recording.open(folder), Depths(sounders_of(scenario), depth)
    painter = Painter(eyes_of(scenario)[0][0])
    for t in recording.tape["eta"].t.tolist():
        painter.take(depths.instant({"t": t, "eta": recording.at("eta", t), "sensors": recording.sensors(t)}))
    painter.finish()
    window = painter.cells.window(np.min(area, axis=0), np.max(area, axis=0))
    found = share_seen(area, Seen.of(*window))
    return found["share"], 1.0 - missing / found["area_m2"], found["gaps_m2"], missing


# A cell of the map counts as seen where any pixel falls into it: up to half a cell more at every edge.


def test_share_and_gaps_are_those_of_the_map(tmp_path):
    painted, mapped, gaps, missing = compared(tmp_path, flown(tmp_path), AREA, 5.0, 0.03)
    area = 4.2 * 2.6
    assert 0.05 < missing / area < 0.4
    assert -0.005 < mapped - painted < 0.02
    assert gaps == pytest.approx(missing, abs=0.02 * area)


@pytest.mark.slow
def test_share_and_gaps_of_a_flight_of_the_twin_are_those_of_the_map(tmp_path):
    """Three lines too far apart, by a vehicle that steers, estimates and measures for itself; cells as by default."""
    places = ((0.0, 1.2), (7.3, 1.2), (8.0, 2.6), (0.7, 2.6), (0.0, 4.0), (7.3, 4.0))
    points = ", ".join(f"{{position: [{x}, {y}, 3.0], speed: 0.25}}" for x, y in places)
    world = ["world.floor=4.5", "sensors={altimeter: true, dvl: true}", "autopilot=model_based", "duration=260"]
    scenario = load_scenario("lawnmower_calm", [*world, f"mission.waypoints=[{points}]"])
    assert fly(scenario, tmp_path / "run").completed
    area = ((1.0, 0.7), (6.5, 0.7), (6.5, 4.5), (1.0, 4.5))
    painted, mapped, gaps, missing = compared(tmp_path / "run", scenario, area, 4.5, 0.01)
    assert 0.05 < 1.0 - painted < 0.4
    assert -0.005 < mapped - painted < 0.02
    assert gaps == pytest.approx(missing, abs=0.02 * 5.5 * 3.8)
