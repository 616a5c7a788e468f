"""The web server's side of the wire: news of the engine as they come, orders and their answers, and STOP."""

import asyncio
import itertools
import json
import logging
import os
import socket
import time
from collections.abc import Callable
from typing import Any

import zmq
import zmq.asyncio

from rovtwin.console.wire import Place, encode
from rovtwin.core.errors import LinkError

logger = logging.getLogger(__name__)

PATIENCE = 2.5  # for an answer [s]
CONFIRMED = 0.5  # longest wait until the link's host says that thrusters are off [s]
HUNG = 1.0  # an engine that was silent for so long hangs, or is gone [s]

News = Callable[[str, bytes], None]  # kind and text of a message


class Client:
    """An engine somewhere on this machine.

    Attributes:
        last: The latest message of each kind.
        heard_at: When the engine last said anything [s, monotonic].
        also_stops: Called first by every STOP, and returns at once: whether it ends something that moves a vehicle
            which the engine does not hold.
    """

    def __init__(self, place: Place, news: News):
        """Calls `news` in the event loop for every message."""
        self._place, self._news = place, news
        self._ear = zmq.asyncio.Context.instance().socket(zmq.SUB)
        self._order_socket = zmq.asyncio.Context.instance().socket(zmq.DEALER)
        self._ear.setsockopt(zmq.RCVHWM, 40)
        self._ear.setsockopt(zmq.SUBSCRIBE, b"")
        self._ear.connect(place.news)
        # What is not received at once is dropped: an order must not reach an engine that starts later.
        self._order_socket.setsockopt(zmq.IMMEDIATE, 1)
        self._order_socket.setsockopt(zmq.LINGER, 0)
        self._order_socket.connect(place.orders)
        self._red = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._red.setblocking(False)
        self._red_at = place.folder / f"stopped-{os.getpid()}"  # where the link's host answers
        self._red_at.unlink(missing_ok=True)
        self._red.bind(str(self._red_at))
        self._numbers = itertools.count(1)
        self._waiting: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._stopping: dict[bytes, asyncio.Future[None]] = {}
        self.last: dict[str, dict[str, Any]] = {}
        self.received_at = -1e9
        self.also_stops: Callable[[], bool] = lambda: False

    async def listen(self) -> None:
        """Until cancelled."""
        loop = asyncio.get_running_loop()
        loop.add_reader(self._red, self._receive_stopped)
        try:
            await asyncio.gather(self._receive_news(), self._receive_answers())
        finally:
            loop.remove_reader(self._red)

    @property
    def hung(self) -> bool:
        """Whether the engine has been silent for a while."""
        return time.monotonic() - self.received_at > HUNG

    async def stop(self) -> bool:
        """Thrusters off, past the engine; False where there is no vehicle to stop.

        Raises:
            LinkError: The link's host is there, and does not say that thrusters are off; the text is for people.
        """
        ends = self.also_stops()
        text = f"stop {next(self._numbers)}".encode()
        confirmed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._stopping[text] = confirmed
        try:
            there = self._press(text)
            self.tell("stop")
            if there:
                await asyncio.wait_for(confirmed, CONFIRMED)
        except TimeoutError:
            raise LinkError(
                "the vehicle's process does not confirm that thrusters are off. Cut the vehicle's power"
            ) from None
        finally:
            self._stopping.pop(text, None)
        return there or ends

    def off(self) -> None:
        """Thrusters off, past the engine, for who cannot wait for an answer."""
        self.also_stops()
        self._press(b"stop at the end")

    def _press(self, text: bytes) -> bool:
        """Tell the link's host to stop; whether there is one."""
        try:
            self._red.sendto(text, str(self._place.stop))
        except BlockingIOError:  # one that does not listen; what waits there will stop it when it does
            return True
        except OSError:  # the socket is not there, or of a host that is gone
            return False
        return True

    def tell(self, do: str, /, **what: Any) -> None:
        """An order that nobody waits for: it is said at once or not at all."""
        # Through the socket of the event loop: to send past it may swallow the sign that an answer has come.
        sent: Any = self._order_socket.send(encode(what | {"do": do, "sent": time.monotonic()}), zmq.NOBLOCK)
        sent.exception()  # an engine that takes no more orders hangs, and is known to

    async def ask(self, do: str, /, **what: Any) -> dict[str, Any]:
        """An order; what the engine answers.

        Raises:
            LinkError: It refuses, or does not answer; the text is for people.
        """
        number = next(self._numbers)
        answer: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        self._waiting[number] = answer
        try:
            self.tell(do, **what | {"id": number})
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
        for one in (self._ear, self._order_socket, self._red):
            one.close()
        self._red_at.unlink(missing_ok=True)

    async def _receive_news(self) -> None:
        while True:
            text = await self._ear.recv()
            self.received_at = time.monotonic()
            try:
                message = json.loads(text)
                self.last[message["kind"]] = message
                self._news(message["kind"], text)
            except Exception:  # one message that nobody understands must not deafen the console
                logger.exception("news of the autopilot: %.200r", text)

    async def _receive_answers(self) -> None:
        while True:
            message = json.loads(await self._order_socket.recv())
            waiting = self._waiting.get(message.get("id"))
            if waiting is not None and not waiting.done():
                waiting.set_result(message)

    def _receive_stopped(self) -> None:
        """The link's host says that it obeyed a STOP."""
        try:
            waiting = self._stopping.get(self._red.recv(64))
        except OSError:  # nothing after all
            return
        if waiting is not None and not waiting.done():
            waiting.set_result(None)
