"""Whether the sea allows a plan: what `rovtwin sea` says of its places, found beside the server's work."""

import asyncio
from collections.abc import Callable

from rovtwin.core.errors import RovtwinError
from rovtwin.scenario.composition import compose
from rovtwin.scenario.schema import MissionSection, Scenario, Waypoint
from rovtwin.scenario.sea import moves, verdict

QUIET = 1.0  # a plan that is being changed is not judged yet [s]
LEVELS = {"holds": "ok", "swept": "warning"}

Check = dict[str, str]


class SeaCheck:
    """Judges the newest plan in the scenario's sea, current and waves; nothing to say in still water."""

    def __init__(self, scenario: Scenario):
        self._scenario = scenario
        self._task: asyncio.Task[None] | None = None

    def ask(self, waypoints: list[Waypoint], tell: Callable[[Check], None]) -> None:
        """Judge these, and no longer the ones before; `tell` is called when it is known."""
        if self._task is not None:
            self._task.cancel()
        if waypoints and not self._scenario.test and moves(self._scenario):
            self._task = asyncio.create_task(self._judge(waypoints, tell))

    async def _judge(self, waypoints: list[Waypoint], tell: Callable[[Check], None]) -> None:
        await asyncio.sleep(QUIET)
        tell(await asyncio.to_thread(self._verdict, waypoints))

    def _verdict(self, waypoints: list[Waypoint]) -> Check:
        scenario = self._scenario.model_copy(update={"mission": MissionSection(waypoints=waypoints)})
        try:
            worst, said = verdict(compose(scenario))
        except RovtwinError as error:
            return {"level": "error", "what": f"in this sea: {error}"}
        return {"level": LEVELS.get(worst, "error"), "what": f"in this sea: {said}"}
