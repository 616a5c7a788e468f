"""Where lines lie and when they were taken: the run's own origin and clock, and a floor from a file of heights."""

from dataclasses import replace

import netCDF4
import numpy as np
import pytest
import trimesh
from tests.imaging.helper import head
from tests.mapping.test_floors import DATUM as DEM_DATUM
from tests.mapping.test_floors import dem, depth_at

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError, LogError
from rovtwin.core.log import Channel, Log
from rovtwin.imaging.lines_writer import write_lines
from rovtwin.runs.mapping.request import MapRequest
from rovtwin.runs.mapping.sources import open_inputs
from rovtwin.runs.recording.channels import ETA, ETA_UNITS
from rovtwin.scenario.files import dump_scenario, load_scenario

CUBE = np.full((7, 12, 5), 200, np.uint16)
EARLIER = Datum(59.0, 5.0, 40.0, "2021-06-01T09:59:50Z")  # starts 10 s before the datum of `head`


def file_of(folder, datum=True, place=None):
    path = write_lines(folder / "lines.h5", head() if place is None else replace(head(), datum=place), [CUBE])
    if not datum:
        with netCDF4.Dataset(path, "a") as file:
            file["rovtwin"].renameVariable("datum", "elsewhere")
    return path


def run_of(folder, datum):
    t = np.arange(0.0, 20.0, 0.1)
    metadata = {} if datum is None else {"datum": datum.metadata()}
    eta = np.column_stack([0.2 * t, *[0 * t] * 5])
    Log.from_arrays([Channel("autopilot/eta", ETA, ETA_UNITS, "n")], {"autopilot/eta": (t, eta)}, metadata).write(
        folder / "log.mcap", overwrite=True
    )
    (folder / "scenario.yaml").write_text(dump_scenario(load_scenario("lawnmower_calm", ["world.floor=5"])))
    return folder


@pytest.mark.parametrize("given", [None, Datum(59.0, 5.0, 40.0)], ids=["no --datum", "--datum"])
def test_lines_without_a_datum_are_put_on_the_clock_and_the_origin_of_the_run(tmp_path, given):
    path = file_of(tmp_path, datum=False)
    with open_inputs(run_of(tmp_path, EARLIER), MapRequest(path, datum=given)).lines as lines:
        assert np.abs(lines.t - (head().t + 10.0)).max() < 1e-6
        assert lines.datum == EARLIER


def test_without_a_run_the_clock_counts_from_the_first_line(tmp_path):
    path = file_of(tmp_path, datum=False)
    with open_inputs(None, MapRequest(path, datum=Datum(59.0, 5.0))).lines as lines:
        assert 0.0 <= lines.t[0] < 1e-3 and np.abs(np.diff(lines.t) - 0.05).max() < 1e-6
        assert lines.datum is not None and lines.datum.utc_start.startswith("2021-06-01T10:00:01")


def test_two_origins_or_two_starts_are_refused(tmp_path):
    path, run = file_of(tmp_path), run_of(tmp_path, EARLIER)
    with pytest.raises(ConfigError, match="Are the lines of another run"):
        open_inputs(run, MapRequest(path))
    late = Datum(utc_start="2021-06-01T10:00:01Z")
    with pytest.raises(ConfigError, match="Are the lines of another run"):
        open_inputs(run_of(tmp_path, late), MapRequest(path))
    with pytest.raises(ConfigError, match="Leave --datum out"):
        open_inputs(None, MapRequest(path, datum=Datum(59.0, 5.0)))


def test_unix_stamps_beside_a_log_without_a_start_are_refused(tmp_path):
    path = file_of(tmp_path, datum=False)
    with pytest.raises(LogError, match="utc_start"):
        open_inputs(run_of(tmp_path, None), MapRequest(path, datum=Datum(59.0, 5.0)))


def test_the_first_depth_is_that_of_the_file_of_heights(tmp_path):
    path = file_of(tmp_path, place=DEM_DATUM)
    request = MapRequest(path, floor=str(dem(tmp_path / "dem.tif")))
    found = open_inputs(None, request)
    with found.lines:
        assert found.first_floor().depth == pytest.approx(depth_at(0.23, 0.0), abs=0.02)
    found = open_inputs(None, replace(request, floor="plane"))
    with found.lines, pytest.raises(ConfigError, match="nobody knows how deep"):
        found.first_floor()


def test_a_mesh_is_kept_above_the_vehicle_too(tmp_path):
    """A wall 2 m before the imager, from 4 m above it to 4 m below: it may look up."""
    found = open_inputs(None, MapRequest(file_of(tmp_path), floor=str(tmp_path / "wall.ply")))
    with found.lines:
        place = found.navigation.at(found.times).position[0]
        corners = place + np.array([[2.0, -1, -4], [2, 1, -4], [2, 1, -2], [2, -1, -2], [2, 1, 4], [2, -1, 4]])
        trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3], [3, 2, 4], [3, 4, 5]], process=False).export(
            tmp_path / "wall.ply"
        )
        assert len(found._mesh.corners) == 4
