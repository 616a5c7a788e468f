"""Views of one's own beside the server: looked at in processes of their own, whatever becomes of them."""

import asyncio
import sys
import time
from types import SimpleNamespace

import pytest
from tests.console.loops import ran

pytest.importorskip("zmq", reason="the console needs pyzmq: pip install 'rovtwin[console]'")

from rovtwin.console.web import own_views
from rovtwin.console.web.own_views import OwnViews
from rovtwin.core.trust import VARIABLE

SOURCE = """
import os, time
from rovtwin.console.view import View
class Fine(View):
    every = 0.2
    def __init__(self): self.looks = 0
    def show(self, state):
        self.looks += 1
        return f"look {self.looks} at {state['t']}"
class Raises(View):
    def show(self, state): return state["nothing"]
class Hangs(View):
    def show(self, state):
        while True: pass
class Mine(str):
    pass
class Odd(Exception):
    pass
class Foreign(View):
    def show(self, state): return Mine(f"of {__name__}")
class Drawn:
    def savefig(self, *a, **k): raise Odd("ink")
class Blot(View):
    def show(self, state): return Drawn()
class Ends(View):
    def show(self, state): os._exit(3)
"""


@pytest.fixture
def hub(tmp_path, monkeypatch):
    """With an engine's state and a page that is open; `kept` is what pages are given."""
    (tmp_path / "mine.py").write_text(SOURCE)
    monkeypatch.setenv(VARIABLE, "1")
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{':'.join(p for p in sys.path if p)}")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(own_views, "AGAIN", 1.0)
    kept = []
    client = SimpleNamespace(last={"state": {"t": 7.0, "stage": "ready"}})
    return SimpleNamespace(client=client, pages=1, kept=kept, keep=kept.append)


def until(hub, views, done, seconds=90.0):
    """Run views until something holds of what pages were given; the longest that the server's loop was kept waiting."""

    async def watched():
        running = asyncio.create_task(OwnViews(hub, views).run())
        longest, end = 0.0, time.monotonic() + seconds
        while not done(hub.kept):
            assert time.monotonic() < end, hub.kept[-5:]
            before = time.monotonic()
            await asyncio.sleep(0.01)
            longest = max(longest, time.monotonic() - before - 0.01)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        return longest

    return ran(watched())


def of(kept, number):
    return [message for message in kept if message["kind"] == f"view-{number}"]


@pytest.mark.system
def test_one_that_raises_and_one_that_ends_are_named_while_others_go_on(hub):
    def done(kept):
        return len(of(kept, 0)) >= 3 and of(kept, 1) and len(of(kept, 2)) >= 2

    until(hub, ["mine:Fine", "mine:Raises", "mine:Ends"], done)
    assert of(hub.kept, 0)[2]["text"] == "look 3 at 7.0" and of(hub.kept, 0)[2]["error"] == ""
    assert of(hub.kept, 1)[0]["title"] == "Raises"
    assert "Raises.show failed: KeyError: 'nothing' (mine.py, line" in of(hub.kept, 1)[0]["error"]
    assert "the view Ends: its process ended" in of(hub.kept, 2)[0]["error"]


def test_nothing_of_its_module_comes_into_this_process(hub, monkeypatch):
    monkeypatch.syspath_prepend(".")
    until(hub, ["mine:Foreign", "mine:Blot"], lambda kept: of(kept, 0) and of(kept, 1))
    assert of(hub.kept, 0)[0]["text"] == "of mine" and "Odd: ink" in of(hub.kept, 1)[0]["error"]
    assert "mine" not in sys.modules


@pytest.mark.parametrize(("every", "wait"), [(float("nan"), own_views.AGAIN), (1e9, own_views.AGAIN), (2.0, 2.0)])
def test_what_another_process_gives_is_a_view_and_no_more(every, wait):
    kept = []

    class Other:
        async def call(self, *_):
            return {"kind": "state", "armed": False, "text": "x", "every": every}

    views = OwnViews(SimpleNamespace(keep=kept.append), ["mine:Fine"])
    assert ran(views._look(0, Other(), {})) == wait
    (message,) = kept
    assert message["kind"] == "view-0" and message["text"] == "x" and "armed" not in message


@pytest.mark.system
def test_one_that_hangs_is_ended_and_keeps_nobody_waiting(hub, monkeypatch):
    monkeypatch.setattr(own_views, "PATIENCE", 1.0)
    longest = until(hub, ["mine:Hangs", "mine:Fine"], lambda kept: of(kept, 0) and len(of(kept, 1)) >= 5)
    assert "the view Hangs: found no end within 1 s, and gave up" in of(hub.kept, 0)[0]["error"]
    assert longest < 0.5, f"the server was kept waiting for {longest:.2f} s"


@pytest.mark.system
def test_nobody_looks_while_no_page_is_open(hub):
    hub.pages = 0

    async def some_time():
        running = asyncio.create_task(OwnViews(hub, ["mine:Fine"]).run())
        await asyncio.sleep(1.5)
        running.cancel()

    ran(some_time())
    assert hub.kept == []


def test_tabs_have_the_names_of_classes_and_entry_points():
    assert OwnViews(None, ["a.b:Balance", "a:C.D", "trim"]).names == ["Balance", "D", "trim"]
