"""Plans of the console from and into files of other programs."""

import json

import pytest
from tests.planning.exchange.routes import GPX, PLAN

from rovtwin.console.chart.files import exported, imported
from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError
from rovtwin.planning.exchange.missions import FORMATS, read_route
from rovtwin.scenario.files import load_scenario

DATUM = Datum(63.45, 10.36)
ROW = {"x": 1.0, "y": 2.0, "depth": 3.0, "speed": 0.2, "acceptance": 0.2, "hold_time": 0.0, "heading_deg": None}


def test_rows_have_what_the_file_has_and_the_rest_is_the_vehicle_s():
    rows, notes = imported(json.dumps(PLAN), "theirs.plan", DATUM)
    assert [row["speed"] for row in rows] == [0.3, 0.3]
    assert "acceptance" in rows[0] and "acceptance" not in rows[1]
    assert any("geofence.polygon" in note for note in notes)
    rows, notes = imported(GPX.format(marks=""), "theirs.gpx", DATUM)
    x, y, _ = DATUM.position(63.4501, 10.3601, 3.5)
    assert "speed" not in rows[0] and (rows[0]["x"], rows[0]["y"]) == pytest.approx((x, y), abs=1e-3)


def test_depths_that_are_missing_are_named():
    flat = GPX.format(marks="").replace("<ele>-4</ele>", "")
    rows, (note,) = imported(flat, "theirs.gpx", DATUM)
    assert [row["depth"] for row in rows] == [3.5, 1.0] and "no depth of 1 way-point" in note


def test_way_points_of_our_own_may_be_on_the_map():
    text = "waypoints: [{geodetic: [63.4501, 10.3601, 3.5]}]"
    ((row,), notes) = imported(text, "mine.yaml", DATUM)
    assert (row["x"], row["y"], row["depth"]) == pytest.approx(DATUM.position(63.4501, 10.3601, 3.5), abs=1e-3)
    with pytest.raises(ConfigError, match="geodetic way-points"):
        imported(text, "mine.yaml", None)


def test_without_a_datum_the_fix_is_named():
    for act in (
        lambda: imported(GPX.format(marks=""), "theirs.gpx", None),
        lambda: exported([ROW], "gpx", load_scenario("square")),
    ):
        with pytest.raises(ConfigError, match="--set 'datum="):
            act()


@pytest.mark.parametrize("kind", FORMATS)
def test_a_plan_is_exported_with_what_is_lost(kind):
    scenario = load_scenario("square", ["datum={latitude: 63.44, longitude: 10.42}"])
    text, notes = exported([ROW, ROW | {"x": 9.0}], kind, scenario)
    assert len(read_route(text, "x").points) == 2
    assert bool(notes) == ("speed" not in FORMATS[kind].holds)
    with pytest.raises(ConfigError, match="empty"):
        exported([], kind, scenario)
