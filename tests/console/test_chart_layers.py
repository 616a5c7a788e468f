"""Layers of the chart: maps are drawn where they lie, asked for as they are seen; dives only when they are picked."""

import io
import re

import pytest
from PIL import Image
from tests.console import messages
from tests.console.conftest import answer

RED = (200, 30, 40)
MAP = {"name": "harbour.tif", "path": "", "north": [-9, 30], "east": [-9, 30], "pixel": 0.1, "shades": None}
MAP |= {"coarsest": -7, "finest": 4, "side": 256}
RUN = {"run": "20261120-101500-quay", "name": "quay", "date": "2026-11-20 10:15", "verdict": "completed", "level": "ok"}
PIXEL = """([u, v]) => {
  const canvas = document.querySelector('#chart canvas');
  const ratio = canvas.width / canvas.clientWidth;
  return [...canvas.getContext('2d').getImageData(Math.round(u * ratio), Math.round(v * ratio), 1, 1).data].slice(0, 3);
}"""

STRIP = """() => {
  const canvas = document.querySelector('#chart canvas');
  const {data} = canvas.getContext('2d').getImageData(0, canvas.height * 0.4, canvas.width * 0.85, 1);
  return [...data].join();
}"""


@pytest.fixture
def chart(open_views):
    """A chart that asks a server of tiles and tracks; `chart.asked` are the addresses."""
    packed, asked, tracks = io.BytesIO(), [], {"lines": [[[1, 8], [8, 8]]]}
    Image.new("RGB", (256, 256), RED).save(packed, "PNG")

    def serve(route):
        path = route.request.url.partition("console.test")[2]
        if path.startswith("/map/"):
            asked.append(path)
            route.fulfill(body=packed.getvalue(), content_type="image/png")
        elif path.startswith("/replay/runs"):
            asked.append(path)
            route.fulfill(json={"folder": "runs", "runs": [RUN]})
        elif path.startswith("/chart/track"):
            asked.append(path)
            route.fulfill(json=tracks)
        else:
            answer(route)

    page = open_views("chart")
    page.route("**/*", serve)

    def opened(maps=(MAP,)):
        for message in (messages.setup(), messages.state(), messages.plan((0, 0), (6, 0), (6, 6)), messages.rights()):
            page.evaluate("message => window.emit(message)", message)
        page.evaluate("message => window.emit(message)", {"kind": "layers", "maps": list(maps)})
        return page

    opened.page, opened.asked, opened.tracks = page, asked, tracks
    yield opened
    page.evaluate("message => window.emit(message)", {"kind": "layers", "maps": []})
    page.unroute("**/*", serve)


def is_red(page, at=(300, 420)):
    red, green, blue = page.evaluate(PIXEL, list(at))
    return red > 110 and red > green + 60 and red > blue + 60


def soon(page, met):
    for _ in range(100):
        if met():
            return True
        page.wait_for_timeout(30)
    return False


def test_a_map_lies_under_the_plan_and_can_be_switched_off(chart):
    page = chart()
    assert soon(page, lambda: is_red(page))
    levels = {int(re.match(r"/map/0/(-?\d+)/", path)[1]) for path in chart.asked}
    assert max(levels) <= MAP["finest"] and len(chart.asked) < 60
    page.locator(".chart-layers summary").click()
    page.get_by_label("harbour.tif").uncheck()
    assert soon(page, lambda: not is_red(page))
    page.get_by_label("harbour.tif").check()
    page.get_by_label("Strength of the maps").fill("0.1")
    assert soon(page, lambda: not is_red(page))


def test_a_map_that_is_not_under_the_view_says_how_far_away_it_is(chart):
    page = chart([MAP | {"north": [500, 900], "east": [-9, 30]}])
    page.locator(".chart-layers summary").click()
    note = page.locator(".chart-layers .chart-note")
    assert re.fullmatch(r"not here: it begins 4\d\d m north", note.inner_text())
    assert not [path for path in chart.asked if path.startswith("/map/")]


def test_an_earlier_dive_is_drawn_once_it_is_picked(chart):
    page = chart(())
    assert not chart.asked
    page.locator(".chart-layers summary").click()
    box = page.get_by_label("quay")
    box.wait_for()
    before = page.evaluate(STRIP)
    box.check()
    assert chart.asked == ["/replay/runs", f"/chart/track?run={RUN['run']}"]
    assert soon(page, lambda: page.evaluate(STRIP) != before)
    box.uncheck()
    assert soon(page, lambda: page.evaluate(STRIP) == before)
    chart.tracks |= {"error": "quay: its metres count from elsewhere"}
    box.click()
    assert soon(page, lambda: "count from elsewhere" in page.locator(".chart-layers [role=status]").inner_text())
    assert not box.is_checked()
