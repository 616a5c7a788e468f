"""The web server's side of the wire: news of the engine as they come, orders and their answers, and STOP."""

import asyncio
import itertools
import json
import socket
import time
from collections.abc import Callable
from typing import Any

import zmq
import zmq.asyncio

from rovtwin.console.wire import Place, encode
from rovtwin.core.errors import LinkError

PATIENCE = 2.5  # for an answer [s]
HUNG = 1.0  # an engine that was not heard for so long hangs, or is gone [s]

News = Callable[[str, bytes], None]  # kind and text of a message


class Client:
    """An engine somewhere on this machine.

    Attributes:
        last: The latest message of each kind.
        heard_at: When the engine last said anything [s, monotonic].
    """

    def __init__(self, place: Place, news: News):
        """Calls `news` in the event loop for every message."""
        self._place, self._news = place, news
        self._ear = zmq.asyncio.Context.instance().socket(zmq.SUB)
        self._mouth = zmq.Context.instance().socket(zmq.DEALER)  # speaks at once or not at all
        self._answers = zmq.asyncio.Socket.shadow(self._mouth)  # and is listened to in the event loop
        self._ear.setsockopt(zmq.RCVHWM, 40)
        self._ear.setsockopt(zmq.SUBSCRIBE, b"")
        self._ear.connect(place.news)
        # What is not heard at once is not said: an order must not reach an engine that starts later.
        self._mouth.setsockopt(zmq.IMMEDIATE, 1)
        self._mouth.setsockopt(zmq.LINGER, 0)
        self._mouth.connect(place.orders)
        self._red = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._red.setblocking(False)
        self._numbers = itertools.count(1)
        self._waiting: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self.last: dict[str, dict[str, Any]] = {}
        self.heard_at = -1e9

    async def listen(self) -> None:
        """Until cancelled."""
        await asyncio.gather(self._hear_news(), self._hear_answers())

    @property
    def hung(self) -> bool:
        """Whether the engine has not been heard for a while."""
        return time.monotonic() - self.heard_at > HUNG

    def stop(self) -> bool:
        """Thrusters off, past the engine; whether the link's host was there to hear it."""
        try:
            self._red.sendto(b"stop", str(self._place.stop))
            heard = True
        except OSError:  # no vehicle is held
            heard = False
        self.tell("stop")
        return heard

    def tell(self, do: str, **what: Any) -> None:
        """An order that nobody waits for."""
        try:
            self._mouth.send(encode({"do": do, "sent": time.monotonic()} | what), zmq.NOBLOCK)
        except zmq.Again:
            pass

    async def ask(self, do: str, **what: Any) -> dict[str, Any]:
        """An order; what the engine answers.

        Raises:
            LinkError: It refuses, or does not answer; the text is for people.
        """
        number = next(self._numbers)
        answer: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        self._waiting[number] = answer
        try:
            self.tell(do, id=number, **what)
            found = await asyncio.wait_for(answer, PATIENCE)
        except TimeoutError:
            raise LinkError("the autopilot does not answer. STOP works all the same") from None
        finally:
            self._waiting.pop(number, None)
        if not found["ok"]:
            raise LinkError(found["error"])
        return found

    def close(self) -> None:
        """Let go of the sockets; the engine goes on."""
        for one in (self._ear, self._mouth, self._red):
            one.close()

    async def _hear_news(self) -> None:
        while True:
            text = await self._ear.recv()
            self.heard_at = time.monotonic()
            message = json.loads(text)
            self.last[message["kind"]] = message
            self._news(message["kind"], text)

    async def _hear_answers(self) -> None:
        while True:
            message = json.loads(await self._answers.recv())
            waiting = self._waiting.get(message.get("id"))
            if waiting is not None and not waiting.done():
                waiting.set_result(message)
