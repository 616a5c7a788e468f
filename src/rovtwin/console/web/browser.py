"""A page that is open somewhere, seen from the server."""

import asyncio
import time
from collections import deque

WAITING = 500  # messages for a page that does not take them, before it is given up


class Browser:
    """What waits to be sent to a page. Of states only the newest counts.

    Attributes:
        name: Its own, which no other page has at the same time.
        orders: That it gave and that are not answered yet.
    """

    def __init__(self, name: str):
        self.name, self.orders = name, 0
        self._texts: deque[str] = deque()
        self._state: str | None = None
        self._news, self._over = asyncio.Event(), asyncio.Event()
        self._spoke_at = time.monotonic()

    def put(self, text: str, is_state: bool = False) -> None:
        """Something to send. A page that does not take it is given up: it comes anew, and gets all there is."""
        if is_state:
            self._state = text
        elif len(self._texts) < WAITING:
            self._texts.append(text)
        else:
            self.give_up()
        self._news.set()

    async def next(self) -> str:
        """The next text to send."""
        while True:
            if self._texts:
                return self._texts.popleft()
            if self._state is not None:
                text, self._state = self._state, None
                return text
            self._news.clear()
            await self._news.wait()

    def spoke(self) -> None:
        """It said something."""
        self._spoke_at = time.monotonic()

    @property
    def silent(self) -> float:
        """Since it last said anything [s]."""
        return time.monotonic() - self._spoke_at

    def give_up(self) -> None:
        """Its socket is to be closed."""
        self._over.set()

    async def given_up(self) -> None:
        """Wait until it is."""
        await self._over.wait()
