"""HTTP as Water Linked's instruments speak it: requests one after the other on a connection, answers in JSON."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, Protocol

from rovtwin.core.errors import LinkError
from rovtwin.links.http_wire import LONGEST_HEAD, Request, parse_request, response_bytes
from rovtwin.links.servers.tcp_server import Client, open_tcp_server

PATIENCE = 10.0  # for a whole request, and between two on one connection [s of real time]
MOST_CLIENTS = 32  # connections; browsers open six each


class Pages(Protocol):
    """What answers requests.

    Attributes:
        malformed: How many made no sense.
    """

    malformed: int

    def answer(self, request: Request, body: bytes) -> tuple[int, Any]:
        """Status and JSON of the answer to a request."""
        ...


@asynccontextmanager
async def serving_pages(what: str, host: str, port: int, pages: Pages, most: int = MOST_CLIENTS) -> AsyncIterator[None]:
    """Serve the pages there until the block is left.

    Raises:
        LinkError: The address cannot be bound.
    """

    async def serve(client: Client) -> None:
        while await _converse(client, pages):
            pass
        await client.finish()

    def quiet(text: str) -> None:
        """Four connections a second are no news."""

    async with open_tcp_server(what, host, port, serve, quiet, LONGEST_HEAD, most, must_ask=True):
        yield


def outcome(error: str = "") -> dict[str, Any]:
    """What is answered to an order: that it was obeyed, or why not."""
    return {"success": not error, "error": error}


async def _converse(client: Client, pages: Pages) -> bool:
    """One request and its response; whether the connection stays."""
    try:
        head = await asyncio.wait_for(client.reader.readuntil(b"\r\n\r\n"), PATIENCE)
    except (TimeoutError, asyncio.IncompleteReadError):
        return False
    except asyncio.LimitOverrunError:
        client.send(response_bytes(413, outcome("head too long"), False))
        return False
    try:
        request = parse_request(head)
        body = await asyncio.wait_for(client.reader.readexactly(request.length), PATIENCE)
    except LinkError as error:
        pages.malformed += 1
        client.send(response_bytes(400, outcome(str(error)), False))
        return False
    except (TimeoutError, asyncio.IncompleteReadError):
        return False
    status, answer = pages.answer(request, body)
    client.send(response_bytes(status, answer, request.keep))
    return request.keep and not client.gone
