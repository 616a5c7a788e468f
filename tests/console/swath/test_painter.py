"""What is painted is what the georeference says was seen; and nothing is, where nothing can be known."""

import base64
import zlib

import numpy as np
import pytest
import shapely
from tests.console.swath.eyes import SOUNDER, fan, picture, scanner, states, straight

from rovtwin.console.swath.cells import CELL, MOST, RETURN, Cells
from rovtwin.console.swath.painter import Depths, Painter, swath_of
from rovtwin.imaging.floor import Plane
from rovtwin.imaging.footprint import footprint_of
from rovtwin.imaging.path import quaternions
from rovtwin.mapping.georeference import Georeference
from rovtwin.mapping.navigation import Navigation
from rovtwin.runs.mapping.request import TURN


def painted(eye, given, floor=None, sounders=(SOUNDER,)):
    painter, depths = Painter(eye), Depths(list(sounders), floor)
    for state in given:
        if (instant := depths.instant(state)) is not None:
            painter.take(instant)
    painter.finish()
    return painter


def middles(cells):
    """North and east of cells that were seen [m]."""
    rows, columns = np.nonzero(np.isfinite(cells.first))
    return (cells.low + np.column_stack([rows, columns]) + 0.5) * cells.cell


@pytest.mark.parametrize("heading", [0.0, 0.9, 2.5])
def test_the_strip_is_what_the_georeference_sees_on_a_flat_floor(heading):
    t, eta = straight(heading=heading)
    painter = painted(fan(), states(t, eta))
    imager, mount = scanner()
    where = Georeference(imager, mount, Navigation(t, eta[:, :3], quaternions(eta[:, 3:])), Plane(5.0)).locate(t)
    edges = where.point[:, [0, -1], :2]
    quads = [shapely.MultiPoint([*a, *b]).convex_hull for a, b in zip(edges[:-1], edges[1:], strict=True)]
    strip = shapely.union_all(quads)
    assert painter.cells.seen_m2 == pytest.approx(strip.area, rel=0.01)
    seen = shapely.points(middles(painter.cells))
    assert shapely.distance(seen, strip).max() <= CELL
    inner = strip.buffer(-CELL)
    box = [
        np.arange(np.floor(lo / CELL), np.ceil(hi / CELL))
        for lo, hi in zip(*np.reshape(inner.bounds, (2, 2)), strict=True)
    ]
    every = (np.stack(np.meshgrid(*box, indexing="ij"), axis=-1).reshape(-1, 2) + 0.5) * CELL
    inside = {tuple(np.round(one, 3)) for one in every[shapely.contains_xy(inner, *every.T)]}
    assert inside and inside <= {tuple(np.round(one, 3)) for one in middles(painter.cells)}


def test_a_picture_is_painted_while_it_stands():
    painter = painted(picture(), states([0.0, 1.0, 2.0], [[2.0, 3.0, 3.0, 0, 0, 0]] * 3))
    size = 2 * 2.0 * np.tan(np.radians([20.0, 30.0]))
    assert painter.cells.seen_m2 == pytest.approx(np.prod(size), rel=0.05)
    assert middles(painter.cells).mean(axis=0) == pytest.approx([2.0, 3.0], abs=CELL)


def test_the_swath_is_that_of_the_footprint():
    imager, mount = scanner()
    seen = footprint_of(imager, mount, 1.6)
    width, middle = swath_of(fan(), 1.6)
    assert width == pytest.approx(seen.level_width, rel=1e-6) and middle == pytest.approx(seen.middle, abs=1e-6)
    assert swath_of(picture(), 2.0)[0] == pytest.approx(4.0 * np.tan(np.radians(30.0)))
    assert swath_of(fan(reach=1.0), 3.0) is None


def test_the_altimeter_is_taken_where_it_sits_and_points():
    """At a tilt of 10 deg its reading is longer than the height; the floor below is as deep as it is."""
    (state,) = states([0.0], [[0, 0, 3.0, 0.1, 0.17, 0]], floor=5.0)
    assert state["sensors"]["altimeter"]["value"][0] > 1.95
    assert Depths([SOUNDER], None).instant(state).floor == pytest.approx(5.0)


def reading(value, age=0.05):
    return {"altimeter": {"age": age, "value": [value]}}


def silent(state):
    return state | {"sensors": reading(1.5, 1.5)}


REASONS = {
    "a link that is silent": (lambda s: s | {"link_age": 1.5}, "nothing comes from the vehicle"),
    "an altimeter that is silent": (silent, "no height by altimeter"),
    "no reading yet": (
        lambda s: s | {"sensors": {"altimeter": {"age": None, "value": None}}},
        "no height by altimeter",
    ),
    "a floor out of reach": (lambda s: s | {"sensors": reading(15.0)}, "no ray meets the floor within 12 m"),
    "an altimeter that looks up": (lambda s: s | {"eta": [*s["eta"][:3], np.pi, 0.0, 0.0]}, "below the floor"),
}


@pytest.mark.parametrize("case", REASONS)
def test_nothing_is_painted_of(case):
    change, why = REASONS[case]
    painter = painted(fan(), [change(state) for state in states(*straight(5.0))])
    assert painter.cells.message() is None and painter.began is None
    assert why in painter.why


def test_without_an_altimeter_the_worlds_floor_counts_and_without_that_nothing():
    given = states(*straight(5.0))
    known = painted(fan(), given, floor=5.0, sounders=())
    assert known.cells.seen_m2 > 1.0 and Depths([], 5.0).source == "the world's floor"
    unknown = painted(fan(), given, sounders=())
    assert unknown.cells.seen_m2 == 0.0 and unknown.why == "the height over the floor is not known"
    silent_now = painted(fan(), [silent(state) for state in given], floor=5.0)
    assert silent_now.cells.seen_m2 == 0.0  # an altimeter that fails is no reason to trust the world's floor


@pytest.mark.parametrize(("share", "seen"), [(0.9, True), (1.1, False)])
def test_turns_are_left_out_above_the_maps_limit(share, seen):
    t, eta = straight(10.0)
    eta[:, 5] = share * TURN * t
    painter = painted(fan(), states(t, eta))
    assert (painter.cells.seen_m2 > 0.0) == seen and (painter.why == "") == seen


def test_a_turn_between_two_lines_leaves_the_lines():
    """The map takes lines up to half a COURSE before a turn: what was flown then is painted, late."""
    t, eta = straight(20.0)
    eta[:, 5] = np.radians(30.0) * np.clip(t - 10.0, 0.0, 3.0)
    navigation = Navigation(t, eta[:, :3], quaternions(eta[:, 3:]))
    counted = np.abs(navigation.turn_rates(t, 1.5)) <= TURN
    painter = painted(fan(), states(t, eta))
    assert 10.0 - 0.5 * 1.5 - 0.1 < t[~counted].min() < 10.0
    times = painter.cells.first[np.isfinite(painter.cells.first)]
    assert not ((times > t[~counted].min() + 0.06) & (times < t[~counted].max() - 0.06)).any()
    assert times.max() > 19.0 and (times < t[~counted].min()).any()


def test_no_strip_leads_over_a_gap_of_time():
    t, eta = straight(30.0)
    there = (t < 10.0) | (t > 20.0)
    painter = painted(fan(), states(t[there], eta[there]))
    whole = painted(fan(), states(t, eta)).cells.seen_m2
    assert painter.cells.seen_m2 == pytest.approx(2.0 / 3.0 * whole, rel=0.02)


def test_no_strip_leads_over_a_leap_of_the_estimate():
    """A position that comes back after a while puts the estimate right: nobody saw what lies between."""
    t, eta = straight(20.0)
    eta[t > 10.0, 0] += 5.0
    leapt, whole = painted(fan(), states(t, eta)), painted(fan(), states(*straight(20.0)))
    assert leapt.cells.seen_m2 == pytest.approx(whole.cells.seen_m2, rel=0.02)


def test_a_state_without_a_number_is_passed_over():
    given = states(*straight(20.0))
    given[150]["eta"][3] = given[151]["eta"][0] = None
    given[152]["eta"] = None
    whole = painted(fan(), states(*straight(20.0)))
    assert painted(fan(), given).cells.seen_m2 == pytest.approx(whole.cells.seen_m2, rel=1e-3)


def test_rays_at_the_end_of_their_reach_come_and_go():
    """Of a fan that just reaches the floor, outer rays are lost while it rolls; the strip is what is in reach."""
    painter = painted(fan(reach=1.6), states(*straight(20.0)))
    width = 2.0 * np.sqrt(1.6**2 - 1.49**2)
    assert painter.cells.seen_m2 == pytest.approx(0.3 * 20.0 * width, rel=0.15)


def test_what_was_out_of_view_is_seen_a_second_time():
    once = painted(fan(), states(*straight(20.0)))
    assert once.cells.passes.max() == 1
    t, eta = straight(20.0)
    back = painted(fan(), [*states(t, eta), *states(t + 20.0 + RETURN, eta[::-1])])
    assert (back.cells.passes == 2).sum() > 0.95 * (back.cells.passes > 0).sum()
    still = painted(fan(), states(np.arange(0.0, 60.0, 0.1), np.tile(eta[:1], (600, 1))))
    assert still.cells.passes.max(initial=0) <= 1


def test_an_hours_dive_stays_within_the_memory_and_keeps_its_area():
    """Over 900 x 1200 m: cells are put together, and the strips stay about as large as they are."""
    cells, t, area = Cells(), 0.0, 0.0
    for line in range(30):
        for step in range(30):
            low, east = np.array([40.0 * step, 30.03 * line]) - 400.7
            cells.paint(np.array([[low, east], [low + 40.0, east], [low + 40.0, east + 8.0], [low, east + 8.0]]), t)
            t, area = t + 4.0, area + 40.0 * 8.0
    assert cells.first.size <= MOST and cells.cell > CELL
    assert cells.seen_m2 == pytest.approx(area, rel=0.05)


@pytest.mark.parametrize("times", [False, True])
def test_pages_can_unpack_what_was_seen(times):
    t, eta = straight(20.0)
    painter = painted(fan(), [*states(t, eta), *states(t + 30.0, eta)])
    message = painter.cells.message(times=times)
    numbers = np.frombuffer(zlib.decompress(base64.b64decode(message["data"])), "<u2" if times else np.uint8)
    shape = (message["rows"], message["columns"])
    assert message["north"] == pytest.approx(middles(painter.cells)[:, 0].min() - 0.5 * CELL)
    if times:
        first, second = numbers.reshape(2, *shape)
        at = np.where(first < 65535, message["begin"] + message["step"] * first, np.inf)
        assert ((first < 65535) & (second < 65535)).sum() > 0.95 * (first < 65535).sum()
        assert np.isfinite(at).sum() * CELL**2 == pytest.approx(painter.cells.seen_m2)
        halfway = painted(fan(), [state for state in states(t, eta) if state["t"] <= 10.75])
        assert (at <= 10.75).sum() * CELL**2 == pytest.approx(halfway.cells.seen_m2, rel=0.02)
    else:
        assert set(np.unique(numbers)) <= {0, 1, 2} and numbers.size == np.prod(shape)
        assert (numbers > 0).sum() * CELL**2 == pytest.approx(painter.cells.seen_m2)
