"""The plan on the table: every change is checked before it counts, and can be taken back."""

import pytest

from rovtwin.console import planning
from rovtwin.console.planning import DEPTHS, MOST, Draft, rows_of, square
from rovtwin.core.errors import ConfigError


def places(draft):
    return [(row["x"], row["y"], row["depth"]) for row in draft.rows]


@pytest.fixture
def draft():
    made = Draft()
    made.add({"x": 0.0, "y": 0.0, "depth": 2.0, "speed": 0.3})
    made.add({"x": 4.0, "y": 0.0})
    made.add({"x": 4.0, "y": 4.0})
    return made


def test_what_a_way_point_does_not_say_is_as_before(draft):
    assert places(draft) == [(0.0, 0.0, 2.0), (4.0, 0.0, 2.0), (4.0, 4.0, 2.0)]
    assert {row["speed"] for row in draft.rows} == {0.3}
    draft.insert(0, {"x": 9.0, "y": 9.0})  # nothing before it
    assert places(draft)[0] == (9.0, 9.0, 1.0)
    draft.insert(99, {"x": 8.0, "y": 8.0})
    assert places(draft)[-1] == (8.0, 8.0, 2.0)


def test_points_are_moved_taken_away_and_put_elsewhere(draft):
    draft.edit(1, {"depth": 3.0})
    draft.reorder(2, 0)
    assert places(draft) == [(4.0, 4.0, 2.0), (0.0, 0.0, 2.0), (4.0, 0.0, 3.0)]
    draft.delete(0)
    draft.cancel_last()
    assert places(draft) == [(0.0, 0.0, 2.0)]


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d.edit(3, {"x": 1.0}),
        lambda d: d.delete(-1),
        lambda d: d.reorder(0, 3),
        lambda d: d.add({"x": 1.0}),
        lambda d: d.add({"x": "1", "y": 0.0}),
        lambda d: d.add({"x": 10**400, "y": 0.0}),
        lambda d: d.add({"x": float("nan"), "y": 0.0}),
        lambda d: d.add({"x": 1.0, "y": 0.0, "depth": -1.0}),
        lambda d: d.add({"x": 1.0, "y": 0.0, "speed": 0.0}),
        lambda d: d.add({"x": 1.0, "y": 0.0, "speed": float("inf")}),
        lambda d: d.add({"x": 1.0, "y": 0.0, "thrust": 1.0}),
        lambda d: d.load([{"x": 0.0, "y": 0.0}] * (MOST + 1)),
    ],
)
def test_a_change_that_is_wrong_changes_nothing(draft, change):
    before, undo = places(draft), len(draft._past)
    with pytest.raises(ConfigError):
        change(draft)
    assert places(draft) == before and len(draft._past) == undo and not draft.can_redo


def test_nothing_is_taken_from_an_empty_plan():
    with pytest.raises(ConfigError, match="found 0"):
        Draft().cancel_last()


def test_undo_and_redo_go_both_ways_and_a_change_ends_redo(draft):
    states = [[], *(places(draft)[:n] for n in (1, 2, 3))]
    for state in reversed(states[:-1]):
        draft.undo()
        assert places(draft) == state
    draft.undo()  # no more
    assert not draft.can_undo
    for state in states[1:]:
        draft.redo()
        assert places(draft) == state
    assert not draft.can_redo
    draft.undo()
    draft.clear()
    draft.redo()
    assert places(draft) == []
    draft.undo()
    assert places(draft) == states[2]


def test_so_many_changes_are_kept_and_no_more():
    draft = Draft()
    for i in range(DEPTHS + 7):
        draft.load([{"x": float(i), "y": 0.0}])
    undone = 0
    while draft.can_undo:
        draft.undo()
        undone += 1
    assert undone == DEPTHS


def test_a_file_comes_back_as_it_went(draft):
    draft.edit(1, {"heading_deg": 90.0, "hold_time": 5.0})
    other = Draft()
    other.load(rows_of(draft.as_yaml()))
    assert other.rows == draft.rows


@pytest.mark.parametrize("text", ["", "7", "[1]", "waypoints: []", "{", "waypoints: [{geodetic: [63.4, 10.4, 1.0]}]"])
def test_a_file_that_is_no_mission_is_refused(text):
    with pytest.raises(ConfigError, match="the file"):
        rows_of(text)


def test_what_rows_do_not_say_is_the_vehicle_s_own():
    own = {"speed": 0.32, "acceptance": 0.5}
    made = Draft(own=own)
    made.add({"x": 0.0, "y": 0.0})
    made.load(rows_of("waypoints: [{position: [0, 0, 1]}, {position: [3, 0, 1], speed: 0.1, acceptance: 0.3}]"))
    assert [(row["speed"], row["acceptance"]) for row in made.rows] == [(0.32, 0.5), (0.1, 0.3)]
    made.undo()
    assert made.rows[0].items() >= own.items()


def test_length_and_time(draft):
    assert draft.length() == pytest.approx(8.0)
    draft.edit(2, {"hold_time": 10.0})
    assert draft.seconds() == pytest.approx(8.0 / 0.3 + 10.0)
    assert Draft().length() == Draft().seconds() == 0.0


def test_a_square_comes_back_to_its_corner():
    rows = square(1.0, 2.0, 4.0, 3.0, 0.2)
    assert [(row["x"], row["y"]) for row in rows] == [(1.0, 2.0), (5.0, 2.0), (5.0, 6.0), (1.0, 6.0), (1.0, 2.0)]
    assert planning.Draft().rows == []


@pytest.mark.parametrize("inside", [True, False])
def test_a_lawn_mower_stays_inside_where_that_is_required(inside):
    pytest.importorskip("shapely", reason="needs shapely: pip install 'rovtwin[survey]'")
    from rovtwin.console.surveys import SurveyArea
    from rovtwin.console.web.drafting import _lawnmower

    area = SurveyArea(((0, 0), (8, 0), (8, 8), (0, 8)), 3.0, 0.2, inside)
    rows = _lawnmower(area, 2.0, "double_blueye")
    places = [value for row in rows for value in (row["x"], row["y"])]
    assert len(rows) >= 8 and {row["depth"] for row in rows} == {3.0}
    assert (min(places) >= 0.0 and max(places) <= 8.0) == inside
