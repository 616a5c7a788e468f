"""Tells browsers how good the log of a test is and what it says of the vehicle, again and again while it grows."""

import asyncio
import shlex
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rovtwin.console.assess import AssessProcess, Subject
from rovtwin.runs.compose.experiment import spans_of
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Vehicle

if TYPE_CHECKING:
    from rovtwin.console.web.hub import Hub

EVERY = 10.0  # between two looks at a log that grows, at least [s]
LOOK = 0.5  # between two looks at the state [s]
PATIENCE = 600.0  # with a process that says nothing, before another takes its place [s]
TRIES = 2  # at the whole log, where the process does not survive it


class Assessing:
    """Looks at the logs of a hub's engine, one after the other: while they grow, and once as a whole."""

    def __init__(self, hub: "Hub", scenario: Scenario, vehicle: Vehicle):
        """`scenario` has a test."""
        spans = spans_of(scenario)
        pieces = 1 + sum(span["hand"] for span in spans)
        self._tested = Subject(vehicle, spans[-1]["end"], pieces)
        self._hub, self._scenario = hub, scenario
        self._process: AssessProcess | None = None
        self._folder, self._due, self._tries = "", 0.0, 0
        self._news: dict[str, Any] = {}

    async def run(self) -> None:
        """Until cancelled."""
        try:
            while True:
                await self.turn()
                await asyncio.sleep(LOOK)
        finally:
            await self._end_process()

    async def turn(self) -> None:
        """Look, if it is time to."""
        grows = self._growing()
        if self._folder and grows != self._folder:  # closed: looked at as a whole before the next one comes
            self._tries += 1
            if await self._look(final=True) or self._tries >= TRIES:
                self._folder = ""
        elif grows and not self._folder:
            self._folder, self._due, self._tries, self._news = grows, 0.0, 0, {}
        if self._folder and grows == self._folder and time.monotonic() >= self._due:
            self._due = time.monotonic() + EVERY
            await self._look(final=False)

    def _growing(self) -> str:
        """Folder of the log that is written now, "" without one; an engine that is gone writes none."""
        client = self._hub.client
        return "" if client.hung else client.last.get("state", {}).get("folder", "")

    async def _look(self, final: bool) -> bool:
        """Once, to the end; whether the process survived it."""
        self._tell(busy=True, final=final)
        try:
            if self._process is None:
                self._process = await asyncio.to_thread(AssessProcess, self._tested)
            self._process.ask(Path(self._folder) / "log.mcap", final)
            while answer := await self._answer(self._process):
                self._tell(**({"error": ""} | answer))
        except (EOFError, OSError):
            await self._end_process()
            self._tell(busy=False, error="the process that looks at the log ended, or was killed")
            return False
        self._tell(busy=False)
        return True

    async def _end_process(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            await asyncio.to_thread(process.close)  # it may take a second, and STOP must not wait

    @staticmethod
    async def _answer(process: AssessProcess) -> dict[str, Any]:
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            answer = await asyncio.to_thread(process.answer, 0.2)
            if answer is not None:
                return answer
        raise TimeoutError  # an OSError

    def _tell(self, **news: Any) -> None:
        self._news |= {"kind": "identify", "folder": self._folder, "command": self._command()} | news
        self._hub.keep(self._news)

    def _command(self) -> str:
        """What makes the full estimate of this log."""
        vehicle = self._scenario.vehicle if isinstance(self._scenario.vehicle, str) else "VEHICLE.yaml"
        log = str(Path(self._folder) / "log.mcap")
        return f"rovtwin identify {shlex.quote(vehicle)} {shlex.quote(log)} -o {self._scenario.name}_identified.yaml"
