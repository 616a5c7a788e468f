"""Tells browsers how good the log of a test is and what it says of the vehicle, again and again while it grows."""

import asyncio
import contextlib
import shlex
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rovtwin.console.assess import AssessProcess, Subject
from rovtwin.scenario.compose_trial import spans_of
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Vehicle

if TYPE_CHECKING:
    from rovtwin.console.web.hub import Hub

EVERY = 10.0  # between two looks at a log that grows, at least [s]
LOOK = 0.5  # between two looks at the state [s]


class Assessing:
    """Looks at the newest log of a hub's engine."""

    def __init__(self, hub: "Hub", scenario: Scenario, vehicle: Vehicle):
        """`scenario` has a test."""
        spans = spans_of(scenario)
        pieces = 1 + sum(span["hand"] for span in spans)
        self._tested = Subject(vehicle, spans[-1]["end"], pieces)
        self._hub, self._scenario = hub, scenario
        self._process: AssessProcess | None = None
        self._folder, self._done = "", True
        self._told: dict[str, Any] = {}

    async def run(self) -> None:
        """Until cancelled."""
        try:
            while True:
                began = time.monotonic()
                grows = self._hub.client.last.get("state", {}).get("folder", "")
                if grows and grows != self._folder:
                    self._folder, self._done, self._told = grows, False, {}
                if self._folder and not self._done:
                    final = grows != self._folder
                    await self._look(final)
                    self._done = final
                    rests = EVERY - (time.monotonic() - began)
                    await self._until_over_or(rests)
                await asyncio.sleep(LOOK)
        finally:
            if self._process is not None:
                self._process.close()

    async def _until_over_or(self, seconds: float) -> None:
        """So long, or until the log is closed."""
        until = time.monotonic() + seconds
        while not self._done and time.monotonic() < until:
            if self._hub.client.last.get("state", {}).get("folder", "") != self._folder:
                return
            await asyncio.sleep(LOOK)

    async def _look(self, final: bool) -> None:
        """Once, to the end."""
        if self._process is None:
            self._process = await asyncio.to_thread(AssessProcess, self._tested)
        log = Path(self._folder) / "log.mcap"
        self._tell(busy=True, final=final)
        try:
            self._process.ask(log, final)
            while answer := await self._answer(self._process):
                self._tell(**({"error": ""} | answer))
        except (EOFError, OSError):
            with contextlib.suppress(OSError):
                self._process.close()
            self._process = None
            self._tell(error="the process that looks at the log ended, or was killed; it is started anew")
        self._tell(busy=False)

    @staticmethod
    async def _answer(process: AssessProcess) -> dict[str, Any]:
        while True:
            answer = await asyncio.to_thread(process.answer, 0.2)
            if answer is not None:
                return answer

    def _tell(self, **news: Any) -> None:
        self._told |= {"kind": "identify", "folder": self._folder, "command": self._command()} | news
        self._hub.keep(self._told)

    def _command(self) -> str:
        """What makes the full estimate of this log."""
        vehicle = self._scenario.vehicle if isinstance(self._scenario.vehicle, str) else "VEHICLE.yaml"
        log = str(Path(self._folder) / "log.mcap")
        return f"rovtwin identify {shlex.quote(vehicle)} {shlex.quote(log)} -o {self._scenario.name}_identified.yaml"
