"""Who looks at the log of a test, and when: while it grows, once as a whole, and whatever becomes of the process."""

import shlex
import time
from types import SimpleNamespace

import pytest
from tests.console.loops import ran

pytest.importorskip("zmq", reason="the console needs pyzmq: pip install 'rovtwin[console]'")

from rovtwin.console.web import assessing
from rovtwin.console.web.assessing import Assessing
from rovtwin.scenario.files import load_scenario
from rovtwin.vehicle import load_vehicle


class FakeProcess:
    """Answers with the quality of a log; ends at once where it is asked to."""

    asked: list[tuple[str, bool]] = []
    dies = 0
    closed = 0

    def __init__(self, tested):
        self._answers = []

    def ask(self, log, final):
        FakeProcess.asked.append((str(log.parent), final))
        self._answers = [{"seconds": 5.0, "quality": {"verdict": "good"}}, {}]

    def answer(self, patience):
        if FakeProcess.dies:
            FakeProcess.dies -= 1
            raise EOFError
        return self._answers.pop(0)

    def close(self):
        FakeProcess.closed += 1


@pytest.fixture
def looking(monkeypatch):
    """Of a test, with `folder(name)` for the log that its engine writes now."""
    monkeypatch.setattr(assessing, "AssessProcess", FakeProcess)
    FakeProcess.asked, FakeProcess.dies, FakeProcess.closed = [], 0, 0
    client, reported = SimpleNamespace(hung=False, last={"state": {}}), []
    made = Assessing(SimpleNamespace(client=client, keep=lambda m: reported.append(dict(m))), SCENARIO, VEHICLE)
    made.folder, made.news, made.client = lambda name: client.last.update(state={"folder": name}), reported, client
    return made


SCENARIO, VEHICLE = load_scenario("test_mixed"), load_vehicle("double_blueye")


def turns(looking, count=1):
    async def work():
        for _ in range(count):
            await looking.turn()

    ran(work())


def test_log_is_looked_at_while_it_grows_and_once_as_a_whole(looking):
    turns(looking)
    assert FakeProcess.asked == []
    looking.folder("runs/a")
    turns(looking, 3)
    assert FakeProcess.asked == [("runs/a", False)]  # not again so soon
    looking._due = time.monotonic()
    turns(looking)
    looking.folder("")
    turns(looking, 3)
    assert FakeProcess.asked == [("runs/a", False)] * 2 + [("runs/a", True)]
    last = looking.news[-1]
    assert last["final"] and not last["busy"] and last["quality"] == {"verdict": "good"}
    assert shlex.split(last["command"])[:4] == ["rovtwin", "identify", "double_blueye", "runs/a/log.mcap"]


def test_next_test_waits_until_the_one_before_was_looked_at_as_a_whole(looking):
    looking.folder("runs/a")
    turns(looking)
    looking.folder("runs/b")
    turns(looking, 2)
    assert FakeProcess.asked == [("runs/a", False), ("runs/a", True), ("runs/b", False)]
    assert looking.news[-1]["folder"] == "runs/b" and not looking.news[-1]["final"]


def test_engine_that_is_gone_writes_no_more(looking):
    looking.folder("runs/a")
    turns(looking)
    looking.client.hung = True
    turns(looking, 3)
    assert FakeProcess.asked == [("runs/a", False), ("runs/a", True)]


def test_process_that_dies_at_the_whole_log_is_started_anew_but_not_for_ever(looking):
    looking.folder("runs/a")
    turns(looking)
    looking.folder("")
    FakeProcess.dies = 1
    turns(looking, 3)
    assert FakeProcess.asked[1:] == [("runs/a", True)] * 2 and looking.news[-1]["error"] == ""
    FakeProcess.asked, FakeProcess.dies = [], 100
    looking.folder("runs/b")
    turns(looking)
    looking.folder("")
    turns(looking, 5)
    assert FakeProcess.asked == [("runs/b", False), ("runs/b", True), ("runs/b", True)]
    assert "ended, or was killed" in looking.news[-1]["error"] and not looking.news[-1]["busy"]


def test_process_that_cannot_be_started_is_reported(looking, monkeypatch):
    def none_left(tested):
        raise OSError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(assessing, "AssessProcess", none_left)
    looking.folder("runs/a")
    turns(looking)
    assert "ended, or was killed" in looking.news[-1]["error"]


def test_process_ends_with_the_server(looking):
    import asyncio

    async def work():
        task = asyncio.create_task(looking.run())
        looking.folder("runs/a")
        await asyncio.sleep(0.2)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    ran(work())
    assert FakeProcess.closed == 1
