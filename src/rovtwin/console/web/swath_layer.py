"""Paints what the vehicle's eyes have seen of the floor, tells pages once a second, and lays lines over the gaps."""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from rovtwin.console.surveys import SurveyArea
from rovtwin.console.swath.eyes import Eye, eyes_of, looks_down, sounders_of
from rovtwin.console.swath.gaps import Seen, lines_over, share_seen
from rovtwin.console.swath.painter import Depths, Painter, swath_of
from rovtwin.core.errors import ConfigError, RovtwinError
from rovtwin.scenario.schema import Scenario

if TYPE_CHECKING:
    from rovtwin.console.web.hub import Hub

logger = logging.getLogger(__name__)

LOOK = 0.05  # between two looks at the state [s]
EVERY = 1.0  # between two messages [s]
AGAIN = 5.0  # until the eyes are looked for again, where the worker failed [s]


class SwathLayer:
    """The floor seen in the flight under way, or in the last one, by each eye; a new flight begins with none.

    Attributes:
        painters: One for each eye; none where the vehicle has no eye that looks down.
        notes: Why something that looks down is not among them.
    """

    def __init__(self, hub: "Hub", scenario: Scenario):
        self._hub, self._scenario = hub, scenario
        self._eyes: list[Eye] = []
        self._depths = Depths([], None)
        self.painters: list[Painter] = []
        self.notes: list[str] = []
        self._folder, self._t = "", -1.0
        self._found: dict[str, dict[str, Any]] = {}  # of the area, by eye
        self._judged: list[Any] = []  # what they rest on: the area, and how much each eye had seen
        self._sent: dict[str, Any] = {}
        self._judging: asyncio.Task[None] | None = None
        hub.others["fill_gaps"] = self.fill

    async def run(self) -> None:
        """Until cancelled."""
        if not looks_down(self._scenario):
            return
        while not (self._eyes or self.notes):
            try:
                eyes, notes, depths = await self._hub.worker.call(seeing, self._scenario)
                self.open(eyes, notes, depths)
            except RovtwinError as error:  # the worker is busy, or was ended
                logger.warning("the swath: %s", error)
                await asyncio.sleep(AGAIN)
        await asyncio.gather(*(self._again(what, every) for what, every in ((self._paint, LOOK), (self._show, EVERY))))

    async def _again(self, what: Callable[[], Awaitable[None]], every: float) -> None:
        while True:
            await asyncio.sleep(every)
            try:
                await what()
            except Exception:  # a mistake of ours must not end the layer
                logger.exception("the swath")

    async def _paint(self) -> None:
        self.look(self._hub.client.last.get("state", {}))

    async def _show(self) -> None:
        if not self._hub.pages:
            return
        if self._judging is None or self._judging.done():  # it waits while a survey is laid out, and the rest goes on
            self._judging = asyncio.create_task(self.judge())
        self.send()

    def open(self, eyes: list[Eye], notes: list[str], depths: Depths) -> None:
        """Paint from now on what these see."""
        self._eyes, self.notes, self._depths = eyes, notes, depths
        self._begin()

    def look(self, state: dict[str, Any]) -> None:
        """Take a state, where it is a new one of a flight."""
        folder, t = state.get("folder") or "", state.get("t")
        if self._folder and folder != self._folder:
            for painter in self.painters:
                painter.finish()
        if folder and (folder != self._folder or (t is not None and t < self._t)):
            self._begin()
        self._folder = folder
        if not folder or t is None or t == self._t:
            return
        self._t = t
        if (instant := self._depths.instant(state)) is not None:
            for painter in self.painters:
                painter.take(instant)

    async def judge(self) -> None:
        """Find by the worker what of the survey's area is missing, where that may be other than it was."""
        area = self._area()
        basis = [area, *(painter.cells.seen_m2 for painter in self.painters)]
        if area is None or basis == self._judged:
            return
        found = {}
        for painter in list(self.painters):
            try:
                seen = _seen(painter, area)
                found[painter.eye.name] = await self._hub.worker.call(share_seen, area.corners, seen)
            except RovtwinError as error:
                found[painter.eye.name] = {"error": str(error)}
        self._found, self._judged = found, basis

    def send(self) -> None:
        """The message to all pages, if it is another one than the last."""
        if (message := self.message()) != self._sent:
            self._sent = message
            self._hub.keep(message)

    def message(self) -> dict[str, Any]:
        """What pages are given; see docs/console.md."""
        area = self._area()
        return {
            "kind": "swath",
            "flying": bool(self._folder),
            "area": None if area is None else area.corners,
            "notes": self.notes,
            "eyes": [self._report(painter) for painter in self.painters],
        }

    async def fill(self, what: dict[str, Any]) -> str:
        """Lay a draft over what an eye, by its name, has not seen of the area.

        Raises:
            RovtwinError: There is no area, nothing was seen or is missing, or no line can be laid.
        """
        names = [painter.eye.name for painter in self.painters]
        if not names:
            raise ConfigError(f"no sensor whose swath is known looks down at the floor. {' '.join(self.notes)}".strip())
        if what.get("eye") not in names:
            raise ConfigError(f"fill_gaps.eye: found {what.get('eye')!r}, expected one of {', '.join(names)}")
        painter, area = self.painters[names.index(what["eye"])], self._area()
        if area is None:
            raise ConfigError("there is no area whose gaps could be planned: lay a survey with Area first")
        if painter.began is None or painter.floor is None:
            raise ConfigError(f"{painter.eye.name} has seen nothing yet: fly the survey first")
        swath = swath_of(painter.eye, painter.floor - area.depth)
        if swath is None:
            raise ConfigError(f"{painter.eye.name} would see nothing {area.depth:g} m deep, the floor is too far")
        eye = {"name": painter.eye.name, "imager": painter.eye.imager, "width": swath[0], "middle": swath[1].tolist()}
        rows = await self._hub.worker.call(
            lines_over, area, _seen(painter, area), self._hub.vehicle, eye, painter.floor
        )
        self._hub.draft.load(rows, area)
        await self._hub.drafting.look()
        return f"{len(rows)} way-points over the gaps: look at them, then Submit"

    def _begin(self) -> None:
        self.painters = [Painter(eye) for eye in self._eyes]
        self._t, self._found, self._judged = -1.0, {}, []

    def _area(self) -> SurveyArea | None:
        return self._hub.draft.area or self._hub.submitted_area

    def _report(self, painter: Painter) -> dict[str, Any]:
        return {
            "name": painter.eye.name,
            "kind": painter.eye.kind,
            "reach": painter.eye.reach,
            "height": painter.height,
            "by": self._depths.source,
            "why": painter.why,
            "began": painter.began,
            "ended": painter.ended,
            "seen_m2": painter.cells.seen_m2,
            "cells": painter.cells.message(),
            "found": self._found.get(painter.eye.name) if self._judged and self._judged[0] == self._area() else None,
        }


def seeing(scenario: Scenario) -> tuple[list[Eye], list[str], Depths]:
    """In the worker's process, for lenses are compiled: the eyes, why others are none, and how deep the floor is."""
    eyes, notes = eyes_of(scenario)
    return eyes, notes, Depths(sounders_of(scenario), scenario.world.floor)


def _seen(painter: Painter, area: SurveyArea) -> Seen:
    corners = area.corners
    return Seen.of(*painter.cells.window(np.min(corners, axis=0), np.max(corners, axis=0)))
