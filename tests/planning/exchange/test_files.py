"""Missions converted from file to file, and by `rovtwin convert`."""

import json
from pathlib import Path

import numpy as np
import pytest
from tests.planning.exchange.routes import GPX, PLAN
from typer.testing import CliRunner

from rovtwin.cli import app
from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.yamlfile import dump_yaml
from rovtwin.planning.exchange.files import convert
from rovtwin.runs.compose.fitting import fitted
from rovtwin.runs.vehicle_defaults import vehicle_of
from rovtwin.scenario.files import load_mission, load_scenario

DATUM = Datum(63.45, 10.36)


@pytest.fixture
def gpx(tmp_path: Path) -> Path:
    path = tmp_path / "harbour.gpx"
    path.write_text(GPX.format(marks='<wpt lat="63" lon="10"/>'))
    return path


def test_a_route_stays_on_the_map_without_a_datum_and_is_in_metres_with_one(gpx, tmp_path):
    for datum, key in ((None, "geodetic"), (DATUM, "position")):
        result = convert(str(gpx), tmp_path / "m.yaml", datum)
        (tmp_path / "m.yaml").write_text(result.text)
        mission = load_mission(str(tmp_path / "m.yaml"))
        assert result.count == 2 and mission.name == "harbour" and result.notes == ["1 mark beside the route left out"]
        assert all(getattr(point, key) for point in mission.waypoints)
        np.testing.assert_allclose(mission.waypoints[1].placed(DATUM), DATUM.position(63.4502, 10.3604, 4.0), atol=2e-3)
        assert "speed" not in mission.waypoints[0].model_fields_set  # it is the vehicle's own


def test_a_scenario_s_mission_goes_where_its_datum_says(tmp_path):
    with pytest.raises(ConfigError, match="square: where the plan lies .* --datum latitude,longitude"):
        convert("square", tmp_path / "x.plan")
    with pytest.raises(ConfigError, match="test_mixed: is an identification test"):
        convert("test_mixed", tmp_path / "x.plan")
    scenario = load_scenario("square", ["datum={latitude: 59.9, longitude: 10.7}"])
    plan = json.loads(convert("square", tmp_path / "x.plan", scenario=scenario).text)
    assert plan["mission"]["plannedHomePosition"][:2] == pytest.approx([59.9, 10.7], abs=0.01)
    fence = [[-9, -9], [99, -9], [99, 99]]
    fenced = load_scenario(
        "square", ["datum={latitude: 59.9, longitude: 10.7}", f"autopilot.supervisor.geofence.polygon={fence}"]
    )
    assert len(json.loads(convert("square", tmp_path / "x.plan", scenario=fenced).text)["geoFence"]["polygons"]) == 1


def test_a_mission_that_gives_no_speed_gets_that_of_the_scenario_s_vehicle_and_none_without(tmp_path, gpx):
    """Every speed was 0.2 m/s in a plan, whatever the vehicle."""
    changes = ["vehicle=bluerov2_heavy", "mission.waypoints=[{position: [0, 0, 2]}, {position: [5, 0, 2]}]"]
    scenario = load_scenario("square", ["datum={latitude: 59.9, longitude: 10.7}", *changes])
    own = fitted(scenario, vehicle_of(scenario).model()).mission.waypoints[0].speed
    (tmp_path / "own.yaml").write_text(dump_yaml(scenario.mission.model_dump(mode="json", exclude_unset=True)))

    def speeds(**more):
        plan = json.loads(convert(str(tmp_path / "own.yaml"), tmp_path / "x.plan", **more).text)
        return [item["params"][1] for item in plan["mission"]["items"] if item.get("command") == 178]

    assert speeds(scenario=scenario) == [pytest.approx(own)] and own != 0.2
    assert speeds(datum=DATUM) == []


def test_a_plan_keeps_its_fence_into_another_plan(tmp_path):
    source = tmp_path / "theirs.plan"
    source.write_text(json.dumps(PLAN))
    again = json.loads(convert(str(source), tmp_path / "x.plan").text)
    assert again["geoFence"]["polygons"][0]["polygon"] == PLAN["geoFence"]["polygons"][0]["polygon"]


def test_the_command_writes_and_names_what_is_left_out(gpx, tmp_path):
    run = CliRunner().invoke
    assert run(app, ["convert", "square", str(tmp_path / "s.gpx"), "--datum", "63.45,10.36"]).exit_code == 0
    found = run(app, ["convert", str(tmp_path / "s.gpx"), str(tmp_path / "s.kml"), "--json"])
    report = json.loads(found.stdout)
    assert report["way_points"] == len(load_mission("square").waypoints) and (tmp_path / "s.kml").is_file()
    shown = run(app, ["convert", "square", str(tmp_path / "t.gpx"), "--datum", "63.45,10.36"]).stdout
    assert "GPX does not hold" in shown and "speeds" in shown
    assert "exists already" in str(run(app, ["convert", "square", str(tmp_path / "s.gpx")]).exception)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["square", "x.shp"], "found the ending '.shp'"),
        (["nowhere.gpx", "x.yaml"], "no such"),
        (["square", "x.gpx", "--datum", "63"], "--datum: found '63', expected latitude,longitude"),
        (["square", "x.gpx", "--datum", "163,10"], "latitude 163"),
        (["square", "x.gpx", "--set", "seed=1"], "no --scenario says what is changed"),
        (["packed.kmz", "x.gpx"], "A KMZ is a packed KML: unpack it"),
        (["flat.gpx", "x.yaml"], "add --depth 3"),
    ],
)
def test_bad_input_names_the_fix(words, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("packed.kmz").write_bytes(b"PK\x03\x04\xff\xfe")
    Path("flat.gpx").write_text("<gpx><rte><rtept lat='1' lon='1'/></rte></gpx>")
    error = CliRunner().invoke(app, ["convert", *words]).exception
    assert isinstance(error, ConfigError) and message in str(error)
