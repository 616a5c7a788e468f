"""Places on the map in the browser: converted as the datum does, written and read as people do."""

import re
from typing import Any

import numpy as np
import pytest
from tests.console import messages

from rovtwin.core.datum import Datum

METRES = "() => import('/static/places.js').then(places => places.writePlacesAs('m'))"
DATUM = {"latitude": 63.44, "longitude": 10.42, "height": 40.0}


@pytest.fixture
def module(open_views):
    """`module(script, argument)` runs `async (g, argument) => ...` with geodesy.js and places.js as `g`."""
    page = open_views("chart")
    page.evaluate(METRES)
    load = "{...await import('/static/geodesy.js'), ...await import('/static/places.js')}"

    def run(script: str, argument: Any = None) -> Any:
        return page.evaluate(f"async argument => ({script})({load}, argument)", argument)

    run.page = page
    return run


@pytest.mark.parametrize("at", [(63.44, 10.42, 40.0), (-33.9, 151.2, 0.0), (0.0, 179.999, 0.0), (89.5, -120.0, 0.0)])
def test_places_are_converted_as_the_datum_does(module, at):
    places = [[0, 0, 0], [3.2, -7.1, 5], [9000, -4000, 30], [-9000, 9000, 0]]
    script = """(g, [[latitude, longitude, height], places]) => {
      const datum = new g.Datum({latitude, longitude, height});
      return places.map(([x, y, depth]) => datum.geodetic({x, y, depth}));
    }"""
    found = module(script, [at, places])
    latitude, longitude, _ = Datum(*at).geodetic(np.array(places, float))
    np.testing.assert_allclose([p["latitude"] for p in found], latitude, atol=2e-10)  # 20 micrometres
    np.testing.assert_allclose([p["longitude"] for p in found], longitude, atol=2e-10 / np.cos(np.radians(at[0])))


@pytest.mark.parametrize(
    ("text", "key", "value"),
    [
        ("63.45004", "latitude", 63.45004),
        ("63,45004", "latitude", 63.45004),
        ("-33.9", "latitude", -33.9),
        ("\u221233.9", "latitude", -33.9),
        ("33.9 S", "latitude", -33.9),
        ("63° 27.0024′ N", "latitude", 63.45004),
        ("63 27.0024n", "latitude", 63.45004),
        ("63°27'00.144\"N", "latitude", 63.45004),
        ("63d 27m 0.144s N", "latitude", 63.45004),
        ("010° 21.6′ W", "longitude", -10.36),
        ("180", "longitude", 180),
        *[
            (wrong, "latitude", None)
            for wrong in ("", "north", "63 61", "63.5 20", "91", "-63 N", "63 E", "63 27 60", "1e3")
        ],
        ("181", "longitude", None),
        ("10 N", "longitude", None),
    ],
)
def test_angles_are_read_as_people_type_them(module, text, key, value):
    found = module("(g, [text, key]) => g.angleOf(text, key)", [text, key])
    assert found is None if value is None else found == pytest.approx(value, abs=1e-9)


def test_angles_are_written_so_that_they_can_be_read_again(module):
    module.page.evaluate("message => window.emit(message)", messages.setup(datum=DATUM))
    script = """(g, way) => {
      g.writePlacesAs(way);
      return [[63.4500449, 'latitude'], [-10.9999999, 'longitude'], [0, 'latitude']].flatMap(([value, key]) =>
        [g.angleText(value, key), g.angleOf(g.angleText(value, key, 7), key)]);
    }"""
    assert module(script, "deg")[::2] == ["63.450045° N", "11.000000° W", "0.000000° N"]
    assert module(script, "min")[::2] == ["63° 27.0027′ N", "11° 00.0000′ W", "0° 00.0000′ N"]
    for way in ("deg", "min"):
        assert module(script, way)[1::2] == pytest.approx([63.4500449, -10.9999999, 0.0], abs=2e-7)


def test_the_read_out_has_metres_and_degrees_and_turns(open_views):
    page = open_views("chart")
    page.evaluate(METRES)
    for message in (messages.setup(datum=DATUM), messages.state(), messages.plan((0, 0)), messages.rights()):
        page.evaluate("message => window.emit(message)", message)
    page.mouse.move(450, 300)
    notice = page.locator(".chart-notice")
    words = notice.inner_text()
    assert re.fullmatch(r"N -?[\d.]+, E -?[\d.]+ m · 63\.\d{6}° N, 10\.\d{6}° E", words), words
    turn = page.get_by_role("button", name="Places are written in")
    for sign in ("°", "° ′", "m"):
        turn.click()
        assert turn.inner_text() == sign
    page.evaluate("message => window.emit(message)", messages.setup(datum=None))
    assert not turn.is_visible()
    page.mouse.move(440, 310)
    assert "°" not in notice.inner_text()


def test_a_place_is_copied_by_who_only_watches(open_views):
    page = open_views("chart")
    page.evaluate(METRES)
    for message in (messages.setup(datum=DATUM), messages.state(), messages.plan((0, 0)), messages.rights(False)):
        page.evaluate("message => window.emit(message)", message)
    clipboard = "{configurable: true, value: {writeText: async text => { window.copied = text; }}}"
    page.evaluate(f"Object.defineProperty(navigator, 'clipboard', {clipboard})")
    page.mouse.click(450, 300, button="right")
    page.get_by_role("menuitem", name="Copy").click()
    assert "° N, " in page.evaluate("window.copied")
