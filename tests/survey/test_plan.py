"""Plans: what they see, what they keep clear of, which heading is best, how lines lie."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from rovtwin.core.errors import ConfigError
from rovtwin.survey.lines import bands
from rovtwin.survey.pace import Pace
from rovtwin.survey.plan import plan_survey
from rovtwin.survey.room import Swath

PACE = Pace(speed=0.2, speeding=0.1, slowing=0.2, turning_rate=0.5, turning=0.5, settling=2.0)
SWATH = Swath(1.2, 0.2)
CLEARANCE = 0.3


def area(outline, *holes):
    return shapely.MultiPolygon([shapely.Polygon(outline, holes)])


SQUARE = area([(0, 0), (12, 0), (12, 9), (0, 9)])
U = area([(0, 0), (15, 0), (15, 5), (5, 5), (5, 10), (15, 10), (15, 15), (0, 15)])
ROUND = area([(5.0 * np.cos(a), 5.0 * np.sin(a)) for a in np.linspace(0.0, 2.0 * np.pi, 4000, endpoint=False)])
RING = area([(0, 0), (14, -2), (15, 12), (1, 11)], [(5, 4), (9, 3), (10, 7), (6, 8)])


def star(draw, low, high, corners, middle=(0.0, 0.0)):
    """A star-shaped outline, concave as it comes."""
    angles = np.sort(draw(st.lists(st.floats(0, 1), min_size=corners, max_size=corners)))
    angles = 2 * np.pi * (np.arange(corners) + 0.8 * angles) / corners
    radii = np.array(draw(st.lists(st.floats(low, high), min_size=corners, max_size=corners)))
    return np.array(middle) + radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)


@st.composite
def areas(draw):
    """Outlines 8 to 20 m across, with up to three holes anywhere, cut off by the outline or each other as it comes."""
    outline = shapely.Polygon(star(draw, 4, 10, draw(st.integers(4, 8)))).buffer(0)
    for _ in range(draw(st.integers(0, 3))):
        middle = (draw(st.floats(-6, 6)), draw(st.floats(-6, 6)))
        outline = outline.difference(shapely.Polygon(star(draw, 0.5, 2, draw(st.integers(3, 5)), middle)).buffer(0))
    parts = [part for part in shapely.get_parts(outline) if part.geom_type == "Polygon" and part.area > 4]
    return shapely.MultiPolygon(parts)


def holes_of(shape):
    return shapely.union_all([shapely.Polygon(ring) for part in shape.geoms for ring in part.interiors])


@settings(max_examples=15)
@given(areas(), st.floats(0, np.pi), st.booleans())
def test_all_that_can_be_reached_is_seen_and_no_leg_crosses_a_hole(shape, heading, inside):
    if not shape.geoms:
        return
    try:
        plan = plan_survey(shape, SWATH, PACE, CLEARANCE, heading, inside, 0.2)
    except ConfigError as error:
        assert inside and "nowhere in it" in str(error)
        return
    assert plan.coverage_of_reachable >= 0.995
    way, holes = shapely.LineString(plan.path.points), holes_of(shape)
    if not holes.is_empty:
        assert way.distance(holes) >= CLEARANCE - 0.01
    if inside:
        assert shape.buffer(-CLEARANCE + 0.01).covers(way)
    elif not holes.is_empty and not plan.short_leads:
        assert plan.coverage > 0.9
    # Legs are as many as the points say, and way-points are those at which it bends.
    assert len(plan.path.sees) == len(plan.path.points) - 1
    assert np.allclose(plan.path.corners[[0, -1]], plan.path.points[[0, -1]])


@pytest.mark.system
@pytest.mark.parametrize("shape", [SQUARE, U, RING], ids=["square", "u", "ring"])
def test_auto_is_no_worse_than_any_of_36_headings(shape):
    best = plan_survey(shape, SWATH, PACE, CLEARANCE).seconds
    for heading in np.radians(np.arange(0, 360, 10)):
        assert best <= plan_survey(shape, SWATH, PACE, CLEARANCE, heading).seconds + 1e-6


def test_a_rectangle_is_mown_along_its_longer_side():
    plan = plan_survey(SQUARE, SWATH, PACE, CLEARANCE)
    assert plan.lines.heading == pytest.approx(0.0) and len(plan.lines.cells) == 1
    assert len(plan.lines.all) == 10 and plan.coverage == pytest.approx(1.0)
    assert plan.turns == 2 * 9 and plan.detours == 0
    assert plan.seeing == pytest.approx(10 * 12)


@settings(max_examples=40)
@given(st.floats(-50, 50), st.floats(0.1, 60), st.floats(0.3, 5), st.floats(0, 0.9))
def test_spacing_holds(low, size, width, overlap):
    swath = Swath(width, overlap)
    middles, edges = bands(low, low + size, swath)
    assert edges[0] == low and edges[-1] == pytest.approx(low + size)
    assert (np.diff(middles) <= swath.spacing + 1e-9).all()
    assert np.allclose(np.diff(middles), np.diff(middles).mean() if len(middles) > 1 else 0)
    # Everything between the limits lies within half a swath of a line, and one line less would not do.
    assert max(middles[0] - low, low + size - middles[-1]) <= 0.5 * width + 1e-9
    assert len(middles) == 1 or (len(middles) - 2) * swath.spacing + width < size + 1e-6


def test_a_bay_and_a_hole_make_cells():
    assert len(plan_survey(U, SWATH, PACE, CLEARANCE, 0.0).lines.cells) == 1  # along the bay: one line after the other
    assert len(plan_survey(U, SWATH, PACE, CLEARANCE, np.pi / 2).lines.cells) == 3
    ring = plan_survey(RING, SWATH, PACE, CLEARANCE, 0.0)
    assert len(ring.lines.cells) >= 4 and len(ring.room.laps) == 1
    assert ring.path.sees[1:-1].sum() > 0


def test_leads_let_the_vehicle_settle():
    plan = plan_survey(SQUARE, SWATH, PACE, CLEARANCE, 0.0, acceptance=0.2)
    lines = plan.path.points[:4]
    assert np.linalg.norm(lines[1] - lines[0]) == pytest.approx(PACE.lead_in)
    assert np.linalg.norm(lines[3] - lines[2]) == pytest.approx(PACE.lead_out + 0.2)
    assert plan.short_leads == 0 and plan.outside == pytest.approx(PACE.lead_in)


def test_inside_the_outline_is_not_left():
    plan = plan_survey(U, SWATH, PACE, CLEARANCE, inside=True)
    assert plan.outside == 0 and plan.coverage_of_reachable > 0.995
    assert U.buffer(-CLEARANCE + 0.01).covers(shapely.LineString(plan.path.points))


def test_parts_that_lie_apart_are_joined_and_it_is_reported():
    apart = shapely.MultiPolygon([SQUARE.geoms[0], shapely.box(40, 0, 50, 9)])
    plan = plan_survey(apart, SWATH, PACE, CLEARANCE)
    assert plan.coverage == pytest.approx(1.0, abs=1e-6) and plan.detours > 15 and plan.outside > 5


def test_an_island_in_a_moat_stays_unseen():
    moat = [(20, 20), (40, 20), (40, 40), (20, 40)]
    shape = shapely.MultiPolygon(
        [shapely.Polygon([(0, 0), (60, 0), (60, 60), (0, 60)], [moat]), shapely.box(28, 28, 32, 32)]
    )
    plan = plan_survey(shape, Swath(4.0), PACE, CLEARANCE, 0.0)
    assert plan.gaps.area == pytest.approx(16, rel=0.05)
    assert plan.coverage_of_reachable > 0.995


def test_times_follow_from_speed_acceleration_and_turns():
    assert PACE.leg(np.array(10.0)) == pytest.approx(10 / 0.2 + 0.5 * 0.2 / 0.1 + 0.5 * 0.2 / 0.2)
    short = 0.1  # accelerates to a peak: 2 s / v_peak, v_peak^2 (1/a + 1/d) / 2 = s
    assert PACE.leg(np.array(short)) == pytest.approx(2 * short / np.sqrt(2 * short / (1 / 0.1 + 1 / 0.2)))
    assert PACE.turn(np.array(np.pi)) == pytest.approx(np.pi / 0.5 + 0.5 / 0.5)
    legs, turns = PACE.times(np.array([[0, 0], [10, 0], [10, 1], [0, 1.0]]))
    assert legs.sum() == pytest.approx(2 * PACE.leg(np.array(10.0)) + PACE.leg(np.array(1.0)))
    np.testing.assert_allclose(turns, PACE.turn(np.array(np.pi / 2)))


def test_a_long_corridor_is_no_area_of_many_lines():
    """Its lines are few and long: 10 km of 10 m take less than a square of 320 m."""
    corridor = area([(0, 0), (4000, 0), (4000, 10), (0, 10)])
    plan = plan_survey(corridor, Swath(2.5), PACE, CLEARANCE, heading=0.0)
    assert len(plan.lines.all) == 5


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: Swath(0.0), "swath: found 0 m"),
        (lambda: Swath(float("nan")), "swath: found nan m"),
        (lambda: Swath(1.0, 1.0), "overlap: found 1, expected"),
        (lambda: Swath(1.0, -0.1), "overlap: found -0.1"),
        (lambda: plan_survey(SQUARE, Swath(20.0), PACE, CLEARANCE), "wider than the whole area of 12 x 9 m"),
        (lambda: plan_survey(SQUARE, SWATH, PACE, 6.0, inside=True), "nowhere in it"),
        (lambda: plan_survey(SQUARE, Swath(1e-4), PACE, CLEARANCE), "swath: 0.0001 m takes some 129,904 lines"),
        (lambda: plan_survey(ROUND, SWATH, PACE, CLEARANCE), "area: found outlines of 4,001 corners, expected at most"),
    ],
)
def test_what_cannot_be_is_named(make, message):
    with pytest.raises(ConfigError, match=message):
        make()
