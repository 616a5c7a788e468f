"""Between browsers and the engine: hands states on, holds the plan on the table, and lets one browser give orders."""

import asyncio
import contextlib
import json
import math
from collections import deque
from typing import Any

from rovtwin.console.client import Client
from rovtwin.console.control import Rights
from rovtwin.console.planning import Draft
from rovtwin.console.web.drafting import Drafting
from rovtwin.console.wire import Place, encode
from rovtwin.core.errors import RovtwinError

PULSE = 0.5  # how often browsers hear whether the engine lives [s]
WAITING = 500  # messages for a browser that does not take them, before it is given up
FREE = ("stop", "take", "give", "refuse", "alive", "hello")  # orders that need no control
PLAIN = ("arm", "disarm", "start", "pause", "resume", "abort", "hold", "reconnect")  # as they come, to the engine
FULL = ("goto", "pace", "inject")


class Browser:
    """A page that is open: what waits to be sent to it. Of states only the newest counts."""

    def __init__(self, name: str):
        self.name = name
        self._texts: deque[str] = deque()
        self._state: str | None = None
        self._news = asyncio.Event()

    def put(self, text: str, is_state: bool = False) -> None:
        if is_state:
            self._state = text
        elif len(self._texts) < WAITING:
            self._texts.append(text)
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


class Hub:
    """One engine, many browsers.

    Attributes:
        client: To the engine.
        rights: Who is in control.
        draft: The plan on the table, which all see and one edits.
    """

    def __init__(self, place: Place):
        self.client = Client(place, self._pass_on)
        self.rights, self.draft = Rights(), Draft()
        self._drafting = Drafting(self)
        self._browsers: list[Browser] = []
        self._seen_plan = False
        self._tasks: set[asyncio.Task[Any]] = set()
        self._kept: dict[str, str] = {}

    async def run(self) -> None:
        """Until cancelled."""
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.gather(self.client.listen(), self._pulse())

    # To the browsers

    def come(self, name: str) -> Browser:
        """A page that opens, with all that it has to know."""
        browser = Browser(name)
        self._browsers.append(browser)
        self.rights.come(name)
        for kind in ("setup", "history", "state"):
            if kind in self.client.last:
                browser.put(encode(self.client.last[kind]).decode())
        for text in self._kept.values():
            browser.put(text)
        browser.put(self._text(self.plan()))
        self.tell_rights()
        return browser

    def leave(self, browser: Browser) -> None:
        """A page that closes."""
        self._browsers.remove(browser)
        if self.rights.leave(browser.name):
            self.say("warning", f"{browser.name} left, who was in control: the operator watchdog counts")
        self.tell_rights()

    def send(self, message: dict[str, Any]) -> None:
        """A message to all."""
        text = self._text(message)
        for browser in self._browsers:
            browser.put(text)

    def keep(self, message: dict[str, Any]) -> None:
        """A message to all, and the newest of its kind to who comes later."""
        self._kept[message["kind"]] = self._text(message)
        self.send(message)

    def say(self, level: str, text: str) -> None:
        """An event of the console's own."""
        state = self.client.last.get("state", {})
        from datetime import datetime

        clock = f"{datetime.now():%H:%M:%S}"
        self.send({"kind": "event", "t": state.get("t", 0.0), "clock": clock, "level": level, "text": text})

    def tell_rights(self) -> None:
        """Who is in control, to each in its own words."""
        for browser in self._browsers:
            browser.put(self._text(self.rights.told(browser.name)))

    def tell_plan(self) -> None:
        self.send(self.plan())

    def plan(self) -> dict[str, Any]:
        """The plan on the table, the one that was submitted, and what there is to say of the first."""
        flown = self.client.last.get("flown", {})
        rows = [_for_browser(_row(waypoint)) for waypoint in flown.get("waypoints", [])]
        return {
            "kind": "plan",
            "draft": [_for_browser(row) for row in self.draft.rows],
            "flown": rows,
            "submitted": bool(flown.get("submitted")),
            "changed": [_place(row) for row in self.draft.rows] != [_place(row) for row in rows],
            "undo": self.draft.can_undo,
            "redo": self.draft.can_redo,
            "length": self.draft.length(),
            "seconds": self.draft.seconds(),
            "checks": self._drafting.checks,
        }

    # From the browsers

    async def obey(self, browser: Browser, text: str) -> None:
        """Do what a message of a browser asks, and say what came of it."""
        try:
            message = json.loads(text)
            if not isinstance(message, dict):
                raise ValueError
        except ValueError:
            browser.put(self._text({"kind": "reply", "id": None, "ok": False, "error": "not understood"}))
            return
        number, do = message.get("id"), str(message.get("do"))
        try:
            said = await self._do(browser, do, {k: v for k, v in message.items() if k not in ("id", "do")})
            reply: dict[str, Any] = {"ok": True, "said": said}
        except RovtwinError as error:
            reply = {"ok": False, "error": str(error)}
        if number is not None:
            browser.put(self._text({"kind": "reply", "id": number} | reply))

    async def _do(self, browser: Browser, do: str, what: dict[str, Any]) -> str:
        name = browser.name
        if do == "stop":
            return "thrusters off" if self.client.stop() else "no vehicle is held"
        if do == "alive":
            if self.rights.holder == name:
                self.client.tell("alive")
            return ""
        if do in ("take", "ask", "give", "refuse"):
            said = self.rights.take(name) if do in ("take", "ask") else getattr(self.rights, do)(name) or ""
            self.tell_rights()
            return said
        if self.rights.holder != name:
            raise RovtwinError(f"{self.rights.holder or 'nobody'} is in control: ask for it first")
        if do == "pilot":
            self.client.tell("pilot", **what)
        elif do == "plan":
            await self._drafting.do(what)
        elif do in PLAIN:
            await self.client.ask(do)
        elif do in FULL:
            await self.client.ask(do, **what)
        else:
            raise RovtwinError(f"{do}: there is no such order")
        return ""

    def _pass_on(self, kind: str, text: bytes) -> None:
        """News of the engine, as they are."""
        if kind == "flown":
            self._plan_told()
            return
        for browser in self._browsers:
            browser.put(text.decode(), kind == "state")

    def _plan_told(self) -> None:
        flown = self.client.last["flown"]
        if not self._seen_plan:  # what the scenario brings along is where the operator begins
            self._seen_plan = True
            self.draft.rows = [_row(waypoint) for waypoint in flown["waypoints"]]
        if flown != self._told_flown:
            self._told_flown = flown
            self.tell_plan()

    _told_flown: dict[str, Any] | None = None

    async def _pulse(self) -> None:
        while True:
            self.send({"kind": "pulse", "hung": self.client.hung})
            await asyncio.sleep(PULSE)

    @staticmethod
    def _text(message: dict[str, Any]) -> str:
        return encode(message).decode()


def _row(waypoint: dict[str, Any]) -> dict[str, Any]:
    x, y, depth = waypoint.get("position") or (0.0, 0.0, 0.0)
    row = {"speed": 0.2, "acceptance": 0.2, "hold_time": 0.0, "heading_deg": None, "altitude": None}
    return {"x": x, "y": y, "depth": depth} | row | {k: v for k, v in waypoint.items() if k in row}


def _for_browser(row: dict[str, Any]) -> dict[str, Any]:
    degrees = row["heading_deg"]
    return row | {"heading": None if degrees is None else math.radians(degrees)}


def _place(row: dict[str, Any]) -> tuple[Any, ...]:
    return tuple(row[key] for key in ("x", "y", "depth", "speed", "hold_time", "heading_deg", "altitude"))
