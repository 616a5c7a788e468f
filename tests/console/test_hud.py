"""The head-up display: what it says, what it marks as old, where it draws markers."""

import pytest
from tests.console import messages

COUNT = """([u, v, w, h, name]) => {
  const canvas = document.querySelector('#hud canvas');
  const colour = getComputedStyle(document.body).getPropertyValue(name).trim();
  const wanted = [1, 3, 5].map(i => parseInt(colour.slice(i, i + 2), 16));
  const {data} = canvas.getContext('2d').getImageData(u, v, w, h);
  let count = 0;
  for (let i = 0; i < data.length; i += 4) {
    count += wanted.every((c, k) => Math.abs(data[i + k] - c) < 12) && data[i + 3] > 250;
  }
  return count;
}"""

BAR = """async state => {
  await import('/static/live.js');
  window.emit(state);
  document.body.innerHTML = '<div id="alerts"></div><section id="bar"></section>';
  await import('/static/bar.js');
}"""

DOT = '<svg xmlns="http://www.w3.org/2000/svg" width="8" height="4"/>'


@pytest.fixture
def hud(open_views):
    def opened(*sent):
        page = open_views("hud")
        page.wait_for_selector("#hud canvas")
        for message in sent:
            page.evaluate("message => window.emit(message)", message)
        page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        return page

    return opened


def test_without_a_camera_it_says_so_and_asks_for_no_picture(hud):
    page = hud(messages.setup(), messages.camera(live=False, why="no camera over this link"), messages.state())
    assert page.get_by_text("no camera over this link").is_visible()
    assert page.locator("#hud img").get_attribute("src") is None


def test_a_state_that_does_not_follow_is_marked_as_old_until_the_next(hud):
    page = hud(messages.setup(), messages.state())
    assert page.locator("#hud").get_attribute("data-stale") == ""
    page.wait_for_selector("#hud[data-stale=STALE]", timeout=1500)
    assert page.evaluate(COUNT, [0, 0, 6, 600, "--hud-danger"]) > 3000
    page.evaluate("message => window.emit(message)", messages.state())
    page.wait_for_selector('#hud[data-stale=""]', timeout=1500)
    assert page.evaluate(COUNT, [0, 0, 6, 600, "--hud-danger"]) == 0


def test_a_vehicle_that_is_silent_is_not_mistaken_for_a_fresh_one(hud):
    page = hud(messages.setup(), messages.state(link_age=0.8))
    assert page.locator("#hud").get_attribute("data-stale") == "VEHICLE SILENT"


def test_a_picture_that_nothing_follows_is_not_left_standing(hud, views_page):
    views_page[0].route("**/camera.mjpg*", lambda route: route.fulfill(body=DOT, content_type="image/svg+xml"))
    page = hud(messages.setup(), messages.camera(live=True), messages.state(running=True))
    picture = page.locator("#hud img")
    picture.wait_for()
    page.evaluate("() => { window.now = performance.now; performance.now = () => now.call(performance) + 40_000; }")
    try:
        page.evaluate("message => window.emit(message)", messages.state(running=False))
        page.evaluate("message => window.emit(message)", messages.state(running=True))
        page.wait_for_timeout(150)
        assert picture.is_visible()  # time had stood still, and so may it
        page.evaluate("() => { performance.now = () => now.call(performance) + 80_000; }")
        page.evaluate("message => window.emit(message)", messages.state(running=True))
        page.get_by_text("trying again").wait_for(timeout=450)
        assert not picture.is_visible() and picture.get_attribute("src") is None
    finally:
        page.evaluate("() => { performance.now = now; }")
        page.evaluate(
            "message => window.emit(message)", messages.camera(live=False)
        )  # no picture is asked for any more
        page.unroute("**/camera.mjpg*")


def test_markers_lie_where_the_picture_has_them(hud):
    """A picture of 1200 x 600 in 900 x 600 is 900 x 450, 75 px lower."""
    square = [[200, 100], [280, 100], [280, 180], [200, 180]]
    page = hud(messages.setup(), messages.state(markers=[{"id": 7, "corners": square}], picture=[1200, 600]))
    assert page.evaluate(COUNT, [150, 145, 60, 10, "--hud-ok"]) > 60  # its upper edge
    assert page.evaluate(COUNT, [155, 160, 45, 40, "--hud-ok"]) == 0  # within
    assert page.evaluate(COUNT, [600, 75, 300, 400, "--hud-ok"]) == 0


def test_what_it_says_in_words(hud):
    page = hud(messages.setup(), messages.state())
    script = "async states => { const w = await import('/static/hud_words.js'); return states.map(w.hudLines); }"
    states = [
        messages.state(waypoint=1, count=3, to_go=5),
        messages.state(phase="held", reason="positions lost", stopped=True),
        messages.state(stage="lost", note="no answer for 2 s", armed=False, count=0),
        messages.state(phase="piloted"),
        messages.state(phase="idle"),
    ]
    flying, held, lost, piloted, idle = page.evaluate(script, states)
    assert [line["text"] for line in flying["left"]] == ["ARMED", "GO"]
    assert [line["text"] for line in flying["right"]] == ["way-point 2 of 3", "5.0 m to go"]
    assert [line["text"] for line in held["left"]] == ["STOPPED", "HELD: positions lost"]
    assert held["left"][1]["level"] == "hud-danger"
    assert [line["text"] for line in lost["left"]] == ["DISARMED", "lost: no answer for 2 s"] and lost["right"] == []
    assert [line["text"] for line in piloted["left"]] == ["ARMED", "PILOTED"]
    assert piloted["right"] == idle["right"] == []  # there is no way-point to go to


def test_the_bar_tells_of_a_mission_only_while_one_is_flown(open_views):
    page = open_views()
    reported = {}
    for phase in ("go", "paused", "piloted", "idle"):
        page.evaluate(BAR, messages.state(phase=phase, alerts=[], nis={}, running=True, progress=0.25))
        reported[phase] = page.inner_text("#fact-progress")
    assert reported == {"go": "2/3 · 25 %", "paused": "2/3 · 25 %", "piloted": "none", "idle": "none"}


def test_the_bar_tells_whether_thrusters_may_turn_while_a_commissioning_has_the_vehicle(open_views):
    page = open_views()
    shown = []
    for phase in ("asking", "turning", "resting"):
        message = {"kind": "commission", "now": {"moves": True, "phase": phase}}
        page.evaluate("async message => { await import('/static/live.js'); window.emit(message); }", message)
        page.evaluate(BAR, messages.state(stage="lent", armed=False, alerts=[], nis={}, running=True))
        shown.append([page.inner_text("#fact-link"), page.inner_text("#fact-arm")])
    assert shown == [["in use", "off"], ["in use", "may turn"], ["in use", "off"]]


def test_the_bar_tells_of_every_sensor_of_a_kind(open_views):
    page = open_views()
    two = {"leak": {"age": 0.1, "value": [0.0]}, "leak_2": {"age": 0.1, "value": [1.0]}}
    two |= {"position": {"age": 40.0, "value": [0, 0]}, "position_2": {"age": 0.5, "value": [0, 0]}}
    two |= {"battery": {"age": 0.1, "value": [0.9, 0.0]}, "battery_2": {"age": 0.1, "value": [0.4, 30.0]}}
    page.evaluate(BAR, messages.state(sensors=two, alerts=[], nis={}, running=True, progress=0.25))
    assert page.inner_text("#fact-leak") == "LEAK" and page.inner_text("#fact-battery") == "40 %"
    assert page.locator("#fact-position").get_attribute("data-level") == ""


def test_the_bar_says_when_time_goes_slower_than_was_asked_for(open_views):
    """A state of 0.2 s more every 40 ms is five times as fast, where four or twenty were requested."""
    page = open_views()
    page.evaluate("() => { window.ours = 0; performance.now = () => ours; }")

    def emit(**state):
        page.evaluate("message => window.emit(message)", messages.state(running=True, alerts=[], nis={}, **state))

    def time_fact():
        return page.inner_text("#fact-time"), page.locator("#fact-time").get_attribute("data-level")

    page.evaluate(BAR, messages.state(t=0.0, speed=4, running=True, alerts=[], nis={}))
    for speed, text in ((4, ("0:10 ×4", "")), (20, ("0:10 ×20, reached ×5.0", "warn"))):
        for k in range(51):
            page.evaluate("() => { ours += 40; }")
            emit(t=0.2 * k, speed=speed)
        assert time_fact() == text
    emit(t=10.0, speed=20, stage="lost")
    assert time_fact() == ("0:10 ×20", "")
    emit(t=0.0, speed=20)
    page.evaluate("() => { ours += 1000; }")
    emit(t=0.2, speed=20)  # too early to say
    assert time_fact() == ("0:00 ×20", "")
