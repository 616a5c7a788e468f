"""The whole console as `rovtwin console` starts it, driven in Chromium: a mission, STOP, operators, what goes wrong."""

import json
import os
import signal
import subprocess
import time

import numpy as np
import pytest

pytest.importorskip("nicegui", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")
zmq = pytest.importorskip("zmq")
playwright = pytest.importorskip("playwright.sync_api", reason="the console is tested in Chromium by Playwright")

from playwright.sync_api import TimeoutError as Late  # noqa: E402
from tests.console.whole import READY, arm, opened, order, serving, state  # noqa: E402

from rovtwin.console.launch import alive, running  # noqa: E402
from rovtwin.scenario.files import load_scenario  # noqa: E402

# Thesis table 8.3; the last one is cancelled.
TABLE_8_3 = [(6, 0), (6, 3), (0, 3), (0, 6), (6, 6), (6, 9), (0, 9)]
DEPTH = 3
FENCE = 40.0
SILENT = 6.0  # [s]


@pytest.fixture(scope="module")
def served(tmp_path_factory, browser):
    fence = f"autopilot.supervisor.geofence={FENCE}"
    rules = [
        "--set",
        "datum={latitude: 63.44, longitude: 10.42}",
        "--set",
        fence,
        "--set",
        f"autopilot.supervisor.operator_silent={SILENT}",
    ]
    own = ["lawnmower_calm", "--speed", "20", "--set", "autopilot=model_based", *rules]
    with serving(tmp_path_factory.mktemp("console"), *own) as one:
        yield one


@pytest.fixture
def page(browser, served):
    """A page in control of a vehicle that is disarmed."""
    page = opened(browser, served)
    page.wait_for_function("() => rovtwin.last.rights")
    if not page.evaluate("rovtwin.last.rights.may"):
        order(page, "take")
        page.wait_for_function("() => rovtwin.last.rights.may")
    if page.evaluate("rovtwin.last.state.armed"):
        order(page, "disarm")
    page.wait_for_function("() => !rovtwin.last.state.armed")
    try:
        yield page
    finally:
        page.context.close()
    assert page.complaints == []
    assert page.asked == {"127.0.0.1"}


def add(page, count, x, y):
    """Click until the plan has so many way-points: where the machine is busy an order comes late, and is refused."""
    for _ in range(4):
        for key, value in (("x", x), ("y", y), ("depth", DEPTH)):
            page.fill(f"#new-{key}", str(value))
        page.click("#add")
        try:
            return page.wait_for_function(f"() => rovtwin.last.plan.draft.length === {count}")
        except playwright.TimeoutError:
            assert page.evaluate("rovtwin.last.plan.draft.length") == count - 1
    raise AssertionError(f"no {count} way-points: {page.inner_text('body')}")


def states(served):
    """What the engine tells, without a page."""
    with zmq.Context.instance().socket(zmq.SUB) as ear:
        ear.setsockopt(zmq.SUBSCRIBE, b'{"kind":"state"')
        ear.connect(served.place.news)
        while ear.poll(2000):
            yield json.loads(ear.recv())


def test_the_way_point_mission(page, served):
    """Add the seven points of table 8.3, cancel the last, submit, start: the vehicle flies and says when it is over."""
    page.click("#clear")
    page.wait_for_function("() => rovtwin.last.plan.draft.length === 0")
    for count, (x, y) in enumerate(TABLE_8_3, start=1):
        add(page, count, x, y)
    page.click("#cancel-last")
    page.wait_for_function("() => rovtwin.last.plan.draft.length === 6")
    assert page.locator("#plan tbody tr").count() == 6
    arm(page)
    page.click("#submit")
    page.wait_for_function("() => rovtwin.last.plan.submitted && !rovtwin.last.plan.changed")
    page.click("#start")
    page.wait_for_function("() => rovtwin.last.state.phase === 'go'", timeout=60_000)
    assert "under way" in order(page, "start")  # a double click
    assert "under way" in order(page, "plan", op="submit")
    page.wait_for_function("() => rovtwin.last.state.phase === 'finished'", timeout=90_000)
    found = state(page)
    end = [*TABLE_8_3[5], DEPTH]
    assert np.linalg.norm(np.subtract(found["truth"][:3], end)) < 1.0
    assert "finished" in page.inner_text("#bar")
    page.click("#arm")  # disarm
    page.wait_for_function("() => !rovtwin.last.state.armed && rovtwin.last.state.folder === ''")
    summary = json.loads((served.folder / found["folder"] / "summary.json").read_text())
    # Armed before it was planned, and yet the folder tells what was flown.
    assert len(load_scenario(str(served.folder / found["folder"] / "scenario.yaml"), (), None).waypoints) == 6
    assert summary["completed"] and (served.folder / found["folder"] / "log.mcap").stat().st_size > 100_000
    # The monitor beside it: a vehicle that was not identified has nothing that could be called a change.
    assert summary["changed"] == [] and "monitor" not in summary
    page.wait_for_function("() => rovtwin.last.watch.note.startsWith('The last flight')")
    changes = page.text_content("#changes")
    assert "not identified" in changes and "net buoyancy" in changes
    assert page.locator("#changes tr.changed").count() == 0
    assert page.locator("#changes tr:not(.unknown) .figures").count() > 5


def test_stop_is_one_click_or_escape_and_arming_goes_on_from_there(page):
    for press in (lambda: page.click("#stop"), lambda: page.keyboard.press("Escape")):
        arm_after_a_stop(page)
        assert order(page, "hold") == ""
        page.wait_for_function("() => rovtwin.last.state.u.some(u => u !== 0)")
        with page.expect_response("**/stop"):
            press()
        page.wait_for_function("() => rovtwin.last.state.stopped && !rovtwin.last.state.armed")
        page.wait_for_function("() => rovtwin.last.state.u.every(u => u === 0)")
        page.wait_for_function("() => document.querySelector('#alerts').innerText.includes('STOPPED')")
        assert order(page, "stop") == ""


def arm_after_a_stop(page, tries=4):
    """STOP goes two ways, and the slower one rightly stops what was armed before it arrives: so arm again."""
    for _ in range(tries):
        page.click("#arm")
        try:
            page.wait_for_function("() => rovtwin.last.state.armed", timeout=5_000)
            return
        except Late:
            print(page.inner_text("#alerts"))
    raise AssertionError(f"not armed after {tries} tries")


def test_an_autopilot_that_hangs_is_seen_and_stopped_past(page, served):
    arm(page)
    assert order(page, "hold") == ""
    pid = running(served.place).pid
    os.kill(pid, signal.SIGSTOP)
    try:
        page.wait_for_function("() => document.querySelector('#fact-link').innerText === 'autopilot silent'")
        assert order(page, "stop") == ""  # the link's host heard it, though nobody else could
        assert "does not answer" in order(page, "pause")
    finally:
        os.kill(pid, signal.SIGCONT)
    page.wait_for_function("() => rovtwin.last.state.stopped && !rovtwin.last.state.armed")


def test_killed_console_leaves_the_autopilot_flying_and_finds_it_again(page, served, browser):
    arm(page)
    assert order(page, "hold") == ""
    pid = running(served.place).pid
    os.kill(served.process.pid, signal.SIGKILL)
    served.process.wait()
    page.wait_for_function("() => document.querySelector('#fact-link').innerText === 'no server'")
    reported = states(served)
    last = next(reported)
    assert last["armed"] and last["pid"] == pid
    served.start_again()
    back = f"() => window.rovtwin?.last?.state?.pid === {pid} && rovtwin.last.state.armed"
    page.wait_for_function(back, timeout=READY)
    page.complaints.clear()  # of the server that was gone


def test_abort_ends_piloting_though_a_stick_goes_on(page):
    arm(page)
    assert order(page, "pilot", begin=True, surge=0.5) == ""
    page.evaluate("() => { window.stick = setInterval(() => rovtwin.tell({do: 'pilot', surge: 0.5}), 50); }")
    page.wait_for_function("() => rovtwin.last.state.phase === 'piloted' && rovtwin.last.state.u.some(u => u !== 0)")
    for do, phase in (("abort", "aborted"), ("hold", "paused")):
        assert order(page, do) == ""
        page.wait_for_function(f"() => rovtwin.last.state.phase === '{phase}'")
        page.wait_for_timeout(300)
        assert state(page)["phase"] == phase and (do != "abort" or not any(state(page)["u"]))
    page.evaluate("() => clearInterval(stick)")


def test_a_plan_that_was_changed_is_not_started_and_what_was_given_up_is_tried_again(page):
    arm(page)
    assert order(page, "plan", op="template", name="square", x=0, y=0, side=4, depth=2) == ""
    assert order(page, "plan", op="submit") == ""
    assert order(page, "plan", op="cancel_last") == ""
    assert "changed since it was submitted" in order(page, "start")
    assert order(page, "plan", op="undo") == ""
    assert order(page, "inject", fault="thruster", thruster=0, share=0.0) == ""
    assert order(page, "start") == ""
    page.wait_for_function("() => rovtwin.last.state.reason === 'thruster failed'", timeout=60_000)
    assert "nothing to resume" in order(page, "resume") and page.locator("#resume").is_disabled()
    assert order(page, "inject", fault="thruster", thruster=0, share=1.0) == ""
    assert order(page, "disarm") == ""
    page.wait_for_function("() => !rovtwin.last.state.armed")
    arm(page)
    assert order(page, "start") == ""
    page.wait_for_function("() => rovtwin.last.state.phase === 'go'")
    page.wait_for_timeout(500)
    assert state(page)["reason"] == "" and min(state(page)["health"]) > 0.5


def test_what_was_begun_and_is_paused_can_be_resumed_and_nothing_else(page):
    arm(page)
    assert order(page, "hold") == ""
    page.wait_for_function("() => rovtwin.last.state.phase === 'paused'")  # but no mission that was begun
    assert "nothing to resume" in order(page, "resume") and page.locator("#resume").is_disabled()
    assert order(page, "goto", x=0.0, y=30.0, depth=2.0) == ""
    page.wait_for_function("() => rovtwin.last.state.phase === 'go'")
    page.click("#pause")
    page.wait_for_function("() => rovtwin.last.state.phase === 'paused'")
    page.click("#resume")
    page.wait_for_function("() => rovtwin.last.state.phase === 'go'")
    assert order(page, "pilot", begin=True) == ""
    page.wait_for_function("() => rovtwin.last.state.phase === 'piloted'")
    page.click("#resume")
    page.wait_for_function("() => rovtwin.last.state.phase === 'go'")
    assert order(page, "abort") == ""
    page.wait_for_function("() => rovtwin.last.state.phase === 'aborted'")
    assert order(page, "pilot", begin=True) == ""  # which begins anew: there is nothing to go on with
    page.wait_for_function("() => rovtwin.last.state.phase === 'piloted'")
    assert "nothing to resume" in order(page, "resume") and page.locator("#resume").is_disabled()


def test_two_operators(page, browser, served):
    other = opened(browser, served, 390, 844)
    other.wait_for_function("() => rovtwin.last.rights")
    try:
        assert other.is_disabled("#arm") and other.is_disabled("#submit")
        mine = page.evaluate("rovtwin.name")
        assert order(other, "arm") == f"{mine} is in control: ask for it first"
        assert order(other, "plan", op="clear") == f"{mine} is in control: ask for it first"
        assert mine in other.inner_text("#fact-control")
        other.click("#take")
        page.get_by_role("alertdialog").get_by_role("button", name="Give").click()
        other.wait_for_function("() => rovtwin.last.rights.may")
        page.wait_for_function("() => !rovtwin.last.rights.may")
        assert order(other, "stop") == "" and order(page, "stop") == ""  # that anybody may
        assert order(other, "give") == "" and order(page, "take") == ""
        assert other.complaints == []
    finally:
        other.context.close()


def test_a_closed_tab_in_control_sets_off_the_operator_watchdog(page, browser, served):
    other = opened(browser, served, 390, 844)
    arm(page)
    assert order(page, "goto", x=0.0, y=3.0, depth=2.0) == ""
    page.wait_for_function("() => rovtwin.last.state.phase === 'go'")
    page.close()
    try:
        other.wait_for_function("() => rovtwin.last.state.reason === 'operator silent'")
        assert state(other)["armed"] and state(other)["operator_age"] > SILENT
        assert "operator silent" in other.inner_text("#alerts")
        assert other.evaluate("rovtwin.last.rights.holder") in ("", None, other.evaluate("rovtwin.name"))
        assert order(other, "take") == "" and order(other, "disarm") == ""
    finally:
        other.context.close()


@pytest.mark.parametrize(
    "text, message",
    [
        ("{[", "the file"),
        ("waypoints: [{position: [1, 2]}]", "position"),
        ("waypoints: 7", "waypoints"),
        ("waypoints: [{position: [1, 2, -3]}]", "depth"),
        ("\x00\x01", "the file"),
    ],
)
def test_malformed_file_changes_nothing(page, text, message):
    before = page.evaluate("rovtwin.last.plan.draft")
    page.set_input_files(
        "#mission-file", {"name": "mission.yaml", "mimeType": "text/yaml", "buffer": text.encode("utf-8")}
    )
    page.wait_for_function(
        "said => [...document.querySelectorAll('.toast.danger')].some(t => t.innerText.includes(said))", arg=message
    )
    assert page.evaluate("rovtwin.last.plan.draft") == before


def test_a_mission_beyond_the_fence_is_refused(page):
    page.click("#clear")
    assert order(page, "plan", op="add", x=FENCE + 20.0, y=0.0, depth=2.0) == ""
    page.wait_for_function("() => document.querySelector('#plan .checks').innerText.includes('fence')")
    assert "fence" in order(page, "plan", op="submit")
    assert "fence" in page.evaluate("rovtwin.last.plan.checks[0].what")
    assert order(page, "plan", op="undo") == ""


def test_a_lawn_mower_stays_inside_of_its_area_where_that_is_required(page):
    area = [[0, 0], [8, 0], [8, 8], [0, 8]]
    drawn = {"op": "template", "name": "lawnmower", "area": area, "spacing": 2, "depth": 3, "speed": 0.2}
    reach = "() => Math.max(...rovtwin.last.plan.draft.flatMap(({x, y}) => [-x, x - 8, -y, y - 8]))"
    assert order(page, "plan", **drawn, inside=True) == "" and page.evaluate(reach) <= 0.0
    assert order(page, "plan", **drawn, inside=False) == "" and page.evaluate(reach) > 0.5
    assert "expected true or false" in order(page, "plan", **drawn, inside="yes")


def test_export_and_import_give_the_same_plan(page, tmp_path):
    assert order(page, "plan", op="template", name="square", x=0, y=0, side=4, depth=2) == ""
    before = page.evaluate("rovtwin.last.plan.draft")
    with page.expect_download() as coming:
        page.click("#export")
    file = tmp_path / "mission.yaml"
    coming.value.save_as(file)
    page.click("#clear")
    page.wait_for_function("() => rovtwin.last.plan.draft.length === 0")
    page.set_input_files("#mission-file", str(file))
    page.wait_for_function("() => rovtwin.last.plan.draft.length === 5")
    assert page.evaluate("rovtwin.last.plan.draft") == before


def test_a_plan_goes_to_other_programs_and_comes_back(page, tmp_path):
    assert order(page, "plan", op="template", name="square", x=0, y=0, side=4, depth=2) == ""
    before = page.evaluate("rovtwin.last.plan.draft.map(p => [p.x, p.y, p.depth])")
    for kind in ("gpx", "kml", "geojson", "plan"):
        page.select_option("#export-as", kind)
        with page.expect_download() as coming:
            page.click("#export")
        file = tmp_path / coming.value.suggested_filename
        assert file.suffix == f".{kind}"
        coming.value.save_as(file)
        page.click("#clear")
        page.wait_for_function("() => rovtwin.last.plan.draft.length === 0")
        page.set_input_files("#mission-file", str(file))
        page.wait_for_function("() => rovtwin.last.plan.draft.length === 5")
        found = page.evaluate("rovtwin.last.plan.draft.map(p => [p.x, p.y, p.depth])")
        assert sum(found, []) == pytest.approx(sum(before, []), abs=1e-3)
    page.select_option("#export-as", "yaml")


def test_a_vanished_vehicle_is_reported_and_found_again(page, served):
    arm(page)
    hosts = subprocess.run(["pgrep", "-P", str(running(served.place).pid)], capture_output=True, text=True).stdout
    for pid in hosts.split():
        os.kill(int(pid), signal.SIGKILL)
    page.wait_for_function("() => rovtwin.last.state.stage === 'lost'")
    page.wait_for_function("() => document.querySelector('#alerts').innerText.includes('no vehicle')")
    assert "no vehicle" in order(page, "arm")
    page.wait_for_function("() => document.querySelector('#arm').innerText === 'Reconnect'")
    page.click("#arm")
    page.wait_for_function("() => rovtwin.last.state.stage === 'ready' && rovtwin.last.state.eta", timeout=READY)


def test_every_control_has_a_name(page):
    nameless = page.evaluate(
        """() => [...document.querySelectorAll('button, input, select, a[href], [role=tab]')]
          .filter(one => !(one.getAttribute('aria-label') || one.innerText?.trim() || one.labels?.length || one.hidden))
          .map(one => one.outerHTML.slice(0, 120))"""
    )
    assert nameless == []


def test_ctrl_c_ends_all_with_a_page_open(page, served):
    """The last test: thrusters are off at once, and no page keeps the server from ending."""
    arm(page)
    assert order(page, "hold") == ""
    reported = states(served)
    assert next(reported)["armed"]
    began = time.monotonic()
    served.process.send_signal(signal.SIGINT)
    while next(reported)["armed"]:
        assert time.monotonic() - began < 1.0
    served.process.wait(15)
    assert not alive(served.place)
    page.close()  # or it would complain of the server that is gone
    page.complaints.clear()
