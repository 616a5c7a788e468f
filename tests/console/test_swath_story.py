"""An operator surveys a small area with a twin that carries an imager: the strip, the share, the gaps, the replay."""

from pathlib import Path

import pytest

pytest.importorskip("nicegui", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")
pytest.importorskip("playwright.sync_api", reason="the console is tested in Chromium by Playwright")

from tests.console.whole import READY, arm, opened, order, serving

pytestmark = pytest.mark.slow
AREA = [[1.0, 0.5], [6.0, 0.5], [6.0, 3.5], [1.0, 3.5]]
FLOWN = 240_000  # until a piece was flown, on a machine that is busy [ms]
SHARE = "() => rovtwin.last.swath?.eyes[0]?.found?.share"
SEEN = "() => rovtwin.last.swath?.eyes[0]?.seen_m2"


@pytest.fixture(scope="module")
def served(tmp_path_factory, browser):
    world = ["--set", "world.floor=4.5", "--set", "sensors.altimeter=true", "--set", "autopilot=model_based"]
    with serving(tmp_path_factory.mktemp("swath"), "lawnmower_calm", "--speed", "4", *world) as one:
        yield one


def lay(page):
    """A lawn-mower over AREA, whose lines are too far apart; where the machine is busy, once more."""
    survey = {"op": "template", "name": "lawnmower", "area": AREA, "spacing": 1.5, "depth": 3.0, "speed": 0.2}
    for _ in range(5):
        if (answer := order(page, "plan", **survey)) == "":
            return
    raise AssertionError(answer)


def test_a_survey_is_painted_and_its_gaps_become_the_next_plan(served, browser):
    page = opened(browser, served, 1440, 900)
    page.wait_for_function("() => rovtwin.last.swath", timeout=READY)
    assert "Seen: nothing yet" in page.inner_text(".chart-swath")
    lay(page)
    arm(page)
    assert order(page, "plan", op="submit") == ""
    assert order(page, "start") == ""
    page.wait_for_function("() => rovtwin.last.swath.eyes[0].found?.share > 0.25", timeout=FLOWN)
    assert "% of 15 m²" in page.inner_text(".chart-swath") and "gap" in page.inner_text(".chart-swath")
    pictures = served.folder / "pictures"
    page.screenshot(path=pictures / "swath_wide.png")
    phone = opened(browser, served, 390, 844)
    phone.wait_for_function(SHARE)
    assert phone.evaluate(SEEN) >= 0.25 * 15.0  # all of it, in a page that came late
    assert phone.evaluate("() => document.documentElement.scrollWidth - innerWidth") <= 0
    phone.screenshot(path=pictures / "swath_phone.png")

    assert order(page, "hold") == ""
    before = page.evaluate("rovtwin.last.plan.draft.length")
    page.get_by_role("button", name="Plan the gaps").click()
    page.get_by_text("way-points over the gaps").wait_for(timeout=60_000)
    assert page.evaluate("rovtwin.last.plan.changed") and page.evaluate("rovtwin.last.plan.draft.length") > 1
    page.screenshot(path=pictures / "swath_gaps.png")
    assert order(page, "plan", op="undo") == ""
    page.wait_for_function(f"() => rovtwin.last.plan.draft.length === {before}")

    folder, seen = Path(page.evaluate("rovtwin.last.state.folder")), page.evaluate(SEEN)
    assert order(page, "disarm") == ""
    page.wait_for_function("() => !rovtwin.last.state.armed && rovtwin.last.state.folder === ''")
    replay = page.context.new_page()
    replay.goto(f"{served.url}replay?run={folder.name}", wait_until="domcontentloaded")
    replay.wait_for_function("() => window.rovtwin?.last?.swath", timeout=READY)
    assert order(replay, "seek", t=replay.evaluate("rovtwin.last.setup.range[1]")) == ""
    shown = "() => Number(document.querySelector('.chart-swath summary span').textContent.match(/[\\d.]+/)?.[0] ?? 0)"
    replay.wait_for_function(f"() => ({shown})() > {0.9 * seen}")
    assert replay.evaluate(shown) == pytest.approx(seen, rel=0.1)
    replay.screenshot(path=pictures / "swath_replay.png")

    arm(page)  # a new flight begins with nothing
    page.wait_for_function("() => rovtwin.last.swath.eyes[0].seen_m2 < 2")
    assert order(page, "disarm") == ""
    assert page.complaints == [] and phone.complaints == []
