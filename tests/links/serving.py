"""A protocol's server in a thread, for tests that talk to it as a client would."""

import asyncio
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rovtwin.core.flow import Measurement
from rovtwin.links.servers.pilot_command import PilotCommand
from rovtwin.links.servers.served_vehicle import ServedVehicle
from rovtwin.links.servers.server import Server


class Served:
    """A running server and the vehicle it speaks for: `feed` is what the vehicle measures, `wishes` what is asked."""

    def __init__(self, drones: Sequence[str], speed: float):
        self.commands: list[PilotCommand] = []
        self.messages: list[str] = []
        self.loop = asyncio.new_event_loop()
        self.station = ServedVehicle(drones, self.commands.append, self.messages.append, speed)

    def feed(self, now: float, readings: list[Measurement]) -> None:
        self.call(lambda: self.station.feed(now, readings))

    def call(self, function: Callable[[], None]) -> None:
        """Run a function within the server's loop and wait for it."""
        done = threading.Event()

        def run() -> None:
            function()
            done.set()

        self.loop.call_soon_threadsafe(run)
        assert done.wait(5), "the server's loop is blocked"


def wait_for(true: Callable[[], object], seconds: float = 5.0) -> bool:
    """Whether it becomes true in time (real)."""
    end = time.monotonic() + seconds
    while not true():
        if time.monotonic() > end:
            return False
        time.sleep(0.005)
    return True


@contextmanager
def serving(*servers: Server, drones: Sequence[str] = ("",), speed: float = 1.0) -> Iterator[Served]:
    """Servers that run in one loop in a thread until the block is left; an error of theirs comes out there."""
    served = Served(drones, speed)

    async def run_all() -> None:
        await asyncio.gather(*(server.run(served.station) for server in servers))

    task = served.loop.create_task(run_all())
    failed: list[BaseException] = []

    def run() -> None:
        try:
            served.loop.run_until_complete(task)
        except asyncio.CancelledError:
            pass
        except BaseException as error:  # it is raised in the test thread
            failed.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield served
    finally:
        served.loop.call_soon_threadsafe(task.cancel)
        thread.join(10)
        assert not thread.is_alive(), "the server does not end when it is cancelled"
        served.loop.close()
    if failed:
        raise failed[0]
