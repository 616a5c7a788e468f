"""Wires that misbehave: proxies for UDP and TCP that delay, lose, reorder, repeat, cut and garble what they pass on.

A `Wire` holds what is wrong in each direction and may be changed at any time; several proxies may share one. Proxies
run in a `Loop`, an asyncio loop in a thread. ZeroMQ messages have their own proxy in `wire_faults_zmq`.
"""

import asyncio
import contextlib
import random
import threading
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass, field, replace
from typing import Any

CHUNK = 65536


@dataclass(frozen=True)
class Fault:
    """What happens to what goes one way; shares are probabilities per unit (datagram, message, piece of a stream).

    Attributes:
        delay, jitter: Time under way, and what is added to it at random, evenly distributed [s].
        loss, twice, cut, garbage: Shares that vanish, come twice, lose their end, become random bytes.
        held, hold: Share that is held back, so that later ones overtake it, and for how long [s].
        copies: How often each comes.
        hole: Nothing passes, and nobody is informed: connections stay open.
    """

    delay: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    twice: float = 0.0
    cut: float = 0.0
    garbage: float = 0.0
    held: float = 0.0
    hold: float = 0.2
    copies: int = 1
    hole: bool = False

    def fates(self, rng: random.Random) -> list[tuple[float, str]]:
        """What becomes of one unit: of each copy that arrives the time under way [s] and "", "cut" or "garbage"."""
        if self.hole or rng.random() < self.loss:
            return []
        copies = self.copies * (2 if rng.random() < self.twice else 1)
        return [self._fate(rng) for _ in range(copies)]

    def _fate(self, rng: random.Random) -> tuple[float, str]:
        late = self.delay + self.jitter * rng.random() + (self.hold if rng.random() < self.held else 0.0)
        how = rng.random()
        return late, "cut" if how < self.cut else "garbage" if how < self.cut + self.garbage else ""


SOUND = Fault()


@dataclass
class Wire:
    """What is wrong, towards the server (`up`) and towards the client (`down`); `passed` counts units that came."""

    up: Fault = SOUND
    down: Fault = SOUND
    rng: random.Random = field(default_factory=lambda: random.Random(7))
    passed: int = 0

    def set(self, both: Fault | None = None, *, up: Fault = SOUND, down: Fault = SOUND) -> None:
        self.up, self.down = (both, both) if both is not None else (up, down)

    def mend(self) -> None:
        self.set(SOUND)

    def fault(self, upwards: bool) -> Fault:
        return self.up if upwards else self.down


def damage(data: bytes, how: str, rng: random.Random) -> bytes:
    """Bytes that lost their end, or random ones of about as many."""
    if how == "cut":
        return data[: rng.randrange(max(1, len(data)))]
    return rng.randbytes(rng.randint(1, 2 * len(data) + 8)) if how == "garbage" else data


class Loop:
    """An asyncio loop in a thread; what is opened in it is closed with it."""

    def __init__(self) -> None:
        self.loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self.loop.run_forever, daemon=True)
        self._thread.start()
        self._open: list[Any] = []

    def run(self, doing: Coroutine[Any, Any, Any]) -> Any:
        return asyncio.run_coroutine_threadsafe(doing, self.loop).result(10.0)

    def open(self, proxy: Any) -> Any:
        """Start a proxy, and stop it at the end."""
        self.run(proxy.start())
        self._open.append(proxy)
        return proxy

    def __enter__(self) -> "Loop":
        return self

    def __exit__(self, *_: object) -> None:
        for proxy in reversed(self._open):
            self.run(proxy.stop())
        self.loop.call_soon_threadsafe(self.loop.stop)
        self._thread.join(5.0)
        assert not self._thread.is_alive()
        self.loop.close()


class UdpProxy:
    """Datagrams from clients of one address to a server and back. A held-back or jittered one is overtaken."""

    def __init__(self, wire: Wire, here: tuple[str, int], server: tuple[str, int]):
        self.wire, self._here, self._server = wire, here, server
        self._ups: dict[Any, asyncio.DatagramTransport] = {}
        self._free: list[asyncio.DatagramTransport] = []
        self._clients: dict[asyncio.DatagramTransport, Any] = {}

    def forget(self) -> None:
        """All clients are gone: the next ones get their ports towards the server, which knows only so many."""
        self._free += self._ups.values()
        self._ups.clear()
        self._clients.clear()

    async def start(self) -> None:
        loop = asyncio.get_running_loop()
        self._making = asyncio.Lock()
        self._front, _ = await loop.create_datagram_endpoint(lambda: _Datagrams(self._up), local_addr=self._here)

    async def stop(self) -> None:
        for transport in (self._front, *self._ups.values(), *self._free):
            transport.close()

    def _up(self, data: bytes, client: Any) -> None:
        asyncio.ensure_future(self._forward(data, client))

    async def _forward(self, data: bytes, client: Any) -> None:
        async with self._making:
            if client not in self._ups:
                self._ups[client] = self._free.pop() if self._free else await self._new_up()
                self._clients[self._ups[client]] = client
        self._pass(True, data, self._ups[client].sendto)

    async def _new_up(self) -> asyncio.DatagramTransport:
        def down(answer: bytes, _: Any) -> None:
            client = self._clients.get(transport)
            if client is not None:
                self._pass(False, answer, lambda piece: self._front.sendto(piece, client))

        loop = asyncio.get_running_loop()
        transport, _ = await loop.create_datagram_endpoint(lambda: _Datagrams(down), remote_addr=self._server)
        return transport

    def _pass(self, upwards: bool, data: bytes, send: Callable[[bytes], None]) -> None:
        rng = self.wire.rng
        for late, how in self.wire.fault(upwards).fates(rng):
            self.wire.passed += 1
            asyncio.get_running_loop().call_later(late, send, damage(data, how, rng))


class _Datagrams(asyncio.DatagramProtocol):
    def __init__(self, take: Callable[[bytes, Any], None]):
        self._take = take

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self._take(data, addr)

    def error_received(self, exc: Exception) -> None:
        """The other end is not there, or not yet again."""


class TcpProxy:
    """Connections to one port, passed on to a server's. What is cut ends the connection, as on a wire.

    A hole keeps connections open and what was sent waits, as in the kernel's buffers of a host whose cable is out;
    after it all of it arrives, unless `reset` is called, as when a host has given up meanwhile. Connections made in a
    hole reach nobody before its end.
    """

    def __init__(self, wire: Wire, here: tuple[str, int], server: tuple[str, int]):
        self.wire, self._here, self._server = wire, here, server
        self._tasks: set[asyncio.Task[None]] = set()

    async def start(self) -> None:
        self._listener = await asyncio.start_server(self._serve, *self._here)

    async def stop(self) -> None:
        self._listener.close()
        await self.reset()

    async def reset(self) -> None:
        """Break every connection there is."""
        tasks = list(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        writers, ways = [writer], []
        try:
            await self._through(True)
            back, forth = await asyncio.open_connection(*self._server)
            writers.append(forth)
            ways = [asyncio.ensure_future(self._pump(*way)) for way in ((True, reader, forth), (False, back, writer))]
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            with contextlib.suppress(OSError):
                for one in writers:
                    await one.drain()
        except (OSError, asyncio.CancelledError):
            pass
        finally:
            self._tasks.discard(task)
            for way in ways:
                way.cancel()
            await asyncio.gather(*ways, return_exceptions=True)
            for one in writers:
                one.close()

    async def _through(self, upwards: bool) -> None:
        while self.wire.fault(upwards).hole:
            await asyncio.sleep(0.005)

    async def _pump(self, upwards: bool, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Pieces in order, each as late as its fault wants it; the next is read meanwhile."""
        waiting: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(1000)
        deliver = asyncio.ensure_future(self._deliver(waiting, upwards, writer))
        loop, rng = asyncio.get_running_loop(), self.wire.rng
        try:
            while data := await _unless_over(reader.read(CHUNK), deliver):
                # Of a stream nothing vanishes and nothing overtakes: only time and damage are left.
                fault = replace(self.wire.fault(upwards), loss=0.0, held=0.0, copies=1, twice=0.0, hole=False)
                ((late, how),) = fault.fates(rng)
                await waiting.put((loop.time() + late, damage(data, how, rng)))
                if how == "cut":
                    break
            if not deliver.done():
                await waiting.put((loop.time(), b""))
            await deliver
        except OSError:
            pass
        finally:
            deliver.cancel()

    async def _deliver(self, waiting: "asyncio.Queue[tuple[float, bytes]]", upwards: bool, writer: Any) -> None:
        loop = asyncio.get_running_loop()
        while True:
            due, data = await waiting.get()
            await asyncio.sleep(max(0.0, due - loop.time()))
            await self._through(upwards)
            if not data:
                return
            self.wire.passed += 1
            writer.write(data)
            await writer.drain()


async def _unless_over(doing: Awaitable[bytes], other: "asyncio.Future[None]") -> bytes:
    """What is read, or nothing when the other side is gone."""
    task = asyncio.ensure_future(doing)
    try:
        await asyncio.wait([task, other], return_when=asyncio.FIRST_COMPLETED)
        return task.result() if task.done() else b""
    finally:
        task.cancel()
