"""Missions from and into other programs' files: what each holds comes back, the rest is named, junk is refused."""

import copy
import json

import numpy as np
import pytest
from pymap3d.vincenty import vdist
from tests.planning.exchange.routes import GPX, KML, PATH, PLACES, PLAN, POINTS

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import parse
from rovtwin.planning.exchange import xmltext
from rovtwin.planning.exchange.missions import (
    FORMATS,
    LEFT_OUT,
    MOST,
    depthless,
    fence_in_words,
    left_out,
    mission_data,
    read_route,
    route_of,
)
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import MissionSection

DATUM = Datum(63.45, 10.36, 40.0)
FULL = {
    "name": "all of it",
    "waypoints": [
        {"position": [0.0, 0.0, 3.0], "speed": 0.3, "acceptance": 0.5, "hold_time": 4.0, "heading_deg": 0.0},
        {"position": [400.0, -250.0, 2.5], "speed": 0.3, "acceptance": 0.5, "altitude": 2.0},
        {"position": [400.0, 900.0, 0.0], "speed": 0.1, "acceptance": 0.2, "heading_deg": -90.0},
    ],
}


def places(route):
    return [(p.latitude, p.longitude, p.depth) for p in route.points]


def mission(data=None):
    return parse(MissionSection, FULL if data is None else data, "mine.yaml")


READ = {
    "gpx": GPX.format(marks=""),
    "kml path": KML.format(shape=PATH.format(mode="<altitudeMode>absolute</altitudeMode>")),
    "plan": json.dumps(PLAN),
    "points": POINTS,
    "line": json.dumps({"type": "LineString", "coordinates": [[b, a, -d] for a, b, d in PLACES]}),
}


@pytest.mark.parametrize("text", READ.values(), ids=READ)
def test_the_places_of_other_programs_files_are_read(text):
    route = read_route(text, "theirs")
    np.testing.assert_allclose(places(route), PLACES, atol=1e-9)
    assert read_route("﻿" + text, "theirs").points == route.points  # a byte order mark


def test_what_a_plan_says_of_its_way_points_and_its_fence():
    route = read_route(json.dumps(PLAN), "theirs.plan")
    first, second = route.points
    assert (first.speed, first.acceptance, first.hold_time, first.heading_deg) == (0.3, 0.5, None, None)
    assert (second.speed, second.acceptance, second.hold_time, second.heading_deg) == (0.3, None, 20.0, 90.0)
    assert len(route.fence) == 4 and "206" in route.notes[0] and "1 more area" in route.notes[1]
    (note,) = fence_in_words(route, DATUM)
    scenario = load_scenario("square", [note.split("--set ")[1].replace("'", "")])  # what it says can be typed
    corners = np.array(scenario.autopilot.supervisor.geofence.polygon)
    np.testing.assert_allclose(corners, [DATUM.position(*c, 0.0)[:2] for c in route.fence], atol=0.01)
    assert "out" in fence_in_words(route, None)[0] and "10 km" in fence_in_words(route, Datum(60.0, 10.0))[0]


def test_a_survey_of_a_plan_is_flown_by_its_items():
    plan = copy.deepcopy(PLAN)
    inner = plan["mission"]["items"]
    plan["mission"]["items"] = [{"type": "ComplexItem", "TransectStyleComplexItem": {"Items": inner}}]
    np.testing.assert_allclose(places(read_route(json.dumps(plan), "x")), PLACES)
    plan["mission"]["items"] = [{"type": "ComplexItem", "complexItemType": "StructureScan"}]
    with pytest.raises(ConfigError, match=r"items\[0\]: found a StructureScan without its items"):
        read_route(json.dumps(plan), "x")


def test_an_older_plan_has_its_places_apart():
    plan = copy.deepcopy(PLAN)
    for item in plan["mission"]["items"]:
        item["coordinate"] = item["params"][4:]
        del item["params"][4:]
    np.testing.assert_allclose(places(read_route(json.dumps(plan), "x")), PLACES)


def test_a_file_without_depths_says_so():
    flat = read_route(KML.format(shape=PATH.format(mode="")), "x.kml")  # drawn on the ground, as by default
    assert depthless(flat) == 2
    with pytest.raises(ConfigError, match="no depth of 2 of 2 way-points"):
        mission_data(flat, DATUM, "x.kml")
    assert [p["position"][2] for p in mission_data(flat, DATUM, "x.kml", 2.5)["waypoints"]] == [2.5, 2.5]


def test_elevations_of_a_boat_are_no_depths():
    assert depthless(read_route(GPX.format(marks="").replace("-3.5", "2.1"), "x.gpx")) == 1


@pytest.mark.parametrize("kind", FORMATS)
def test_a_mission_comes_back_as_far_as_the_format_holds_it(kind):
    route = route_of(mission(), DATUM)
    back = mission_data(read_route(FORMATS[kind].write(route), "x"), DATUM, "x")
    kept = ("position", *FORMATS[kind].holds)
    for was, now in zip(FULL["waypoints"], back["waypoints"], strict=True):
        np.testing.assert_allclose(now["position"], was["position"], atol=1e-3)
        heading = now.pop("heading_deg", None)
        assert heading == (was.get("heading_deg") if "heading_deg" in kept else None) or (heading, kind) == (
            360,
            "plan",
        )
        assert now.keys() <= {*kept, "position"}
        shown = {key: was[key] for key in kept if key in was and key not in ("position", "heading_deg")}
        assert {key: now[key] for key in shown} == shown
    (note,) = left_out(route, kind) or [""]
    lost = {key for key in LEFT_OUT if LEFT_OUT[key] in note}
    assert lost == {*LEFT_OUT} - FORMATS[kind].holds and bool(note) == bool(lost)


@pytest.mark.parametrize("kind", FORMATS)
def test_places_on_the_map_are_as_far_apart_as_in_metres(kind):
    """By another way than the datum's own conversion: geodesics on the ellipsoid (Vincenty)."""
    datum = Datum(63.45, 10.36)  # on the ellipsoid, as geodesics are: 40 m higher they would be 3 mm longer
    points = read_route(FORMATS[kind].write(route_of(mission(), datum)), "x").points
    metres = np.array([p["position"] for p in FULL["waypoints"]])
    for i in range(2):
        away, bearing = vdist(points[i].latitude, points[i].longitude, points[i + 1].latitude, points[i + 1].longitude)
        north, east = (metres[i + 1] - metres[i])[:2]
        # Three metres of depth make it half a millimetre at a kilometre, and so do 9 digits of a degree.
        assert away == pytest.approx(np.hypot(north, east), abs=1e-3)
        assert np.cos(np.radians(bearing)) == pytest.approx(north / np.hypot(north, east), abs=1e-4)


def test_geojson_is_read_by_geos():
    shapely = pytest.importorskip("shapely", reason="needs shapely: pip install 'rovtwin[survey]'")
    shapes = shapely.get_parts(shapely.from_geojson(FORMATS["geojson"].write(route_of(mission(), DATUM))))
    assert [shape.geom_type for shape in shapes] == ["Point"] * 3
    np.testing.assert_allclose([shapes[0].x, shapes[0].y], [10.36, 63.45], atol=1e-9)


def test_the_fence_goes_along_with_a_plan():
    changes = ["autopilot.supervisor.geofence={limit: 30, polygon: [[-9, -9], [99, -9], [99, 99]]}"]
    scenario = load_scenario("square", changes)
    route = route_of(mission(), DATUM, scenario)
    fence = json.loads(FORMATS["plan"].write(route))["geoFence"]
    (polygon,), (circle,) = fence["polygons"], fence["circles"]
    np.testing.assert_allclose(
        [DATUM.position(*c, 0.0)[:2] for c in polygon["polygon"]], [[-9, -9], [99, -9], [99, 99]], atol=1e-3
    )
    assert circle["circle"]["radius"] == 30.0
    np.testing.assert_allclose(
        DATUM.position(*circle["circle"]["center"], 0.0)[:2], scenario.start.position[:2], atol=1e-3
    )
    assert "fence" in left_out(route, "gpx")[-1]


def test_metres_without_a_datum_are_no_place_on_the_map():
    with pytest.raises(ConfigError, match="--set 'datum="):
        route_of(mission(), None)
    on_map = mission({"waypoints": [{"geodetic": [63.45, 10.36, 2.0]}]})
    assert places(route_of(on_map, None)) == [(63.45, 10.36, 2.0)]


def test_a_mission_far_from_the_datum_is_refused():
    with pytest.raises(ConfigError, match="x.gpx: way-point 1: .* km from the datum"):
        mission_data(read_route(READ["gpx"], "x.gpx"), Datum(59.0, 10.0), "x.gpx")


BOMB = (
    '<?xml version="1.0"?><!DOCTYPE g [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;">]><gpx><rte><name>&b;</name></rte></gpx>'
)
DEEP = "<gpx>" + "<a>" * 99 + "</a>" * 99 + "</gpx>"
JUNK = {
    "entities": (BOMB, "declares a document type"),
    "external": ('<!DOCTYPE gpx SYSTEM "file:///etc/passwd"><gpx/>', "declares a document type"),
    "nested": (DEEP, f"deeper than {xmltext.DEEPEST} levels"),
    "broken": ("<gpx><rte>", "line 1, column 11: not XML"),
    "other xml": ("<svg/>", "found <svg>, expected a GPX or a KML file"),
    "large": ("<gpx>" + " " * MOST, "expected at most 10 MB"),
    "packed": ("PK\x03\x04", "unpack it"),
    "empty gpx": ("<gpx/>", "no route"),
    "two routes": ("<gpx><rte><name>a</name></rte><rte/></gpx>", "found 2 routes or tracks .a, without a name."),
    "marks and tracks": ("<gpx><wpt lat='1' lon='1'/><trk/></gpx>", "1 way-point and 1 track"),
    "no points": ("<gpx><rte/></gpx>", "has no way-points"),
    "no number": ("<gpx><rte><rtept lat='x' lon='1'/></rte></gpx>", "rtept 1.lat: found 'x', expected a number"),
    "nan": ("<gpx><rte><rtept lat='nan' lon='1'/></rte></gpx>", "rtept 1: latitude nan"),
    "swapped": ("<gpx><rte><rtept lat='100' lon='63'/></rte></gpx>", "swapped"),
    "above water": ('{"type": "Point", "coordinates": [1, 1, 12]}', "height of 12 m"),
    "infinitely deep": ("<gpx><rte><rtept lat='1' lon='1'><ele>-inf</ele></rtept></rte></gpx>", "height of -inf m"),
    "kml area": (KML.format(shape="<Polygon/>"), "plan-survey"),
    "kml two paths": (KML.format(shape=PATH.format(mode="") * 2), r"2 path\(s\)"),
    "kml blanks": (KML.format(shape="<Point><coordinates>1, 2, 3</coordinates></Point>"), "without blanks|number"),
    "json": ('{"type": "LineString", "coordinates": [', "not JSON"),
    "json bomb": ('{"type": ' + "[" * 100_000, "nested too deeply"),
    "json digits": ('{"type": ' + "1" * 5000 + "}", "too long a number"),
    "geojson area": ('{"type": "Polygon", "coordinates": [[[0,0],[1,0],[1,1]]]}', "plan-survey --area"),
    "geojson both": ('{"type": "GeometryCollection", "geometries": [{"type": "Point", "coordinates": [1,1]}, '
                     '{"type": "LineString", "coordinates": [[1,1],[2,2]]}]}', r"1 line\(s\) and 1 point\(s\)"),
    "geojson place": ('{"type": "Point", "coordinates": [1, true]}', "expected .longitude, latitude."),
    "geojson system": ('{"type": "Point", "coordinates": [1, 1], "crs": "EPSG:32632"}', "expected WGS-84"),
    "geojson depth": ('{"type": "Feature", "geometry": {"type": "Point", "coordinates": [1, 1]}, '
                      '"properties": {"depth_m": "3"}}', "depth_m"),
    "geojson empty": ('{"type": "FeatureCollection", "features": []}', "not empty"),
    "plan without": ('{"fileType": "Plan"}', "mission.items"),
    "plan items": ('{"fileType": "Plan", "mission": {"items": [7]}}', "expected an item"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "message"), JUNK.values(), ids=JUNK)
def test_what_is_no_route_is_refused_in_words(text, message):
    with pytest.raises(ConfigError, match=message) as refused:
        read_route(text, "theirs")
    assert str(refused.value).startswith("theirs: ")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frame": 10}, "heights over terrain"),
        ({"frame": True}, "whole numbers"),
        ({"params": "x"}, "list of params"),
        ({"params": [0, 0, 0, 0, 63.4, 10.3]}, "expected latitude, longitude and height"),
        ({"params": [0, 0, 0, 0, 63.4, 10.3, 30]}, "height of 30 m"),
        ({"params": [0, 0, 0, 0, 163.4, 10.3, -3]}, "latitude 163.4"),
        ({"coordinate": 7}, "expected latitude, longitude and height"),
    ],
)
def test_items_of_a_plan_that_no_vehicle_can_go_to_are_refused(change, message):
    plan = copy.deepcopy(PLAN)
    plan["mission"]["items"][1] |= change
    with pytest.raises(ConfigError, match=message):
        read_route(json.dumps(plan), "theirs")


@pytest.mark.parametrize("text", ["waypoints: []", "{waypoints: [{position: [1, 2, 3]}]}", '{"waypoints": []}', ""])
def test_what_may_be_yaml_is_left_to_yaml(text):
    assert read_route(text, "mine") is None


@pytest.mark.parametrize(
    "text",
    [
        '{"type": "Point", "coordinates": [10, 1' + "0" * 400 + "]}",
        '{"type": "Point", "coordinates": [10, 60, -1' + "0" * 400 + "]}",
        "<gpx>\ud800</gpx>",
    ],
    ids=["latitude", "height", "half a character"],
)
def test_what_python_cannot_convert_is_refused_in_words(text):
    with pytest.raises(ConfigError, match="^theirs: "):
        read_route(text, "theirs")
