"""TcpServer: many clients of one TCP port, none of which can hold up the others or the server."""

import asyncio
import contextlib
import math
import socket
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager

from rovtwin.core.errors import LinkError
from rovtwin.links.servers.server import address_taken

MOST_CLIENTS = 16
IDLE = 5.0  # after this a client gives way to a new one where there are too many: of what, see `open_tcp_server` [s]
MOST_WAITING = 256 * 1024  # bytes that a client may leave unread before it is dropped, beside the kernel's buffers
KERNEL_BUFFER = 64 * 1024  # bytes of the kernel's own sending buffer [as asked; Linux doubles it]
KEEP_ALIVE = ((socket.TCP_KEEPIDLE, 10), (socket.TCP_KEEPINTVL, 5), (socket.TCP_KEEPCNT, 3))  # [s, s, probes]


class _Reader(asyncio.StreamReader):
    """Keeps in mind when bytes came last [s, monotonic]; -inf: never."""

    last_at = -math.inf

    def feed_data(self, data: bytes) -> None:
        """Bytes that came."""
        self.last_at = time.monotonic()
        super().feed_data(data)


class Client:
    """One connection. `send` never waits: a client that does not read is dropped.

    Attributes:
        name: Its address, for people.
        slow, idle: Whether it was dropped because it left too much unread, or because others waited.
        gone: Whether the connection is closed or being so.
    """

    def __init__(self, reader: _Reader, writer: asyncio.StreamWriter):
        self.reader, self.came_at = reader, time.monotonic()
        self._writer = writer
        peer = writer.get_extra_info("peername")
        self.name = f"{peer[0]}:{peer[1]}" if peer else "a client"
        self.slow = self.idle = False
        self._empty_at = self.came_at  # when all that was queued had last gone out [s, monotonic]

    @property
    def silence(self) -> tuple[float, float]:
        """How long it has been silent [s], by which clients give way: since it last said anything, since it came."""
        now = time.monotonic()
        return now - self.reader.last_at, now - self.came_at

    @property
    def stuck(self) -> float:
        """For how long it has not taken what waits for it [s]; 0 where nothing waits."""
        waits = self._writer.transport.get_write_buffer_size() > 0
        return time.monotonic() - self._empty_at if waits else 0.0

    @property
    def gone(self) -> bool:
        return self._writer.transport.is_closing()

    def send(self, data: bytes) -> None:
        """Queue bytes for it."""
        transport = self._writer.transport
        if transport.is_closing():
            return
        if transport.get_write_buffer_size() == 0:
            self._empty_at = time.monotonic()
        self._writer.write(data)
        if transport.get_write_buffer_size() > MOST_WAITING:
            self.slow = True
            transport.abort()

    @property
    def ending(self) -> str:
        """How it ended, for people."""
        if self.slow:
            return "did not read and was dropped"
        return "gave way to another" if self.idle else "left"

    async def finish(self) -> None:
        """Close after what is queued has gone out, or after two seconds."""
        self._writer.close()
        with contextlib.suppress(OSError, TimeoutError):
            await asyncio.wait_for(self._writer.wait_closed(), 2.0)
        self.drop()

    def drop(self) -> None:
        """Close at once."""
        self._writer.transport.abort()


class TcpServer:
    """Those who are connected now, and how many could not be had."""

    def __init__(self, say: Callable[[str], None], must_ask: bool = False):
        self.clients: set[Client] = set()
        self.refused = self.dropped = 0
        self._say, self._must_ask = say, must_ask
        self._tasks: set[asyncio.Task[None]] = set()

    def make_room(self) -> bool:
        """Drop one client that makes no use of its place, if there is one; whether there was. See `open_tcp_server`."""
        useless = [one for one in self.clients if one.stuck >= IDLE]
        if not useless and self._must_ask:
            useless = [one for one in self.clients if min(one.silence) >= IDLE]
        if not useless:
            return False
        first = max(useless, key=lambda one: (one.stuck, one.silence))
        first.idle = True
        first.drop()
        self.clients.discard(first)
        return True

    def say_of(self, text: str) -> None:
        """Tell the user, in plain ASCII: what clients send goes nowhere near a terminal."""
        self._say(text.encode("ascii", "backslashreplace").decode())


Handle = Callable[[Client], Awaitable[None]]


@asynccontextmanager
async def open_tcp_server(
    what: str,
    host: str,
    port: int,
    handle: Handle,
    say: Callable[[str], None],
    line: int,
    most: int = MOST_CLIENTS,
    must_ask: bool = False,
) -> AsyncIterator[TcpServer]:
    """Listen on a port; each client that comes is given to `handle` in a task of its own, which ends with it.

    Args:
        what: Name of the service, for people.
        host: Address to bind.
        port: TCP port; 0 takes a free one.
        handle: May end by any OSError or LinkError; the connection is closed then.
        say: What a user should know.
        line: Longest line that a client's reader takes [bytes].
        most: Clients at a time. For one more, a client gives way that has not taken what waits for it for `IDLE`
            seconds, the longest first; where there is none, the new one is turned away.
        must_ask: Whether a client gets nothing that it does not ask for. One that was silent for `IDLE` seconds gives
            way, too: those that never said anything first, the oldest of them before others. Where clients are sent a
            stream, silence is usual and no reason.

    Raises:
        LinkError: The address cannot be bound.
    """
    people = TcpServer(say, must_ask)

    async def meet(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        assert isinstance(reader, _Reader)
        client = Client(reader, writer)
        if len(people.clients) >= most and not people.make_room():
            people.refused += 1
            client.drop()
            return
        people.clients.add(client)
        people._tasks.add(task)
        _tune(writer)
        people.say_of(f"{what}: {client.name} connected")
        try:
            await handle(client)
        except (OSError, LinkError, asyncio.IncompleteReadError, asyncio.CancelledError):
            pass  # a connection that breaks, and the end of the server, are all the same here
        finally:
            client.drop()
            people.clients.discard(client)
            people._tasks.discard(task)
            people.dropped += client.slow
            people.say_of(f"{what}: {client.name} {client.ending}")

    loop = asyncio.get_running_loop()
    try:
        server = await loop.create_server(
            lambda: asyncio.StreamReaderProtocol(_Reader(line, loop), meet, loop), host, port
        )
    except (OSError, OverflowError) as error:
        raise LinkError(address_taken(f"{what} at {host}:{port}", error)) from None
    try:
        yield people
    finally:
        await _settle()  # those who are just being let in get their task, so that it can be ended
        server.close()
        for client in list(people.clients):
            client.drop()
        tasks = list(people._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await _settle()  # connections that were dropped are closed by the loop, a little later


async def _settle() -> None:
    """Let the loop do what it has put off."""
    for _ in range(6):
        await asyncio.sleep(0)


def _tune(writer: asyncio.StreamWriter) -> None:
    """Send at once, notice a peer that vanished, and let the kernel keep only little."""
    connection = writer.get_extra_info("socket")
    if connection is None:
        return
    with contextlib.suppress(OSError):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, KERNEL_BUFFER)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in KEEP_ALIVE:
            connection.setsockopt(socket.IPPROTO_TCP, option, value)
