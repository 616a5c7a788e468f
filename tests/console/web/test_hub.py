"""The hub with an engine that is not there: orders, who may give them, pages that come, go, and do not read."""

import asyncio
import json
import os
import time

import pytest
from tests.console import errands
from tests.console.loops import ran

pytest.importorskip("zmq", reason="the console needs pyzmq: pip install 'rovtwin[console]'")
pytest.importorskip("nicegui", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")

from starlette.websockets import WebSocketDisconnect

from rovtwin.console.planning import MOST
from rovtwin.console.web import browser, drafting, hub, sockets
from rovtwin.console.web.app import LARGEST
from rovtwin.console.wire import Place, encode
from rovtwin.core.errors import LinkError
from rovtwin.core.user_files import files
from rovtwin.scenario.files import load_scenario
from rovtwin.vehicle import load_vehicle


class FakeClient:
    """An engine that obeys all; `given` is what it was sent, with when."""

    def __init__(self, place, news):
        self.last, self.given, self.hung = {}, [], False
        self.broken = False

    def tell(self, do, /, **what):
        self.given.append((do, time.monotonic()))

    async def ask(self, do, /, **what):
        if self.broken:
            raise TypeError("a mistake of ours")
        encode(what)
        self.given.append((do, time.monotonic()))
        return {"ok": True, "checks": []}

    async def stop(self):
        self.given.append(("stop", time.monotonic()))
        return True

    def did(self, do):
        return [order for order, _ in self.given].count(do)


@pytest.fixture
def desk(tmp_path, monkeypatch):
    monkeypatch.setattr(hub, "Client", FakeClient)
    monkeypatch.setattr(hub, "PATIENCE", 300.0)  # tests may run on a machine that is busy
    return hub.Hub(Place(tmp_path), load_scenario("lawnmower_calm"))


def messages_of(page):
    """All that waits for a page."""
    texts = [json.loads(text) for text in page._texts]
    page._texts.clear()
    return texts


def obey(desk, page, text):
    """Give an order; the answer."""
    messages_of(page)
    ran(desk.obey(page, text if isinstance(text, str) else json.dumps(text)))
    replies = [message for message in messages_of(page) if message["kind"] == "reply"]
    return replies[0] if replies else None


JUNK = [
    "",
    "[]",
    "7",
    "{",
    '{"id": 1}',
    '{"id": [[[]]], "do": {"do": 1}}',
    '{"id": NaN, "do": "arm", "pulse": Infinity}',
    '{"id": 1, "do": "goto", "self": 1, "do ": 2, "sent": 1e999, "x": 1e999}',
    '{"id": 1, "do": "plan", "op": ["add"]}',
    '{"id": 1, "do": "plan", "op": "add", "x": Infinity, "y": 0}',
    '{"id": 1, "do": "plan", "op": "add", "x": 1' + "0" * 400 + ', "y": 0}',
    '{"id": 1, "do": "plan", "op": "template", "name": "square", "side": 1' + "0" * 400 + "}",
    '{"id": 1, "do": "plan", "op": "template", "name": "lawnmower", "area": [[0, 0], [0, 9], "x"]}',
    '{"id": 1, "do": "plan", "op": "template", "name": "lawnmower", "area": [[0,0],[9,0],[9,9]], "spacing": 1e-9}',
    '{"id": 1, "do": "plan", "op": "import", "text": {"a": 1}}',
    '{"id": 1, "do": "plan", "op": "edit", "i": -1}',
    '{"id": 1, "do": "goto", "x": ' + "[" * 600 + "]" * 600 + "}",
    '{"id": 1, "do": ' + "[" * 100_000 + "]" * 100_000 + "}",
    '{"id": 1, "do": "_check"}',
    '{"id": 1, "do": "__init__"}',
]


@pytest.mark.system
@pytest.mark.parametrize("text", JUNK, ids=lambda text: text[:40])
def test_junk_is_refused_with_an_answer(desk, text):
    page = desk.come("b1")
    answer = obey(desk, page, text)
    if text.startswith(('{"id": NaN', '{"id": 1, "do": "goto", "self"')):
        return  # what the fake engine makes of it; the real one is strict, see test_orders
    assert answer is None or not answer["ok"]
    assert "[[[[[" not in text or "nested deeper" in answer["error"]
    assert desk.draft.rows == []
    assert obey(desk, page, {"id": 2, "do": "stop"})["ok"]


@pytest.mark.system
def test_plans_are_laid_for_the_vehicle_that_is_flown(tmp_path, monkeypatch):
    """Faster than the Double Blueye could, also where the scenario describes the vehicle itself."""
    monkeypatch.setattr(hub, "Client", FakeClient)
    monkeypatch.setattr(hub, "PATIENCE", 300.0)
    described = load_vehicle("sf30k").to_dict()
    desk = hub.Hub(Place(tmp_path), load_scenario("square").model_copy(update={"vehicle": described}))
    assert desk.plan()["own"] == {"speed": 0.4, "acceptance": 0.8}  # which the chart's form begins with
    page, area = desk.come("b1"), [[0, 0], [20, 0], [20, 20], [0, 20]]
    for template in ({"name": "square", "side": 9}, {"name": "lawnmower", "area": area, "spacing": 4, "depth": 3}):
        assert obey(desk, page, {"id": 1, "do": "plan", "op": "template"} | template)["ok"]
        assert {(row["speed"], row["acceptance"]) for row in desk.draft.rows} == {(0.4, 0.8)}


def test_a_mistake_of_ours_is_answered(desk):
    page = desk.come("b1")
    desk.client.broken = True
    answer = obey(desk, page, {"id": 3, "do": "arm"})
    assert answer["id"] == 3 and not answer["ok"] and "TypeError" in answer["error"]


def test_only_who_is_in_control_gives_orders_and_anybody_stops(desk):
    one, other = desk.come("b1"), desk.come("b2")
    for order in ("arm", "disarm", "start", "goto", "pilot", "plan", "pace", "inject", "reconnect"):
        assert "in control" in obey(desk, other, {"id": 1, "do": order})["error"]
    obey(desk, other, {"do": "alive"})
    assert desk.client.given == []  # the watchdog hears of nobody who only watches
    obey(desk, one, {"do": "alive"})
    assert desk.client.did("alive") == 1
    assert obey(desk, other, {"id": 1, "do": "stop"})["ok"] and desk.client.did("stop") == 1


def test_stop_does_not_wait_behind_a_file_that_is_read(desk, monkeypatch):
    """By a process of its own: a thread that parses would let the server's own go on every now and then only."""
    monkeypatch.setattr(drafting, "imported", errands.read_slowly)

    async def press():
        page = desk.come("b1")
        reading = asyncio.create_task(desk.obey(page, '{"do": "plan", "op": "import", "text": "..."}'))
        await asyncio.sleep(0.02)
        await desk.obey(page, '{"do": "stop"}')
        assert desk.client.did("stop") == 1 and not reading.done()
        await reading
        assert [row["x"] for row in desk.draft.rows] != [os.getpid()]
        desk.worker.close()

    ran(press())


def test_places_on_the_map_become_metres_of_the_plan(tmp_path, monkeypatch):
    monkeypatch.setattr(hub, "Client", FakeClient)
    scenario = load_scenario("square", ["datum={latitude: 63.44, longitude: 10.42}"])
    desk = hub.Hub(Place(tmp_path), scenario)
    page, at = desk.come("b1"), {"latitude": 63.4401, "longitude": 10.4204}
    assert obey(desk, page, {"id": 1, "do": "plan", "op": "add", "depth": 2} | at)["ok"]
    x, y, _ = scenario.origin.position(63.4401, 10.4204, 2.0)
    assert [desk.draft.rows[0][key] for key in ("x", "y")] == pytest.approx([x, y], abs=1e-3)
    assert obey(desk, page, {"id": 1, "do": "plan", "op": "edit", "i": 0, "latitude": 63.4402})["ok"]
    x, north_of, _ = scenario.origin.position(63.4402, 10.4204, 2.0)
    assert [desk.draft.rows[0][key] for key in ("x", "y")] == pytest.approx([x, north_of], abs=2e-3)
    before = desk.draft.rows
    for wrong in (
        {"latitude": 10.42},
        {"latitude": 163.0},
        {"latitude": "63"},
        {"latitude": None},
        {"latitude": 1e400},
    ):
        order = {"id": 1, "do": "plan", "op": "edit", "i": 0} | wrong
        assert not obey(desk, page, order)["ok"] and desk.draft.rows == before
    assert not obey(desk, page, {"id": 1, "do": "plan", "op": "add", "latitude": 63.44})["ok"]  # and the longitude?


def test_without_a_datum_no_place_on_the_map_is_taken(desk):
    order = {"id": 1, "do": "plan", "op": "add", "latitude": 63.44, "longitude": 10.42}
    assert "--set 'datum=" in obey(desk, desk.come("b1"), order)["error"]


def test_a_file_that_is_too_large_is_refused_with_the_limit(desk):
    page = desk.come("b1")
    large = "waypoints: []" + " " * files.MOST_UPLOAD
    answer = obey(desk, page, {"id": 1, "do": "plan", "op": "import", "text": large})
    assert not answer["ok"] and answer["error"] == "the file: found 100 kB, expected at most 100 kB"
    assert len(json.dumps({"text": "\n" * files.MOST_UPLOAD})) < LARGEST  # what is allowed reaches the server


def test_a_plan_as_long_as_can_be_is_a_file_that_can_be_read_again(desk):
    row = {"x": -1234.567, "y": 1234.567, "depth": 123.456, "speed": 0.123, "acceptance": 0.123}
    desk.draft.load([row | {"hold_time": 12.5, "heading_deg": -123.5, "altitude": 1.25}] * MOST)
    assert len(desk.draft.as_yaml().encode()) < files.MOST_UPLOAD


def test_a_flood_of_orders_is_answered_and_stop_among_them(desk, monkeypatch):
    """Of changes to a plan only the newest is checked; what comes while too many wait is refused at once."""
    checking = asyncio.Event()

    async def slow(do, /, **what):
        desk.client.given.append((do, time.monotonic()))
        await checking.wait()
        return {"ok": True}

    monkeypatch.setattr(desk.client, "ask", slow)

    async def flood():
        page = desk.come("b1")
        messages_of(page)
        orders = [{"id": i, "do": "plan", "op": "add", "x": float(i), "y": 0.0} for i in range(100)]
        tasks = [asyncio.create_task(desk.obey(page, json.dumps(order))) for order in orders]
        await asyncio.sleep(0.01)
        await desk.obey(page, '{"id": "stop", "do": "stop"}')
        early = {reply["id"]: reply for reply in messages_of(page) if reply["kind"] == "reply"}
        assert early["stop"]["ok"] and len(early) == 1 + 100 - hub.AT_ONCE
        assert all("wait already" in reply["error"] for number, reply in early.items() if number != "stop")
        checking.set()
        await asyncio.gather(*tasks)
        late = [reply for reply in messages_of(page) if reply["kind"] == "reply"]
        assert len(late) == hub.AT_ONCE == len(desk.draft.rows) and all(reply["ok"] for reply in late)
        assert desk.client.did("check") <= 2
        desk.worker.close()

    ran(flood())


def test_an_order_that_waited_in_the_network_is_not_given(desk):
    page, old = desk.come("b1"), time.monotonic() - hub.LATE - 1.0
    for order in ({"do": "start"}, {"do": "arm"}, {"do": "pilot", "surge": 1}, {"do": "plan", "op": "submit"}):
        assert "late" in obey(desk, page, order | {"id": 1, "pulse": old})["error"]
    for wrong in (time.monotonic() + 60.0, True, "now", [old]):
        assert not obey(desk, page, {"id": 1, "do": "arm", "pulse": wrong})["ok"]
    assert desk.client.given == []
    for order in ("stop", "disarm", "abort"):
        assert obey(desk, page, {"id": 1, "do": order, "pulse": old})["ok"]
    assert obey(desk, page, {"id": 1, "do": "arm", "pulse": time.monotonic()})["ok"]


def test_a_page_hears_first_of_the_pulse_and_who_it_is(desk):
    reported = messages_of(desk.come("b1"))
    assert reported[0]["kind"] == "pulse" and abs(reported[0]["at"] - time.monotonic()) < 1.0
    assert next(message for message in reported if message["kind"] == "rights")["you"] == "b1"


def test_a_duplicated_tab_is_another_page(desk, monkeypatch):
    """The browser copies the name along with the tab; control stays with the original."""
    monkeypatch.setattr(hub, "LIVING", 60.0)
    first = desk.come("b1")
    second = desk.come("b1")
    assert second.name != "b1" and desk.rights.holder == "b1"
    assert "in control" in obey(desk, second, {"id": 1, "do": "arm"})["error"]
    assert obey(desk, first, {"id": 1, "do": "arm"})["ok"]
    desk.leave(second)
    assert desk.rights.holder == "b1"


def test_a_page_whose_network_was_lost_comes_back_as_itself(desk, monkeypatch):
    """Its old socket is silent and still open here: it is given up, and control stays."""
    first = desk.come("b1")
    monkeypatch.setattr(first, "_spoke_at", time.monotonic() - 2.0 * hub.LIVING)
    second = desk.come("b1")
    assert second.name == "b1" and first._over.is_set()
    desk.leave(first)
    assert desk.rights.message("b1")["may"]
    assert obey(desk, second, {"id": 1, "do": "arm"})["ok"]


def test_a_page_that_takes_nothing_is_given_up(desk):
    page, other = desk.come("b1"), desk.come("b2")
    for _ in range(browser.WAITING + 1):
        desk.say("info", "one more")
        messages_of(other)
    assert page._over.is_set() and len(page._texts) <= browser.WAITING
    assert not other._over.is_set()


class FakeSocket:
    """A browser's end of a WebSocket: says nothing, and takes what it is sent or not."""

    def __init__(self, takes=True, closes=None):
        """`closes`: the page is closed soon, and to close its socket then is this error."""
        self._takes, self._closes = takes, closes
        self.closed, self.query_params = None, {"name": "b1"}

    async def accept(self):
        pass

    async def send_text(self, text):
        if not self._takes:
            await asyncio.sleep(60.0)

    async def receive_text(self):
        await asyncio.sleep(0.02 if self._closes else 60.0)
        raise WebSocketDisconnect(1001)

    async def close(self, code, reason=""):
        if self._closes:
            raise self._closes
        self.closed = code


def serve(desk, socket, meanwhile=lambda: None):
    """Serve a page until it ends; how many of its tasks are left."""

    async def run():
        serving = asyncio.create_task(sockets.serve(desk, socket))
        await asyncio.sleep(0.01)
        meanwhile()
        await asyncio.wait_for(serving, 5.0)
        return len(asyncio.all_tasks()) - 1

    return ran(run())


@pytest.mark.parametrize("error", [RuntimeError("closed already"), WebSocketDisconnect(1006)])
def test_a_closed_page_leaves_nothing_behind(desk, error):
    assert serve(desk, FakeSocket(closes=error)) == 0
    assert desk._browsers == [] and desk.rights.message("b1")["in_control"] is None


def test_the_socket_of_a_page_that_takes_nothing_is_closed(desk):
    socket = FakeSocket(takes=False)

    def flood():
        for _ in range(browser.WAITING + 2):
            desk.say("info", "one more")

    assert serve(desk, socket, flood) == 0
    assert socket.closed == 1013 and desk._browsers == []


def test_a_page_that_says_too_much_is_read_more_slowly(desk, monkeypatch):
    monkeypatch.setattr(sockets, "PACE", 100)
    monkeypatch.setattr(sockets, "BURST", 0.2)
    socket = FakeSocket()

    async def chatter():
        await asyncio.sleep(0.0)
        return '{"do": "alive"}'

    async def listen():
        page = desk.come("b1")
        receiving = asyncio.create_task(sockets._receive(desk, socket, page))
        began = time.monotonic()
        await asyncio.sleep(0.5)
        receiving.cancel()
        return time.monotonic() - began

    monkeypatch.setattr(socket, "receive_text", chatter)
    seconds = ran(listen())
    assert 20 <= desk.client.did("alive") <= 100 * (seconds + 0.2) + 2


@pytest.fixture
def full(desk, monkeypatch):
    """As many pages as there may be, and one more comes; their sockets, and that of the last."""
    monkeypatch.setattr(sockets, "MOST_PAGES", 3)

    def come(silent):
        async def run():
            first = [FakeSocket() for _ in range(3)]
            serving = [asyncio.create_task(sockets.serve(desk, socket)) for socket in first]
            await asyncio.sleep(0.01)
            for browser_, seconds in zip(desk._browsers, silent, strict=True):
                browser_._spoke_at = time.monotonic() - seconds
            last = FakeSocket()
            serving.append(asyncio.create_task(sockets.serve(desk, last)))
            await asyncio.sleep(0.05)
            ended = [task.done() for task in serving]
            for task in serving:
                task.cancel()
            await asyncio.gather(*serving, return_exceptions=True)
            return [socket.closed for socket in (*first, last)], ended

        return ran(run())

    return come


def test_one_page_too_many_is_turned_away(full):
    closed, ended = full([0.0, sockets.GONE / 2, 1.0])
    assert closed == [None, None, None, sockets.LATER] and ended == [False, False, False, True]
    assert not sockets._pages


def test_the_most_silent_page_gives_way_to_a_new_one(full):
    """Pages say something five times a second: connections that nobody is behind keep no operator out."""
    closed, ended = full([0.0, 2 * sockets.GONE, sockets.GONE + 1.0])
    assert closed == [None, sockets.LATER, None, None] and ended == [False, True, False, False]


def test_nobody_in_control_is_reported(desk):
    one, other = desk.come("b1"), desk.come("b2")
    desk.leave(one)
    assert any("left, who was in control" in message.get("text", "") for message in messages_of(other))


def test_a_plan_of_the_engine_with_holes_in_it_is_shown_as_far_as_it_goes(desk):
    desk.client.last["flown"] = {"kind": "flown", "waypoints": [{"position": [1, 2, 3]}, {}]}
    desk._pass_on("flown", b"")
    assert [row["x"] for row in desk.draft.rows] == [1, 0.0]
    assert desk.plan()["flown"][1]["speed"] == 0.2


def test_an_engine_that_refuses_is_quoted(desk, monkeypatch):
    async def refuse(do, /, **what):
        raise LinkError("not armed")

    page = desk.come("b1")
    monkeypatch.setattr(desk.client, "ask", refuse)
    assert obey(desk, page, {"id": 1, "do": "start"})["error"] == "not armed"


def test_pages_of_replays_hear_how_long_nobody_is_in_control(desk):
    desk.client.last["state"] = {"armed": True, "phase": "go", "operator_age": 7.0, "eta": [0.0] * 6}
    desk.client.last["setup"] = {"operator_silent": {"limit": 60.0, "action": "hold"}, "thrusters": []}
    rule = {"limit": 60.0, "action": "hold"}
    assert desk.attended() == {"armed": True, "phase": "go", "operator_age": 7.0, "operator_silent": rule}
