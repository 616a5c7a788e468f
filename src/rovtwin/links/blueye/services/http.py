"""The little HTTP that a Blueye drone speaks: who it is, and its log.

Requests may name the drone by an absolute URI, as clients behind a proxy do: so `http_proxy=http://127.0.0.2:8080`
takes the SDK, which knows port 80 only, to a server that does not run as root.
"""

import asyncio
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from rovtwin.core.errors import LinkError
from rovtwin.links.blueye.drone.divelog import DiveLog, packed

LONGEST = 8192  # bytes of a request's head
PATIENCE = 5.0  # time that a client has to send it, and to take the answer [s]
MOST = 32  # connections at a time
REASON = {200: "OK", 400: "Bad Request", 404: "Not Found", 405: "Method Not Allowed", 503: "Service Unavailable"}


@dataclass(frozen=True)
class HttpRequest:
    """Method, host (empty if not given) and path of a request."""

    method: str
    host: str
    path: str


class Records(list[bytes]):
    """Records of a log, still to be packed."""


def parse_http(head: bytes) -> HttpRequest:
    """A request from its head, up to the empty line.

    Raises:
        LinkError: It is no HTTP request.
    """
    if len(head) > LONGEST:
        raise LinkError(f"HTTP request of {len(head)} bytes, expected at most {LONGEST}")
    lines = head.decode("latin-1").split("\r\n")
    words = lines[0].split(" ")
    if len(words) != 3 or not words[2].startswith("HTTP/1.") or not words[0].isalpha():
        raise LinkError(f"HTTP request {lines[0][:80]!r}: expected METHOD TARGET HTTP/1.1")
    try:
        target = urlsplit(words[1])
        host = target.hostname or ""
        if not host:
            named = next((line[5:].strip() for line in lines[1:] if line[:5].lower() == "host:"), "")
            host = urlsplit("//" + named).hostname or ""
    except ValueError:
        raise LinkError(f"HTTP request {lines[0][:80]!r}: the target is no address") from None
    return HttpRequest(words[0].upper(), host, target.path or "/")


def respond(request: HttpRequest, info: Mapping[str, Any], log: DiveLog | None = None) -> tuple[int, Any]:
    """Status and content of the answer: JSON, or the records of a log. `info` and `log` are the drone's."""
    path = request.path.rstrip("/")
    binlog = None if log is None else f"/logs/{log.name}/binlog"
    if path not in ("/diagnostics/drone_info", "/logs", "/logcsv", binlog):
        return 404, {"error": f"{request.path[:80]}: the twin has no such page"}
    if request.method != "GET":
        return 405, {"error": f"{request.method[:20]}: expected GET"}
    if log is not None and path in ("/logs", binlog):
        return 200, Records(log.records()) if path == binlog else log.index()
    return (200, dict(info)) if path.startswith("/diagnostics") else (200, [])


def encode(status: int, content: Any) -> bytes:
    """The bytes of an answer: JSON, or what is bytes already."""
    kind = "application/octet-stream" if isinstance(content, bytes) else "application/json"
    body = content if isinstance(content, bytes) else json.dumps(content).encode()
    head = f"HTTP/1.1 {status} {REASON[status]}\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\n"
    return head.encode() + b"Connection: close\r\n\r\n" + body


class HttpServer:
    """Answers for several drones at one address.

    Args:
        infos: What each drone says of itself, by its address.
        default: Address of the drone that is meant when the request names none of them.
        logs: The log of each drone, by its address.
    """

    def __init__(self, infos: Mapping[str, Mapping[str, Any]], default: str, logs: Mapping[str, DiveLog] | None = None):
        self._infos, self._default, self._logs = infos, default, logs or {}
        self._open: set[asyncio.Task[None]] = set()
        self._server: asyncio.Server | None = None

    async def start(self, host: str, port: int) -> None:
        """Listen there. Raises OSError if that cannot be."""
        self._server = await asyncio.start_server(self._serve, host, port, limit=LONGEST)

    async def close(self) -> None:
        """Listen no more, and let go of who is connected."""
        if self._server is not None:
            self._server.close()
        for task in self._open:
            task.cancel()
        await asyncio.gather(*self._open, return_exceptions=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._open.add(task)
        try:
            async with asyncio.timeout(PATIENCE):
                status, content = await self._answer(reader)
                if isinstance(content, Records):
                    content = await asyncio.to_thread(packed, content)  # megabytes must not hold up the drone
                writer.write(encode(status, content))
                await writer.drain()
                writer.close()
                await writer.wait_closed()
        except (OSError, TimeoutError):
            pass  # it went away, or it is too slow
        finally:
            self._open.discard(task)
            writer.transport.abort()

    async def _answer(self, reader: asyncio.StreamReader) -> tuple[int, Any]:
        if len(self._open) > MOST:
            return 503, {"error": "too many connections"}
        try:
            request = parse_http(await reader.readuntil(b"\r\n\r\n"))
        except (LinkError, asyncio.IncompleteReadError, asyncio.LimitOverrunError) as error:
            return 400, {"error": str(error)[:200]}
        host = request.host if request.host in self._infos else self._default
        return respond(request, self._infos[host], self._logs.get(host))
