"""A commissioning begun in the browser: checklist, a question that is declined, one vehicle for one, and given back."""

import pytest

pytest.importorskip("nicegui", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")
pytest.importorskip("zmq")
pytest.importorskip("playwright.sync_api", reason="the console is tested in Chromium by Playwright")

from tests.console.whole import READY, opened, order, serving

from rovtwin.commission.dossier import Dossier

LONG = 480_000  # a stage, on a machine that is busy [ms]


@pytest.fixture(scope="module")
def served(tmp_path_factory, browser):
    with serving(tmp_path_factory.mktemp("console"), "lawnmower_calm") as one:
        yield one


def until(page, condition, timeout=LONG):
    page.wait_for_function(f"() => {condition}", timeout=timeout)


def done(page, stage):
    """Start a stage that asks nothing, and wait for its end."""
    page.get_by_role("button", name=f"Start {stage}").click(timeout=LONG)
    until(page, f"rovtwin.last.commission.ended?.text === '{stage}: go.' && !rovtwin.last.commission.now")


def test_a_commissioning_goes_as_far_as_a_no(browser, served):
    page = opened(browser, served, 1440, 900)
    try:
        page.get_by_role("tab", name="Commission").click()
        page.get_by_role("link", name="Begin a commissioning").click()
        for side, value in (("length", "6"), ("width", "3"), ("depth", "1.5")):
            page.get_by_label(f"{side} of the tank").fill(value)
        page.get_by_label("Folder").fill("first")
        page.locator("#commission-send").click()
        page.get_by_role("button", name="Start Paper").wait_for(timeout=LONG)
        done(page, "Paper")
        assert "tank" in page.inner_text(".commission-checks")
        assert page.evaluate("rovtwin.last.state.stage") == "ready", "what only computes takes no vehicle"
        assert order(page, "arm") == ""
        until(page, "rovtwin.last.state.armed")
        assert "disarm it first" in order(page, "commission", op="start", folder="first", stage="bench")
        assert order(page, "disarm") == ""
        until(page, "!rovtwin.last.state.armed")
        done(page, "Bench")
        assert "commissioning holds the vehicle" in order(page, "arm")
        assert "not flown from here" in page.inner_text("#alerts")
        page.get_by_role("button", name="Start Dip").click()
        page.get_by_role("alertdialog").get_by_role("button", name="Yes").wait_for(timeout=LONG)
        page.reload()  # the question waits for it, and nothing moves
        page.get_by_role("alertdialog").get_by_role("button", name="No").click(timeout=LONG)
        until(page, "window.rovtwin?.last?.commission?.ended?.how === 'no-go'")
        (attempt,) = Dossier.open(served.folder / "runs" / "first").attempts("dip")
        assert "not confirmed" in attempt.outcome.reasons[0]
        page.get_by_role("button", name="Start Dip").click(timeout=LONG)
        page.get_by_role("alertdialog").get_by_role("button", name="Yes").wait_for(timeout=LONG)
        page.keyboard.press("Escape")
        until(page, "rovtwin.last.commission.ended?.how === 'stopped'")
        page.get_by_role("button", name="Give the vehicle back").click()
        until(page, "rovtwin.last.state.stage === 'ready'", READY)
        assert page.complaints == [] and page.asked == {"127.0.0.1"}
    finally:
        page.context.close()
