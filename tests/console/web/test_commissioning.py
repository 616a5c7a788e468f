"""Commissionings for pages: who may answer, what counts as no, STOP, one vehicle for one, folders that stay folders."""

import asyncio
import os
from types import SimpleNamespace

import pytest
from tests.commission.waterside import Yes
from tests.console.commissioning.cheap import STAGES
from tests.console.loops import ran

pytest.importorskip("zmq", reason="the console needs pyzmq: pip install 'rovtwin[console]'")
pytest.importorskip("nicegui", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")

from rovtwin.commission.dossier import Dossier
from rovtwin.commission.request import Request
from rovtwin.commission.run import commission
from rovtwin.console.commissioning.checklist import checklist
from rovtwin.console.commissioning.folders import ask_anew, begin, file_of, find, listed
from rovtwin.console.web.commissioning import attending as module
from rovtwin.console.web.commissioning.attending import Commissioning
from rovtwin.console.web.commissioning.routes import APART, add_commissioning
from rovtwin.console.wire import Place
from rovtwin.core.errors import ConfigError, LinkError, RovtwinError

CHEAP = "tests.console.commissioning.cheap:STAGES"
FORM = {"vehicle": "double_blueye", "link": "twin://", "tank": "6x3x1.5", "minutes": 8}
QUESTION = {"id": 1, "kind": "confirm", "text": "May it move?", "unit": ""}


class FakeHub:
    """Pages that are not there; `sent` is what they would be sent."""

    def __init__(self):
        self.others, self.sent, self.silent, self.refuses = {}, [], 0.0, ""
        self.kept = {}
        self.client, self.asked = SimpleNamespace(ask=self._ask, also_stops=None), []

    async def _ask(self, do):
        self.asked.append(do)
        if self.refuses:
            raise LinkError(self.refuses)

    def keep(self, message):
        self.kept[message["kind"]] = message
        self.sent.append(message)

    def say(self, level, text):
        self.sent.append({"kind": "event", "level": level, "text": text})

    @property
    def last(self):
        return [one for one in self.sent if one["kind"] == "commission"][-1]


class FakeWorker:
    """Calls at once."""

    def __init__(self, *_):
        pass

    async def call(self, function, *arguments):
        return function(*arguments)

    def close(self):
        pass


class FakeProcess:
    """Gives the messages that it is handed, and notes what it is told; a stop is its end."""

    def __init__(self, job, nice):
        self.job, self.nice, self.coming, self.given, self.stopped = job, nice, [], [], False

    def message(self, seconds):
        if self.coming:
            return self.coming.pop(0)
        return ("ended", ("stopped", "")) if self.stopped else None

    def answer(self, number, value):
        self.given.append((number, value))

    def stop(self):
        self.stopped = True

    def close(self):
        self.given.append("closed")


@pytest.fixture
def hub():
    return FakeHub()


@pytest.fixture
def desk(hub, tmp_path, monkeypatch):
    """Commissionings of a folder in which one was begun and `looks` was passed."""
    monkeypatch.setattr(module, "Worker", FakeWorker)
    monkeypatch.setattr(module, "StageProcess", FakeProcess)
    begin(tmp_path, "c", FORM)
    commission(Dossier.open(tmp_path / "c").request, tmp_path / "c", STAGES, Yes(), only=["looks"])
    made = Commissioning(hub, Place(tmp_path), tmp_path, CHEAP)
    yield made
    made._hold.give()


async def settled(desk, until=lambda: False):
    for _ in range(300):
        if until():
            return
        await asyncio.sleep(0.01)


async def asking(desk, hub, stage="asks"):
    """A stage that waits for an answer; its process."""
    await desk.do({"op": "start", "folder": "c", "stage": stage})
    desk._process.coming.append(("question", dict(QUESTION)))
    await settled(desk, lambda: hub.last["question"])
    assert hub.last["question"]["text"] == "May it move?"
    return desk._process


def answer(value, number=1):
    return {"op": "answer", "question": number, "value": value}


def test_an_answer_is_that_to_the_question_that_waits(desk, hub):
    async def story():
        process = await asking(desk, hub)
        for wrong in (answer(True, 2), answer(True, None), answer("yes"), answer(1), answer(None)):
            with pytest.raises(RovtwinError):
                await desk.do(wrong)
        assert process.given == []
        await desk.do(answer(True))
        with pytest.raises(RovtwinError, match="waits no more"):
            await desk.do(answer(True))
        assert process.given == [(1, True)] and hub.last["question"] is None
        process.coming.append(("question", QUESTION | {"id": 2, "kind": "number", "unit": "N"}))
        await settled(desk, lambda: hub.last["question"])
        for wrong in ("12", True, float("nan"), [1]):
            with pytest.raises(RovtwinError, match="number in N"):
                await desk.do(answer(wrong, 2))
        await desk.do(answer(1, 2))
        assert process.given[-1] == (2, 1) and hub.last["lines"][-1].endswith("1 N")
        process.coming.append(("ended", ("go", "")))
        await settled(desk, lambda: hub.last["now"] is None)
        assert hub.last["ended"]["text"] == "Asks: go." and process.given[-1] == "closed"

    ran(story())


def test_a_question_waits_for_a_page_that_is_loaded_anew_and_then_it_is_no(desk, hub, monkeypatch):
    async def story():
        hub.silent = float("inf")
        process = await asking(desk, hub)
        await asyncio.sleep(0.1)
        assert process.given == [] and hub.last["question"], "the page may be back in a second"
        monkeypatch.setattr(module, "UNANSWERED", 0.0)
        await settled(desk, lambda: process.given)
        assert process.given == [(1, False)] and "no page was in control" in hub.last["lines"][-1]
        process.coming.append(("question", QUESTION | {"id": 2, "kind": "number", "unit": "N"}))
        await settled(desk, lambda: len(process.given) > 1)
        assert process.given[1] == (2, None)
        hub.silent = 50.0  # a page that is hidden for long speaks once a minute
        process.coming.append(("question", QUESTION | {"id": 3}))
        await settled(desk, lambda: hub.last["question"])
        await asyncio.sleep(0.1)
        assert len(process.given) == 2 and hub.last["question"]["id"] == 3, "somebody may look at it"

    ran(story())


def test_what_turns_is_ended_where_nobody_could_press_stop_and_what_computes_is_not(desk, hub, monkeypatch):
    monkeypatch.setattr(module, "ALONE", 0.0)

    async def story():
        await desk.do({"op": "start", "folder": "c", "stage": "flies"})
        process, hub.silent = desk._process, float("inf")
        for phase in ("asking", "resting"):
            process.coming.append(("phase", phase))
            await settled(desk, lambda phase=phase: hub.last["now"]["phase"] == phase)
            await asyncio.sleep(0.1)
            assert not process.stopped, "thrusters are off"
        process.coming.append(("phase", "turning"))
        await settled(desk, lambda: hub.last["now"] is None)
        assert process.stopped and "no page has been in control" in hub.last["lines"][-1]

    ran(story())


def test_pages_that_come_late_learn_since_when_a_stage_and_what_it_does_go_on(desk, hub):
    async def story():
        await desk.do({"op": "start", "folder": "c", "stage": "computes"})
        began = hub.last["progress"]["began"]
        assert hub.last["progress"]["since"] == began
        for share in (0.1, 0.2):
            desk._process.coming.append(("progress", ("planning", share)))
            await settled(desk, lambda share=share: hub.sent[-1].get("share") == share)
        anew, first, second = (one for one in hub.sent if one["kind"] == "commission_progress")
        assert anew["what"] == "starting", "not what the stage before did last"
        assert first["began"] == second["began"] == began < first["since"] == second["since"], "the same goes on"
        desk._process.coming.append(("progress", ("flying", None)))
        await settled(desk, lambda: hub.sent[-1].get("what") == "flying")
        assert hub.sent[-1]["since"] > second["since"] and hub.kept["commission_progress"] == hub.sent[-1]
        await desk.do({"op": "end"})
        await settled(desk, lambda: hub.last["now"] is None)

    ran(story())


def test_stop_ends_what_moves_and_nothing_else(desk, hub):
    async def story():
        process = await asking(desk, hub)
        assert hub.client.also_stops() is True and process.stopped
        with pytest.raises(RovtwinError, match="waits no more"):
            await desk.do(answer(True))
        await settled(desk, lambda: hub.last["now"] is None)
        assert hub.last["ended"]["how"] == "stopped" and "kept" in hub.last["ended"]["text"]
        assert hub.client.also_stops() is False
        await desk.do({"op": "start", "folder": "c", "stage": "computes"})
        process = desk._process
        assert hub.client.also_stops() is False and not process.stopped and process.nice == module.NICE
        desk._process.stop = lambda: None  # it does not look whether it shall end
        await desk.do({"op": "end"})
        assert hub.last["now"]["ending"], "pages say that it was heard"
        process.stopped = True
        await settled(desk, lambda: hub.last["now"] is None)
        with pytest.raises(RovtwinError, match="no stage"):
            await desk.do({"op": "end"})

    ran(story())


def test_one_of_the_two_has_the_vehicle(desk, hub):
    async def story():
        hub.refuses = "the console has armed the vehicle: disarm it first"
        with pytest.raises(LinkError, match="disarm it first"):
            await desk.do({"op": "start", "folder": "c", "stage": "flies"})
        assert desk._process is None and not hub.last["held"] and not desk._hold.is_ours
        hub.refuses = ""
        await desk.do({"op": "start", "folder": "c", "stage": "flies"})
        assert hub.asked == ["lend", "lend"] and hub.last["held"] and desk._process.nice is None
        assert desk._process.job.stop_at == desk._place.stop
        for op in ({"op": "start", "folder": "c", "stage": "flies"}, {"op": "give_back"}):
            with pytest.raises(RovtwinError, match="is being done"):
                await desk.do(op)
        await desk.do({"op": "end"})
        await settled(desk, lambda: hub.last["now"] is None)
        assert hub.last["held"], "the next stage may follow"
        await desk.do({"op": "give_back"})
        assert not hub.last["held"]
        await desk.do({"op": "start", "folder": "c", "stage": "computes"})
        assert hub.asked == ["lend", "lend"], "what only computes needs no vehicle"
        await desk.close()
        assert desk._process is None

    ran(story())


def test_what_is_wrong_is_reported_in_words(desk, hub):
    async def story():
        for op in (None, "steer", ["start"]):
            with pytest.raises(RovtwinError, match="expected begin"):
                await desk.do({"op": op})
        with pytest.raises(RovtwinError, match="expected one of looks"):
            await desk.do({"op": "start", "folder": "c", "stage": "nothing"})
        with pytest.raises(RovtwinError, match="no such commissioning"):
            await desk.do({"op": "start", "folder": "../c", "stage": "looks"})
        await desk.do({"op": "start", "folder": "c", "stage": "computes"})
        desk._process.coming.append(("ended", ("died", "its process ended (exit code -9: is there memory left?)")))
        await settled(desk, lambda: hub.last["now"] is None)
        assert "exit code -9" in hub.last["ended"]["text"] and "start it again" in hub.last["ended"]["text"]

    ran(story())


def test_the_checklist_has_the_next_step_and_the_pages(desk, tmp_path):
    found = checklist(tmp_path, "c", CHEAP)
    assert found["due"] == "asks" and found["next"] == "Put it where it looks. Start Asks."
    assert [stage["state"] for stage in found["stages"]] == ["passed", "to do", "to do", "to do"]
    (attempt,) = found["stages"][0]["attempts"]
    assert [check["verdict"] for check in attempt["checks"]] == ["ok", "note"] and attempt["state"] == "go"
    assert [(file["path"], file["picture"]) for file in attempt["files"]] == [("1-looks/1/picture.png", True)]
    request = Dossier.open(tmp_path / "c").request
    commission(request, tmp_path / "c", STAGES, Yes(answer=False), only=["asks"])
    found = checklist(tmp_path, "c", CHEAP)
    assert found["next"] == "No-go, asked: it was not confirmed. Repeat this stage."
    (tmp_path / "c" / "2-asks" / "1" / "outcome.json").unlink()
    assert "cut off" in checklist(tmp_path, "c", CHEAP)["next"]
    ask_anew(tmp_path, "c", {"tank": "8x4x2"})
    found = checklist(tmp_path, "c", CHEAP)
    assert found["due"] == "looks" and "changed since" in found["next"] and found["request"]["minutes"] == 8.0


def test_commissionings_are_listed_begun_and_asked_for_anew(tmp_path):
    for name in ("../c", "", ".hidden", "a/b", "x" * 61, None, 7):
        with pytest.raises(ConfigError, match="folder"):
            begin(tmp_path, name, FORM)
    texts = {"vehicle": "", "tank": "big", "link": "nobody://x", "prior": "nowhere.yaml"}
    figures = [("minutes", 0), ("minutes", True), ("seas", [99]), ("samples", 1.5), ("currents", "0.1")]
    for key, wrong in [*texts.items(), *figures]:
        with pytest.raises(ConfigError):
            begin(tmp_path, "c", FORM | {key: wrong})
    with pytest.raises(ConfigError, match="expected the fields"):
        begin(tmp_path, "c", None)
    assert not (tmp_path / "c").exists(), "nothing is written of what cannot be used"
    assert begin(tmp_path, "c", FORM | {"currents": [0, 0.3], "samples": 5}) == "c"
    with pytest.raises(ConfigError, match="there already"):
        begin(tmp_path, "c", FORM)
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "commission.json").write_text("{")
    assert [(one["name"], one["vehicle"], one["last"]) for one in listed(tmp_path)] == [("c", "double_blueye", "")]
    ask_anew(tmp_path, "c", {"minutes": 20.0})
    request = Dossier.open(tmp_path / "c").request
    assert (request.minutes, request.currents, request.samples, request.speed) == (20.0, (0.0, 0.3), 5, 1.0)
    with pytest.raises(ConfigError, match="commissioning of double_blueye"):
        ask_anew(tmp_path, "c", {"vehicle": "bluerov2_heavy"})
    with Dossier.open(tmp_path / "c").locked(), pytest.raises(ConfigError, match="another process"):
        ask_anew(tmp_path, "c", {"minutes": 9.0})


def test_no_file_outside_of_a_commissioning_is_served(desk, tmp_path):
    (tmp_path / "secret.txt").write_text("mine")
    os.symlink(tmp_path / "secret.txt", tmp_path / "c" / "1-looks" / "1" / "link.txt")
    assert file_of(tmp_path, "c", "1-looks/1/picture.png").name == "picture.png"
    for path in ("../secret.txt", "/etc/passwd", "1-looks", "1-looks/1/link.txt", "\0", "x" * 5000):
        with pytest.raises(ConfigError, match="no such file"):
            file_of(tmp_path, "c", path)
    for name in ("..", ".", "", "c/../..", "\0", "x" * 5000, "d"):
        with pytest.raises(ConfigError, match="no such commissioning"):
            find(tmp_path, name)


def test_pages_are_served_apart_and_mistakes_in_words(desk, tmp_path):
    import httpx
    from nicegui import app

    (tmp_path / "c" / "certificate.html").write_text("<script>parent.stop()</script>")
    add_commissioning(desk, tmp_path, {"vehicle": "double_blueye"})

    async def story():
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost") as client:
            found = (await client.get("/commission/list")).json()
            assert found["found"][0]["name"] == "c" and found["defaults"]["vehicle"] == "double_blueye"
            assert (await client.get("/commission/checklist?name=c")).json()["due"] == "asks"
            assert "no such commissioning" in (await client.get("/commission/checklist?name=..")).json()["error"]
            served = await client.get("/commission/file?name=c&path=certificate.html")
            assert served.headers["content-security-policy"] == APART["Content-Security-Policy"] != ""
            assert served.headers["x-content-type-options"] == "nosniff" and "parent.stop" in served.text
            assert (await client.get("/commission/file?name=c&path=../secret")).status_code == 404

    ran(story())


def test_a_request_that_was_begun_elsewhere_is_opened(tmp_path):
    Dossier.begin(tmp_path / "runs" / "c", Request("double_blueye", "twin://", seed=7, speed=2.0))
    ask_anew(tmp_path, "runs/c", {"minutes": 9.0})
    request = Dossier.open(tmp_path / "runs" / "c").request
    assert (request.seed, request.speed, request.minutes) == (7, 2.0, 9.0)
    assert [one["name"] for one in listed(tmp_path)] == ["runs/c"]
