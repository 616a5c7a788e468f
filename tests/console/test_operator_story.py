"""An operator's day with a twin: start, arm, plan, fly, change the plan, look again; at three sizes of screen."""

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("nicegui", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")
pytest.importorskip("playwright.sync_api", reason="the console is tested in Chromium by Playwright")

from tests.console.whole import READY, arm, opened, order, serving, state

from rovtwin.core.log import Log
from rovtwin.core.log.maps import map_of
from rovtwin.report.flight import Flight

pytestmark = pytest.mark.slow
SIZES = {"wide": (1440, 900), "tablet": (1024, 768), "phone": (390, 844)}
SILENT = 20.0  # until the autopilot acts without an operator [s]
PRESSED = "button, a[href], input:not([type=checkbox]), select, [role=tab], summary"
SMALL = """kinds => [...document.querySelectorAll(kinds)]
  .filter(one => one.offsetParent && one.getBoundingClientRect().width)
  .filter(one => { const {width, height} = one.getBoundingClientRect(); return width < 44 || height < 44; })
  .map(one => one.outerHTML.slice(0, 120))"""
SIDEWAYS = "() => document.documentElement.scrollWidth - innerWidth"
WATCH_FRAMES = """() => { window.gaps = []; let last = performance.now();
  const frame = () => {
    const now = performance.now();
    gaps.push(now - last); last = now; requestAnimationFrame(frame); };
  requestAnimationFrame(frame); }"""


@pytest.fixture(scope="module")
def served(tmp_path_factory, browser):
    rules = ["--set", "autopilot.supervisor.geofence=40", "--set", f"autopilot.supervisor.operator_silent={SILENT}"]
    own = ["lawnmower_calm", "--speed", "5", "--set", "autopilot=model_based", *rules]
    with serving(tmp_path_factory.mktemp("story"), *own) as one:
        yield one


@pytest.fixture
def pages(served, browser):
    """Opens pages of a size, the first in control of a vehicle that is disarmed; all are closed afterwards."""
    made = []

    def of_size(name):
        page = opened(browser, served, *SIZES[name])
        made.append(page)
        if len(made) == 1:
            assert order(page, "take") == ""
            page.wait_for_function("() => rovtwin.last.rights.may")
            assert order(page, "disarm") == ""
            page.wait_for_function("() => !rovtwin.last.state.armed")
        return page

    yield of_size
    for page in made:
        page.context.close()


@pytest.fixture
def pictures(served):
    """Takes a picture of a page under a name; they lie beside the runs."""

    def take(page, name):
        page.screenshot(path=served.folder / "pictures" / f"{name}.png")

    return take


def violations(page):
    """What axe-core finds that is not minor: impact, rule, first element."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="needs axe-playwright-python")
    found = axe.Axe().run(page).response["violations"]
    return [(one["impact"], one["id"], one["nodes"][0]["html"][:120]) for one in found if one["impact"] != "minor"]


def chart_click(page, across, down):
    box = page.locator("#chart canvas").bounding_box()
    page.mouse.click(box["x"] + across * box["width"], box["y"] + down * box["height"])


def drag(page, start, end):
    box = page.locator("#chart canvas").bounding_box()
    places = [(box["x"] + a * box["width"], box["y"] + d * box["height"]) for a, d in (start, end)]
    page.mouse.move(*places[0])
    page.mouse.down()
    page.mouse.move(*places[1], steps=5)
    page.mouse.up()


def plan_by_hand(page):
    """Clear, click three points beside each other on the chart, take one back by key and bring it again."""
    page.click("#clear")
    page.get_by_text("Nothing to check: the plan is empty.").wait_for()
    page.get_by_role("button", name="Add way-points by clicking").click()
    for count, across in enumerate((0.3, 0.4, 0.5), start=1):
        chart_click(page, across, 0.5)
        page.wait_for_function(f"() => rovtwin.last.plan.draft.length === {count}")
    laid = page.evaluate("rovtwin.last.plan.draft.map(({x, y}) => [x, y])")
    steps = np.diff(laid, axis=0)
    assert np.ptp(steps, axis=0).max() < 0.05, f"the view moved between clicks: {laid}"
    page.keyboard.press("Control+z")
    page.wait_for_function("() => rovtwin.last.plan.draft.length === 2")
    page.keyboard.press("Control+Shift+Z")
    page.wait_for_function("() => rovtwin.last.plan.draft.length === 3")
    page.get_by_role("button", name="Move way-points and the chart").click()


def survey_by_default(page):
    """An area with the form's own numbers; the longest time in which the page drew nothing [ms]."""
    page.get_by_role("button", name="Draw an area for a lawn-mower plan").click()
    drag(page, (0.3, 0.35), (0.6, 0.65))
    page.evaluate(WATCH_FRAMES)
    page.get_by_role("button", name="Make plan").click()
    page.wait_for_function("() => rovtwin.last.plan.draft.length > 3", timeout=30_000)
    assert not page.get_by_role("dialog").is_visible()
    return page.evaluate("Math.max(...gaps)")


def fly_both(page):
    """The survey until its second way-point, then home at once, to the end; thrusters off after it, and disarmed."""
    page.click("#submit")
    page.wait_for_function("() => rovtwin.last.plan.submitted && !rovtwin.last.plan.changed")
    points = page.evaluate("rovtwin.last.plan.flown.length")
    for _ in range(4):  # where the machine is busy an order comes late, and is refused
        if order(page, "start") == "":
            break
    page.wait_for_function("() => rovtwin.last.state.waypoint >= 1", timeout=120_000)
    folder = state(page)["folder"]
    assert order(page, "goto", x=1.0, y=1.0, depth=2.0) == ""
    page.wait_for_function("() => rovtwin.last.state.phase === 'finished'", timeout=120_000)
    page.click("#abort")
    page.wait_for_function("() => rovtwin.last.state.phase === 'aborted'")
    page.click("#arm")
    page.wait_for_function("() => !rovtwin.last.state.armed && rovtwin.last.state.folder === ''")
    return Path(folder), points


def test_the_day(served, pages, pictures):
    page = pages("wide")
    page.get_by_text("No alerts").wait_for()
    arm(page)  # before anything was planned
    plan_by_hand(page)
    pictures(page, "planned")
    frozen = survey_by_default(page)
    assert frozen < 1000.0, f"the page stood still for {frozen:.0f} ms while the survey was laid out"
    pictures(page, "survey")
    folder, points = fly_both(page)

    told = json.loads((served.folder / folder / "summary.json").read_text())
    assert told["completed"] and told["phase"] == "finished", "what came after the mission relabelled it"
    log = Log.read(served.folder / folder / "log.mcap")
    report = Flight(log)
    assert [len(mission.waypoints) for mission in report.missions] == [points, 1]
    assert len(map_of(log).waypoints) == len(report.waypoints) == points + 1

    replay = page.context.new_page()
    replay.goto(f"{served.url}replay?run={folder.name}", wait_until="domcontentloaded")
    replay.wait_for_function("() => window.rovtwin?.last?.state?.replay", timeout=READY)
    shown = "() => [rovtwin.last.plan.flown.length, rovtwin.last.state.count]"
    begun, changed = (mission.t for mission in report.missions)
    for t, expected in ((begun - 0.5, 0), (begun + 1.0, points), (changed + 1.0, 1)):
        assert order(replay, "seek", t=t) == ""
        replay.wait_for_function(f"() => rovtwin.last.plan.flown.length === {expected}")
        replay.wait_for_function(f"() => Math.abs(rovtwin.last.state.t - {t}) < 0.01")
        assert replay.evaluate(shown) == [expected, expected]
    for name, (width, height) in SIZES.items():
        replay.set_viewport_size({"width": width, "height": height})
        assert violations(replay) == []
        pictures(replay, f"replay_{name}")
    assert page.complaints == []


@pytest.mark.parametrize("name", SIZES)
def test_every_size_of_screen(pages, pictures, name):
    """Nothing is wider than the screen, nothing that a finger presses is small, faults are on their rows."""
    page = pages(name)
    assert order(page, "plan", op="clear") == ""
    for x, y in ((0, 0), (60, 0), (4, 4), (0, 50)):
        assert order(page, "plan", op="add", x=x, y=y, depth=2.0) == ""
    page.wait_for_function("() => document.querySelectorAll('#plan tr.error').length === 2")
    assert violations(page) == []
    assert page.evaluate(SIDEWAYS) <= 0
    pictures(page, f"faults_{name}")
    page.keyboard.press("?")
    assert page.locator("#help").is_visible()
    pictures(page, f"keys_{name}")
    assert violations(page) == []
    page.keyboard.press("?")
    if name == "phone":
        assert page.evaluate(SMALL, PRESSED) == []
    for tab in ("Pilot", "World", "Replay"):
        page.get_by_role("tab", name=tab, exact=True).click()
        page.wait_for_timeout(500)
        assert violations(page) == []
        assert name != "phone" or page.evaluate(SMALL, PRESSED) == []
        pictures(page, f"tab_{tab.lower()}_{name}")
    assert page.complaints == []


def test_camera_and_sticks_are_on_one_screen_of_a_phone(pages):
    page = pages("phone")
    page.get_by_role("tab", name="Pilot", exact=True).click()
    page.wait_for_timeout(300)
    camera, *sticks = (one.bounding_box() for one in (page.locator("#hud"), *page.locator(".stick").all()))
    assert len(sticks) == 2 and camera["y"] > 0
    for stick in sticks:
        assert camera["y"] + camera["height"] <= stick["y"] and stick["y"] + stick["height"] <= SIZES["phone"][1]


def test_a_closed_page_in_control_is_counted_down_on_every_other(pages, pictures):
    page, *others = (pages(name) for name in ("wide", "tablet", "phone"))
    arm(page)  # which leaves a run that can be replayed
    assert order(page, "disarm") == ""
    page.wait_for_function("() => !rovtwin.last.state.armed && rovtwin.last.state.folder === ''")
    replay = others[0].context.new_page()
    run = others[0].evaluate("fetch('/replay/runs').then(found => found.json()).then(({runs}) => runs[0].run)")
    replay.goto(f"{page.url}replay?run={run}", wait_until="domcontentloaded")
    replay.wait_for_function("() => window.rovtwin?.last?.state?.replay")
    assert order(page, "pace", speed=1) == ""
    arm(page)
    assert order(page, "goto", x=0.0, y=20.0, depth=2.0) == ""
    page.wait_for_function("() => rovtwin.last.state.phase === 'go' || rovtwin.last.state.phase === 'dive'")
    page.close(run_before_unload=False)
    for name, other in zip(("tablet", "phone"), others, strict=True):
        other.get_by_text("Nobody is in control: it stays where it is in 0:").wait_for()
        pictures(other, f"alone_{name}")
    replay.get_by_text("Nobody is in control: it stays where it is in 0:").wait_for()
    others[1].wait_for_function("() => rovtwin.last.state.reason === 'operator silent'", timeout=60_000)
    assert "operator silent" in others[0].inner_text("#alerts")
    assert order(others[0], "take") == "" and order(others[0], "disarm") == ""
