"""Names of files that no file can have: refused by name, as those of files that are not there."""

import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.files import is_file
from rovtwin.imaging.files import load_imager_file
from rovtwin.scenario.files import load_mission, load_scenario
from rovtwin.simulation.scene import load_scene
from rovtwin.survey.area import read_area
from rovtwin.vehicle.description.vehicle import load_vehicle

LONG = 300 * "x"  # file systems take 255 bytes


@pytest.mark.parametrize("load", [load_scenario, load_mission, load_vehicle, load_imager_file, load_scene, read_area])
@pytest.mark.parametrize("name", [LONG, f"{LONG}.yaml", f"{LONG}.geojson", f"{LONG}/a.yaml"])
def test_a_name_that_is_too_long_is_that_of_no_file(load, name):
    with pytest.raises(ConfigError, match=r"no such|no file|File name too long|expected a GeoJSON file"):
        load(name)


def test_an_ordinary_file_is_one_and_a_folder_is_none(tmp_path):
    (tmp_path / "a").write_text("")
    assert is_file(tmp_path / "a") and not is_file(tmp_path) and not is_file(tmp_path / LONG)
