"""An operator rehearses a plan, flies it, and sees both beside each other: live, in the folder, and in the replay."""

import json
from pathlib import Path

import pytest

pytest.importorskip("nicegui", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")
pytest.importorskip("playwright.sync_api", reason="the console is tested in Chromium by Playwright")

from tests.console.whole import READY, arm, opened, order, serving

pytestmark = pytest.mark.system
REHEARSED = 900_000  # until all drawn vehicles were flown, below all others in priority on a machine that is busy [ms]
FLOWN = 240_000  # [ms]
POINTS = [(2.0, 0.0), (2.0, 1.5)]


@pytest.fixture(scope="module")
def served(tmp_path_factory, browser):
    own = ["--set", "world.floor=4", "--set", "autopilot=model_based"]
    with serving(tmp_path_factory.mktemp("rehearsal"), "lawnmower_calm", "--speed", "2", *own) as one:
        yield one


def again(page, do, **what):
    """An order; where the machine is busy it comes late and is refused, and is given again."""
    for _ in range(8):
        if (answer := order(page, do, **what)) == "":
            return
    raise AssertionError(answer)


def test_a_plan_is_rehearsed_flown_and_compared(served, browser):
    page = opened(browser, served, 1440, 900)
    again(page, "plan", op="clear")
    assert "the plan is empty" in order(page, "rehearse", op="now")
    for x, y in POINTS:
        again(page, "plan", op="add", x=x, y=y, depth=1.0, speed=0.2)
    page.get_by_role("tab", name="Rehearsal").click()
    page.locator("#rehearse").click()
    page.wait_for_function("() => rovtwin.last.rehearsing.busy")
    page.wait_for_function("() => rovtwin.last.rehearsal", timeout=REHEARSED)  # the vehicle as it is known comes first
    page.wait_for_function("() => rovtwin.last.rehearsal.whole && !rovtwin.last.rehearsing.busy", timeout=REHEARSED)
    text = page.inner_text("#rehearsal")
    assert "95 %" in text and "it was not identified" in text and "Hull to the floor" in text
    assert page.locator("#plan tbody th small").count() == len(POINTS)
    late = opened(browser, served, 390, 844)
    late.wait_for_function("() => rovtwin.last.rehearsal?.whole")
    assert late.evaluate("() => document.documentElement.scrollWidth - innerWidth") <= 0

    arm(page)
    again(page, "plan", op="submit")
    again(page, "start")
    page.wait_for_function("() => rovtwin.last.state.phase === 'finished'", timeout=FLOWN)
    page.wait_for_function("() => rovtwin.last.rehearsal.flown", timeout=FLOWN)
    flown = page.evaluate("rovtwin.last.rehearsal.flown")
    assert flown["completed"] and flown["reached"] == len(POINTS) and flown["verdict"] != "unknown"
    assert "Predicted against flown" in page.inner_text("#rehearsal")
    pictures = served.folder / "pictures"
    page.screenshot(path=pictures / "rehearsal.png")
    late.screenshot(path=pictures / "rehearsal_phone.png", full_page=True)

    folder = Path(page.evaluate("rovtwin.last.state.folder"))
    again(page, "disarm")
    page.wait_for_function("() => rovtwin.last.state.folder === ''")
    kept = json.loads((served.folder / folder / "rehearsal.json").read_text())
    assert len(kept["rehearsals"]) == 1 and kept["rehearsals"][0]["bands"] is not None
    replay = page.context.new_page()
    replay.goto(f"{served.url}replay?run={folder.name}", wait_until="domcontentloaded")
    replay.wait_for_function("() => window.rovtwin?.last?.rehearsal", timeout=READY)
    replay.get_by_role("tab", name="Rehearsal").click()
    assert "Predicted against flown" in replay.inner_text("#rehearsal")
    assert not replay.get_by_role("button", name="Rehearse").is_visible()
    assert page.complaints == [] and late.complaints == []
