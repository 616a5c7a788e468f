"""The chart under a hand: what clicks, drags, keys and fingers send to the server."""

import re

import pytest
from tests.console import messages

COLOUR = """([u, v, name]) => {
  const colour = getComputedStyle(document.body).getPropertyValue(name).trim();
  const {data} = document.querySelector('#chart canvas').getContext('2d').getImageData(u - 4, v - 4, 8, 8);
  return [1, 3, 5].map(i => parseInt(colour.slice(i, i + 2), 16))
    .every((c, k) => data.some((value, i) => i % 4 === k && Math.abs(value - c) < 12));
}"""
TOOLS = {"top": 0.0, "right": 0.0}  # what the buttons cover [px]
SQUARE = ((0.0, 0.0), (6.0, 0.0), (6.0, 6.0))


@pytest.fixture
def chart(open_views):
    """A chart of a plan of three way-points, fitted, with the rights to edit."""

    def opened(*, may: bool = True):
        page = open_views("chart")
        for message in (messages.setup(), messages.state(), messages.plan(*SQUARE), messages.rights(may)):
            emit(page, message)
        drawn(page)
        edit, view = (page.get_by_role("toolbar", name=name).bounding_box() for name in ("Edit the", "View of the"))
        TOOLS.update(top=edit["y"] + edit["height"] if edit else 0.0, right=900 - view["x"])
        return page

    return opened


def emit(page, message):
    page.evaluate("message => window.emit(message)", message)


def drawn(page):
    page.wait_for_selector("#chart canvas")
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


def sent(page):
    page.evaluate("() => new Promise(done => requestAnimationFrame(done))")
    return page.evaluate("window.sent")


def at(x: float, y: float) -> tuple[float, float]:
    """Pixel of a place on a chart of 900 x 600 fitted to the tank of `messages`: 13 m less margins and buttons."""
    scale = (600 - TOOLS["top"] - 2 * 54) / 13
    return 450 - TOOLS["right"] / 2 + (y - 5) * scale, 300 + TOOLS["top"] / 2 - (x - 4.5) * scale


def press(page, name: str):
    page.get_by_role("button", name=name, exact=True).click()


def test_a_click_in_add_mode_adds_where_it_was(chart):
    page = chart()
    page.mouse.click(*at(3, 3))
    assert sent(page) == []  # only in that mode
    press(page, "Add way-points by clicking")
    page.mouse.click(*at(2, 8))
    (added,) = sent(page)
    assert (added["do"], added["op"]) == ("plan", "add")
    assert (added["x"], added["y"]) == pytest.approx((2, 8), abs=0.03)


def test_a_test_has_no_way_points_to_edit(chart):
    page = chart()
    emit(page, messages.setup(test={"name": "mixed"}))
    assert not page.get_by_role("toolbar", name="Edit the plan").is_visible()
    page.mouse.click(*at(3, 3), button="right")
    page.mouse.move(*at(6, 0))
    page.mouse.down()
    page.mouse.move(*at(4, 1))
    page.mouse.up()
    assert sent(page) == [] and not page.get_by_role("menu").is_visible()
    emit(page, messages.setup())
    assert page.get_by_role("toolbar", name="Edit the plan").is_visible()


def test_a_drag_moves_a_way_point_and_a_refusal_puts_it_back(chart):
    page = chart()
    page.mouse.move(*at(6, 0))
    page.mouse.down()
    page.mouse.move(*at(5, 3), steps=3)
    assert page.get_by_text("2: N 5.0, E 3.0 m, 3.0 m deep, 0.2 m/s").is_visible()
    assert sent(page) == []
    page.evaluate("window.refuse = 'way-point 2 lies outside the fence'")
    page.mouse.up()
    (moved,) = sent(page)
    assert moved == pytest.approx({"do": "plan", "op": "move", "i": 1, "x": 5, "y": 3}, abs=0.03)
    assert page.get_by_role("alert").inner_text() == "way-point 2 lies outside the fence"
    assert page.get_by_text("2: N 6.0, E 0.0 m").is_visible()


def test_only_a_submitted_plan_is_drawn_as_flown(chart):
    page = chart()
    reported = messages.plan((0, 0), flown=SQUARE)

    def drawn_beside(plan):
        emit(page, plan)
        drawn(page)
        return page.evaluate(COLOUR, [*at(6, 3), "--plan"])  # midway between two that are flown, not drafted

    assert drawn_beside(reported)
    assert not drawn_beside(reported | {"submitted": False})


def test_delete_by_key_and_by_button(chart):
    page = chart()
    page.mouse.click(*at(6, 6))
    page.keyboard.press("Delete")
    page.mouse.click(*at(0, 0))
    press(page, "Delete the chosen way-point")
    assert [(m["op"], m["i"]) for m in sent(page)] == [("delete", 2), ("delete", 0)]
    page.keyboard.press("Delete")  # nothing is chosen any more
    assert len(sent(page)) == 2


def test_the_menu_of_a_place_and_of_a_way_point(chart):
    page = chart()
    page.mouse.click(*at(3, 1), button="right")
    page.get_by_role("menuitem", name="Insert between 1 and 2").click()
    page.mouse.click(*at(3, 8), button="right")
    page.get_by_role("menuitem", name="Go to here, 3.0 m deep").click()
    page.mouse.click(*at(6, 0), button="right")
    page.get_by_role("menuitem", name="Insert after").click()
    insert, goto, after = sent(page)
    assert insert == pytest.approx({"do": "plan", "op": "insert", "i": 1, "x": 3, "y": 1}, abs=0.03)
    assert goto == pytest.approx({"do": "goto", "x": 3, "y": 8, "depth": 3}, abs=0.03)
    assert after == {"do": "plan", "op": "insert", "i": 2, "x": 6, "y": 3}
    assert page.get_by_role("menu").count() == 0


@pytest.mark.parametrize("hand", ["rectangle", "polygon"])
def test_an_area_becomes_a_lawn_mower(chart, hand):
    page = chart()
    press(page, "Draw an area for a lawn-mower plan")
    if hand == "rectangle":
        page.mouse.move(*at(8, 2))
        page.mouse.down()
        page.mouse.move(*at(4, 9), steps=3)
        page.mouse.up()
        corners = [[8, 2], [8, 9], [4, 9], [4, 2]]
    else:
        corners = [[1, 1], [8, 2], [4, 9]]
        for x, y in (*corners, corners[0]):
            page.mouse.click(*at(x, y))
    page.get_by_label("Line spacing").fill("1.5")
    page.get_by_label("Depth").fill("2")
    page.get_by_label("Stay inside the area").set_checked(hand == "polygon")
    press(page, "Make plan")
    (asked,) = sent(page)
    assert asked.pop("inside") == (hand == "polygon")
    assert [pytest.approx(corner, abs=0.03) for corner in corners] == asked.pop("area")
    expected = {"do": "plan", "op": "template", "name": "lawnmower", "spacing": 1.5, "depth": 2, "speed": 0.2}
    assert asked == expected
    assert page.get_by_role("dialog").count() == 0


def test_who_only_watches_edits_nothing(chart):
    page = chart(may=False)
    assert page.get_by_role("button", name="Add way-points by clicking", exact=True).is_disabled()
    page.mouse.click(*at(6, 0))
    page.keyboard.press("Delete")
    page.mouse.click(*at(6, 0), button="right")
    assert page.get_by_text("You are watching").is_visible()
    assert page.get_by_role("menuitem", name="Go to here, 3.0 m deep").is_disabled()
    page.mouse.move(*at(6, 0))
    page.mouse.down()
    page.mouse.move(*at(5, 3))
    assert page.get_by_text("2: N 5.0").count() == 0  # it does not even seem to move
    page.mouse.up()
    assert sent(page) == []


def test_rights_lost_while_drawing_end_it(chart):
    page = chart()
    press(page, "Draw an area for a lawn-mower plan")
    page.mouse.click(*at(1, 1))
    emit(page, messages.rights(False))
    page.mouse.click(*at(5, 5))
    emit(page, messages.rights(True))
    assert page.get_by_role("button", name="Move way-points and the chart").get_attribute("aria-pressed") == "true"
    assert sent(page) == []


def test_wheel_zooms_about_the_pointer_and_a_drag_pans(chart):
    page = chart()
    press(page, "Add way-points by clicking")
    u, v = at(3, 9)
    page.mouse.move(u, v)
    page.mouse.wheel(0, -400)
    page.mouse.click(u, v)
    page.mouse.move(u, v - 100)
    page.mouse.down()
    page.mouse.move(u + 50, v - 70, steps=2)
    page.mouse.up()
    page.mouse.click(u + 50, v + 30)
    same, panned = sent(page)
    assert (same["x"], same["y"]) == pytest.approx((3, 9), abs=0.03)
    assert (panned["x"], panned["y"]) == pytest.approx((3, 9), abs=0.03)


def test_fingers_pinch_and_press_long(chart):
    page = chart()
    fingers = page.context.new_cdp_session(page)

    def touch(kind: str, *points: tuple[float, float]):
        places = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(points)]
        fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": places})

    (u, v) = at(4.5, 5)
    touch("touchStart", (u - 50, v))
    touch("touchStart", (u - 50, v), (u + 50, v))
    touch("touchMove", (u - 100, v), (u + 100, v))
    touch("touchEnd")
    press(page, "Add way-points by clicking")
    page.touchscreen.tap(u + 150, v)
    (added,) = sent(page)
    assert (added["x"], added["y"]) == pytest.approx((4.5, 5 + 75 / (at(4.5, 6)[0] - u)), abs=0.03)
    touch("touchStart", (u, v))
    page.get_by_role("menuitem", name="Add way-point here").wait_for()
    touch("touchEnd")
    assert len(sent(page)) == 1  # lifting the finger is no click


def test_follow_keeps_the_vehicle_in_the_middle(chart):
    page = chart()
    press(page, "Follow the vehicle")
    emit(page, messages.state(eta=[3, 8, 2, 0, 0, 0]))
    press(page, "Add way-points by clicking")
    page.mouse.click(450, 300)
    (added,) = sent(page)
    assert (added["x"], added["y"]) == pytest.approx((3, 8), abs=0.03)


def test_every_control_has_a_name(chart):
    page = chart()
    unnamed = """() => [...document.querySelectorAll('#chart button, #chart canvas, #chart summary, #chart input')]
      .filter(e => !(e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.length)).map(e => e.outerHTML)"""
    assert page.locator("#chart button").count() > 8
    assert page.evaluate(unnamed) == []


def test_the_view_is_built_again_when_its_element_is_replaced(chart):
    page = chart()
    page.evaluate("""() => { const old = document.getElementById('chart'); const next = old.cloneNode(false);
      old.replaceWith(next); }""")
    drawn(page)
    page.mouse.click(*at(6, 0), button="right")
    page.get_by_role("menuitem", name="Delete way-point 2").click()
    assert [m["op"] for m in sent(page)] == ["delete"]


def test_what_lies_under_the_pointer_stays_there_while_points_are_added(chart):
    """A plan that grows fits itself again only where nobody aims at it."""
    page = chart()
    press(page, "Add way-points by clicking")
    places = [(3, 3), (2, 8), (9, 9)]
    for i, place in enumerate(places, start=1):
        page.mouse.click(*at(*place))
        emit(page, messages.plan(*SQUARE, *places[:i], (40 * i, 60 * i)))  # far beyond what is seen
        drawn(page)
    assert [(m["x"], m["y"]) for m in sent(page)] == [pytest.approx(place, abs=0.03) for place in places]


def test_a_view_that_nobody_touched_shows_a_new_plan(chart):
    page = chart()
    emit(page, messages.plan(*SQUARE, (40, 60)))
    drawn(page)
    assert not page.evaluate(COLOUR, [*at(6, 6), "--plan"])  # it lies elsewhere now


def test_the_vehicle_is_seen_above_the_way_points_of_a_survey(chart):
    page = chart()
    page.evaluate("""() => { window.shape = null; import('/static/chart_draw.js').then(({hull}) => {
      window.shape = [hull([0.5, 0.8], 2), hull([0.5, 0.8], 200)]; }); }""")
    page.wait_for_function("() => window.shape")
    arrow, outline = page.evaluate(
        "shape.map(points => Math.max(...points.map(([x]) => x)) - Math.min(...points.map(([x]) => x)))"
    )
    assert arrow * 2 == pytest.approx(28) and outline == pytest.approx(0.5)
    survey = [(x, y) for y in range(0, 200, 2) for x in ((0, 200) if y % 4 else (200, 0))]
    emit(page, messages.setup(room={"kind": "open", "floor": None}))
    emit(page, messages.plan(*survey))
    emit(page, messages.state(eta=[*survey[60], 3, 0, 0, 0], truth=None, reference=None, ellipse=None))
    drawn(page)
    scale = (600 - TOOLS["top"] - 2 * 54) / 200
    x, y = survey[60]
    u, v = 450 - TOOLS["right"] / 2 + (y - 99) * scale, 300 + TOOLS["top"] / 2 - (x - 100) * scale
    assert page.evaluate(COLOUR, [u, v, "--track"])


def test_an_area_begins_with_what_the_vehicle_can_do_and_says_why_it_cannot_be(chart):
    """Lines at 0.3 m/s of 0.23, and the reason under the dialog."""
    page = chart()
    emit(page, messages.plan(*SQUARE) | {"draft": [{"x": 0, "y": 0, "depth": 3, "speed": 0.3}], "line_speed": 0.23})
    press(page, "Draw an area for a lawn-mower plan")
    page.mouse.move(*at(4, 2))
    page.mouse.down()
    page.mouse.move(*at(2.4, 5), steps=3)
    page.mouse.up()
    assert page.get_by_label("Speed").input_value() == "0.23"
    assert page.get_by_text("At most 0.23 m/s").is_visible()
    assert float(page.get_by_label("Line spacing").input_value()) <= 0.4  # four lines over 1.6 m
    page.evaluate("window.refuse = 'swath: found 2 m, wider than the whole area'")
    press(page, "Make plan")
    dialog = page.get_by_role("dialog")
    dialog.get_by_role("alert").get_by_text("wider than the whole area").wait_for()
    assert dialog.get_by_role("button", name="Make plan").is_enabled()


def test_a_plan_that_is_being_made_says_so(chart):
    page = chart()
    press(page, "Draw an area for a lawn-mower plan")
    page.mouse.move(*at(8, 2))
    page.mouse.down()
    page.mouse.move(*at(4, 9), steps=3)
    page.mouse.up()
    page.evaluate("window.late = 1500")
    press(page, "Make plan")
    page.get_by_role("button", name="Planning … 1 s").wait_for()
    assert page.get_by_role("dialog").get_attribute("aria-busy") == "true"
    page.evaluate("window.late = 0")
    page.get_by_role("dialog").wait_for(state="hidden")


def test_distances_bearings_and_areas_are_measured_by_who_only_watches(chart):
    page = chart(may=False)
    press(page, "Measure distances, bearings and areas")
    notice = page.locator(".chart-notice")
    for x, y in ((2, 2), (5, 6)):
        page.mouse.click(*at(x, y))
    page.mouse.move(*at(5, 2))
    words = notice.inner_text()
    # Three, four and five metres; a pixel is 3 cm of this chart.
    leg, bearing, whole, size = re.search(r"([\d.]+) m, (\d{3})° · all ([\d.]+) m · area ([\d.]+) m²", words).groups()
    assert float(leg) == pytest.approx(4, abs=0.1) and float(whole) == pytest.approx(9, abs=0.15)
    assert abs(int(bearing) - 270) <= 1 and float(size) == pytest.approx(6, abs=0.2)
    assert page.evaluate(COLOUR, [*at(3.5, 4), "--text"])
    press(page, "Leave this mode")
    assert "area" not in notice.inner_text() and sent(page) == []


def test_a_fence_is_drawn_and_taken_away(chart):
    page = chart()
    press(page, "Draw the fence in which the vehicle has to stay")
    assert "Disarm first" in page.inner_text(".chart-notice") and sent(page) == []
    emit(page, messages.state(armed=False))
    press(page, "Draw the fence in which the vehicle has to stay")
    corners = [[1, 1], [8, 2], [4, 9]]
    for x, y in (*corners, corners[0]):
        page.mouse.click(*at(x, y))
    (drawn_fence,) = sent(page)
    assert drawn_fence["do"] == "fence" and sum(drawn_fence["corners"], []) == pytest.approx(sum(corners, []), abs=0.03)
    fence = {"outlines": [corners], "polygon": corners, "north": [1, 8], "east": [1, 9]}
    emit(page, messages.setup(fence=fence, fence_drawn=True))
    page.mouse.click(*at(3, 3), button="right")
    page.get_by_role("menuitem", name="Take the drawn fence away").click()
    assert sent(page)[-1] == {"do": "fence", "corners": None}
