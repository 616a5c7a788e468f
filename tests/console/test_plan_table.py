"""The table of way-points: what its cells show, what a refusal leaves, when a mission may be started."""

import pytest
from tests.console import messages

WIDEST = "-123.45"
AS_ON_THE_PAGE = """() => {
  const page = document.createElement('main');
  page.className = 'views';
  document.querySelector('#plan').className = 'form';
  document.querySelector('#plan .table').style.paddingRight = '15px'; // Playwright hides scroll bars
  page.append(...['i', 'i'].map(name => document.createElement(name)), document.querySelector('#plan').parentElement);
  document.body.append(page);
}"""
SIZES = [(1366, 768), (1920, 1080)]


@pytest.fixture
def table(open_views):
    """The form with these way-points, in control of a vehicle that is armed."""

    def opened(*points, **changes):
        page = open_views("plan")
        reported = messages.plan(*points, flown=points) | {"changed": False, "length": 4.0, "seconds": 20.0}
        for message in (messages.state(), messages.rights(), reported | changes):
            page.evaluate("message => window.emit(message)", message)
        return page

    return opened


def cell(page, name: str, i: int = 1):
    return page.get_by_label(f"{name} of way-point {i}", exact=True)


def test_numbers_have_two_decimals_at_most(table):
    rows = [{"x": -0.849, "y": 2.077, "depth": 2.00079385, "speed": 0.12345, "hold_time": 0, "heading_deg": None}]
    page = table((0, 0), draft=rows)
    shown = page.locator("#plan .cell-input").evaluate_all("cells => cells.map(cell => cell.value)")
    assert shown == ["-0.85", "2.08", "2", "0.12", "0", ""]


def test_a_square_is_laid_at_a_depth_that_can_be_read(table):
    page = table((0, 0))
    page.evaluate("message => window.emit(message)", messages.state(eta=[0, 0, 2.00079385, 0, 0, 0]))
    page.get_by_role("button", name="A square from where the vehicle is").click()
    assert page.evaluate("window.sent.at(-1).depth") == 2.0


@pytest.mark.parametrize("size", SIZES)
def test_no_cell_cuts_its_number_off_and_no_row_its_buttons(table, size):
    page = table((0, 0))
    before = page.viewport_size
    page.set_viewport_size(dict(zip(("width", "height"), size, strict=True)))
    try:
        page.evaluate(AS_ON_THE_PAGE)
        cut = """(cells, widest) => cells.map(cell => {
          cell.value = widest;
          const style = getComputedStyle(cell);
          const pen = document.createElement('canvas').getContext('2d');
          pen.font = `${style.fontSize} ${style.fontFamily}`;
          const room = cell.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight);
          return room - pen.measureText(widest).width;
        })"""
        assert min(page.locator("#plan .cell-input").evaluate_all(cut, WIDEST)) >= 0
        over = "table => table.scrollWidth - table.clientWidth"
        assert page.locator("#plan .table").evaluate(over) <= 0
    finally:
        page.set_viewport_size(before)


@pytest.mark.parametrize(("name", "typed", "planned"), [("Depth [m]", "-3", "3"), ("Speed [m/s]", "0", "0.2")])
def test_a_value_that_is_refused_gives_way_to_the_plans(table, name, typed, planned):
    page = table((0, 0), (4, 0))
    page.evaluate("window.refuse = 'way-point 1: refused'")
    cell(page, name).fill(typed)
    cell(page, name).press("Enter")
    page.get_by_role("alert").filter(has_text="way-point 1: refused").first.wait_for()
    assert page.evaluate("window.sent.at(-1).op") == "edit"
    assert cell(page, name).input_value() == planned


def test_a_plan_that_was_changed_is_not_started_before_it_is_submitted(table):
    page = table((0, 0), (4, 0))
    assert page.is_enabled("#start")
    plan = page.evaluate("async () => (await import('/static/live.js')).live.last.plan")
    page.evaluate("message => window.emit(message)", plan | {"changed": True})
    assert page.is_disabled("#start")
    assert "Submit it, or Undo" in page.get_attribute("#start", "title")
    page.evaluate("message => window.emit(message)", plan)
    assert page.is_enabled("#start") and "Undo" not in page.get_attribute("#start", "title")


def test_one_way_point_is_one(table):
    assert table((0, 0)).inner_text("#plan-summary").startswith("1 way-point; ")
    assert table((0, 0), (4, 0)).inner_text("#plan-summary").startswith("2 way-points, ")


FAULTS = [
    {"level": "error", "what": "way-point 2: found 120 m deep, expected less than 100 m", "points": [1]},
    {"level": "warning", "what": "way-points 1 to 3: faster than thrusters keep up"},
    {"level": "ok", "what": "nothing in it is beyond the vehicle"},
]


def test_faults_stand_on_their_rows_and_lead_there(table):
    page = table((0, 0), (1, 0), (2, 0), checks=FAULTS)
    rows = page.locator("#plan tbody tr")
    assert rows.evaluate_all("rows => rows.map(row => row.className)") == ["warning", "error", "warning"]
    assert "120 m deep" in rows.nth(1).get_attribute("title") and "faster" in rows.nth(1).get_attribute("title")
    shown = page.locator("#plan .checks li")
    assert shown.evaluate_all("lines => lines.map(line => line.className)") == [
        "error",
        "warning",
    ]  # nothing green beside
    page.get_by_role("button", name="Go to way-point 2").click()
    assert cell(page, "North [m]", 2).evaluate("one => one === document.activeElement")


def test_what_was_not_checked_is_not_green(table):
    page = table()
    empty = page.locator("#plan .checks li")
    assert empty.inner_text() == "Nothing to check: the plan is empty." and empty.get_attribute("class") == "note"
    page = table((0, 0), checks=[{"level": "error", "what": "no vehicle yet (connecting)"}])
    page.evaluate("message => window.emit(message)", messages.state(eta=None))
    assert page.locator("#plan .checks li").get_attribute("class") == "note"


def test_times_are_minutes_and_seconds(table):
    page = table((0, 0), (1, 0), seconds=135.4)
    assert "2:15 min at these speeds" in page.inner_text("#plan-summary")


def test_undo_redo_and_delete_have_their_keys(table):
    page = table((0, 0), (1, 0), undo=True, redo=True)
    page.keyboard.press("Control+z")
    page.keyboard.press("Control+Shift+Z")
    page.keyboard.press("Control+y")
    page.get_by_role("button", name="Move way-point 2 up").focus()
    page.keyboard.press("Delete")
    cell(page, "North [m]", 1).fill("7")
    page.keyboard.press("Control+z")  # of what is being typed
    cell(page, "North [m]", 2).focus()
    page.keyboard.press("Control+z")
    assert [(m["op"], m.get("i")) for m in page.evaluate("window.sent") if m["op"] != "edit"] == [
        *(("undo", None), ("redo", None), ("redo", None)), ("delete", 1), ("undo", None)
    ]  # fmt: skip


def test_question_mark_shows_the_keys_and_takes_them_away(table):
    page = table((0, 0))
    page.keyboard.press("?")
    assert "undo the last change" in page.locator("#help").inner_text()
    assert "play or pause" not in page.locator("#help").inner_text()  # there is no time line
    page.keyboard.press("?")
    assert page.locator("#help").count() == 0


def test_a_long_plan_has_its_fields_where_it_is_looked_at(table):
    """All of them at once took the browser 1.6 s, in which STOP could not be pressed."""
    places = [(i % 40, i // 40) for i in range(512)]
    page = table(*places, checks=[{"level": "error", "what": "way-point 500: too deep", "points": [499]}])
    page.evaluate("""() => { document.querySelector('#plan .table').style.cssText = 'height: 300px; flex: none';
      document.querySelector('#plan').className = 'form'; }""")
    page.wait_for_timeout(100)
    rows = page.locator("#plan tbody tr")
    assert rows.count() == 512 and rows.nth(499).get_attribute("class") == "error"
    assert page.locator("#plan .cell-input").count() < 512
    assert rows.nth(300).inner_text().endswith("20, 7, 3 m; 0.2 m/s")
    page.get_by_role("button", name="Go to way-point 500").click()
    assert cell(page, "North [m]", 500).evaluate("one => one === document.activeElement")
    cell(page, "Depth [m]", 505).fill("2")  # beside it, in sight
    cell(page, "Depth [m]", 505).press("Tab")
    assert page.evaluate("window.sent.at(-1)") == {"do": "plan", "op": "edit", "i": 504, "depth": 2}
    assert page.locator("#plan .cell-input").count() < 6 * 100


def test_way_points_can_be_typed_on_the_map(table):
    page = table((0, 0))
    page.evaluate("message => window.emit(message)", messages.setup(datum={"latitude": 63.44, "longitude": 10.42}))
    page.select_option("#places-as", "min")
    try:
        assert cell(page, "Latitude").input_value() == "63° 26.40000′ N"
        cell(page, "Latitude").fill("63 26.5 N")
        cell(page, "Latitude").press("Enter")
        cell(page, "Longitude").fill("twelve")
        cell(page, "Longitude").press("Enter")
        page.wait_for_selector(".toast.danger")
        assert cell(page, "Longitude").input_value() == "10° 25.20000′ E"
        page.get_by_label("New way-point: Latitude").fill("63.441")
        page.get_by_label("New way-point: Longitude").fill("10.421")
        page.get_by_role("button", name="Add this way-point").click()
        edit, add = page.evaluate("window.sent")
        assert edit == pytest.approx({"do": "plan", "op": "edit", "i": 0, "latitude": 63 + 26.5 / 60}, abs=1e-9)
        assert add == {"do": "plan", "op": "add", "latitude": 63.441, "longitude": 10.421}
    finally:
        page.select_option("#places-as", "m")
    assert cell(page, "North [m]").input_value() == "0"
