"""Surveys as scenarios: what is written loads, says what it takes, and flies."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

from rovtwin.cli import app
from rovtwin.core.errors import ConfigError
from rovtwin.planning.survey import SurveyRequest, lay_out, survey_picture, write_survey
from rovtwin.runs.compose.fitting import fitted
from rovtwin.runs.fly import fly
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema.mission import LONGEST
from rovtwin.survey.energy import budget, thruster_powers
from rovtwin.survey.pace import line_speed, top_of_lines
from rovtwin.survey.room import Swath
from rovtwin.vehicle import load_vehicle

EXAMPLES = Path(__file__).parents[2] / "examples" / "survey"
POOL = EXAMPLES / "pool.yaml"


@pytest.fixture(scope="module")
def pool():
    return lay_out(SurveyRequest(POOL, Swath(1.6), heading_deg=0.0, inside=True))


def test_what_is_written_is_what_was_laid_out(pool, tmp_path):
    write_survey(pool, tmp_path / "mine.yaml")
    scenario = load_scenario(tmp_path / "mine.yaml")
    assert scenario == pool.scenario
    places = np.array([waypoint.position for waypoint in scenario.waypoints])
    assert np.allclose(places[:, :2], pool.plan.path.corners, atol=1e-3) and (places[:, 2] == 3.0).all()
    assert scenario.start.position[:2] == places[0, :2].tolist()
    assert scenario.duration > pool.plan.seconds and scenario.battery is not None
    assert "# Laid out by rovtwin plan-survey: pool.yaml" in (tmp_path / "mine.yaml").read_text()


def test_a_speed_that_was_asked_for_is_flown_by_a_vehicle_with_another_of_its_own(tmp_path):
    """0.2 m/s is also the schema's default: what is left out of a file is taken from the vehicle."""
    request = SurveyRequest(POOL, Swath(1.6), heading_deg=0.0, vehicle="minerva", speed=0.2)
    write_survey(lay_out(request), tmp_path / "mine.yaml")
    scenario = load_scenario(tmp_path / "mine.yaml")
    flown = fitted(scenario, load_vehicle("minerva").model())
    assert {w.speed for w in flown.waypoints} == {0.2} and flown.duration == scenario.duration


@pytest.mark.parametrize("vehicle", ["double_blueye_thesis", "bluerov2", "blueye_x3", "minerva", "torpedo"])
def test_lines_begin_with_a_speed_that_the_vehicle_has(vehicle):
    """The thesis's vehicle has 0.17 m/s with half of its thrust, and 0.2 m/s of its own."""
    model = load_vehicle(vehicle).model()
    survey = lay_out(SurveyRequest(POOL, Swath(1.6), heading_deg=0.0, vehicle=vehicle))
    assert 0.0 < survey.plan.pace.speed <= line_speed(model) < top_of_lines(model)
    lay_out(SurveyRequest(POOL, Swath(1.6), heading_deg=0.0, vehicle=vehicle, speed=line_speed(model)))


def test_speed_acceptance_settling_and_clearance_are_the_vehicle_s_own(pool):
    """The Double Blueye's are 0.2 m/s, 0.2 m, 4 s and 0.3 m beside the hull."""
    large = lay_out(SurveyRequest(POOL, Swath(1.6), heading_deg=0.0, vehicle="minerva"))
    for survey, speed, acceptance, settling in ((pool, 0.2, 0.2, 4.0), (large, 0.32, 0.5, 6.0)):
        assert {(w.speed, w.acceptance) for w in survey.scenario.waypoints} == {(speed, acceptance)}
        assert survey.plan.pace.settling == pytest.approx(settling) and survey.plan.pace.speed == speed
        hull = load_vehicle(survey.scenario.vehicle).model().hull
        widest = np.linalg.norm(np.asarray(hull.corners)[:, :2], axis=1).max()
        assert survey.clearance - widest == pytest.approx(1.5 * acceptance)


def test_figures_are_plain_and_hang_together(pool):
    text = pool.figures()
    assert json.loads(json.dumps(text)) == text
    assert text["length_m"] > text["seeing_m"] > 0 and text["coverage"] < text["coverage_of_reachable"] <= 1
    assert text["duration_s"] > text["length_m"] / text["speed_m_s"]
    # Hotel load of both halves over the time, and thrust besides.
    assert text["energy_wh"] > 40.0 * text["duration_s"] / 3600
    assert any("cannot be seen" in remark for remark in text["remarks"])


def test_the_picture_shows_what_matters(pool):
    (axes,) = survey_picture(pool).axes
    assert axes.get_xlabel() == "East [m]" and "seen" in axes.get_title(loc="left")


def test_thrust_is_shared_and_weighed():
    vehicle = load_vehicle("double_blueye")
    model = vehicle.model()
    power = thruster_powers(vehicle, model, np.array([2.0, 0, 0, 0, 0, 0]))
    assert power.sum() == pytest.approx(2 * 1.0**1.5, rel=0.2)  # two thrusters of 1 N at about 1 W/N^1.5
    once, twice = (budget(vehicle, model, 0.2, seconds, 0.0) for seconds in (100.0, 200.0))
    assert twice.used_wh == pytest.approx(2 * once.used_wh) and once.share is not None


def run(*words):
    return CliRunner().invoke(app, ["plan-survey", *map(str, words)])


def test_the_command_writes_scenario_picture_and_json(tmp_path):
    out, picture = tmp_path / "s.yaml", tmp_path / "s.png"
    words = ("--area", POOL, "--swath", 1.6, "--heading", 90, "-o", out, "--figure", picture, "--vehicle", "bluerov2")
    result = run(*words, "--altitude", 1, "--floor", 4, "--json")
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    assert report["heading_deg"] == pytest.approx(90) and report["depth_m"] == 3 and report["scenario"] == str(out)
    assert picture.stat().st_size > 10_000 and load_scenario(out).world.floor == 4
    assert load_scenario(out).vehicle == "bluerov2"
    assert all(w.altitude is None for w in load_scenario(out).waypoints)


def test_with_an_altimeter_on_board_the_floor_is_followed(tmp_path):
    out = tmp_path / "s.yaml"
    words = ("--area", POOL, "--swath", 1.6, "-o", out, "--scenario", "terrain_following", "--altitude", 1.2)
    result = run(*words)
    assert result.exit_code == 0, result.output
    assert {w.altitude for w in load_scenario(out).waypoints} == {1.2}
    assert {w.position[2] for w in load_scenario(out).waypoints} == {4.5 - 1.2}


def test_what_is_set_changes_the_scenario(tmp_path):
    """Also what is set to a default that the survey would choose otherwise."""
    out = tmp_path / "s.yaml"
    settings = (
        "world.current=[0,0.1,0]",
        "battery=false",
        "vehicle=minerva",
        "duration=9000",
        "autopilot=thesis_placed",
    )
    words = ("--area", POOL, "--swath", 1.6, "--heading", 0, "-o", out)
    result = run(*words, *(word for text in settings for word in ("--set", text)))
    assert result.exit_code == 0, result.output
    written = load_scenario(out)
    assert written == load_scenario(out, settings) and written.vehicle == "minerva"
    assert written.world.current.velocity == [0, 0.1, 0] and written.battery is None and written.duration == 9000
    assert written.waypoints[0].speed == 0.32  # minerva's own


def test_a_floor_may_have_a_relief_that_is_set():
    relief = "world.relief={hills: {height: 0.3, length: 6.0, seed: 7}}"
    survey = lay_out(SurveyRequest(POOL, Swath(1.6), 0.0, floor=6.0, overrides=(relief,)))
    assert survey.scenario.world.floor == 6.0 and survey.scenario.world.relief.hills.height == 0.3


BAD = {
    "no file": (("--area", "none.geojson"), "none.geojson: no such file"),
    "overlap": (("--overlap", "1"), "overlap: found 1"),
    "swath": (("--swath", "50"), "wider than the whole area"),
    "heading": (("--heading", "north"), "--heading: found 'north'"),
    "depth": (("--depth", "150"), "--depth: found 150 m"),
    "both": (("--depth", "2", "--altitude", "1"), "found both, expected one"),
    "no floor": (("--altitude", "1"), "has no floor"),
    "into the floor": (("--depth", "3", "--floor", "3"), "into the floor"),
    "speed": (("--speed", "3"), "speed: found 3 m/s"),
    "clearance": (("--clearance", "-1"), "clearance: found -1 m"),
    "datum": (("--datum", "here"), "--datum: found 'here'"),
    "picture": (("--figure", "s.gif"), "--figure: found 's.gif'"),
    "cannot turn": (("--vehicle", "blueye_pioneer"), "cannot turn it both ways"),
    "set unknown": (("--set", "world.curent=[0,0,0]"), "--set world.curent=[0,0,0]: world.curent: no such key"),
    "set laid": (("--set", "mission.waypoints=[]"), "lays its way-points and its start itself"),
    "set twice": (("--floor", "9", "--set", "world={floor: 8}"), "--floor and --set world: found both"),
    "vehicle twice": (("--vehicle", "minerva", "--set", "vehicle=otter"), "--vehicle and --set vehicle: found both"),
    "set a deep floor": (("--set", "world.floor=2"), "into the floor at 2 m"),
    "vehicle": (("--vehicle", "double_blueey"), "Did you mean 'double_blueye'"),
}


@pytest.mark.parametrize("words, message", BAD.values(), ids=BAD)
def test_bad_input_is_named(words, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run("--area", POOL, "--swath", "1.6", "--heading", "0", *words)
    assert isinstance(result.exception, ConfigError) and message in str(result.exception)


@pytest.mark.system
def test_a_survey_too_long_for_a_mission_says_so(tmp_path):
    (tmp_path / "sea.yaml").write_text("outline: [[0, 0], [2000, 0], [2000, 2000], [0, 2000]]")
    with pytest.raises(ConfigError, match="split the area"):
        lay_out(SurveyRequest(tmp_path / "sea.yaml", Swath(0.9), heading_deg=0.0))
    assert LONGEST >= 1000


@pytest.mark.slow  # half a minute to compile
def test_a_planned_survey_is_flown_in_the_planned_time_and_sees_the_area(tmp_path):
    (tmp_path / "small.yaml").write_text("outline: [[0, 0], [6, 0], [6, 4], [0, 4]]")
    survey = lay_out(SurveyRequest(tmp_path / "small.yaml", Swath(1.5)))
    write_survey(survey, tmp_path / "survey.yaml")
    flight = fly(load_scenario(tmp_path / "survey.yaml"))
    assert flight.figures["completed"]
    # The plan is on the safe side: a way-point counts as reached before it (docs/survey.md).
    assert 0.6 < flight.figures["duration_s"] / survey.plan.seconds < 1.15
    assert flight.figures["energy_wh"] == pytest.approx(survey.figures()["energy_wh"], rel=0.4)
    track = flight.log["truth/eta"].values
    swept = shapely.LineString(track[np.abs(track[:, 2] - 3.0) < 0.2, :2]).buffer(0.75)
    area = survey.plan.room.area
    assert swept.intersection(area).area / area.area > 0.97


def test_lines_are_those_of_the_imager(pool, tmp_path):
    """An imager 0.2 m to starboard: way-points lie 0.2 m to port of its lines, and the user is informed."""
    mine = tmp_path / "mine.yaml"
    mine.write_text(
        "name: mine\nrestoring: {buoyancy: neutral}\nparts:\n- {name: rov, part: double_blueye}\n"
        "- name: eye\n  pose: {position: [0, 0.2, 0.1]}\n  sensors: [{name: slit, kind: imager}]\n"
    )
    survey = lay_out(SurveyRequest(POOL, Swath(1.6), 0.0, vehicle=str(mine), inside=True, sees="eye.slit"))
    corners = survey.plan.path.corners
    places = np.array([waypoint.position[:2] for waypoint in survey.scenario.waypoints])
    away = np.linalg.norm(places - corners, axis=1)
    assert np.median(away) == pytest.approx(0.2, abs=2e-3)
    assert any("eye.slit, which sits 0 m ahead and 0.2 m to the right" in remark for remark in survey.remarks)
    with pytest.raises(ConfigError, match="no such imager or camera; there are: .*uhi.camera, eye.slit"):
        lay_out(SurveyRequest(POOL, Swath(1.6), vehicle=str(mine), sees="eye.slot"))


def test_lines_are_those_of_a_swath_beside_the_vehicle():
    """A swath 0.3 m to starboard that is no instrument's own, as the console knows one."""
    survey = lay_out(SurveyRequest(POOL, Swath(1.6), 0.0, inside=True, middle=(0.0, 0.3)))
    places = np.array([waypoint.position[:2] for waypoint in survey.scenario.waypoints])
    away = np.linalg.norm(places - survey.plan.path.corners, axis=1)
    assert np.median(away) == pytest.approx(0.3, abs=2e-3)
    assert any("the swath's middle, which sits 0 m ahead and 0.3 m to the right" in text for text in survey.remarks)
