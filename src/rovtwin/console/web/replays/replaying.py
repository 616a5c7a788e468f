"""Replays for browsers: each is somewhere in a finished run, by itself, and hears its state there."""

import asyncio
import math
import time
from collections.abc import Awaitable, Callable
from functools import cached_property, partial
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from rovtwin.console.rehearsal.flight import rehearsals_of
from rovtwin.console.replays.history import history
from rovtwin.console.replays.marks import marks_of
from rovtwin.console.replays.replay import LOG, Recording
from rovtwin.console.replays.seen import has_seen, seen
from rovtwin.console.replays.shelf import Shelf
from rovtwin.console.web.browser import Browser
from rovtwin.console.web.hub import answer
from rovtwin.console.web.mesh import vehicle_glb
from rovtwin.console.wire import encode
from rovtwin.core.errors import ConfigError, RovtwinError
from rovtwin.core.log import Log
from rovtwin.runs.ensemble.forecast import for_page

STATES = 0.05  # between two states while it plays [s]
PACES = (0.1, 50.0)  # slowest and fastest
OPEN = 3  # runs that are kept open at most, besides those that somebody looks at

Read = Callable[[Path], Awaitable[Log]]
Stop = Callable[[], Awaitable[bool]]  # thrusters off, of what flies beside; whether somebody was there to hear it


class Seat(Browser):
    """A page that is open: where it is in the run [s], how fast it goes on, and whether; the mission that it shows."""

    def __init__(self, name: str, t: float):
        super().__init__(name)
        self.t, self.speed, self.running = t, 1.0, False
        self.mission: int | None = None  # whose plan it has
        self.player: asyncio.Task[None] | None = None


class Replaying:
    """One run, many browsers, each where it wants to be.

    Attributes:
        recording: The run.
        seats: Who looks at it.
    """

    def __init__(self, recording: Recording, run: str = "", stop: Stop | None = None):
        """`run` is its name for the server, `stop` stops what flies beside."""
        self.recording, self._run, self._stop = recording, run, stop
        self.seats: list[Seat] = []
        try:
            self.looks = None if recording.vehicle is None else vehicle_glb(recording.vehicle)
        except ConfigError as error:
            self.looks = None
            recording.notes.append(f"no looks of the vehicle: {error}")
        try:
            rehearsed = rehearsals_of(recording.path.parent)
        except RovtwinError as error:
            rehearsed = []
            recording.notes.append(str(error))
        marks = marks_of(recording)
        self._messages = [
            self._setup(),
            {"kind": "marks", "marks": marks},
            {"kind": "history", "events": marks},
            *({"kind": "rehearsal"} | for_page(one) for one in rehearsed[-1:]),
        ]

    @cached_property
    def history(self) -> bytes:
        """All of the run, thinned: see `console.replays.history`."""
        return history(self.recording)

    @cached_property
    def swath(self) -> bytes | None:
        """What its eyes had seen of the floor, and when; None where it had none."""
        found = seen(self.recording)
        return None if found is None else encode(found)

    def come(self, name: str) -> Seat:
        """A page that opens, with all that it has to know; it begins at the beginning, and stands."""
        seat = Seat(name, self.recording.start)
        self.seats.append(seat)
        for message in self._messages:
            seat.put(encode(message).decode())
        self._show(seat)
        return seat

    def leave(self, browser: Browser) -> None:
        """A page that closes."""
        for seat in [one for one in self.seats if one is browser]:
            seat.running = False
            self.seats.remove(seat)

    async def obey(self, browser: Browser, text: str) -> None:
        """Do what a message of a browser asks, and say what came of it."""
        for seat in [one for one in self.seats if one is browser]:
            await answer(seat, text, partial(self._do, seat))

    async def _do(self, seat: Seat, do: str, what: dict[str, Any]) -> str:
        if do == "stop":
            return await self._stopped()
        if do == "alive":  # as every page says all the time
            return ""
        if do == "seek":
            seat.t = self._within(_number(what, "t"))
        elif do == "step":
            seat.running, seat.t = False, self._sample(seat.t, int(_number(what, "by")))
        elif do == "play":
            self._play(seat, what)
        else:
            raise RovtwinError(f"{do}: this is a replay, it takes seek, step and play")
        self._show(seat)
        return ""

    async def _stopped(self) -> str:
        if self._stop is None:
            raise RovtwinError("this is a replay: nothing flies that could be stopped")
        return "thrusters off" if await self._stop() else "no vehicle is held"

    def _play(self, seat: Seat, what: dict[str, Any]) -> None:
        if "speed" in what:
            seat.speed = min(max(_number(what, "speed"), PACES[0]), PACES[1])
        if "running" in what:
            seat.running = bool(what["running"])
        if seat.running and seat.t >= self.recording.end:
            seat.t = self.recording.start
        if seat.running and (seat.player is None or seat.player.done()):
            seat.player = asyncio.create_task(self._go_on(seat))

    async def _go_on(self, seat: Seat) -> None:
        last = time.monotonic()
        while seat.running:
            await asyncio.sleep(STATES)
            now = time.monotonic()
            if seat.running:
                seat.t = self._within(seat.t + (now - last) * seat.speed)
                seat.running = seat.t < self.recording.end
                self._show(seat)
            last = now

    def _show(self, seat: Seat) -> None:
        if (mission := self.recording.mission_at(seat.t)) != seat.mission:
            seat.mission = mission
            seat.put(encode(self.recording.plan(mission)).decode())
        pace = {"speed": seat.speed, "running": seat.running, "sent": time.monotonic()}
        seat.put(encode(self.recording.state(seat.t) | pace).decode(), is_state=True)

    def _within(self, t: float) -> float:
        return min(max(t, self.recording.start), self.recording.end)

    def _sample(self, t: float, by: int) -> float:
        """Time of the sample that is so many on from a time [s]."""
        tape = self.recording.tape
        times = tape["eta"].t if "eta" in tape else next(iter((tape or self.recording.readings).values())).t
        edge = 1e-6 if by > 0 else -1e-6  # at a sample the next is another one
        at = int(np.searchsorted(times, t + edge, side="right" if by > 0 else "left")) + (by - 1 if by > 0 else by)
        return self._within(float(times[min(max(at, 0), len(times) - 1)]))

    def _setup(self) -> dict[str, Any]:
        run, recording = quote(self._run, safe=""), self.recording
        return recording.setup() | {
            "replay": True,
            "range": [recording.start, recording.end],
            "history": f"/replay/history?run={run}",
            "swath": f"/replay/swath?run={run}" if has_seen(recording) else None,
            "mesh": f"/replay/vehicle.glb?run={run}" if self.looks else None,
            "camera": recording.album is not None,
            "pictures": f"/replay/picture?run={run}&n=" if recording.album else None,
        }


class Library:
    """Runs by name, opened when somebody asks for them.

    Attributes:
        shelf: The runs there are.
        flies: Whether a vehicle flies beside the replays.
    """

    def __init__(self, shelf: Shelf, read: Read, given: Recording | None = None, stop: Stop | None = None):
        """`read` reads a log, `given` is the run of no name, `stop` stops what flies beside."""
        self.shelf, self._read, self._stop, self.flies = shelf, read, stop, stop is not None
        self._given = None if given is None else Replaying(given, "", stop)
        self._open: dict[tuple[str, int], Replaying] = {}
        self._one_at_a_time = asyncio.Lock()

    async def open(self, run: str) -> Replaying:
        """A run of the shelf.

        Raises:
            RovtwinError: There is no such run, or its log cannot be read; the text says what to do.
        """
        if not run:
            if self._given is None:
                raise ConfigError("no run was named; choose one of the list")
            return self._given
        async with self._one_at_a_time:
            path = self.shelf.find(run) / LOG
            key = run, path.stat().st_mtime_ns
            if key not in self._open:
                log = await self._read(path)
                self._open[key] = await asyncio.to_thread(self._opened, log, path, run)
                self._tidy()
            return self._open[key]

    def _opened(self, log: Log, path: Path, run: str) -> Replaying:
        return Replaying(Recording(log, path), run, self._stop)

    def _tidy(self) -> None:
        """Close what nobody looks at, the oldest first; the newest is about to be looked at."""
        idle = [key for key, one in self._open.items() if not one.seats][:-1]
        for key in idle[: max(len(self._open) - OPEN, 0)]:
            del self._open[key]


def _number(what: dict[str, Any], key: str) -> float:
    found = what.get(key)
    if not isinstance(found, int | float) or isinstance(found, bool) or not math.isfinite(found):
        raise RovtwinError(f"{key}: found {found!r}, expected a number")
    return float(found)
