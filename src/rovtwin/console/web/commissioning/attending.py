"""Attends a commissioning: starts its stages, hands their questions to pages and answers back, ends them by STOP.

A question waits, thrusters off, for a page that was loaded anew or lost its network; where none comes in a minute it
counts as no. While thrusters may turn, a stage is ended where no page has been in control for a while, since nobody
could press STOP.
"""

import asyncio
import contextlib
import math
import time
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rovtwin.console.commissioning.checklist import checklist
from rovtwin.console.commissioning.folders import ask_anew, begin, find, listed
from rovtwin.console.commissioning.process import NICE, STAGES, Job, StageProcess, count_of
from rovtwin.console.locks import Lock
from rovtwin.console.wire import Place
from rovtwin.console.worker import Worker
from rovtwin.core.errors import RovtwinError

if TYPE_CHECKING:
    from rovtwin.console.web.hub import Hub

LOOK = 0.1  # longest wait for a message of a stage, before it is looked who is there [s]
SILENT = 3.0  # a page that says nothing for so long is away [s]; it says something five times a second
ALONE = 10.0  # longest time without a page in control while thrusters may turn [s]
UNANSWERED = 60.0  # for which a question waits without a page in control; nothing moves meanwhile [s]
CLOSING = 5.0  # longest wait for a stage that the console's end ends [s]
LINES = 60  # that are kept of what a stage says
PATIENCE = 120.0  # with a checklist that is read: the first one imports all that computes [s]
ENDINGS = {
    "go": ("ok", "{title}: go."),
    "no-go": ("danger", "{title}: no-go. Its page says why, and what to do."),
    "stopped": ("danger", "{title}: ended before its time. What it has measured is kept."),
    "refused": ("danger", "{title}: not done. {why}"),
    "failed": ("danger", "{title}: failed, a mistake of rovtwin's ({why}). What it has measured is kept."),
    "died": ("danger", "{title}: {why}. What it has measured is kept; start it again."),
}


class Commissioning:
    """The commissionings of a console, of which one stage at a time is done."""

    def __init__(self, hub: "Hub", place: Place, root: Path, stages: str = STAGES):
        """`root` is the folder of all; `stages`: module and name of the stages in their order."""
        self._hub, self._place, self._root, self._stages = hub, place, root, stages
        self._worker = Worker("the commissioning", PATIENCE)
        self._hold = Lock(place.commissioning)
        self._process: StageProcess | None = None
        self._starting = False
        self._now: dict[str, Any] | None = None  # the stage that is being done, for pages
        self._question: dict[str, Any] | None = None
        self._progress: dict[str, Any] = {"what": "", "share": None}
        self._began = self._doing_since = 0.0  # of the stage, and of what it does now [s, monotonic]
        self._lines: deque[str] = deque(maxlen=LINES)
        self._ended: dict[str, Any] | None = None
        self._seen_at = 0.0  # when a page in control last said something [s, monotonic]
        self._waits_since = 0.0  # when a question came, or a page in control that could answer it was last open
        self._revision = 0  # of what lies in the folders
        self._task: asyncio.Task[None] | None = None
        self._warming: asyncio.Task[None] | None = None
        hub.others["commission"] = self.do
        hub.client.also_stops = self.stop
        self._tell()

    # What pages read

    async def listed(self) -> dict[str, Any]:
        """The commissionings there are; somebody is about to choose one, so the process that reads them begins."""
        if self._warming is None:
            self._warming = asyncio.create_task(self._warm())
        return {"folder": str(self._root), "found": await asyncio.to_thread(listed, self._root)}

    async def _warm(self) -> None:
        with contextlib.suppress(RovtwinError, OSError):
            await self._worker.call(count_of, self._stages)

    async def checklist(self, name: str) -> dict[str, Any]:
        """All of one; ConfigError where it cannot be read."""
        return await self._worker.call(checklist, self._root, name, self._stages)

    # What the page in control orders

    async def do(self, what: dict[str, Any]) -> str:
        """An order; what to say.

        Raises:
            RovtwinError: It cannot be done; the text says why.
        """
        op = what.get("op")
        if op == "begin":
            return await self._worker.call(begin, self._root, what.get("folder"), what.get("request"))
        if op == "change":
            await self._worker.call(ask_anew, self._root, what.get("folder"), what.get("request"))
            self._changed()
        elif op == "start":
            await self._start(what.get("folder"), what.get("stage"))
        elif op == "answer":
            self._answer(what)
        elif op == "end":
            self._end()
        elif op == "give_back":
            self._give_back()
        else:
            raise RovtwinError(
                f"commission.op: found {op!r:.40}, expected begin, change, start, answer, end, give_back"
            )
        return ""

    async def _start(self, folder: Any, stage: Any) -> None:
        if self._process is not None or self._starting:
            raise RovtwinError("a stage is being done already: wait, or end it first")
        self._starting = True
        try:
            rows = (await self.checklist(folder))["stages"]
            row = next((one for one in rows if one["name"] == stage), None)
            if row is None:
                raise RovtwinError(f"stage: found {stage!r:.40}, expected one of {', '.join(r['name'] for r in rows)}")
            if row["connects"]:
                await self._hold_vehicle()
            job = Job(find(self._root, folder), row["name"], self._place.stop, self._stages)
            process = await asyncio.to_thread(StageProcess, job, None if row["connects"] else NICE)
        finally:
            self._starting = False
        self._process, self._question, self._ended = process, None, None
        self._lines.clear()
        self._seen_at = self._began = self._doing_since = time.monotonic()
        self._progress = {"what": "starting", "share": None}
        self._now = {key: row[key] for key in ("name", "title", "moves")}
        self._now |= {"folder": folder, "attempts": len(row["attempts"]), "phase": "resting", "ending": False}
        self._changed()
        self._tell_progress()  # or a page that comes now would get that of the stage before
        self._task = asyncio.create_task(self._attend(process))

    async def _hold_vehicle(self) -> None:
        """From now on the engine commands nothing; RovtwinError where it cannot let go of the vehicle."""
        if self._hold.is_ours:
            return
        if not await asyncio.to_thread(self._hold.take):
            raise RovtwinError("another console on this port is commissioning already: use its page")
        try:
            await self._hub.client.ask("lend")
        except BaseException:
            self._hold.give()
            raise

    def _answer(self, what: dict[str, Any]) -> None:
        """Answer the question that waits; a number, or None; of yes and no only true is a yes."""
        question, process = self._question, self._process
        if question is None or process is None or what.get("question") != question["id"]:
            raise RovtwinError("that question waits no more")
        value = what.get("value")
        if question["kind"] == "number" and value is not None:
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise RovtwinError(f"found {value!r:.40}, expected a number in {question['unit']}, such as 12.5")
        elif question["kind"] == "confirm" and not isinstance(value, bool):
            raise RovtwinError(f"found {value!r:.40}, expected true or false")
        self._reply(value)

    def _reply(self, value: Any, why: str = "") -> None:
        question, self._question = self._question, None
        if question is None or self._process is None:
            return
        if question["kind"] == "confirm":
            given = "yes" if value is True else "no"
        else:
            given = "not to be had" if value is None else f"{value:g} {question['unit']}"
        self._lines.append(f"{question['text']} – {given}{f' ({why})' if why else ''}")
        self._process.answer(question["id"], value)
        self._tell()

    def _end(self) -> None:
        if self._process is None:
            raise RovtwinError("no stage is being done")
        self._stop(self._process)

    def _give_back(self) -> None:
        if self._process is not None or self._starting:
            raise RovtwinError("a stage is being done: end it first")
        self._hold.give()
        self._tell()

    # STOP

    def stop(self) -> bool:
        """STOP: end a stage that may move the vehicle, at once; whether there is one."""
        moves = self._process is not None and self._now is not None and self._now["moves"]
        if moves and self._process is not None:
            self._stop(self._process)
        return moves

    def _stop(self, process: StageProcess) -> None:
        """End it; one that computes may take some seconds, and pages say that it was heard."""
        self._question = None
        process.stop()
        if self._now is not None:
            self._now = self._now | {"ending": True}
        self._tell()

    async def close(self) -> None:
        """End what is being done; the console ends."""
        process, task = self._process, self._task
        if process is not None:
            process.stop()
        if task is not None:
            with contextlib.suppress(asyncio.CancelledError, TimeoutError):
                await asyncio.wait_for(task, CLOSING)
        self._hold.give()
        self._worker.close()

    # A stage that is being done

    async def _attend(self, process: StageProcess) -> None:
        """Until its process has ended."""
        how, why = "died", "its messages could not be read"
        try:
            while True:
                message = await asyncio.to_thread(process.message, LOOK)
                if message is not None and message[0] == "ended":
                    how, why = message[1]
                    break
                if message is not None:
                    self._take(*message)
                self._mind(process)
        finally:
            self._process, self._question = None, None
            if how in ("no-go", "died", "refused") and process.stopped:
                how = "stopped"
            await asyncio.shield(asyncio.to_thread(process.close))
            self._over(how, why)

    def _over(self, how: str, why: str) -> None:
        now, self._now = self._now or {"title": "stage", "name": "", "folder": ""}, None
        level, text = ENDINGS[how]
        words = text.format(title=now["title"], why=why)
        self._ended = {"stage": now["name"], "folder": now["folder"], "level": level, "text": words, "how": how}
        self._hub.say("info" if how == "go" else "warning", f"commissioning: {words}")
        self._changed()

    def _take(self, kind: str, content: Any) -> None:
        """A message of its process."""
        if kind == "progress":
            if content[0] != self._progress["what"]:
                self._doing_since = time.monotonic()
            self._progress = {"what": content[0], "share": content[1]}
            self._tell_progress()
        elif kind == "phase" and self._now is not None:
            self._now = self._now | {"phase": content}
            self._tell()
        elif kind == "say":
            self._lines.append(content)
            self._tell()
        elif kind == "question" and self._process is not None and not self._process.stopped:
            self._question, self._waits_since = content, time.monotonic()
            self._tell()

    def _mind(self, process: StageProcess) -> None:
        """End what turns where nobody could press STOP, and decline what nobody is there to answer.

        A page that is loaded anew is back before. One that is hidden for long speaks too seldom for what turns, but
        can be looked at, and answers then.
        """
        now, silent = time.monotonic(), self._hub.silent
        if silent < SILENT:
            self._seen_at = now
        if math.isfinite(silent):
            self._waits_since = now
        if self._question is not None and now - self._waits_since > UNANSWERED:
            value = False if self._question["kind"] == "confirm" else None
            self._reply(value, f"no page was in control for {UNANSWERED:g} s")
        turning = self._now is not None and self._now["phase"] == "turning"
        if turning and now - self._seen_at > ALONE and not process.stopped:
            self._lines.append(f"ended: no page has been in control for {ALONE:g} s")
            self.stop()

    def _tell_progress(self) -> None:
        self._hub.keep({"kind": "commission_progress", **self._progress, **self._times()})

    def _times(self) -> dict[str, float]:
        """Since when the stage goes on, and what it does now, by the clock of the hub's pulse [s]."""
        return {"since": self._doing_since, "began": self._began}

    def _changed(self) -> None:
        self._revision += 1
        self._tell()

    def _tell(self) -> None:
        self._hub.keep(
            {
                "kind": "commission",
                "now": self._now,
                "question": self._question,
                "progress": self._progress | self._times(),
                "lines": list(self._lines),
                "ended": self._ended,
                "held": self._hold.is_ours,
                "revision": self._revision,
            }
        )
