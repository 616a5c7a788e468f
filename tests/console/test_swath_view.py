"""The floor that was seen, on the chart: colours, words, the button, what can be switched off."""

import base64
import zlib

import numpy as np
import pytest
from tests.console import messages

COLOURS = """() => {
  const {width, height} = document.querySelector('#chart canvas');
  const {data} = document.querySelector('#chart canvas').getContext('2d').getImageData(0, 0, width, height);
  const found = {};
  for (let i = 0; i < data.length; i += 4) {
    const key = data.slice(i, i + 3).join();
    found[key] = (found[key] ?? 0) + 1;
  }
  return found;
}"""
AREA = [[0, 0], [6, 0], [6, 6], [0, 6]]
GAP = {"area_m2": 12.0, "rings": [[[0, 4], [6, 4], [6, 6], [0, 6]]]}
FOUND = {"share": 2 / 3, "area_m2": 36.0, "gaps_m2": 12.0, "count": 1, "gaps": [GAP]}


def packed(numbers):
    return base64.b64encode(zlib.compress(np.ascontiguousarray(numbers).tobytes())).decode()


def cells(**times):
    """Six metres a side, of 1 m: the western four columns seen, the first of them twice."""
    passes = np.zeros((6, 6), np.uint8)
    passes[:, :4], passes[:, 0] = 1, 2
    box = {"cell": 1.0, "north": 0.0, "east": 0.0, "rows": 6, "columns": 6}
    return box | ({"data": packed(passes)} if not times else times)


def eye(**changes):
    fixed = {"name": "uhi.camera", "kind": "imager", "reach": 12.0, "height": 1.5, "by": "altimeter", "why": ""}
    return fixed | {"began": 2.0, "ended": 10.0, "seen_m2": 24.0, "cells": cells(), "found": FOUND} | changes


def swath(*eyes, **changes):
    return {"kind": "swath", "flying": True, "area": AREA, "notes": [], "eyes": list(eyes or [eye()])} | changes


@pytest.fixture
def chart(open_views):
    def opened(message, *, may=True, **state):
        page = open_views("chart")
        away = {"eta": [9, 9, 2.5, 0, 0, 0], "truth": None, "reference": None, "leg": None, "on_leg": False}
        first = (messages.setup(), messages.state(**(away | state)), messages.plan(), messages.rights(may))
        for one in (*first, message):
            page.evaluate("message => window.emit(message)", one)
        page.wait_for_timeout(100)  # cells are unpacked beside the page
        page.evaluate("document.querySelector('#chart .chart-swath details').open = true")
        page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        return page

    return opened


def words(page):
    return page.locator("#chart .chart-swath").inner_text()


def test_share_gaps_and_height_are_shown(chart):
    page = chart(swath())
    text = words(page)
    for part in (
        "Seen 67 % of 36 m²",
        "1 gap, 12 m²",
        "within 8 s",
        "1.50 m over the floor by altimeter",
        "up to 12 m",
    ):
        assert part in text, text
    assert "not painted" not in text


def test_why_nothing_is_painted_is_shown_with_since_when(chart):
    page = chart(swath(eye(why="turning", ended=4.0)))
    assert "not painted now: turning, for 6 s" in words(page)


def test_a_vehicle_without_an_eye_has_no_panel(chart):
    page = chart(swath(eyes=[]))
    assert not page.locator("#chart .chart-swath").is_visible()
    page.get_by_text("Legend").click()
    assert not page.get_by_text("floor seen once").is_visible()


def test_why_something_that_looks_down_is_no_eye(chart):
    page = chart(swath(eyes=[], notes=["sonar: its swath is not known: say how wide its fan is"]))
    assert "Seen: not known" in words(page) and "say how wide" in words(page)


def test_the_layer_is_painted_darker_where_it_was_seen_twice_and_can_be_switched_off(chart):
    page = chart(swath(eye(found=None), area=None))

    def common():
        page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        found = page.evaluate(COLOURS)
        return sorted(found, key=lambda key: -found[key])[:3], found

    (ground, once, twice), found = common()
    assert ground == "13,19,25"
    assert found[once] == pytest.approx(3 * found[twice], rel=0.1)
    assert int(twice.split(",")[2]) > int(once.split(",")[2]) + 40 > int(ground.split(",")[2]) + 80
    page.get_by_label("Show what was seen").uncheck()
    assert once not in common()[0]
    page.get_by_label("Show what was seen").check()
    assert once in common()[0]


def test_one_of_several_eyes_is_picked(chart):
    other = eye(name="camera", kind="camera", cells=None, began=None, ended=None, seen_m2=0.0, found=None)
    page = chart(swath(eye(), other))
    assert "67 %" in words(page)
    page.get_by_label("Sensor whose swath is shown").select_option("camera")
    assert "nothing yet" in words(page)
    page.evaluate("message => window.emit(message)", swath(eye(), other))
    page.wait_for_timeout(50)
    assert "nothing yet" in words(page)  # a new message does not choose for anybody


def test_the_gaps_are_planned_by_one_press(chart):
    page = chart(swath())
    page.get_by_role("button", name="Plan the gaps").click()
    assert page.evaluate("window.sent") == [{"do": "fill_gaps", "eye": "uhi.camera"}]
    page.evaluate("window.refuse = 'gaps: none of 0.1 m2 can be seen by a line'")
    page.get_by_role("button", name="Plan the gaps").click()
    assert "none of 0.1 m2 can be seen" in words(page)


NO_GAPS = {
    "watching": (swath(), False, "take control"),
    "no area": (swath(eye(found=None), area=None), True, "lay a survey with Area first"),
    "nothing seen": (swath(eye(began=None, cells=None)), True, "fly the survey first"),
    "all seen": (swath(eye(found=FOUND | {"share": 1.0, "count": 0, "gaps": []})), True, "all of the area was seen"),
}


@pytest.mark.parametrize("case", NO_GAPS)
def test_gaps_cannot_be_planned_while(chart, case):
    message, may, why = NO_GAPS[case]
    button = chart(message, may=may).get_by_role("button", name="Plan the gaps")
    assert button.is_disabled() and why in button.get_attribute("title")


def test_a_replay_shows_what_was_seen_by_its_time(chart):
    first = np.full((2, 6, 6), 65535, "<u2")
    first[0, :, :4] = [0, 10, 20, 30]
    times = cells(begin=2.0, step=0.1, data=packed(first))
    course = [[0.0, "turning"], [2.0, ""], [5.0, "no height by altimeter"]]
    replayed = eye(cells=times, course=course, found=None)
    page = chart(swath(replayed, flying=False, area=None), replay=True, t=2.95)
    assert "Seen 6.0 m²" in words(page) and "not painted" not in words(page)
    page.evaluate("message => window.emit(message)", messages.state(replay=True, t=6.0))
    assert "Seen 24 m²" in words(page) and "not painted now: no height by altimeter" in words(page)
    assert not page.get_by_role("button", name="Plan the gaps").is_visible()


@pytest.mark.parametrize("theme", ["", "daylight"])
def test_axe_has_nothing_to_say_of_the_panel(chart, theme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="needs axe-playwright-python")
    page = chart(swath(eye(why="turning", ended=4.0), eye(name="camera", kind="camera")))
    page.evaluate("theme => { document.body.className = theme; }", theme)
    violations = axe.Axe().run(page, context=".chart-corner").response["violations"]
    page.evaluate("document.body.className = ''")
    assert [one["id"] for one in violations if one["impact"] != "minor"] == []
