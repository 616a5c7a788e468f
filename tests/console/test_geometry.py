"""Plane geometry and thinning of the chart, in the browser that will run them."""

import math
from typing import Any

import pytest


@pytest.fixture
def module(open_views):
    """`module(script, argument)` runs `async (g, argument) => ...` with all of geometry.js and track.js as `g`."""
    page = open_views("chart")
    load = "{...await import('/static/geometry.js'), ...await import('/static/track.js')}"

    def run(script: str, argument: Any = None) -> Any:
        return page.evaluate(f"async argument => ({script})({load}, argument)", argument)

    return run


def test_north_is_up_and_east_to_the_right(module):
    script = "g => { const v = new g.View(800, 600, 20, {x: 5, y: 7}); return [v.toScreen({x: 6, y: 9}), v.scale]; }"
    assert module(script) == [{"u": 440, "v": 280}, 20]


def test_the_world_comes_back_from_the_screen_after_zoom_and_pan(module):
    script = """g => {
      const view = new g.View(810, 590, 13, {x: -4, y: 70});
      const before = view.toWorld({u: 200, v: 100});
      view.zoom(2.5, {u: 200, v: 100});
      const after = view.toWorld({u: 200, v: 100});
      view.pan(30, -12);
      return [before, after, view.toWorld({u: 230, v: 88}), view.toWorld(view.toScreen({x: 3, y: 4}))];
    }"""
    before, after, moved, back = module(script)
    assert after == pytest.approx(before) and moved == pytest.approx(before)
    assert back == pytest.approx({"x": 3, "y": 4})


def test_fit_shows_the_whole_box_and_zoom_has_limits(module):
    script = """g => {
      const view = new g.View(800, 400);
      view.fit(g.boxOf([{x: -3, y: 2}, {x: 7, y: 2}, {x: 0, y: 60}]), 50);
      const seen = [view.toScreen({x: 7, y: 2}), view.toScreen({x: -3, y: 60})];
      view.fit(g.boxOf([{x: 1, y: 1}]));
      const lone = view.scale;
      view.zoom(1e9);
      return [seen, lone, view.scale, g.boxOf([])];
    }"""
    (upper, lower), lone, closest, nothing = module(script)
    assert upper["u"] == pytest.approx(50) and lower["u"] == pytest.approx(750)
    assert 50 <= upper["v"] < lower["v"] <= 350
    assert (lone, closest, nothing) == (40, 2000, None)


def test_fit_leaves_the_edges_that_buttons_cover(module):
    script = """g => {
      const view = new g.View(800, 400);
      view.fit(g.boxOf([{x: 0, y: 0}, {x: 10, y: 10}]), 30, {top: 60, right: 90});
      return [view.toScreen({x: 10, y: 0}), view.toScreen({x: 0, y: 10}), view.scale];
    }"""
    upper, lower, scale = module(script)
    assert (upper["v"], lower["v"]) == pytest.approx((90, 370)) and scale == pytest.approx(28)
    assert (upper["u"] + lower["u"]) / 2 == pytest.approx((800 - 90) / 2)


def test_ellipse_of_a_turned_covariance(module):
    turn, long, short = 0.4, 3.0, 0.5
    c, s = math.cos(turn), math.sin(turn)
    xx, yy, xy = (c * long) ** 2 + (s * short) ** 2, (s * long) ** 2 + (c * short) ** 2, c * s * (long**2 - short**2)
    axes = module("(g, p) => g.ellipseAxes(p)", [[xx, xy], [xy, yy]])
    factor = math.sqrt(-2 * math.log(0.05))  # of a Rayleigh distribution
    assert axes == pytest.approx({"long": factor * long, "short": factor * short, "angle": turn}, rel=1e-3)


def test_small_helpers(module):
    script = """g => [
      [0.7, 1, 3, 49, 0.05].map(v => [g.roundLength(v), g.roundLength(v, true)]),
      g.area(g.corners({x: 0, y: 0}, {x: 2, y: -3})),
      g.nearestLeg([{x: 0, y: 0}, {x: 6, y: 0}, {x: 6, y: 3}], {x: 5, y: 2}),
      g.nearestLeg([{x: 0, y: 0}], {x: 5, y: 2}),
      [-1, 1].map(side => g.beside([{x: 0, y: 0}, {x: 6, y: 2}], 0, side)),
      g.beside([{x: 1, y: 1}], 0, 1, 3),
      g.placed([[1, 0]], {x: 10, y: 20}, Math.PI / 2)[0],
    ]"""
    lengths, area, leg, none, ends, lone, bow = module(script)
    assert lengths == [pytest.approx(p) for p in ([0.5, 1], [1, 1], [2, 5], [20, 50], [0.05, 0.05])]
    assert (area, leg, none) == (6, 1, None)
    assert ends == [{"x": -3, "y": -1}, {"x": 3, "y": 1}] and lone == {"x": 1, "y": 4}
    assert bow == pytest.approx({"x": 10, "y": 21})  # heading east: the bow is east of the middle


def test_track_is_thinned_bounded_and_follows_time_back(module):
    script = """g => {
      const circle = t => ({t, x: 5 * Math.cos(t / 20), y: 5 * Math.sin(t / 20)});
      const track = new g.Track({most: 500});
      for (let k = 0; k < 40000; k++) track.add(circle(k * 0.05));
      const [many, first, newest] = [track.points.length, track.points[0].t, track.points.at(-1).t];
      const off = track.points.map(p => Math.hypot(p.x, p.y));
      const {points} = track;
      const steps = points.slice(1, -1).map((p, i) => Math.hypot(p.x - points[i].x, p.y - points[i].y));
      track.add(circle(1500));
      const back = track.points.at(-1).t;
      track.add(circle(1590));
      const {gap} = track.points.at(-1);
      return {many, first, newest, back, widest: Math.max(...steps), off: Math.max(...off), gap};
    }"""
    found = module(script)
    assert 100 < found["many"] <= 500
    assert found["first"] >= 40000 * 0.05 - 600.1 and found["newest"] == pytest.approx(1999.95)
    assert found["widest"] < 1 and found["off"] == pytest.approx(5)
    assert found["back"] == 1500 and found["gap"]


def test_pixels_are_thinned_but_ends_and_gaps_stay(module):
    script = (
        """g => g.thinned([0, 0.5, 1, 2, 2.5, 2.6, 2.7].map(u => ({u, v: 0, gap: u === 2.5})), 1.5).map(p => p.u)"""
    )
    assert module(script) == [0, 2, 2.5, 2.7]
