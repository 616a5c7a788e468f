"""The process that speaks protocols, apart from the physics, so that neither waits for the other.

Either side may be killed at any time: the pipe between them closes, the vehicle turns its thrusters off, the server
closes its sockets. A side that hangs is noticed by the age of its commands.
"""

import asyncio
import os
import select
import signal
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection

from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Measurement
from rovtwin.core.link import COMMAND_LIFE
from rovtwin.core.processes.child import end, started
from rovtwin.core.processes.urgent import settle, urgent
from rovtwin.links.servers.pilot_command import PilotCommand
from rovtwin.links.servers.served_vehicle import ServedVehicle
from rovtwin.links.servers.server import Server

PILOT_COMMAND_LIFE = COMMAND_LIFE  # a command older than this counts no more [s]
GONE = "it ended, or was killed; thrusters are off"
ENDING = 2.0  # a process that does not end by itself in this time is killed [s]
STARTING = 20.0  # a new process must be up within this [s]


class Protocols:
    """Servers in a process of their own, seen from the vehicle: readings go there, pilots' commands come back."""

    def __init__(self, servers: Sequence[Server], drones: Sequence[str], speed: float = 1.0):
        """Starts the process and waits until it runs.

        Raises:
            LinkError: It does not start.
        """
        self._process, self._pipe = started(_main, list(servers), tuple(drones), speed, name="rovtwin-protocols")
        self._commands: dict[str, tuple[float, PilotCommand]] = {}
        self._messages: list[str] = []
        self._lost: str | None = None
        self.left_out = 0
        if not self._pipe.poll(STARTING):
            self.close()
            raise LinkError(
                f"the process of protocols: found no sign of life in {STARTING:g} s, expected it to run. On a busy "
                "machine it starts late: try again, or stop what else computes there"
            )

    @property
    def pid(self) -> int | None:
        """Of the process."""
        return self._process.pid

    def feed(self, now: float, readings: list[Measurement]) -> None:
        """What the vehicle measured up to its time `now` [s]; left out while the other side does not read."""
        _, writable, _ = select.select([], [self._pipe], [], 0.0)
        if not writable or self._lost is not None:
            self.left_out += 1
            return
        try:
            self._pipe.send((now, [(r.sensor, r.value, r.t_valid) for r in readings]))
        except OSError:
            self._lost = self._lost or GONE

    def commands(self) -> dict[str, PilotCommand]:
        """The commands that hold now, by drone."""
        self._listen()
        if self._lost is not None:
            return {}
        # Its age counts from when it was given: one that waited in the pipe for a vehicle that hung is old.
        oldest = time.monotonic() - PILOT_COMMAND_LIFE
        return {drone: command for drone, (commanded_at, command) in self._commands.items() if commanded_at >= oldest}

    def messages(self) -> list[str]:
        """What servers had to say since the last call.

        Raises:
            LinkError: The process is gone, or a server failed.
        """
        self._listen()
        messages, self._messages = self._messages, []
        if self._lost is not None and not messages:
            raise LinkError(f"the process of protocols: {self._lost}")
        return messages

    def _listen(self) -> None:
        try:
            while self._lost is None and self._pipe.poll():
                kind, content = self._pipe.recv()
                if kind == "command":
                    self._receive(*content)
                elif kind == "say":
                    self._messages.append(content)
                elif kind == "failed":
                    self._lost = content
        except (EOFError, OSError):
            self._lost = self._lost or GONE

    def _receive(self, commanded_at: float, command: PilotCommand) -> None:
        """Keep the newest command of a drone; of two servers that speak for one, the one that disarms counts."""
        before = self._commands.get(command.drone)
        if (
            command.armed
            and before is not None
            and not before[1].armed
            and commanded_at - before[0] < PILOT_COMMAND_LIFE
        ):
            return
        self._commands[command.drone] = (commanded_at, command)

    def close(self) -> None:
        """End the process; may be called twice."""
        self._lost = self._lost or "closed"
        end(self._process, self._pipe, ENDING)

    def __enter__(self) -> "Protocols":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _main(pipe: Connection, servers: list[Server], drones: tuple[str, ...], speed: float) -> None:
    # Ctrl-C and what ends a group of processes are for the physics: it closes the pipe, and that ends this one.
    os.setsid()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    settle()
    try:
        with urgent(speed <= 1.0):
            asyncio.run(_serve(pipe, servers, drones, speed))
    except LinkError as error:
        _tell(pipe, "failed", str(error))
    except Exception as error:  # a mistake of ours: said there, where a user looks
        _tell(pipe, "failed", f"{type(error).__name__}: {error}")
        raise


async def _serve(pipe: Connection, servers: list[Server], drones: tuple[str, ...], speed: float) -> None:
    loop, over = asyncio.get_running_loop(), asyncio.Event()
    station = ServedVehicle(
        drones,
        lambda command: _tell(pipe, "command", (time.monotonic(), command)),
        lambda text: _tell(pipe, "say", text),
        speed,
    )

    def receive() -> None:
        try:
            while pipe.poll():
                now, readings = pipe.recv()
                station.feed(now, [Measurement(*reading) for reading in readings])
        except (EOFError, OSError):
            loop.remove_reader(pipe.fileno())
            over.set()

    loop.add_reader(pipe.fileno(), receive)
    _tell(pipe, "running", None)

    async def until_over() -> None:
        await over.wait()

    tasks = [asyncio.create_task(work) for work in (until_over(), *(server.run(station) for server in servers))]
    done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    for task in done:
        task.result()  # what a server failed of


def _tell(pipe: Connection, kind: str, content: object) -> None:
    try:
        pipe.send((kind, content))
    except OSError:
        pass  # the physics is gone; the reader sees it, too
