"""What of an area is missing: share, outlines, and lines over them."""

import numpy as np
import pytest
import shapely

from rovtwin.console.surveys import SurveyArea
from rovtwin.console.swath.cells import MOST, Cells
from rovtwin.console.swath.gaps import LISTED, Seen, lines_over, share_seen
from rovtwin.core.errors import ConfigError

SQUARE = ((0.0, 0.0), (8.0, 0.0), (8.0, 8.0), (0.0, 8.0))
EYE = {"name": "uhi.camera", "imager": "uhi", "width": 1.1, "middle": [0.2, 0.0]}


def seen_of(*boxes, corners=SQUARE):
    """Boxes (south, north, west, east) that were seen [m], over the box of an area."""
    cells = Cells()
    for south, north, west, east in boxes:
        cells.paint(np.array([[south, west], [north, west], [north, east], [south, east]]), 0.0)
    return Seen.of(*cells.window(np.min(corners, axis=0), np.max(corners, axis=0)))


def test_the_share_is_that_of_the_areas():
    found = share_seen(SQUARE, seen_of((-1.0, 9.0, -1.0, 2.0), (-1.0, 9.0, 3.0, 9.0)))
    assert found["area_m2"] == pytest.approx(64.0) and found["share"] == pytest.approx(7 / 8, abs=1e-9)
    assert found["count"] == 1 and found["gaps_m2"] == pytest.approx(8.0)
    (gap,) = found["gaps"]
    assert shapely.Polygon(gap["rings"][0]).symmetric_difference(shapely.box(0, 2, 8, 3)).area < 0.05
    assert gap["area_m2"] == pytest.approx(8.0)


def test_nothing_seen_and_all_seen():
    nothing = share_seen(SQUARE, seen_of())
    assert nothing["share"] == 0.0 and nothing["gaps_m2"] == pytest.approx(64.0)
    everything = share_seen(SQUARE, seen_of((-1, 9, -1, 9)))
    assert (everything["share"], everything["count"], everything["gaps"]) == (1.0, 0, [])


def strip():
    """Cells of a strip of 10 x 0.3 m."""
    cells = Cells()
    cells.paint(np.array([[20.0, 30.0], [30.0, 30.0], [30.0, 30.3], [20.0, 30.3]]), 1.0)
    return cells


@pytest.mark.parametrize("side", [12.0, 200.0, 1000.0])
def test_an_area_of_any_size_leaves_what_was_painted(side):
    """Beyond a million cells the share is judged on a coarser copy; the strip lies in the area's south-western part."""
    cells = strip()
    before = cells.cell, cells.low.copy(), cells.first.copy(), cells.seen_m2
    corners = tuple((19.0 + side * x, 29.0 + side * y) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)))
    seen = Seen.of(*cells.window(np.min(corners, axis=0), np.max(corners, axis=0)))
    assert cells.cell == before[0] and (cells.low == before[1]).all() and cells.seen_m2 == before[3] == strip().seen_m2
    assert np.array_equal(cells.first, before[2])
    assert np.prod(seen.shape) <= MOST
    assert share_seen(corners, seen)["share"] == pytest.approx(3.0 / side**2, rel=0.01)


def test_a_box_beside_what_was_painted_has_seen_nothing():
    for cells in (strip(), Cells()):
        shares, first, cell = cells.window(np.array([-8.0, 0.0]), np.array([-6.0, 40.0]))
        assert shares.shape == (40, 800) and not shares.any()
        assert (first * cell) == pytest.approx([-8.0, 0.0])


def test_a_slanting_area_and_a_gap_with_an_island():
    """Of a triangle; what was seen amid a gap is its hole."""
    triangle = ((0.0, 0.0), (8.0, 0.0), (0.0, 8.0))
    found = share_seen(triangle, seen_of((1, 3, 1, 3), corners=triangle))
    assert found["area_m2"] == pytest.approx(32.0, rel=0.01)
    assert found["share"] == pytest.approx(4 / 32, rel=0.02)
    (gap,) = found["gaps"]
    assert len(gap["rings"]) == 2 and shapely.Polygon(gap["rings"][1]).area == pytest.approx(4.0, rel=0.05)


def test_a_large_area_is_outlined_coarsely_and_its_gaps_are_counted():
    large = tuple((5 * x, 5 * y) for x, y in SQUARE)
    rows = [(40 * k / 50, 40 * k / 50 + 0.4, -1, 41) for k in range(50)]
    found = share_seen(large, seen_of(*rows, corners=large))
    assert found["share"] == pytest.approx(0.5, abs=0.01)
    assert found["count"] == 50 and len(found["gaps"]) == LISTED
    assert found["gaps_m2"] == pytest.approx(800.0, rel=0.02)


@pytest.mark.system
def test_lines_lie_over_the_gap_alone():
    area = SurveyArea(SQUARE, 3.4, 0.2, False)
    rows = lines_over(area, seen_of((-1, 9, -1, 3), (-1, 9, 4, 9)), "double_blueye", EYE, 5.0)
    assert {(row["depth"], row["speed"]) for row in rows} == {(3.4, 0.2)}
    path = shapely.LineString([(row["x"], row["y"]) for row in rows])
    strip = path.buffer(0.55, cap_style="flat")
    assert strip.intersection(shapely.box(0, 3, 8, 4)).area > 0.99 * 8.0
    assert abs(np.array([row["y"] for row in rows]) - 3.5).max() < 0.3


@pytest.mark.system
def test_lines_over_the_gaps_of_a_camera_and_of_a_vehicle_that_is_described():
    from rovtwin.vehicle import load_vehicle

    area, described = SurveyArea(SQUARE, 3.4, 0.2, True), load_vehicle("bluerov2_heavy").to_dict()
    camera = {"name": "sonar", "imager": "", "width": 1.2, "middle": [0.0, 0.0]}
    rows = lines_over(area, seen_of((-1, 9, -1, 3), (-1, 9, 5, 9)), described, camera, 5.0)
    assert all(0 <= row[key] <= 8 for row in rows for key in ("x", "y"))


@pytest.mark.system
@pytest.mark.parametrize("vehicle", ["double_blueye", "bluerov2_heavy"])
@pytest.mark.parametrize("middle", [(0.0, 0.0), (0.0, 0.5), (0.4, -0.5)])
def test_lines_lie_where_the_eye_looks(vehicle, middle):
    """What it sees on the long legs, to their side and ahead, covers the gap; one vehicle has an imager of its own."""
    eye = {"name": "pod.mbes", "imager": "", "width": 1.2, "middle": list(middle)}
    rows = lines_over(SurveyArea(SQUARE, 3.4, 0.2, False), seen_of((-1, 9, -1, 3), (-1, 9, 4, 9)), vehicle, eye, 5.0)
    places = np.array([(row["x"], row["y"]) for row in rows])
    strips = []
    for begin, end in zip(places[:-1], places[1:], strict=True):
        if (length := np.linalg.norm(end - begin)) > 5.0:
            ahead = (end - begin) / length
            moved = ahead * middle[0] + np.array([-ahead[1], ahead[0]]) * middle[1]
            strips.append(shapely.LineString([begin + moved, end + moved]).buffer(0.6, cap_style="flat"))
    assert shapely.union_all(strips).intersection(shapely.box(0, 3, 8, 4)).area > 0.99 * 8.0
    offs = np.abs(places[:, 1] - 3.5)
    assert offs.max() == pytest.approx(abs(middle[1]), abs=0.2)


def test_it_is_refused_in_words_where_nothing_is_missing():
    with pytest.raises(ConfigError, match="nothing is missing"):
        lines_over(SurveyArea(SQUARE, 3.4, 0.2, False), seen_of((-1, 9, -1, 9)), "double_blueye", EYE, 5.0)
