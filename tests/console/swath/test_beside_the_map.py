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
    scene = {
        "name": "flat",
        "water": {"constituents": {"cdom_440": 0.12, "scattering_550": 0.17}},
        "bottom": {"depth": 5.0, "surface": {"material": "mud"}},
        "light": {"surface": 0.0},
    }
    (folder / "scene.yaml").write_text(yaml.safe_dump(scene))
    (folder / "area.yaml").write_text(yaml.safe_dump({"outline": [list(corner) for corner in AREA]}))
    return scenario


def test_share_and_gaps_are_those_of_the_map(tmp_path):
    scenario = flown(tmp_path)
    scan_run(
        tmp_path,
        ScanRequest(imager(pixels=120), str(tmp_path / "scene.yaml"), navigation="truth"),
        tmp_path / "lines.h5",
    )
    request = MapRequest(
        tmp_path / "lines.h5", "estimate", resolution=0.03, area=tmp_path / "area.yaml", formats=("envi",)
    )
    map_run(tmp_path, request, tmp_path / "map")
    missing = json.loads((tmp_path / "map" / "gaps.geojson").read_text())["area_m2"]

    recording, depths = Recording.open(tmp_path), Depths(sounders_of(scenario), 5.0)
    painter = Painter(eyes_of(scenario)[0][0])
    for t in recording.tape["eta"].t.tolist():
        painter.take(depths.instant({"t": t, "eta": recording.at("eta", t), "sensors": recording.sensors(t)}))
    painter.finish()
    window = painter.cells.window(np.min(AREA, axis=0), np.max(AREA, axis=0))
    found = share_seen(AREA, Seen.of(*window, painter.cells.cell))
    area = 4.2 * 2.6
    # A cell of the map counts as seen where any pixel falls into it: up to half a cell, 15 mm, more at every edge.
    assert 0.05 < missing / area < 0.4
    assert -0.005 < (1.0 - missing / area) - found["share"] < 0.02
    assert found["gaps_m2"] == pytest.approx(missing, abs=0.02 * area)
