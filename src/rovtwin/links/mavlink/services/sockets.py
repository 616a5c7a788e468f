"""The endpoint's sockets: UDP and TCP on asyncio, with bounded buffers."""

import asyncio
import contextlib
from collections.abc import Callable
from typing import Any

from rovtwin.core.errors import LinkError
from rovtwin.links.mavlink.wire import Decoder
from rovtwin.links.servers.server import address_taken

BACKED_UP = 64 * 1024  # bytes that a TCP peer may be behind; what comes then is dropped for it


class _Udp(asyncio.DatagramProtocol):
    def __init__(self, take: Callable[[bytes, Any], None]):
        self._take = take

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self._take(data, addr)

    def error_received(self, exc: Exception) -> None:
        """A peer's port is closed: UDP has no other way to say so, and it may open again."""


async def open_udp(host: str, port: int, take: Callable[[bytes, Any], None]) -> asyncio.DatagramTransport:
    """A bound UDP socket; `take` gets each datagram and its sender.

    Raises:
        LinkError: The address cannot be bound.
    """
    loop = asyncio.get_running_loop()
    try:
        transport, _ = await loop.create_datagram_endpoint(lambda: _Udp(take), local_addr=(host, port))
    except OSError as error:
        raise LinkError(address_taken(f"mavlink: udp {host}:{port}", error)) from None
    return transport


class _Tcp(asyncio.Protocol):
    def __init__(self, connected: Callable[..., bool], take: Callable[..., None], gone: Callable[..., None]):
        self._connected, self._take, self._gone = connected, take, gone
        self._decoder = Decoder()
        self._known = False

    def connection_made(self, transport: Any) -> None:
        self._transport = transport
        peer = transport.get_extra_info("peername") or ("?", 0)
        self._name = f"tcp {peer[0]}:{peer[1]}"
        self._known = self._connected(self, self._name, self._write)
        if not self._known:
            transport.close()

    def data_received(self, data: bytes) -> None:
        self._take(self, self._decoder, data)

    def connection_lost(self, exc: Exception | None) -> None:
        self._gone(self, self._name if self._known else "")

    def _write(self, data: bytes) -> None:
        if not self._transport.is_closing() and self._transport.get_write_buffer_size() < BACKED_UP:
            self._transport.write(data)

    def close(self) -> None:
        self._transport.abort()


class TcpServer:
    """A listening socket and its connections, closed together."""

    def __init__(self, server: asyncio.Server, connections: "set[_Tcp]"):
        self._server, self._connections = server, connections

    def close(self) -> None:
        self._server.close()
        for connection in list(self._connections):
            with contextlib.suppress(AttributeError):  # accepted, not yet made
                connection.close()


async def open_tcp(
    host: str,
    port: int,
    connected: Callable[[Any, str, Callable[[bytes], None]], bool],
    take: Callable[[Any, Decoder, bytes], None],
    gone: Callable[[Any, str], None],
) -> TcpServer:
    """A listening TCP socket.

    Args:
        host: To bind.
        port: To bind.
        connected: Gets a key of the connection, its name and how to write; says whether there is room for it.
        take: Gets the key, the connection's decoder and bytes.
        gone: Gets the key and the name.

    Raises:
        LinkError: The address cannot be bound.
    """
    connections: set[_Tcp] = set()

    def left(key: Any, name: str) -> None:
        connections.discard(key)
        if name:  # one that was turned away was never there
            gone(key, name)

    def make() -> _Tcp:
        connection = _Tcp(connected, take, left)
        connections.add(connection)
        return connection

    loop = asyncio.get_running_loop()
    try:
        server = await loop.create_server(make, host, port)
    except OSError as error:
        raise LinkError(address_taken(f"mavlink: tcp {host}:{port}", error)) from None
    return TcpServer(server, connections)
