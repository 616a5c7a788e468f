"""Rehearses the plan on the table in a process of its own, and holds flights against what was predicted of them."""

import asyncio
import logging
import math
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rovtwin.console.rehearsal.flight import flown_beside, write_rehearsals
from rovtwin.console.rehearsal.process import RehearsalProcess
from rovtwin.console.rehearsal.repetition import Repetition
from rovtwin.console.rehearsal.request import Request, Water
from rovtwin.core.errors import ConfigError, RovtwinError
from rovtwin.runs.ensemble.forecast import for_page
from rovtwin.scenario.schema import Scenario

if TYPE_CHECKING:
    from rovtwin.console.web.hub import Hub

logger = logging.getLogger(__name__)

LOOK = 0.25  # between two looks at plan, water and flight [s]
TELLS = 1.0  # between two messages of what is going on [s]
FRESH = 2.0  # a reading that is older is not one of now [s]
OVER = ("finished", "aborted", "held", "returned", "surfaced")  # phases in which a mission is not gone on with
WRITTEN = 4.0  # after a mission's end, until the log on the disk has it [s]
BEGUN, ENDED, CLOSED = 1, 2, 3  # how far a flight is: under way, at its end, its log closed
COLUMNS = ("x", "y", "depth", "speed", "acceptance", "hold_time", "heading_deg", "altitude")
GONE = "the process that rehearses ended, or was killed; is there memory left? Rehearse again"


class Rehearsing:
    """The rehearsal of a hub's draft: asked for by the page in control, and repeated as plan and water change."""

    def __init__(self, hub: "Hub", scenario: Scenario, is_twin: bool):
        self._hub, self._scenario, self._is_twin = hub, scenario, is_twin
        self.repetition = Repetition()
        self._water = Water()
        self._process: RehearsalProcess | None = None
        self._one_at_a_time = asyncio.Lock()  # begins
        self._number, self._began = 0, 0.0
        self._doing: dict[str, Any] | None = None
        self._why, self._sent_at, self._sent = "", -1e9, {}
        self._forecasts: dict[int, dict[str, Any]] = {}  # the newest, and what flies
        self._basis_of: dict[int, Any] = {}
        self._shown: Any = None  # what the forecast that pages have rests on
        self._flying: list[int] = []  # numbers of those that were started in this flight
        self._folder, self._reached, self._under_way = "", 0, False  # the flight, how far it was looked at
        self._over_at: float | None = None  # when its mission was seen to be at its end [s, monotonic]
        hub.others["rehearse"] = self.order
        hub.started, hub.more_checks = self.started, self.remarks

    async def run(self) -> None:
        """Until cancelled."""
        try:
            await asyncio.gather(self._again(self.turn), self._again(self.look_at_flight), self._listen())
        finally:
            await self._end_process()

    @staticmethod
    async def _again(look: Callable[[], Awaitable[None]]) -> None:
        while True:
            try:
                await look()
            except Exception:  # a mistake of ours must not end it
                logger.exception("the rehearsal")
            await asyncio.sleep(LOOK)

    async def order(self, what: dict[str, Any]) -> str:
        """`op`: now; again, with `on`; water, with `speed` [m/s], `toward` [deg], `waves` [m].

        Raises:
            RovtwinError: It cannot be done; the text says why.
        """
        op = what.get("op")
        if op == "now":
            self._require_possible()
            self.repetition.ask()
            await self.turn()
        elif op == "again":
            if not isinstance(on := what.get("on"), bool):
                raise ConfigError(f"rehearse.on: found {on!r:.40}, expected true or false")
            self.repetition.again = on
            self._tell(at_once=True)
        elif op == "water":
            self._water = Water.of(what, self._scenario.world.waves is not None)
            self._tell(at_once=True)
        else:
            raise ConfigError(f"rehearse: found {op!r:.40}, expected now, again or water")
        return ""

    async def turn(self) -> None:
        """Begin where it is time to, and tell how far it is."""
        async with self._one_at_a_time:
            if self.repetition.due(self._basis(), time.monotonic()):
                await self._begin()
        self._tell()

    # Asking

    def _basis(self) -> Any:
        """What a rehearsal rests on: plan, water and fence; not where the vehicle is, which moves."""
        state = self._hub.client.last.get("state", {})
        rows = tuple(tuple(row[key] for key in COLUMNS) for row in self._hub.draft.rows)
        return rows, self._water, _added(state), self._fence()

    def _fence(self) -> tuple[tuple[float, float], ...] | None:
        """Corners of the fence that was drawn on the chart; None while the scenario's holds."""
        setup = self._hub.client.last.get("setup", {})
        if not setup.get("fence_drawn"):
            return None
        return tuple((float(north), float(east)) for north, east in setup["fence"]["polygon"])

    def _require_possible(self) -> None:
        """Raise ConfigError where nothing can be rehearsed; the text says why."""
        if not self._hub.draft.rows:
            raise ConfigError("nothing to rehearse: the plan is empty; add way-points first")
        state = self._hub.client.last.get("state", {})
        if self._hub.client.hung or not state.get("eta"):
            raise ConfigError("no position: where the vehicle is, is not known yet; wait until it is connected")
        faults = [one["what"] for one in self._hub.drafting.refusals]
        if faults:
            more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
            raise ConfigError(f"the checks refuse the plan: {faults[0]}{more}. Mend it, then rehearse")

    async def _begin(self) -> None:
        try:
            self._require_possible()
            self._number += 1
            request, self._why = self._request(), ""
            self._basis_of[self._number] = self.repetition.basis
            self._began, self._doing = time.monotonic(), {"doing": "starting its process", "share": None}
            self._tell(at_once=True)
            if self._process is None:
                self._process = await asyncio.to_thread(RehearsalProcess, self._scenario)
            self._process.ask(request)
        except RovtwinError as error:
            self._end(str(error))
        except OSError:
            await self._end_process()
            self._end(GONE)

    def _request(self) -> Request:
        state = self._hub.client.last["state"]
        eta, sensors = state["eta"], state.get("sensors") or {}
        height, battery = _reading(sensors, "altimeter"), _reading(sensors, "battery")
        return Request(
            number=self._number,
            rows=tuple(self._hub.draft.rows),
            place=(float(eta[0]), float(eta[1]), float(eta[2])),
            heading_deg=math.degrees(eta[5]),
            water=self._water,
            added=_added(state),
            floor=None if height is None or self._is_twin else float(eta[2] + height),
            charge=battery,
            fence=self._fence(),
            is_twin=self._is_twin,
        )

    # Answers

    async def _listen(self) -> None:
        while True:
            if (process := self._process) is None:
                await asyncio.sleep(LOOK)
                continue
            try:
                answer = await asyncio.to_thread(process.answer, 0.5)
            except (EOFError, OSError):
                if process is self._process:
                    await self._end_process()
                    self._end(GONE if self._doing is not None else self._why)
                continue
            try:
                if answer is not None:
                    self.take(*answer)
            except Exception:  # a mistake of ours must not end it
                logger.exception("an answer of the rehearsal")

    def take(self, number: int, news: dict[str, Any]) -> None:
        """An answer of the process."""
        if number != self._number and number not in self._flying:
            return
        if "forecast" in news:
            self._forecasts[number] = news["forecast"]
            if number == self._number:
                self._show(number)
                if news["forecast"]["whole"]:
                    self._end("")
        elif number == self._number:
            if "error" in news:
                self._end(news["error"])
            else:
                self._doing = news

    def _end(self, why: str) -> None:
        """Nothing is going on any more; `why` where it failed."""
        self._doing, self._why = None, why
        kept = {*self._flying, self._number}
        self._forecasts = {number: one for number, one in self._forecasts.items() if number in kept}
        self._basis_of = {number: one for number, one in self._basis_of.items() if number in kept}
        self._tell(at_once=True)

    async def _end_process(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            await asyncio.to_thread(process.close)  # it may take a second, and STOP must not wait

    # Pages

    def _show(self, number: int) -> None:
        self._shown = self._basis_of.get(number)
        self._hub.keep({"kind": "rehearsal"} | for_page(self._forecasts[number]))
        self._hub.tell_plan()

    def _tell(self, at_once: bool = False) -> None:
        """How far it is; nothing is sent where nothing is new."""
        now = time.monotonic()
        if not at_once and now - self._sent_at < TELLS:
            return
        message = {
            "kind": "rehearsing",
            "busy": self._doing is not None,
            "doing": "" if self._doing is None else self._doing["doing"],
            "share": None if self._doing is None else self._doing["share"],
            "seconds": round(now - self._began) if self._doing is not None else None,
            "why": self._why,
            "again": self.repetition.again,
            "asked": self.repetition.basis is not None,
            "stale": self._shown is not None and self._basis() != self._shown,
            "current": self._water.current,
            "waves": self._water.waves,
            "has_waves": self._scenario.world.waves is not None,
        }
        self._sent_at = now
        if message != self._sent:
            changed = message["stale"] != self._sent.get("stale")
            self._sent = message
            self._hub.keep(message)
            if changed:  # what was said of rows does not hold any more
                self._hub.tell_plan()

    def remarks(self) -> list[dict[str, Any]]:
        """What the rehearsal of the plan on the table gives reason to say, as checks of the plan."""
        if self._number not in self._forecasts or self._is_stale():
            return []
        every = self._forecasts[self._number]["remarks"]
        return [one | {"what": f"rehearsal: {one['what']}"} for one in every]

    def _is_stale(self) -> bool:
        """Whether plan, water or fence have changed since."""
        return self._basis() != self._basis_of.get(self._number)

    # The flight

    def started(self) -> None:
        """A page has started the mission: what was predicted of it is kept, if it was rehearsed."""
        basis = self._basis_of.get(self._number)
        if basis is not None and basis[0] == self._basis()[0]:  # what is started is what is on the table
            folder = self._hub.client.last.get("state", {}).get("folder") or ""
            if folder != self._folder:  # a flight that was not looked at yet
                self._folder, self._flying = folder, []
            self._flying = [*(one for one in self._flying if one != self._number), self._number]
            self._reached, self._under_way, self._over_at = 0, False, None

    async def look_at_flight(self) -> None:
        """Keep what was predicted in the flight's folder; compare at the mission's end, and when the log closes."""
        state = self._hub.client.last.get("state", {})
        folder, phase = state.get("folder") or "", state.get("phase") or ""
        closed = bool(self._folder) and folder != self._folder
        before, flying = self._folder or folder, self._flying
        self._folder = folder if closed else before
        if closed:
            self._flying = []
        self._under_way |= phase not in (*OVER, "idle", "")
        if flying and before:
            if self._over_at is None and self._under_way and phase in OVER:
                self._over_at = time.monotonic()
            ended = self._over_at is not None and time.monotonic() - self._over_at >= WRITTEN
            stage = CLOSED if closed else ENDED if ended else BEGUN if self._is_whole(flying[-1]) else 0
            if stage > self._reached:
                self._reached = stage
                await self._keep(stage, Path(before), flying)  # the next flight may begin meanwhile

    def _is_whole(self, number: int) -> bool:
        return self._forecasts.get(number, {}).get("whole", False)

    async def _keep(self, stage: int, folder: Path, flying: list[int]) -> None:
        number = flying[-1]
        if (forecast := self._forecasts.get(number)) is None:
            return
        try:
            if stage > BEGUN:
                arguments = (folder, forecast, self._scenario, stage == CLOSED)
                forecast["flown"] = await self._hub.worker.call(flown_beside, *arguments)
                if number == self._number:
                    self._show(number)
            flown = [self._forecasts[one] for one in flying if one in self._forecasts]
            await asyncio.to_thread(write_rehearsals, folder, flown)
        except Exception as error:
            if not isinstance(error, RovtwinError):  # a mistake of ours
                logger.exception("predicted against flown")
            self._hub.say("warning", f"predicted against flown: {error}")


def _added(state: dict[str, Any]) -> tuple[float, float]:
    """Current that the twin has beside the scenario's [m/s]."""
    north, east = state.get("added_current") or (0.0, 0.0)
    return float(north), float(east)


def _reading(sensors: dict[str, Any], kind: str) -> float | None:
    """The first value of a sensor's reading of now, None where there is none."""
    for name, one in sorted(sensors.items()):
        is_new = one.get("value") is not None and one.get("age") is not None and one["age"] < FRESH
        if is_new and (name == kind or name.startswith(f"{kind}_")):
            return float(one["value"][0])
    return None
