"""A wire of ZeroMQ messages that misbehaves, for a Blueye's three sockets: the faults reach single messages.

What ZeroMQ passes on is whole and in order on a sound connection; relays, full queues and other software are not sound.
"""

import asyncio
import contextlib
from collections.abc import Callable
from typing import Any

import zmq
import zmq.asyncio
from tests.links.faults.wire import Wire, damage

TELEMETRY, REQUESTS, CONTROL = 5555, 5556, 5557


class ZmqProxy:
    """A Blueye at another address: its messages, each of a name and a content, pass one by one."""

    def __init__(self, wire: Wire, here: str, drone: str):
        self.wire, self._here, self._drone = wire, here, drone

    async def start(self) -> None:
        self._context = zmq.asyncio.Context()
        telemetry, published = self._pair(TELEMETRY, zmq.SUB, zmq.PUB)
        telemetry.setsockopt(zmq.SUBSCRIBE, b"")
        inner, outer = self._pair(REQUESTS, zmq.DEALER, zmq.ROUTER)
        commands, received = self._pair(CONTROL, zmq.PUB, zmq.SUB)
        received.setsockopt(zmq.SUBSCRIBE, b"")
        self._sockets = (telemetry, published, inner, outer, commands, received)
        ways = ((False, telemetry, published), (True, received, commands), (True, outer, inner), (False, inner, outer))
        self._tasks = [asyncio.ensure_future(self._pump(*way)) for way in ways]

    def _pair(self, port: int, towards_drone: int, towards_client: int) -> tuple[Any, Any]:
        inner, outer = self._context.socket(towards_drone), self._context.socket(towards_client)
        inner.connect(f"tcp://{self._drone}:{port}")
        outer.bind(f"tcp://{self._here}:{port}")
        for socket in (inner, outer):
            socket.setsockopt(zmq.LINGER, 0)
        return inner, outer

    async def stop(self) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for socket in self._sockets:
            socket.close(0)
        self._context.term()

    async def _pump(self, upwards: bool, source: Any, sink: Any) -> None:
        loop, rng, last = asyncio.get_running_loop(), self.wire.rng, 0.0
        while True:
            frames = await source.recv_multipart()
            fault = self.wire.fault(upwards)
            for late, how in fault.fates(rng):
                due = loop.time() + late
                if not fault.held and not fault.jitter:
                    due = last = max(due, last)
                self._later(due, sink, self._damaged(frames, how))

    def _later(self, due: float, sink: Any, frames: list[bytes]) -> None:
        send: Callable[[], None] = lambda: self._send(sink, frames)  # noqa: E731
        asyncio.get_running_loop().call_at(due, send)

    def _send(self, sink: Any, frames: list[bytes]) -> None:
        self.wire.passed += 1
        if not sink.closed:
            with contextlib.suppress(zmq.Again):  # a full queue loses, too
                zmq.Socket.shadow(sink.underlying).send_multipart(frames, zmq.DONTWAIT)

    def _damaged(self, frames: list[bytes], how: str) -> list[bytes]:
        """The name or the content, cut or garbled, or the content missing; what ZeroMQ routes by stays."""
        if not how:
            return frames
        frames, rng = list(frames), self.wire.rng
        which = rng.choice((-1, -1, -2)) if len(frames) > 1 else -1
        if how == "cut" and rng.random() < 0.2 and len(frames) > 1:
            return frames[:-1]
        frames[which] = damage(frames[which], how, rng)
        return frames
