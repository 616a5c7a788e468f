"""What browsers do to the plan on the table, and what there is to say of it before it is submitted."""

import asyncio
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from rovtwin.console.chart.files import imported
from rovtwin.console.planning import MOST, PLACES, square, waypoint_of
from rovtwin.console.surveys import SurveyArea, rows_over
from rovtwin.console.web.sea_check import SeaCheck
from rovtwin.console.worker import Worker
from rovtwin.core.errors import ConfigError, LinkError
from rovtwin.core.user_files.files import MOST_UPLOAD
from rovtwin.core.user_files.quantity import is_finite
from rovtwin.planning.exchange.missions import NO_DATUM
from rovtwin.scenario.schema.datum import require_near

if TYPE_CHECKING:
    from rovtwin.console.web.hub import Hub

ON_MAP = ("latitude", "longitude")
COLUMNS = ("x", "y", "depth", "speed", "acceptance", "hold_time", "heading_deg", "altitude")
LOOKS = 0.2  # from one look at the draft to the next: each costs the server some 20 ms, if the plan is long [s]
BEYOND = 1e6  # all that is asked for, in metres


class Drafting:
    """Operations on a hub's draft. Files are read and surveys are laid out by a worker: see there.

    Attributes:
        checks: What there is to say of the draft: `level` is ok, warning or error.
        refusals: Those of the autopilot for which it would not take it.
    """

    def __init__(self, hub: "Hub", worker: Worker, sea: SeaCheck):
        self._hub, self._worker, self._sea = hub, worker, sea
        self.checks: list[dict[str, str]] = []
        self.refusals: list[dict[str, str]] = []
        self._one_at_a_time = asyncio.Lock()
        self._look: asyncio.Task[None] | None = None  # that waits to begin
        self._resting = -math.inf  # until when none is taken [s, of the event loop]

    async def do(self, what: dict[str, Any]) -> str:
        """One operation, `op`, with its arguments; what there is to say of it.

        Raises:
            RovtwinError: It cannot be done; the text says why.
        """
        operation = getattr(self, f"_{what.get('op')}", None)
        if operation is None or what.get("op") not in OPERATIONS:
            raise ConfigError(f"plan: found the operation {what.get('op')!r}, expected one of {', '.join(OPERATIONS)}")
        message = await operation(what)
        await self.look()
        return message or ""

    async def look(self) -> None:
        """Check the draft, and tell all. However fast changes come, one look is taken at a time, and one waits."""
        if self._look is None:
            self._look = asyncio.create_task(self._look_in_turn())
        await asyncio.shield(self._look)  # others wait for it, too

    async def _look_in_turn(self) -> None:
        async with self._one_at_a_time:
            await asyncio.sleep(self._resting - asyncio.get_running_loop().time())
            self._look = None  # what is changed from here on has to be looked at again
            await self._check()
            self._hub.tell_plan()
            self._resting = asyncio.get_running_loop().time() + LOOKS

    async def _add(self, what: dict[str, Any]) -> None:
        self._hub.draft.add(self._columns(what))

    async def _insert(self, what: dict[str, Any]) -> None:
        self._hub.draft.insert(_number(what, "i"), self._columns(what))

    async def _edit(self, what: dict[str, Any]) -> None:
        self._hub.draft.edit(i := _number(what, "i"), self._columns(what, i))

    _move = _edit

    def _columns(self, what: dict[str, Any], i: int | None = None) -> dict[str, Any]:
        """Columns of a row; a place on the map in metres. What that leaves out is as in row `i`."""
        columns = {key: what[key] for key in COLUMNS if key in what}
        if not any(key in what for key in ON_MAP):
            return columns
        if (datum := self._hub.datum) is None:
            raise ConfigError(NO_DATUM)
        rows = self._hub.draft.rows
        row = rows[i] if i is not None and i < len(rows) else {}
        known = [float(v) for v in datum.geodetic([row["x"], row["y"], row["depth"]])[:2]] if row else [None, None]
        latitude, longitude = (what.get(key, value) for key, value in zip(ON_MAP, known, strict=True))
        depth = columns.get("depth", row.get("depth", 0.0))
        if not (is_finite(latitude) and is_finite(longitude) and is_finite(depth)):
            raise ConfigError(f"plan: found {latitude!r:.40}, {longitude!r:.40}, expected latitude and longitude [deg]")
        try:
            require_near(datum, [latitude, longitude, depth], "plan")
        except ValueError as error:
            raise ConfigError(str(error)) from None
        x, y, _ = datum.position(latitude, longitude, depth)
        return columns | {"x": round(float(x), PLACES), "y": round(float(y), PLACES)}

    async def _delete(self, what: dict[str, Any]) -> None:
        self._hub.draft.delete(_number(what, "i"))

    async def _cancel_last(self, what: dict[str, Any]) -> None:
        self._hub.draft.cancel_last()

    async def _reorder(self, what: dict[str, Any]) -> None:
        self._hub.draft.reorder(_number(what, "i"), _number(what, "to"))

    async def _undo(self, what: dict[str, Any]) -> None:
        self._hub.draft.undo()

    async def _redo(self, what: dict[str, Any]) -> None:
        self._hub.draft.redo()

    async def _clear(self, what: dict[str, Any]) -> None:
        self._hub.draft.clear()

    async def _import(self, what: dict[str, Any]) -> str:
        text, name = what.get("text"), what.get("name", "the file")
        if not isinstance(text, str) or not isinstance(name, str):
            raise ConfigError(f"the file: found {type(text).__name__}, expected text")
        if (size := len(text.encode(errors="replace"))) > MOST_UPLOAD:
            raise ConfigError(f"the file: found {size / 1e3:,.0f} kB, expected at most {MOST_UPLOAD / 1e3:g} kB")
        rows, notes = await self._worker.call(imported, text, name[:80], self._hub.datum)
        self._hub.draft.load(rows)
        return ". ".join(notes)

    async def _template(self, what: dict[str, Any]) -> None:
        depth, speed = _value(what, "depth", 1.0), _value(what, "speed", self._hub.draft.own["speed"])
        surveyed = None
        if what.get("name") == "square":
            x, y = (float(v) for v in self._hub.client.last.get("state", {}).get("eta", (0.0, 0.0))[:2])
            side = _value(what, "side", 4.0)
            rows = square(_value(what, "x", x), _value(what, "y", y), side, depth, speed)
        elif what.get("name") == "lawnmower":
            area, spacing = what.get("area"), _value(what, "spacing", 1.0)
            speed = min(speed, self._hub.line_speed) if "speed" not in what else speed
            if not isinstance(inside := what.get("inside", False), bool):
                raise ConfigError(f"template.inside: found {inside!r}, expected true or false")
            surveyed = SurveyArea(_corners(area, spacing), depth, speed, inside)
            rows = await self._worker.call(_lawnmower, surveyed, spacing, self._hub.vehicle)
        else:
            raise ConfigError(f"template: found {what.get('name')!r}, expected square or lawnmower")
        self._hub.draft.load(rows, surveyed)

    async def _submit(self, what: dict[str, Any]) -> None:
        if not self._hub.draft.rows:
            raise ConfigError("the plan is empty: add way-points first")
        area = self._hub.draft.area
        await self._hub.client.ask("submit", waypoints=[waypoint_of(row) for row in self._hub.draft.rows])
        self._hub.submitted_area = area

    async def _check(self) -> None:
        """Ask the engine what it thinks of the draft."""
        rows = self._hub.draft.rows
        if not rows:
            self.checks = self.refusals = []
            self._sea.ask([], self._add_check)
            return
        try:
            found = await self._hub.client.ask("check", waypoints=[waypoint_of(row) for row in rows])
            self.checks = found.get("checks", [])
        except LinkError as error:
            self.checks = [{"level": "error", "what": str(error)}]
        self.refusals = [one for one in self.checks if one["level"] == "error"]
        self._sea.ask(rows, self._add_check)

    def _add_check(self, check: dict[str, str]) -> None:
        self.checks = [*self.checks, check]
        self._hub.tell_plan()


OPERATIONS = (
    *("add", "insert", "edit", "move", "delete", "cancel_last", "reorder", "undo", "redo", "clear", "import"),
    *("template", "submit"),
)


def _number(what: dict[str, Any], key: str) -> int:
    found = what.get(key)
    if not isinstance(found, int) or isinstance(found, bool) or found < 0:
        raise ConfigError(f"plan.{key}: found {found!r}, expected the number of a way-point")
    return found


def _value(what: dict[str, Any], key: str, default: float) -> float:
    found = what.get(key, default)
    if not isinstance(found, int | float) or isinstance(found, bool) or not abs(found) < BEYOND:
        raise ConfigError(f"template.{key}: found {found!r}, expected a number")
    return float(found)


def _corners(area: Any, spacing: float) -> tuple[tuple[float, float], ...]:
    """Corners of an area that a page gives, for lines so far apart [m]."""
    if not isinstance(area, list) or len(area) < 3:
        raise ConfigError("lawn-mower: found no area, expected at least three corners [north, east]")
    try:
        corners = tuple((float(north), float(east)) for north, east in area)
        extent = float(np.ptp(np.array(corners), axis=0).max())
    except (TypeError, ValueError, OverflowError):
        raise ConfigError("lawn-mower: found an area of something else than corners [north, east]") from None
    if not 0.0 < extent <= 0.5 * MOST * spacing:
        raise ConfigError(
            f"lawn-mower: found lines {spacing:g} m apart over {extent:g} m, expected at most {MOST // 2} lines"
        )
    return corners


def _lawnmower(area: SurveyArea, spacing: float, vehicle: str | dict[str, Any]) -> list[dict[str, Any]]:
    """In the worker's process: way-points over an area; turns lie outside of it unless all is to stay inside."""
    from rovtwin.survey.room import Swath

    return rows_over(area, vehicle, Swath(spacing, 0.0))
