"""Pieces of a map: gaps beyond its edge, runs that are used, places without a number, old files, losses, the note."""

from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest
from tests.imaging.helper import cut, head
from tests.mapping.helper import moving
from tests.runs.mapping.test_sources import CUBE

from rovtwin.core.errors import ConfigError
from rovtwin.imaging.lines_writer import write_lines
from rovtwin.mapping.alignment.strips import straight_runs
from rovtwin.mapping.alignment.ties import Ties
from rovtwin.mapping.cells.grid import Grid
from rovtwin.report.mapping import figures
from rovtwin.runs.mapping.area import gaps_of, hull_of
from rovtwin.runs.mapping.control import read_control
from rovtwin.runs.mapping.make import _laid_out
from rovtwin.runs.mapping.output.losses import losses
from rovtwin.runs.mapping.output.noting import WHAT, hashes_of, remove_old, settings_of
from rovtwin.runs.mapping.points import Point, read_points, without_value
from rovtwin.runs.mapping.registering import _untried, filled, used_runs
from rovtwin.runs.mapping.request import MapRequest
from rovtwin.runs.mapping.residuals import Residuals
from rovtwin.runs.mapping.sources import Inputs, open_inputs

GRID = Grid("EPSG:32632", 100.0, 50.0, 0.1, 40, 60)  # 6 x 4 m


@pytest.fixture
def inputs(tmp_path):
    there = open_inputs(None, MapRequest(write_lines(tmp_path / "lines.h5", head(), [CUBE])))
    with there.lines:
        yield there


def test_an_area_that_reaches_beyond_the_mosaic_has_its_gap_there():
    seen = np.ones(GRID.shape, bool)
    seen[:10, :10] = False  # 1 m2
    ring = np.array([[98.0, 46.0], [106.0, 46.0], [106.0, 51.0], [98.0, 51.0], [98.0, 46.0]])  # 40 m2
    gaps, wide = gaps_of([[ring]], seen, GRID)
    assert gaps.sum() * 0.01 == pytest.approx(40.0 - 24.0 + 1.0, abs=0.01)
    cells = np.array([[100.05, 49.95], [99.95, 49.95], [101.05, 48.95]])  # not seen, beyond, seen
    assert gaps.ravel()[wide.number(cells)].tolist() == [True, True, False]
    inside, same = gaps_of(hull_of(seen, GRID), seen, GRID)
    assert same == GRID and 0 < inside.sum() * 0.01 < 0.6


def test_runs_are_cut_where_lines_are_not_used():
    navigation, t = moving(seconds=20.0), np.arange(0.0, 20.0, 0.05)
    runs = straight_runs(navigation, t)
    use = (t < 8.0) | (t > 9.0)
    use[t > 11.0] = False
    pieces = used_runs(runs, t, use)
    assert len(runs) == 1 and len(pieces) == 1  # of 9 to 11 s is too short
    assert t[pieces[0][-1]] < 8.0 and use[pieces[0]].all()


def test_patches_that_were_not_tried_are_counted_in_a_remark():
    none = Ties(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0))
    assert _untried(none) == []
    (remark,) = _untried(replace(none, untried=500))
    assert remark.startswith("of 2500 patches of the overlaps 2000")


def test_nodes_without_a_floor_take_the_value_of_the_nearest_that_has_one():
    table = np.array([[0.0, 0.0, 3.0], [0.0, 2.0, 4.0]])
    found = filled(table, table > 0)
    assert found[1].tolist() == [2.0, 2.0, 4.0] and found[0, 1] in (2.0, 3.0) and found[0, 0] == 2.0
    assert np.isnan(filled(table, np.zeros((2, 3), bool))).all()


@pytest.mark.parametrize("text", ["nan", "inf", "", "x"])
def test_a_place_that_is_no_number_is_named(tmp_path, inputs, text):
    path = tmp_path / "p.csv"
    path.write_text(f"name,north,east\nA,1,2\nB,{text},2\n")
    with pytest.raises(ConfigError, match=rf"row 3 \(B\): found '{text}' for north.*take the row out"):
        read_points(path, inputs.datum)
    path.write_text(f"name,line,pixel,north,east,sd\nB,1,2,{text},2,0.1\n")
    with pytest.raises(ConfigError, match=rf"row 2 \(B\): found '{text}' for north"):
        read_control(path, inputs, inputs.times, np.ones(7, bool))


def test_control_points_of_lines_that_are_not_used_are_left_out_and_named(tmp_path, inputs):
    path = tmp_path / "p.csv"
    path.write_text("name,line,pixel,north,east,sd\nA,1,2,0,0,0.1\nB,5,2,0,0,0.1\n")
    control, remarks = read_control(path, inputs, inputs.times, np.arange(7) < 4)
    assert control is not None and control.names == ("A",) and len(control.t) == 1 and "left out: B" in remarks[0]
    path.write_text("name,line,pixel,north,east,sd\nA,9,2,0,0,0.1\n")
    with pytest.raises(ConfigError, match=r"row 2 \(A\): found line 9"):
        read_control(path, inputs, inputs.times, np.ones(7, bool))


def test_control_points_count_through_all_files_or_in_the_one_they_name(tmp_path):
    whole = write_lines(tmp_path / "lines.h5", head(), [CUBE])
    pieces = cut(whole, tmp_path / "cut", [2, 3])
    points = tmp_path / "p.csv"
    rows = [f"A,{pieces[2].name},1,2,0,0,0.1", "B,,4,2,0,0,0.1", f"C,{pieces[1]},0,2,0,0,0.1"]
    points.write_text("\n".join(["name,file,line,pixel,north,east,sd", *rows]) + "\n")
    several = open_inputs(None, MapRequest((tmp_path / "cut",)))
    with several.lines:
        control, _ = read_control(points, several, several.times, np.ones(7, bool))
        assert control is not None and np.array_equal(control.t, several.times[[4, 4, 2]])
        for name, line, message in (
            ("x.h5", 1, r"row 2 \(D\): found the file 'x.h5', which is 0 of the files of lines"),
            (pieces[1].name, 1, r"found line 1, .*expected lines from 0 to 0"),
        ):
            points.write_text(f"name,file,line,pixel,north,east,sd\nD,{name},{line},2,0,0,0.1\n")
            with pytest.raises(ConfigError, match=message):
                read_control(points, several, several.times, np.ones(7, bool))


def test_a_tie_says_the_line_of_each_file(inputs):
    there = Residuals(None, None, np.zeros((0, 2)), 5.0, (2, 1, 4), ("a", "b", "c"))  # type: ignore[arg-type]  (parts that are not used)
    found = there._in_files(np.array([1.25, 2.0, 3.5]))
    assert found == {"files": ["a", "b", "c"], "lines_in_files": [1.25, 0.0, 0.5]}
    assert replace(there, counts=(7,), files=("a",))._in_files(np.array([1.25])) == {}


def test_files_of_one_name_have_each_their_hash(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        write_lines(tmp_path / name / "lines.h5", replace(head(), t=head().t + 9.0 * (name == "two")), [CUBE])
    several = open_inputs(None, MapRequest((tmp_path / "one", tmp_path / "two" / "lines.h5")))
    with several.lines:
        assert set(hashes_of(several, "lines")) == {"one/lines.h5", "two/lines.h5"}
    for name in ("may", "june"):
        (tmp_path / name / "dive").mkdir(parents=True)
        write_lines(tmp_path / name / "dive" / "l.h5", replace(head(), t=head().t + 9.0 * (name == "may")), [CUBE])
    alike = open_inputs(None, MapRequest(tuple(tmp_path / name / "dive" / "l.h5" for name in ("may", "june"))))
    with alike.lines:
        assert set(hashes_of(alike, "lines")) == {"may/dive/l.h5", "june/dive/l.h5"}
    (tmp_path / "none").mkdir()
    with pytest.raises(ConfigError, match="none: is a folder without files"):
        _ = MapRequest((tmp_path / "none",)).files


def test_places_without_a_value_are_named():
    some, none = np.array([0.1, np.nan]), np.full(2, np.nan)
    points = [Point("A", np.zeros(2), some, some, None), Point("B", np.zeros(2), none, none, some)]
    assert without_value(points) == ["places outside the mosaic, or where nothing was seen: B"]
    assert without_value(points[:1]) == []


def test_files_of_an_older_mosaic_are_removed_and_others_stay(tmp_path):
    for name in (*WHAT, "cube.hdr", "thesis.tex"):
        (tmp_path / name).write_text("old")
    remove_old(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_pixels_beyond_the_edge_and_cells_without_a_colour_are_counted():
    seen, rgb = np.ones((2, 2), bool), np.full((2, 2, 3), 0.5)
    rgb[0, 0, 1] = np.nan
    layers = {"coverage": (np.array([[3.0, 2.0], [1.0, np.nan]], np.float32), "1")}
    bands, masked = np.array([500.0, 730.0, 740.0]), np.array([0.5, 1.0, 1.0])
    joined = SimpleNamespace(layers=layers, rgb=rgb, seen=seen, direct=seen, masked=masked)
    words = " ".join(losses({"missed": 2, "saturated": 4, "samples": 100}, joined, 15, bands))
    assert "7 pixels lie beyond" in words and "25.0% of the cells seen have no number in red, green or blue" in words
    rgb[0, 0, 1] = 0.5
    assert "masked whole, as noise hides 99% of their cells or more: 730 to 740 nm" in words
    joined.masked = np.zeros(3)
    assert losses({"missed": 2}, joined, 8, bands) == ["2 pixels see no floor within reach"]


def test_the_grid_has_a_margin_and_the_map_holds_the_area(inputs):
    place, area = np.array([[0.0, 0.0], [2.0, 1.0]]), [[np.array([[-9.0, -9.0], [9.0, 0.0], [0.0, 9.0], [-9.0, -9.0]])]]
    projection, grid = _laid_out(inputs, place, area, 5.0)
    assert (projection.low < -9.0).all() and (projection.high > 9.0).all()
    xy = projection.to_map(place)
    assert (xy.min(0) - [grid.left, grid.top - grid.rows * grid.cell] > 0.045).all()
    assert ([grid.left + grid.columns * grid.cell, grid.top] - xy.max(0) > 0.045).all() and grid.columns < 150


def test_the_note_has_all_that_was_asked_for_and_a_hash_of_each_file(inputs, tmp_path):
    (tmp_path / "control.csv").write_text("x")
    (tmp_path / "smoothed_keys.nc").write_text("x")
    (tmp_path / "grey.csv").write_text("x")
    (tmp_path / "panel.yaml").write_text("{north: 1, east: 2, radius: 0.1, reflectance: grey.csv}")
    request = MapRequest(inputs.lines.path, control=tmp_path / "control.csv", panel=tmp_path / "panel.yaml")
    there = Inputs(tmp_path, None, None, inputs.lines, request)
    other = {"depth": "depth_m", "heights": "dem_values", "resolution": "resolution_m", "best": "blend"}
    other |= {"turn": "turn_deg_s", "clock_offset": "clock_offset_s", "begin": "from_s", "end": "to_s"}
    names = {other.get(field.name, field.name) for field in fields(MapRequest)} - {"datum"}  # the note has it beside
    assert names <= set(settings_of(there, "smoothed"))
    assert {"lines.h5", "control.csv", "panel.yaml", "grey.csv", "smoothed_keys.nc"} == set(
        hashes_of(there, "smoothed")
    )
    assert "smoothed_keys.nc" not in hashes_of(there, "estimate")


def test_cells_without_a_colour_are_hatched():
    rgb = np.full((8, 10, 4), 255, np.uint8)
    without = np.zeros((8, 10), bool)
    plain = figures.picture(figures.Sheet(rgb, 0.0, 0.0, 0.1, "EPSG:32632", (0.0, 0.0), without), [])
    without[2:5, 3:6] = True
    hatched = figures.picture(figures.Sheet(rgb, 0.0, 0.0, 0.1, "EPSG:32632", (0.0, 0.0), without), [])
    found = [[one for one in shown.axes[0].collections if getattr(one, "hatches", None)] for shown in (plain, hatched)]
    assert not found[0] and len(found[1]) == 1
