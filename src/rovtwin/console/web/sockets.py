"""The live socket of a page: what a hub has to say goes out, what the browser asks comes in."""

import asyncio
import contextlib
import logging
import secrets
import time
from typing import Protocol

from fastapi import WebSocket, WebSocketDisconnect

from rovtwin.console.web.browser import Browser

logger = logging.getLogger(__name__)

CLOSING = 1.0  # longest wait for a page to be closed [s]
MOST_PAGES = 40  # open at a time: each is sent twenty states a second, and STOP waits meanwhile
GONE = 5.0  # a page that was silent for so long gives way to a new one; pages say something five times a second [s]
PACE = 100  # messages of a page a second; one that sends more is read more slowly. A pilot's sends 25
BURST = 5.0  # of that pace a page may be ahead, as after its network was down [s]
LATER = 1013  # "try again later", as WebSockets have it


class Speaks(Protocol):
    """What a socket is served by: the hub of a flight, or a replay."""

    def come(self, name: str, /) -> Browser:
        """A page that opens, with all that it has to know."""
        ...

    def leave(self, browser: Browser, /) -> None:
        """A page that closes."""
        ...

    async def obey(self, browser: Browser, text: str, /) -> None:
        """Do what a message of a browser asks."""
        ...


_pages: set[Browser] = set()  # of all hubs


async def serve(hub: Speaks, socket: WebSocket) -> None:
    """Until the page is closed, takes nothing any more, or is silent and has to give way to a new one."""
    await socket.accept()
    if len(_pages) >= MOST_PAGES:
        quietest = max(_pages, key=lambda page: page.silent)
        if quietest.silent < GONE:
            await socket.close(LATER, f"{MOST_PAGES} pages are open; close one")
            return
        _pages.discard(quietest)
        quietest.give_up()
    browser = hub.come(_name(socket.query_params.get("name", "")))
    _pages.add(browser)
    work = (_send(socket, browser), _receive(hub, socket, browser), browser.given_up())
    tasks = [asyncio.create_task(one) for one in work]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        _pages.discard(browser)
        hub.leave(browser)
        for task in tasks:
            task.cancel()
        for ended in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(ended, Exception) and not isinstance(ended, WebSocketDisconnect | RuntimeError):
                logger.error("page %s: %s: %s", browser.name, type(ended).__name__, ended)
    with contextlib.suppress(RuntimeError, TimeoutError, WebSocketDisconnect):  # closed already, or deaf
        await asyncio.wait_for(socket.close(LATER), CLOSING)


def _name(proposed: str) -> str:
    """A browser's name for itself, if it is one."""
    return proposed if proposed.isalnum() and len(proposed) <= 12 else f"b{secrets.token_hex(2)}"


async def _send(socket: WebSocket, browser: Browser) -> None:
    while True:
        await socket.send_text(await browser.next())


async def _receive(hub: Speaks, socket: WebSocket, browser: Browser) -> None:
    """What a page says, at a pace that leaves time for others: STOP of a page that floods us comes by its request."""
    obeying: set[asyncio.Task[None]] = set()
    ahead = 0.0
    while True:
        text = await socket.receive_text()
        ahead = max(ahead, time.monotonic() - BURST) + 1.0 / PACE
        await asyncio.sleep(max(ahead - time.monotonic(), 0.0))
        browser.spoke()
        # STOP must not wait behind a plan that is being laid out.
        task = asyncio.create_task(hub.obey(browser, text))
        obeying.add(task)
        task.add_done_callback(obeying.discard)
