"""The whole console as `rovtwin console` starts it, driven in Chromium: a mission, STOP, operators, what goes wrong."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("nicegui", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")
zmq = pytest.importorskip("zmq")

from rovtwin.console.launch import end, running  # noqa: E402
from rovtwin.console.wire import Place  # noqa: E402

# Thesis table 8.3; the last one is cancelled.
TABLE_8_3 = [(6, 0), (6, 3), (0, 3), (0, 6), (6, 6), (6, 9), (0, 9)]
DEPTH = 3
READY = 120_000  # the autopilot is compiled first [ms]
FENCE = 40.0
SOON = 15_000


@dataclass
class Served:
    """A console that runs, and where it meets its engine."""

    port: int
    folder: Path
    process: subprocess.Popen

    @property
    def url(self):
        return f"http://127.0.0.1:{self.port}/"

    @property
    def place(self):
        return Place.of(self.port)


def start(port, folder):
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST", "NICEGUI"))}
    environment["PYTHONPATH"] = os.pathsep.join(p for p in sys.path if p)
    fence = f"autopilot.supervisor.geofence={FENCE}"
    command = [sys.executable, "-m", "rovtwin.cli", "console", "lawnmower_calm", "--no-browser", "--speed", "20"]
    return subprocess.Popen(
        [*command, "--port", str(port), "--set", "autopilot=model_based", "--set", fence],
        cwd=folder,
        env=environment,
        stdout=(folder / "console.log").open("ab"),
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )


@pytest.fixture(scope="module")
def served(tmp_path_factory, browser):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    folder = tmp_path_factory.mktemp("console")
    one = Served(port, folder, start(port, folder))
    try:
        yield one
    finally:
        one.process.send_signal(signal.SIGINT)
        one.process.wait(20)
        end(one.place)


def opened(browser, served, width=1366, height=768):
    """A page of the console that is ready, and what it complained of and asked for."""
    context = browser.new_context(viewport={"width": width, "height": height}, accept_downloads=True)
    page = context.new_page()
    page.set_default_timeout(SOON)
    page.complaints, page.asked = [], set()
    page.on("console", lambda message: page.complaints.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: page.complaints.append(error.stack or str(error)))
    page.on("request", lambda request: page.asked.add(request.url.split("/")[2].split(":")[0]))
    until = time.monotonic() + 60.0
    while True:
        try:
            page.goto(served.url, wait_until="domcontentloaded")
            break
        except Exception:
            assert time.monotonic() < until, (served.folder / "console.log").read_text()
            time.sleep(0.2)
    page.wait_for_function("() => window.rovtwin?.last?.state?.eta", timeout=READY)
    return page


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


def order(page, do, **what):
    """Give an order; what was answered, the text of the refusal where it was refused."""
    return page.evaluate("order => rovtwin.send(order).then(() => '', error => error.message)", {"do": do, **what})


def arm(page):
    page.click("#arm")
    page.wait_for_function("() => rovtwin.last.state.armed")


def state(page):
    return page.evaluate("rovtwin.last.state")


def test_the_way_point_mission(page, served):
    """Add the seven points of table 8.3, cancel the last, submit, start: the vehicle flies and says when it is over."""
    page.click("#clear")
    for x, y in TABLE_8_3:
        page.fill("#new-x", str(x))
        page.fill("#new-y", str(y))
        page.fill("#new-depth", str(DEPTH))
        count = page.evaluate("rovtwin.last.plan.draft.length")
        page.click("#add")
        page.wait_for_function(f"() => rovtwin.last.plan.draft.length === {count + 1}")
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
    assert summary["completed"] and (served.folder / found["folder"] / "log.mcap").stat().st_size > 100_000


def test_stop_is_one_click_or_escape_and_arming_goes_on_from_there(page):
    for press in (lambda: page.click("#stop"), lambda: page.keyboard.press("Escape")):
        arm(page)
        assert order(page, "hold") == ""
        page.wait_for_function("() => rovtwin.last.state.u.some(u => u !== 0)")
        press()
        page.wait_for_function("() => rovtwin.last.state.stopped && !rovtwin.last.state.armed")
        assert not any(state(page)["u"])
        page.wait_for_function("() => document.querySelector('#alerts').innerText.includes('STOPPED')")


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
    ear = zmq.Context.instance().socket(zmq.SUB)
    ear.setsockopt(zmq.SUBSCRIBE, b'{"kind":"state"')
    ear.connect(served.place.news)
    assert ear.poll(2000)
    told = json.loads(ear.recv())
    ear.close()
    assert told["armed"] and told["pid"] == pid
    served.process = start(served.port, served.folder)
    back = f"() => window.rovtwin?.last?.state?.pid === {pid} && rovtwin.last.state.armed"
    page.wait_for_function(back, timeout=READY)
    page.complaints.clear()  # of the server that was gone


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


@pytest.mark.parametrize(
    "text, said",
    [
        ("{[", "the file"),
        ("waypoints: [{position: [1, 2]}]", "position"),
        ("waypoints: 7", "waypoints"),
        ("waypoints: [{position: [1, 2, -3]}]", "depth"),
        ("\x00\x01", "the file"),
    ],
)
def test_malformed_file_changes_nothing(page, text, said):
    before = page.evaluate("rovtwin.last.plan.draft")
    page.set_input_files(
        "#mission-file", {"name": "mission.yaml", "mimeType": "text/yaml", "buffer": text.encode("utf-8")}
    )
    page.wait_for_function(
        "said => [...document.querySelectorAll('.toast.danger')].some(t => t.innerText.includes(said))", arg=said
    )
    assert page.evaluate("rovtwin.last.plan.draft") == before


def test_a_mission_beyond_the_fence_is_refused(page):
    page.click("#clear")
    assert order(page, "plan", op="add", x=FENCE + 20.0, y=0.0, depth=2.0) == ""
    page.wait_for_function("() => document.querySelector('#plan .checks').innerText.includes('fence')")
    assert "fence" in order(page, "plan", op="submit")
    assert "fence" in page.evaluate("rovtwin.last.plan.checks[0].what")
    assert order(page, "plan", op="undo") == ""


def test_export_and_import_give_the_same_plan(page, tmp_path):
    assert order(page, "plan", op="template", name="square", x=0, y=0, side=4, depth=2) == ""
    before = page.evaluate("rovtwin.last.plan.draft")
    with page.expect_download() as coming:
        page.click("#export")
    file = tmp_path / "mission.yaml"
    coming.value.save_as(file)
    page.click("#clear")
    page.set_input_files("#mission-file", str(file))
    page.wait_for_function("() => rovtwin.last.plan.draft.length === 5")
    assert page.evaluate("rovtwin.last.plan.draft") == before


def test_a_vanished_vehicle_is_said_and_found_again(page, served):
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
