"""How a console ends: by Ctrl-C, by systemd and docker, while it flies and while it has much to do. Real processes."""

import json
import os
import signal
import socket
import time
from contextlib import contextmanager

import pytest
from tests.console.whole import serving

pytest.importorskip("nicegui", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")
zmq = pytest.importorskip("zmq")
client = pytest.importorskip("websockets.sync.client")

from rovtwin.console.launch import alive, running  # noqa: E402  (what the extra needs comes first)
from rovtwin.core.log import Log  # noqa: E402  (as above)
from rovtwin.core.user_files.files import MOST_UPLOAD  # noqa: E402  (as above)

COMPILING = 900.0  # on a machine that is very busy [s]
SOON = 30.0  # all are gone, on a machine that may be ten times as busy as it has cores [s]
IMPORTS = 12


class Page:
    """A page without looks."""

    def __init__(self, socket):
        self._socket = socket

    def wait(self, kind, holds):
        """The next message of a kind for which something holds."""
        until = time.monotonic() + COMPILING
        while time.monotonic() < until:
            message = json.loads(self._socket.recv(COMPILING))
            if message["kind"] == kind and holds(message):
                return message
        raise AssertionError(f"no such {kind}")

    def order(self, do, **what):
        self._socket.send(json.dumps({"do": do, "id": 7} | what))
        answer = self.wait("reply", lambda message: message["id"] == 7)
        assert answer["ok"], answer["error"]

    def import_much(self):
        text = "waypoints:\n" + "  - {position: [1.0, 2.0, 1.5]}\n" * 500
        text += "#" * (MOST_UPLOAD - len(text))
        for i in range(IMPORTS):
            self._socket.send(json.dumps({"do": "plan", "op": "import", "text": text, "id": 100 + i}))


@contextmanager
def page_of(served):
    """A page, once the server is there."""
    until = time.monotonic() + COMPILING
    while True:
        try:
            socket.create_connection(("127.0.0.1", served.port)).close()
            break
        except OSError:
            assert time.monotonic() < until, (served.folder / "console.log").read_text()
            time.sleep(0.2)
    address = f"ws://127.0.0.1:{served.port}/live?name=b1"
    with client.connect(address, max_size=None, open_timeout=COMPILING, ping_interval=None, close_timeout=0.1) as made:
        yield Page(made)


def lives(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    with open(f"/proc/{pid}/stat") as stat:
        return stat.read().rpartition(")")[2].split()[0] != "Z"


def descendants(pid):
    """Processes that a process started, and theirs."""
    with open(f"/proc/{pid}/task/{pid}/children") as children:
        own = [int(one) for one in children.read().split()]
    return own + [one for child in own for one in descendants(child)]


@pytest.mark.slow  # an autopilot is compiled
@pytest.mark.parametrize("way", ["SIGTERM", "SIGTERM to all", "Ctrl-C while files are read"])
def test_it_ends_with_thrusters_off_and_a_whole_log(tmp_path, way):
    with serving(tmp_path, "lawnmower_calm") as served, page_of(served) as page:
        page.wait("state", lambda state: state["stage"] == "ready")
        engine = running(served.place).pid
        page.order("arm")
        page.wait("state", lambda state: state["armed"])
        page.order("hold")
        flown = page.wait("state", lambda state: any(state["u"]))
        processes = [served.process.pid, engine, *descendants(served.process.pid), *descendants(engine)]
        assert len(processes) > 3  # the link's host, too
        time.sleep(2.0)
        if way.endswith("read"):
            page.import_much()
            time.sleep(0.5)
        number = signal.SIGINT if "Ctrl-C" in way else signal.SIGTERM
        began = time.monotonic()
        for pid in processes if way.endswith("all") else processes[:1]:
            if lives(pid):
                os.kill(pid, number)
        code = served.process.wait(2 * SOON)
        while any(lives(pid) for pid in processes) and time.monotonic() < began + 2 * SOON:
            time.sleep(0.02)
        took = time.monotonic() - began
    assert [pid for pid in processes if lives(pid)] == [] and not alive(served.place)
    assert took < SOON and (code == 0 or number == signal.SIGINT)
    folder = tmp_path / flown["folder"]
    assert Log.read(folder / "log.mcap")["autopilot/command"].t[-1] > 2.0  # whole: a log that was cut is refused
    assert json.loads((folder / "summary.json").read_text())["reason"]
    print(f"{way}: {took:.1f} s")


@pytest.mark.slow
def test_it_ends_while_the_autopilot_is_compiled(tmp_path):
    with serving(tmp_path, "lawnmower_calm") as served:
        until = time.monotonic() + COMPILING
        while running(served.place) is None or len(descendants(running(served.place).pid)) < 2:
            assert time.monotonic() < until
            time.sleep(0.05)
        time.sleep(1.0)
        engine = running(served.place).pid
        processes = [served.process.pid, engine, *descendants(engine)]
        began = time.monotonic()
        os.kill(served.process.pid, signal.SIGTERM)
        while any(lives(pid) for pid in processes) and time.monotonic() < began + 4 * SOON:
            time.sleep(0.05)
        took = time.monotonic() - began
    assert [pid for pid in processes if lives(pid)] == [] and took < SOON
    print(f"while compiled: {took:.1f} s")
