"""The sockets of a Blueye drone: HTTP, and the three ports of ZeroMQ, which are fixed in the SDK."""

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from typing import Any

from rovtwin.core.errors import LinkError
from rovtwin.core.extras import require
from rovtwin.links.blueye.services.http import HttpServer
from rovtwin.links.blueye.wire import LARGEST
from rovtwin.links.servers.server import address_taken

TELEMETRY, REQUESTS, CONTROL = 5555, 5556, 5557  # fixed in the SDK
QUEUE = 200  # messages from one client that wait
BACKLOG = 2000  # messages of telemetry that wait for one slow client before the newest are lost
ALIVE = 2000, 6000  # ZeroMQ's own heartbeat and its patience with half-open connections [ms]


async def listen(server: HttpServer, host: str, port: int) -> None:
    """Serve HTTP there.

    Raises:
        LinkError: The address cannot be bound.
    """
    try:
        await server.start(host, port)
    except PermissionError:
        raise LinkError(
            f"{host}:{port}: ports below 1024 need root, and the SDK asks port 80 only. Run as root, or choose --port "
            f"8080 and start the client with http_proxy=http://{host}:8080"
        ) from None
    except OSError as error:
        raise LinkError(address_taken(f"{host}:{port}", error)) from None


@asynccontextmanager
async def ports_of(host: str) -> AsyncIterator[tuple[Any, Any, Any]]:
    """The three sockets of a drone: publish telemetry, answer requests, hear control.

    Raises:
        LinkError: An address cannot be bound, or ZeroMQ is not installed.
    """
    require("zmq", "blueye", "blueye", LinkError)
    import zmq
    import zmq.asyncio

    context = zmq.Context()
    waiting = zmq.asyncio.Context(context)
    kinds = ((TELEMETRY, context, zmq.PUB), (REQUESTS, waiting, zmq.REP), (CONTROL, waiting, zmq.SUB))
    sockets = []
    try:
        for port, owner, kind in kinds:
            socket = owner.socket(kind)
            sockets.append(socket)
            socket.setsockopt(zmq.LINGER, 0)
            socket.setsockopt(zmq.MAXMSGSIZE, LARGEST)
            socket.setsockopt(zmq.SNDHWM, BACKLOG)
            socket.setsockopt(zmq.RCVHWM, QUEUE)
            socket.setsockopt(zmq.HEARTBEAT_IVL, ALIVE[0])
            socket.setsockopt(zmq.HEARTBEAT_TIMEOUT, ALIVE[1])
            try:
                socket.bind(f"tcp://{host}:{port}")
            except zmq.ZMQError as error:
                raise LinkError(address_taken(f"{host}:{port}", error)) from None
        sockets[2].setsockopt(zmq.SUBSCRIBE, b"")
        yield tuple(sockets)
    finally:
        for socket in sockets:
            socket.close(0)
        context.term()


async def received(socket: Any) -> list[Any]:
    """The next message. What is no ZeroMQ at all can wake a socket that then has nothing: that is no end of it."""
    import zmq

    while True:
        try:
            return await socket.recv_multipart(copy=False)
        except zmq.Again:
            await asyncio.sleep(0.01)


def peer_of(frames: Sequence[Any]) -> str:
    """Network address that a message came from; empty where ZeroMQ does not know."""
    try:
        return str(frames[0].get("Peer-Address"))
    except Exception:  # by version: ZMQError, KeyError, IndexError, UnicodeError
        return ""
