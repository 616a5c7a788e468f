"""An identification test flown from the console, as a whole: cues, the log's quality, the estimate, what identifies."""

import json
import shlex

import pytest

pytest.importorskip("nicegui", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")
pytest.importorskip("zmq")

from tests.console.films import filming
from tests.console.whole import arm, opened, order, serving, state

from rovtwin.identification.logs.readers import read_records
from rovtwin.vehicle import load_vehicle

pytestmark = pytest.mark.slow  # the quick estimate is compiled, below all others in priority
LOOKED = 400_000  # [ms]


@pytest.fixture(scope="module")
def film():
    with filming() as film:
        yield film


@pytest.fixture(scope="module")
def page(browser, tmp_path_factory, film):
    own = ("test_mixed", "--speed", "4", "--camera", film.url)
    with serving(tmp_path_factory.mktemp("trial"), *own) as served:
        page = opened(browser, served)
        page.folder = served.folder
        page.wait_for_function("() => rovtwin.last.rights?.may && rovtwin.last.setup")
        yield page
        page.context.close()


@pytest.fixture
def armed(page):
    """Disarmed again afterwards; the browser must have had nothing to complain of."""
    arm(page)
    yield page
    order(page, "disarm")
    page.wait_for_function("() => !rovtwin.last.state.armed")
    assert page.complaints == [] and page.asked == {"127.0.0.1"}


def test_a_test_has_no_way_points_and_no_pilot(armed):
    assert armed.get_by_role("tab", name="Identify").get_attribute("aria-selected") == "true"
    assert not armed.get_by_role("tab", name="Plan").count() and not armed.get_by_role("tab", name="Pilot").count()
    assert not armed.get_by_role("toolbar", name="Edit the plan").is_visible()
    for do, what in (("goto", {"x": 1, "y": 0}), ("pause", {}), ("resume", {})):
        assert "a test is flown here" in order(armed, do, **what)


def test_picture_of_a_real_camera_is_shown_and_taken_away_with_the_reason(armed, film):
    armed.wait_for_function("() => document.querySelector('#hud img').naturalWidth === 960")
    assert armed.locator("#hud img").is_visible()
    film.ended.set()
    armed.wait_for_function("() => document.querySelector('.hud-words').innerText.includes('stream ended')")
    assert not armed.locator("#hud img").is_visible()


def test_abort_ends_it_with_thrusters_off_and_a_log_that_says_so(armed):
    armed.click("#start")
    armed.wait_for_function("() => rovtwin.last.state.u.some(u => u !== 0)")
    folder = state(armed)["folder"]
    armed.click("#abort")
    armed.wait_for_function("() => !rovtwin.last.state.experiment.running && !rovtwin.last.state.u.some(u => u !== 0)")
    armed.wait_for_function("() => document.querySelector('#cue').innerText.includes('thrusters are off')")
    summary = json.loads((armed.folder / folder / "summary.json").read_text())
    assert not summary["completed"] and summary["reason"]


def test_flown_to_its_end_it_is_judged_estimated_and_can_be_identified(armed):
    armed.evaluate(
        "() => { window.cues = new Set();"
        " rovtwin.on('state', s => cues.add([s.experiment?.cue, s.experiment?.hand].join())); }"
    )
    armed.click("#start")
    armed.wait_for_function("() => rovtwin.last.state.experiment.running")
    assert "under way" in order(armed, "start")  # a double click
    folder = state(armed)["folder"]
    armed.wait_for_function("() => rovtwin.last.state.experiment.ended === 'finished'", timeout=90_000)
    cues = armed.evaluate("[...cues]")
    assert any(cue.startswith("TILT IT") and cue.endswith(",true") for cue in cues)
    assert any(cue.startswith("LET GO") for cue in cues)
    reported = "rovtwin.last.identify"
    whole = f"folder => {reported}?.folder === folder && {reported}.final && !{reported}.busy"
    armed.wait_for_function(whole, arg=folder, timeout=LOOKED)
    found = armed.evaluate("rovtwin.last.identify")
    assert found["quality"]["verdict"] != "error" and found["quality"]["not_pushed"] == []
    assert found["estimate"]["informed"] > 40
    rows = {row["name"]: row for row in found["estimate"]["rows"]}
    assert rows["added_mass.surge"]["ratio"] < 0.9
    assert armed.locator("#identify tbody tr").count() > 10
    # The command is one that can be run, and what it reads is there.
    command = shlex.split(armed.inner_text("#command"))
    assert command[:2] == ["rovtwin", "identify"]
    records = read_records(armed.folder / command[3], load_vehicle("double_blueye"))
    assert sum(record.duration for record in records) == pytest.approx(80.0, abs=2.0)  # 84 s less those of the hand
