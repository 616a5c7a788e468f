"""Between browsers and the engine: hands states on, holds the plan on the table, and lets one browser give orders."""

import asyncio
import contextlib
import logging
import math
import secrets
import time
from collections.abc import Awaitable, Callable
from datetime import datetime
from functools import partial
from typing import Any

from rovtwin.console.client import Client
from rovtwin.console.control import Rights
from rovtwin.console.planning import Draft, for_browser, row_from
from rovtwin.console.surveys import SurveyArea
from rovtwin.console.web.browser import Browser
from rovtwin.console.web.drafting import Drafting
from rovtwin.console.web.sea_check import SeaCheck
from rovtwin.console.wire import Place, decode, encode
from rovtwin.console.worker import Worker
from rovtwin.core.errors import RovtwinError
from rovtwin.core.user_files.files import MOST_UPLOAD
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.runs.compose.fitting import own_values
from rovtwin.runs.limits import Limits
from rovtwin.scenario.schema import Scenario
from rovtwin.survey.pace import line_speed

logger = logging.getLogger(__name__)

PULSE = 0.5  # how often browsers hear whether the engine lives [s]
LIVING = 0.8  # a page says something more often than this, and looks for a lost server later than this [s]
LATE = 4.0  # an order given on news older than this is not handed on: it waited in a network that was down [s]
PLAIN = ("arm", "disarm", "start", "pause", "resume", "abort", "hold", "reconnect")  # as they come, to the engine
FULL = ("goto", "pace", "inject", "fence")
ANY_AGE = ("disarm", "abort")  # right however long they waited, as STOP is
AT_ONCE = 16  # orders of one page that are not answered yet; further ones are refused
PATIENCE = 20.0  # with a file that is read, or a survey that is laid out [s]; pages wait for 30


Do = Callable[[str, dict[str, Any]], Awaitable[str]]  # an order and what was said with it -> what to say


async def answer(browser: Browser, text: str, do: Do) -> None:
    """Do what a message of a browser asks, and say what came of it."""
    try:
        message = decode(text)
    except ValueError as error:
        why = f"not understood: {error}"
        browser.put(encode({"kind": "reply", "id": None, "ok": False, "error": why}).decode())
        return
    number, what = message.pop("id", None), message.pop("do", None)
    what = what[:40] if isinstance(what, str) else "?"
    browser.orders += 1
    try:
        reply: dict[str, Any] = {"ok": True, "message": await do(what, message)}
    except RovtwinError as error:
        reply = {"ok": False, "error": str(error)}
    except Exception as error:  # a mistake of ours: whoever gave the order must not be left in doubt
        logger.exception("order %s", what)
        reply = {"ok": False, "error": f"{what}: the console failed at it ({type(error).__name__}: {error})"}
    finally:
        browser.orders -= 1
    if isinstance(number, int | float | str):
        browser.put(encode({"kind": "reply", "id": number} | reply).decode())


class Hub:
    """One engine, many browsers.

    Attributes:
        client: To the engine.
        rights: Who is in control.
        datum: Of the plan's metres, or None where nobody has given it.
        vehicle: That is flown: its name, file or description.
        line_speed: The fastest at which it flies the lines of a survey [m/s].
        draft: The plan on the table, which all see and one edits.
        drafting: What is done to it.
        submitted_area: What the plan that was submitted last surveys, or None.
        worker: Reads files and lays surveys out, in a process of its own.
        others: Orders that are done elsewhere, by name; only the page in control gives them.
        started: Called when a page has started the mission.
        more_checks: What there is to say of the draft beside `drafting.checks`.
    """

    def __init__(self, place: Place, scenario: Scenario):
        self.client = Client(place, self._pass_on)
        model = vehicle_of(scenario).model()
        self.datum = scenario.origin if scenario.datum.is_given else None
        self.vehicle, own, self.line_speed = scenario.vehicle, own_values(Limits.of(model)), line_speed(model)
        self.rights, self.draft = Rights(), Draft(own=own)
        self.submitted_area: SurveyArea | None = None
        self.worker = Worker("the plan", PATIENCE)
        self.drafting = Drafting(self, self.worker, SeaCheck(scenario, self.worker))
        self._browsers: list[Browser] = []
        self._seen_plan = self._ready = False
        self._tasks: set[asyncio.Task[Any]] = set()
        self._kept: dict[str, str] = {}
        self.others: dict[str, Callable[[dict[str, Any]], Awaitable[str]]] = {}
        self.started: Callable[[], None] = lambda: None
        self.more_checks: Callable[[], list[dict[str, Any]]] = list

    async def run(self) -> None:
        """Until cancelled."""
        try:
            with contextlib.suppress(asyncio.CancelledError):
                await asyncio.gather(self.client.listen(), self._pulse())
        finally:
            self.worker.close()

    # To the browsers

    def come(self, name: str) -> Browser:
        """A page that opens, with all that it has to know."""
        browser = Browser(self._unused(name))
        self._browsers.append(browser)
        self.rights.come(browser.name)
        browser.put(self._text(self._pulse_message()))
        for kind in ("setup", "history", "watch", "state"):
            if kind in self.client.last:
                browser.put(encode(self.client.last[kind]).decode())
        for text in self._kept.values():
            browser.put(text)
        browser.put(self._text(self.plan()))
        self.tell_rights()
        return browser

    def _unused(self, name: str) -> str:
        """A name that no page has which lives: a tab that was duplicated brings along that of its original."""
        for other in self._browsers:
            if other.name == name:
                if other.silent < LIVING:
                    return f"b{secrets.token_hex(2)}"
                other.give_up()  # its network was lost, and it is the same that comes anew
        return name

    def leave(self, browser: Browser) -> None:
        """A page that closes."""
        self._browsers.remove(browser)
        if self.rights.leave(browser.name):
            self.say("warning", f"{browser.name} left, who was in control: the operator watchdog counts")
        self.tell_rights()

    @property
    def pages(self) -> int:
        """How many are open."""
        return len(self._browsers)

    @property
    def silent(self) -> float:
        """Since the page in control last said anything [s]; inf where there is none."""
        return min((one.silent for one in self._browsers if one.name == self.rights.holder), default=math.inf)

    def send(self, message: dict[str, Any]) -> None:
        """A message to all."""
        self._hand_on(self._text(message))

    def keep(self, message: dict[str, Any]) -> None:
        """A message to all, and the newest of its kind to who comes later."""
        self._kept[message["kind"]] = text = self._text(message)
        self._hand_on(text)

    def _hand_on(self, text: str) -> None:
        for browser in self._browsers:
            browser.put(text)

    def say(self, level: str, text: str) -> None:
        """An event of the console's own."""
        state = self.client.last.get("state", {})
        clock = f"{datetime.now():%H:%M:%S}"
        self.send({"kind": "event", "t": state.get("t", 0.0), "clock": clock, "level": level, "text": text})

    def tell_rights(self) -> None:
        """Who is in control, to each in its own words."""
        for browser in self._browsers:
            browser.put(self._text(self.rights.message(browser.name)))

    def attended(self) -> dict[str, Any]:
        """What pages need that show no flight, replays, to count down while nobody is in control of one."""
        state, setup = (self.client.last.get(kind, {}) for kind in ("state", "setup"))
        found = {key: state.get(key) for key in ("armed", "phase", "operator_age")}
        return found | {"operator_silent": setup.get("operator_silent")}

    def tell_plan(self) -> None:
        self.send(self.plan())

    def plan(self) -> dict[str, Any]:
        """The plan on the table, the one that was submitted, and what there is to say of the first."""
        flown = self.client.last.get("flown", {})
        rows = [for_browser(row_from(waypoint)) for waypoint in flown.get("waypoints", [])]
        return {
            "kind": "plan",
            "draft": [for_browser(row) for row in self.draft.rows],
            "flown": rows,
            "submitted": bool(flown.get("submitted")),
            "changed": [_place(row) for row in self.draft.rows] != [_place(row) for row in rows],
            "own": self.draft.own,
            "line_speed": self.line_speed,
            "undo": self.draft.can_undo,
            "redo": self.draft.can_redo,
            "length": self.draft.length(),
            "seconds": self.draft.seconds(),
            "checks": [*self.drafting.checks, *self.more_checks()],
            "largest": MOST_UPLOAD,
        }

    def _drafting_differs(self) -> bool:
        """Whether a plan was submitted, and what is on the table is another."""
        plan = self.plan()
        return plan["submitted"] and plan["changed"]

    # From the browsers

    async def obey(self, browser: Browser, text: str) -> None:
        """Do what a message of a browser asks, and say what came of it."""
        await answer(browser, text, partial(self._do, browser))

    async def _do(self, browser: Browser, do: str, what: dict[str, Any]) -> str:
        name, pulse = browser.name, what.pop("pulse", None)
        if do == "stop":
            return "thrusters off" if await self.client.stop() else "no vehicle is held"
        if do == "alive":
            if self.rights.holder == name:
                self.client.tell("alive")
            return ""
        if browser.orders > AT_ONCE:
            raise RovtwinError(f"{browser.orders} orders of this page wait already. Give it again in a moment")
        if do in ("take", "ask", "give", "refuse"):
            text = self.rights.take(name) if do in ("take", "ask") else getattr(self.rights, do)(name) or ""
            self.tell_rights()
            return text
        if self.rights.holder != name:
            raise RovtwinError(f"{self.rights.holder or 'nobody'} is in control: ask for it first")
        if do not in ANY_AGE:
            _require_new(pulse)
        if do == "start" and self._drafting_differs():
            raise RovtwinError("the plan was changed since it was submitted: Submit it, or Undo")
        if do == "pilot" and what.get("begin"):
            await self.client.ask("pilot", **what)
        elif do == "pilot":
            self.client.tell("pilot", **what)
        elif do == "plan":
            return await self.drafting.do(what)
        elif do in PLAIN:
            await self.client.ask(do)
            if do == "start":
                self.started()
        elif do in FULL:
            await self.client.ask(do, **what)
            if do == "fence":
                await self.drafting.look()
        elif do in self.others:
            return await self.others[do](what)
        else:
            raise RovtwinError(f"{do}: there is no such order")
        return ""

    def _pass_on(self, kind: str, text: bytes) -> None:
        """News of the engine, as they are."""
        if kind == "flown":
            self._plan_message()
            return
        if kind == "state" and (ready := self.client.last["state"].get("stage") == "ready") != self._ready:
            self._ready = ready
            if ready:  # what was checked before there was a vehicle
                task = asyncio.get_running_loop().create_task(self.drafting.look())
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)
        for browser in self._browsers:
            browser.put(text.decode(), kind == "state")

    def _plan_message(self) -> None:
        flown = self.client.last["flown"]
        if not self._seen_plan:  # what the scenario brings along is where the operator begins
            self._seen_plan = True
            self.draft.rows = [row_from(waypoint) for waypoint in flown["waypoints"]]
        if flown != self._sent_flown:
            self._sent_flown = flown
            self.tell_plan()

    _sent_flown: dict[str, Any] | None = None

    async def _pulse(self) -> None:
        while True:
            self.send(self._pulse_message())
            await asyncio.sleep(PULSE)

    def _pulse_message(self) -> dict[str, Any]:
        """Whether the engine lives; pages say with each order of which pulse they have received last."""
        return {"kind": "pulse", "hung": self.client.hung, "at": time.monotonic()}

    @staticmethod
    def _text(message: dict[str, Any]) -> str:
        return encode(message).decode()


def _require_new(pulse: Any) -> None:
    """Raise RovtwinError where the newest pulse that a page had received when it gave an order is too old [s]."""
    if pulse is None:  # a program in place of a page
        return
    if isinstance(pulse, bool) or not isinstance(pulse, int | float):
        raise RovtwinError(f"pulse: found {pulse!r:.40}, expected the time of one")
    if not 0.0 <= time.monotonic() - pulse <= LATE:
        raise RovtwinError("it comes late: the network was down when it was given. Look, and give it again")


def _place(row: dict[str, Any]) -> tuple[Any, ...]:
    return tuple(row[key] for key in ("x", "y", "depth", "speed", "hold_time", "heading_deg", "altitude"))
