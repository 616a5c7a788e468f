"""Surveys for maps: the imager's swath, what is predicted of the mosaic, and gaps that become the next plan."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

from rovtwin.cli import app
from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.gnc.navigation import constants
from rovtwin.mapping.alignment import joint
from rovtwin.planning import survey_prediction
from rovtwin.planning.survey import lay_out
from rovtwin.planning.survey_assumptions import Assumptions
from rovtwin.planning.survey_prediction import lay_out_for_error, predict
from rovtwin.planning.survey_request import MapRequest, SurveyRequest
from rovtwin.scenario.files import load_scenario
from rovtwin.survey.room import Swath

AREA = "outline: [[0, 0], [8, 0], [8, 4], [0, 4]]\n"
DVL = ("sensors.dvl=true",)
DATUM = Datum(63.45, 10.36)


@pytest.fixture(scope="module")
def area(tmp_path_factory):
    path = tmp_path_factory.mktemp("area") / "small.yaml"
    path.write_text(AREA)
    return path


def request_of(area, overrides=DVL, **mapping):
    mapping = {"imager": "uhi", "overlap": 0.3} | mapping
    return SurveyRequest(area, None, 0.0, altitude=1.5, floor=5.0, overrides=overrides, mapping=MapRequest(**mapping))


@pytest.fixture(scope="module")
def survey(area):
    return lay_out(request_of(area, assumed=Assumptions.ideal()))


@pytest.fixture(scope="module")
def sigma(survey):
    return predict(survey)


def test_the_swath_is_the_imager_s_and_lines_follow_from_it(survey):
    figures = survey.figures()
    assert json.loads(json.dumps(figures)) == figures
    assert survey.plan.room.swath.width == survey.imaging.footprint.width
    assert figures["line_spacing_m"] <= 0.7 * figures["swath_m"] + 1e-9
    assert figures["coverage"] == pytest.approx(1.0)
    # 20 lines a second over what is seen at 0.2 m/s, of 968 x 169 counts of two bytes.
    assert figures["scan_lines"] == pytest.approx(figures["seeing_m"] / 0.2 * 20.0, abs=1)
    assert figures["file_bytes"] == figures["scan_lines"] * 968 * 169 * 2


def test_speed_for_square_pixels_and_what_stands_against_it(area, survey):
    text = " ".join(survey.remarks)
    assert "square with 8 binned to one" in text and "for which an exposure of 25 ms is too long" in text
    assert "of the floor lies between one line and the next" in text
    slow = lay_out(request_of(area, square=True))
    figures = slow.figures()
    assert figures["pixel_along_m"] == pytest.approx(figures["pixel_across_m"])
    assert figures["speed_m_s"] == pytest.approx(0.025, abs=1e-3)
    assert any("is slow for this vehicle" in remark for remark in slow.remarks)
    assert slow.scenario.waypoints[0].speed == pytest.approx(figures["speed_m_s"])


def test_a_tilted_imager_s_swath_is_where_it_looks(tmp_path, area):
    """Rolled by 8 degrees and 0.25 m to starboard of a vehicle of another kind: way-points are moved."""
    (tmp_path / "mine.yaml").write_text(
        "name: mine\nrestoring: {buoyancy: neutral}\nparts:\n- {name: rov, part: bluerov2_heavy}\n"
        "- name: eye\n  pose: {position: [-0.1, 0.25, 0.15], attitude_deg: [8, 0, 0]}\n"
        "  sensors: [{name: slit, kind: imager, pose: {attitude_deg: [0, -90, 0]}}]\n"
    )
    survey = lay_out(replace(request_of(area), vehicle=str(tmp_path / "mine.yaml")))
    ahead, right = survey.imaging.footprint.middle
    assert ahead == pytest.approx(-0.1, abs=0.01)
    assert right == pytest.approx(0.25 - 1.35 * np.tan(np.radians(8)), abs=0.03)
    places = np.array([waypoint.position[:2] for waypoint in survey.scenario.waypoints])
    away = np.linalg.norm(places - survey.plan.path.corners, axis=1)
    assert np.median(away) == pytest.approx(np.hypot(ahead, right), abs=2e-3)
    assert any("whose swath has its middle" in remark for remark in survey.remarks)


@pytest.mark.system
def test_noise_alone_is_a_common_offset_with_a_doppler_log_and_not_without(area, sigma):
    """As measured on flights of such surveys (docs/survey.md)."""
    with_log, without = sigma.rms(), predict(lay_out(request_of(area, (), assumed=Assumptions.ideal()))).rms()
    assert 30e-3 < with_log["absolute"] < 50e-3 and with_log["within"] < 0.5 * with_log["absolute"]
    assert 80e-3 < without["absolute"] < 130e-3 and without["within"] > 0.8 * without["absolute"]
    for rms in (with_log, without):
        assert rms["registered"] < 0.6 * rms["within"]


def test_causes_are_apart_and_add_up(survey, sigma):
    mapping = replace(survey.request.mapping, assumed=Assumptions(floor=0.0))
    found = predict(replace(survey, request=replace(survey.request, mapping=mapping)))
    for i, grid in enumerate((found.absolute, found.within)):
        assert np.nanmean(grid**2) == pytest.approx(sum(cause[i] ** 2 for cause in found.causes.values()), rel=1e-6)
    assert found.causes["readings"] == pytest.approx(sigma.causes["readings"])
    # A degree of compass turns the mosaic about its middle: as far as its places are from there, 0.9 of it is left.
    places = np.stack(np.meshgrid(found.north, found.east, indexing="ij"), axis=-1)[np.isfinite(found.absolute)]
    lever = np.sqrt(np.mean(np.sum((places - places.mean(axis=0)) ** 2, axis=1)))
    assert 0.6 < found.causes["heading"][1] / (np.radians(1.0) * lever) < 1.1
    # A degree about each axis at 1.39 m: roll and pitch 24 mm, yaw less.
    assert found.causes["boresight"][0] == pytest.approx(1.39 * np.radians(1.0) * np.sqrt(2.0), rel=0.1)
    assert found.causes["clock"][0] == pytest.approx(0.2 * 0.02, rel=1e-6)
    assert found.causes["lever"][0] == pytest.approx(0.01 * np.sqrt(2.0), rel=0.1)  # and a little of the height


def test_what_a_plan_assumes_is_what_its_map_starts_from():
    assumed = Assumptions()
    found = [*np.radians([assumed.boresight] * 3), *[assumed.lever] * 3, assumed.clock]
    assert found == pytest.approx(list(joint.USUAL_STD.values()))
    sensors = [np.radians(assumed.heading), np.radians(assumed.dvl_yaw), assumed.dvl_scale]
    assert sensors == pytest.approx([constants.USUAL_STD[name] for name in constants.SENSOR])


@pytest.mark.system
def test_crosshatch_flies_the_area_twice_and_helps_without_a_doppler_log(area):
    plain, crossed = (lay_out(request_of(area, (), crosshatch=c, assumed=Assumptions.ideal())) for c in (False, True))
    assert crossed.figures()["lines"] > 1.9 * plain.figures()["lines"]
    assert crossed.scenario.waypoints[-1].position[0] != plain.scenario.waypoints[-1].position[0]
    assert predict(crossed).rms()["registered"] < 0.8 * predict(plain).rms()["registered"]


@pytest.mark.system
def test_overlap_follows_from_an_error_or_the_best_is_named(area, monkeypatch):
    request = request_of(area, (), assumed=Assumptions.ideal())
    survey, sigma = lay_out_for_error(replace(request, mapping=replace(request.mapping, error=0.02)))
    assert survey.plan.room.swath.overlap == 0.3 and sigma.rms()["registered"] <= 0.02
    less = predict(lay_out(replace(request, mapping=replace(request.mapping, overlap=0.2))))
    assert less.rms()["registered"] > 0.02
    monkeypatch.setattr(survey_prediction, "TRIED", survey_prediction.TRIED[:2])
    with pytest.raises(ConfigError, match=r"found 0.1 mm, but the best .* is 18.* mm .*\(overlap 0.3\). A Doppler log"):
        lay_out_for_error(replace(request, mapping=replace(request.mapping, error=1e-4)))


def gaps_file(path, *boxes, datum=DATUM, **more):
    """GeoJSON as maps have it: boxes (north, east, north, east)."""
    features = []
    for low_n, low_e, high_n, high_e in boxes:
        corners = np.array([[low_n, low_e, 0], [high_n, low_e, 0], [high_n, high_e, 0], [low_n, high_e, 0]], float)
        latitude, longitude, _ = (np.ravel(x) for x in datum.geodetic(corners))
        ring = [[float(x), float(y)] for x, y in zip(longitude, latitude, strict=True)]
        features.append(
            {"type": "Feature", "properties": {"area_m2": (high_n - low_n) * (high_e - low_e)},
             "geometry": {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}}
        )  # fmt: skip
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features} | more))
    return path


@pytest.mark.system
def test_gaps_become_the_next_plan(area, tmp_path):
    gaps = gaps_file(tmp_path / "gaps.geojson", (1, 1, 3, 1.1), (4, 2, 4.4, 3.9), (1, 1, 1.0005, 1.0005))
    whole, survey = lay_out(request_of(area)), lay_out(replace(request_of(area), gaps=tmp_path))
    assert survey.plan.room.area.area == pytest.approx(0.2 + 0.76, rel=1e-3) and gaps.is_file()
    assert survey.plan.coverage == pytest.approx(1.0, abs=1e-6)
    assert len(survey.plan.all_lines) == 2 and survey.plan.seconds < 0.3 * whole.plan.seconds
    # Each along the longer side of its gap.
    courses = [np.ptp(line.ends, axis=0) for line in survey.plan.all_lines]
    assert sorted(int(np.argmax(course)) for course in courses) == [0, 1]
    assert predict(survey).rms()["absolute"] > 0


def test_the_way_to_gaps_keeps_clear_of_holes(tmp_path):
    path = tmp_path / "holed.yaml"
    path.write_text("outline: [[0, 0], [12, 0], [12, 12], [0, 12]]\nholes: [[[4, 4], [8, 4], [8, 8], [4, 8]]]\n")
    # The last one reaches up to the hole: its line is cut, and has no lead there.
    gaps_file(tmp_path / "gaps.geojson", (1, 5.8, 3, 6.2), (9.5, 5.8, 11, 6.2), (4, 2, 4.4, 3.9))
    survey = lay_out(replace(request_of(path), gaps=tmp_path / "gaps.geojson"))
    way = shapely.LineString(survey.plan.path.points)
    assert way.distance(shapely.box(4, 4, 8, 8)) > survey.clearance - 1e-3


BAD = {
    "no gaps": (lambda p: p.write_text('{"type": "FeatureCollection", "features": []}'), "has no gaps"),
    "outside": (lambda p: gaps_file(p, (1, 1, 3, 2), (20, 1, 21, 2)), "lie outside the area, up to 13.0 m"),
    "elsewhere": (lambda p: gaps_file(p, (100, 1, 101, 2)), "Is --area the one that was surveyed"),
    "far away": (lambda p: gaps_file(p, (1, 1, 3, 2), datum=Datum(60.0, 5.0)), "from the datum"),
    "metres": (
        lambda p: p.write_text(json.dumps({"type": "Polygon", "coordinates": [[[569000, 7030000]] * 4]})),
        "GeoJSON has longitude first",
    ),
    "crs": (lambda p: gaps_file(p, (1, 1, 3, 2), crs={"name": "EPSG:32632"}), "expected WGS-84"),
    "too small": (lambda p: gaps_file(p, (1, 1, 1.05, 1.05)), "none of 0.0025 m2 can be seen by a line"),
    "not there": (lambda p: None, "has no gaps.geojson"),
}


@pytest.mark.parametrize("make, message", BAD.values(), ids=BAD)
def test_bad_gaps_are_named(make, message, area, tmp_path):
    make(tmp_path / "gaps.geojson")
    with pytest.raises(ConfigError, match=message):
        lay_out(replace(request_of(area), gaps=tmp_path))


def run(*words):
    return CliRunner().invoke(app, ["plan-survey", *map(str, words)])


@pytest.mark.system
def test_the_command_says_what_is_predicted(area, tmp_path):
    out, picture = tmp_path / "s.yaml", tmp_path / "sigma.png"
    words = ("--area", area, "--imager", "uhi", "--altitude", 1.5, "--floor", 5, "--heading", 0, "-o", out)
    result = run(*words, "--sigma-figure", picture, "--assume", "heading=2", "--set", "sensors.dvl=true", "--json")
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    causes = report["mosaic_sigma"]["causes"]
    assert causes["heading"]["within_m"] == pytest.approx(2 * 0.045, rel=0.3) and report["imager"] == "uhi"
    assert picture.stat().st_size > 10_000 and load_scenario(out).world.floor == 5
    text = run(*words, "--overlap", 0).output
    assert "error of the mosaic, predicted" in text and "compass bias" in text


COMMANDS = {
    "both": (("--imager", "uhi", "--swath", 1), "--swath and --imager: found both"),
    "neither": ((), "--swath and --imager: found neither"),
    "no height": (("--imager", "uhi"), "its swath depends on the height"),
    "in the floor": (("--imager", "uhi", "--altitude", 0.1, "--floor", 5), "it would be in the floor|into the floor"),
    "no imager on board": (
        ("--imager", "uhi", "--vehicle", "bluerov2_heavy", "--altitude", 1.5, "--floor", 5),
        "carries no imager",
    ),
    "no such imager": (("--imager", "uhj", "--altitude", 1.5, "--floor", 5), "Did you mean 'uhi'"),
    "roll": (("--imager", "uhi", "--altitude", 1.5, "--floor", 5, "--roll", 25), "leave nothing of"),
    "idle": (("--swath", 1, "--crosshatch"), "--crosshatch: nothing would come of it"),
    "assume": (("--imager", "uhi", "--assume", "haeding=1"), "Did you mean 'heading'"),
    "assume number": (("--imager", "uhi", "--assume", "heading=north"), "expected a number of at least 0"),
    "square": (
        ("--imager", "uhi", "--altitude", 1.5, "--floor", 5, "--square", "--speed", 0.1),
        "--speed and --square: found both",
    ),
    "picture": (("--imager", "uhi", "--sigma-figure", "s.gif"), "--sigma-figure: found 's.gif'"),
}


@pytest.mark.parametrize("words, message", COMMANDS.values(), ids=COMMANDS)
def test_bad_input_is_named(words, message, area, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run("--area", area, "--heading", 0, *words)
    assert isinstance(result.exception, ConfigError), result.output
    assert re.search(message, str(result.exception))
    assert not (tmp_path / "survey.yaml").exists()


def test_a_swath_alone_is_no_map(area):
    with pytest.raises(ConfigError, match="say --imager"):
        predict(lay_out(SurveyRequest(area, Swath(1.2), 0.0)))
