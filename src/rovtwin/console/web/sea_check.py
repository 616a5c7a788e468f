"""Whether vehicle and sea allow a plan: what it cannot do of it, and what `rovtwin sea` says of its places."""

import asyncio
from collections.abc import Callable
from typing import Any

from rovtwin.console.planning import waypoint_of
from rovtwin.console.worker import Worker
from rovtwin.core.errors import RovtwinError
from rovtwin.runs.compose.composition import compose, vehicle_of
from rovtwin.runs.compose.sensors import sensors_of
from rovtwin.runs.feasibility.mission import judge
from rovtwin.runs.feasibility.sea import moves, verdict
from rovtwin.scenario.schema import MissionSection, Scenario, Waypoint

QUIET = 1.0  # a plan that is being changed is not judged yet [s]
LEVELS = {"holds": "ok", "swept": "warning", "turns": "warning"}

Check = dict[str, str]


class SeaCheck:
    """Judges the newest plan, by what the vehicle can do, in the scenario's current and waves."""

    def __init__(self, scenario: Scenario, worker: Worker):
        self._scenario, self._worker = scenario, worker
        self._newest: tuple[list[dict[str, Any]], Callable[[Check], None]] | None = None
        self._task: asyncio.Task[None] | None = None

    def ask(self, rows: list[dict[str, Any]], tell: Callable[[Check], None]) -> None:
        """Judge these rows of a plan, and no longer the ones before; `tell` is called when it is known."""
        self._newest = (rows, tell) if rows and not self._scenario.test else None
        if self._newest is not None and (self._task is None or self._task.done()):
            self._task = asyncio.create_task(self._judge())

    async def _judge(self) -> None:
        """Until the newest plan is judged. One that became old meanwhile is judged to its end, without a message."""
        while (asked := self._newest) is not None:
            rows, tell = asked
            await asyncio.sleep(QUIET)
            if self._newest is not asked:
                continue
            try:
                found = await self._worker.call(_verdict, self._scenario, rows)
            except RovtwinError as error:
                found = {"level": "error", "what": str(error)}
            if self._newest is asked:
                self._newest = None
                tell(found)


def _verdict(scenario: Scenario, rows: list[dict[str, Any]]) -> Check:
    """In the worker's process."""
    waypoints = [Waypoint.model_validate(waypoint_of(row)) for row in rows]
    scenario = scenario.model_copy(update={"mission": MissionSection(waypoints=waypoints)})
    try:
        vehicle = vehicle_of(scenario)
        found = judge(scenario, vehicle.model(), sensors=sensors_of(scenario, vehicle))
        worst, why = verdict(compose(scenario)) if moves(scenario) else ("holds", "")
    except RovtwinError as error:
        return {"level": "error", "what": f"in this sea: {error}"}
    lines = [finding.line for finding in found] + ([f"in this sea: {why}"] if why else [])
    if not lines:
        return {"level": "ok", "what": "nothing in it is beyond the vehicle"}
    level = "error" if any(finding.refused for finding in found) else LEVELS.get(worst, "error")
    return {"level": "warning" if found and level == "ok" else level, "what": ". ".join(lines)}
