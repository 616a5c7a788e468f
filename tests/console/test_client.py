"""The web server's side of the wire: STOP and what comes back of it, orders and answers, news that make no sense."""

import asyncio
import json
import socket
import threading
import time

import pytest
from tests.console.loops import ran

zmq = pytest.importorskip("zmq", reason="the console needs pyzmq: pip install 'rovtwin[console]'")

from rovtwin.console import client as module  # noqa: E402
from rovtwin.console.client import Client  # noqa: E402
from rovtwin.console.wire import Place  # noqa: E402
from rovtwin.core.errors import LinkError  # noqa: E402


class Engine:
    """What an engine binds, without an engine."""

    def __init__(self, place):
        context = zmq.Context.instance()
        self.news, self.orders = context.socket(zmq.PUB), context.socket(zmq.ROUTER)
        self.news.bind(place.news)
        self.orders.bind(place.orders)

    def received(self):
        """The next order, and who gave it."""
        assert self.orders.poll(2000)
        who, text = self.orders.recv_multipart()
        return json.loads(text), who

    def answer(self, who, **message):
        self.orders.send_multipart([who, json.dumps(message).encode()])

    def close(self):
        self.news.close(0)
        self.orders.close(0)


async def met(client, engine):
    """Wait until each hears the other."""
    while "hello" not in client.last:
        engine.news.send(b'{"kind":"hello"}')
        await asyncio.sleep(0.005)
    while not engine.orders.poll(5):
        client.tell("hello")
    await asyncio.sleep(0.02)
    while engine.orders.poll(0):
        engine.orders.recv_multipart()


def with_client(tmp_path, test, news=lambda kind, text: None):
    """Run `test(client, engine)` while a client listens to an engine."""

    async def run():
        place = Place(tmp_path)
        engine, client = Engine(place), Client(place, news)
        listening = asyncio.create_task(client.listen())
        try:
            await asyncio.wait_for(met(client, engine), 20.0)
            await test(client, engine)
        finally:
            listening.cancel()
            client.close()
            engine.close()

    ran(run())


def host(place, answers=True):
    """A link's host that hears STOP; what it heard."""
    ear, received = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM), []
    ear.bind(str(place / "stop"))
    ear.settimeout(2.0)

    def listen():
        text, sender = ear.recvfrom(64)
        received.append(time.monotonic())
        if answers:
            ear.sendto(text, sender)

    thread = threading.Thread(target=listen, daemon=True)
    thread.start()
    return ear, thread, received


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """Tests may run on a machine that is busy."""
    monkeypatch.setattr(module, "CONFIRMED", 5.0)


def test_stop_is_confirmed_by_the_host_and_sent_to_the_engine(tmp_path):
    ear, thread, received = host(tmp_path)

    async def test(client, engine):
        assert await client.stop() and len(received) == 1
        assert engine.received()[0]["do"] == "stop"

    with ear:
        with_client(tmp_path, test)
        thread.join(2.0)


def test_stop_that_nobody_confirms_is_reported(tmp_path, monkeypatch):
    """A host that hangs: what is in its socket will stop it, but nobody may believe that thrusters are off."""

    async def test(client, engine):
        for _ in range(20):  # more than fit into its socket
            with pytest.raises(LinkError, match="does not confirm"):
                await client.stop()

    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ear:
        ear.bind(str(tmp_path / "stop"))
        monkeypatch.setattr(module, "CONFIRMED", 0.005)
        with_client(tmp_path, test)


def test_two_who_press_stop_at_once_are_both_answered(tmp_path):
    async def test(client, engine):
        one, other = asyncio.create_task(client.stop()), asyncio.create_task(client.stop())
        await asyncio.sleep(0.01)
        (first, sender), (second, _) = ear.recvfrom(64), ear.recvfrom(64)
        ear.sendto(second, sender)
        ear.sendto(first, sender)
        assert await one and await other

    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ear:
        ear.bind(str(tmp_path / "stop"))
        with_client(tmp_path, test)


@pytest.mark.parametrize("left_over", [False, True])
def test_stop_without_a_host_is_no_error(tmp_path, left_over):
    """No vehicle is held: no socket, or that of a host that was killed."""
    if left_over:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ear:
            ear.bind(str(tmp_path / "stop"))

    async def test(client, engine):
        assert not await client.stop()
        assert engine.received()[0]["do"] == "stop"

    with_client(tmp_path, test)


def test_an_answer_is_received_though_another_order_is_sent_as_it_comes(tmp_path):
    """The socket tells of an answer once; to send before that is read must not swallow it."""

    async def test(client, engine):
        asked = asyncio.create_task(client.ask("hold"))
        await asyncio.sleep(0.01)
        order, who = engine.received()
        engine.answer(who, id=order["id"], ok=True)
        time.sleep(0.05)  # it has come, and nobody has looked
        client.tell("alive")
        await asyncio.wait_for(asked, 1.0)

    with_client(tmp_path, test)


def test_what_a_browser_says_changes_neither_order_nor_time_nor_number(tmp_path):
    async def test(client, engine):
        client.tell("goto", **{"do": "abort", "sent": 1e18, "self": 1, "x": 2.0})
        order, _ = engine.received()
        assert order["do"] == "goto" and order["x"] == 2.0 and abs(order["sent"] - time.monotonic()) < 1.0
        asked = asyncio.create_task(client.ask("goto", **{"self": 1, "id": 77, "do": "abort"}))
        await asyncio.sleep(0.01)
        order, who = engine.received()
        assert order["do"] == "goto" and order["id"] != 77
        engine.answer(who, id=order["id"], ok=False, error="no")
        with pytest.raises(LinkError, match="no"):
            await asked

    with_client(tmp_path, test)


def test_news_that_make_no_sense_deafen_nobody(tmp_path):
    kinds = []

    def news(kind, text):
        kinds.append(kind)
        if kind == "flown":
            raise KeyError("waypoints")

    async def test(client, engine):
        for text in (b'{"kind":"flown"}', b"{", b"[]", b"{}", b'{"kind":"state"}'):
            engine.news.send(text)
        for _ in range(200):
            if "state" in kinds:
                break
            await asyncio.sleep(0.01)
        assert [kind for kind in kinds if kind != "hello"] == ["flown", "state"]
        assert not client.hung

    with_client(tmp_path, test, news)
