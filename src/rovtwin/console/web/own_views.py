"""Views of one's own: each is looked at in a process of its own, and the page is given what comes of it, or why not."""

import asyncio
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rovtwin.console.view import LEAST, MOST, look
from rovtwin.console.worker import Worker
from rovtwin.core.errors import RovtwinError

if TYPE_CHECKING:
    from rovtwin.console.web.hub import Hub

PATIENCE = 5.0  # with one look [s], after which the view's process is ended
AGAIN = 10.0  # after that, or a process that ended, until the next try [s]: starting one takes a second of a core
GIVEN = ("title", "text", "rows", "svg")  # of what a look gives, that the page is given
AT_ONCE = 2  # looks at the same time: each that hangs keeps a thread of the server
IDLE = 0.5  # until it is looked again whether there is a page, and a state [s]


def name_of(text: str) -> str:
    """What a view is called before it is known: the last part of its address, or its entry point."""
    return text.rpartition(":")[2].rpartition(".")[2]


class OwnViews:
    """The views of a console, each with a process; they run until the console ends.

    Attributes:
        names: Of their tabs.
    """

    def __init__(self, hub: "Hub", views: Sequence[str]):
        """`views`: addresses or entry points."""
        self.names = [name_of(view) for view in views]
        self._hub, self._views = hub, list(views)
        self._turn = asyncio.Semaphore(AT_ONCE)

    async def run(self) -> None:
        """Until cancelled."""
        await asyncio.gather(*(self._keep(i) for i in range(len(self._views))))

    async def _keep(self, number: int) -> None:
        """Look at one again and again; whatever becomes of it, the others and the console go on."""
        worker = Worker(f"the view {self.names[number]}", PATIENCE, plain=True)
        try:
            while True:
                state = self._hub.client.last.get("state")
                if state is None or not self._hub.pages:
                    await asyncio.sleep(IDLE)
                    continue
                began = time.monotonic()
                wait = await self._look(number, worker, state)
                await asyncio.sleep(max(wait - (time.monotonic() - began), LEAST))
        finally:
            worker.close()

    async def _look(self, number: int, worker: Worker, state: dict[str, Any]) -> float:
        """One look; seconds from its beginning to the next."""
        message = {"kind": f"view-{number}", "title": self.names[number], "error": "", "t": state.get("t")}
        try:
            async with self._turn:
                found = await worker.call(look, self._views[number], state)
            every = float(found["every"])
            self._hub.keep(message | {key: found[key] for key in GIVEN if key in found})
            return every if LEAST <= every <= MOST else AGAIN
        except RovtwinError as error:
            self._hub.keep(message | {"error": str(error)})
            return AGAIN if "process ended" in str(error) or "gave up" in str(error) else 1.0
        except Exception as error:  # what somebody else's code gives may be anything, such as what cannot be encoded
            worker.close()
            self._hub.keep(message | {"error": f"{type(error).__name__}: {str(error)[-300:]}"})
            return AGAIN
