"""Excite: the test that tells most of what is still uncertain, flown in parts, planned anew after each."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from rovtwin.commission.dossier import Dossier
from rovtwin.commission.evidence.estimated import estimated, written
from rovtwin.commission.evidence.forces import Quantity, damping_forces, pushed, up_to_scale
from rovtwin.commission.evidence.logs import Flown, logs_of, read_logs
from rovtwin.commission.evidence.room import PLACE, from_the_middle, in_tank, outside
from rovtwin.commission.stage import Check, Outcome
from rovtwin.commission.work import Work
from rovtwin.core.errors import ConfigError, IdentificationError
from rovtwin.identification.identify import Identification
from rovtwin.live.connect import on_this_machine
from rovtwin.live.flight import fly_live
from rovtwin.live.manoeuvres import Cue
from rovtwin.live.readiness import Readiness
from rovtwin.planning.experiments import plan_tests
from rovtwin.planning.known import BOLLARD
from rovtwin.planning.plan import Plan
from rovtwin.runs.flight import Flight
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import load_vehicle

PART = 4.0  # of a part [min]: long enough to tell something, short enough to learn from before the next
TO_THE_MIDDLE = 0.3  # of a part, on which it is planned for less [min]
SHORTEST = 1.0  # left over, below which no part is begun [min]
ENDED_EARLY = 4  # parts that may end early before the stage stops
CAUTION = 1.5  # by which the room to walls and to the attitude limit grows after each of them
MOST_CAUTION = 3  # of them, after which it grows no more: no plan would fit
GRAVE = ("leak", "battery critical", "battery low", "operator", "not a number", "interrupted", "link lost")
SO_FAR = "so_far.yaml"


def run(work: Work) -> Outcome:
    """Fly parts until damping is known as well as was asked for, or the minutes are used up."""
    return _Excitation(work).run()


@dataclass(eq=False)
class _Excitation:
    """One attempt at the stage.

    Attributes:
        work: What it works with.
        seconds: Flown in this attempt.
        early: Parts of it that ended early.
        before: Those of earlier attempts.
    """

    work: Work
    seconds: float = 0.0
    early: int = 0

    def __post_init__(self) -> None:
        self.checks: list[Check] = []
        self.before = _ended_early(self.work.dossier)
        self.anchors = list(self.work.dossier.measured("scale").get("anchors", []))
        self.hands = _hands(self.work)

    def run(self) -> Outcome:
        """See the module."""
        work, flown, found = self.work, self._flown(), None
        if flown.records:
            minutes = f"{flown.minutes:.1f} min of earlier attempts are used"
            self.checks.append(Check("note", "earlier parts", f"{minutes}, not flown again"))
        while True:
            if any(check.verdict == "stop" for check in flown.checks):
                break
            if flown.records:
                found = estimated(work, flown.records, self.anchors)
                written(work, found, SO_FAR)
            end = self._reason_to_end(flown, found)
            if end is not None:
                self.checks.append(end)
                break
            stop, before = self._part(flown, found), flown.minutes
            flown = self._flown()
            if stop is None and flown.minutes <= before:
                stop = Check("stop", "parts", "the last one left no log that can be used", "See why, then repeat it.")
            if stop is not None:
                self.checks.append(stop)
                break
        return self._page(flown, found)

    def _flown(self) -> Flown:
        return read_logs(self.work.vehicle, logs_of(self.work.dossier), self.work.folder)

    def _reason_to_end(self, flown: Flown, found: Identification | None) -> Check | None:
        request = self.work.request
        rows = [] if found is None else intervals(found, self.anchors)
        axes = pushed(self.work.vehicle.model())
        wide = too_wide(rows, axes, request.interval)
        if found is not None and not wide and not found.doubts:
            scale = "" if self.anchors else ", but for the common scale of all forces, which no motion tells"
            text = f"known to {_percent(request.interval)} or better in {', '.join(axes)}, as asked for{scale}"
            return Check("ok", "damping", text)
        if request.minutes - flown.minutes >= SHORTEST:
            return None
        text = f"{flown.minutes:.1f} of {request.minutes:g} min are flown, and {_in_words(wide, rows)}"
        if self.anchors and found is not None and not found.doubts and limited_by_scale(rows, wide, request.interval):
            text += "; the scale of all forces alone makes it as wide, which no more minutes tell"
            more = "Pull again on a scale with finer marks: --stage scale; or accept it: --interval."
            return Check("warning", "damping", f"{text}.", more)
        if found is not None and found.doubts:
            text += f"; the estimate is in doubt: {'; '.join(found.doubts)}"
        more = f"--minutes {request.minutes + 2 * PART:g} goes on from here; or accept it: --interval."
        return Check("warning", "damping", f"{text}.", more)

    @property
    def caution(self) -> float:
        """How much more room the next part has than the first one had."""
        return CAUTION ** min(self.before + self.early, MOST_CAUTION)

    def _part(self, flown: Flown, found: Identification | None) -> Check | None:
        """Plan and fly one; a reason to stop, None where the next may come."""
        work = self.work
        left = work.request.minutes - flown.minutes
        minutes, number = left / max(1, round(left / PART)), len(logs_of(work.dossier)) + 1
        try:
            plan = self._plan(minutes - TO_THE_MIDDLE, number, found)
        except IdentificationError as error:
            return Check("stop" if not flown.records else "warning", "plan", str(error), "Give more --minutes.")
        except ConfigError as error:
            more = f" It was to have {self.caution:.2g} times as much room." if self.caution > 1.0 else ""
            return Check("stop", "plan", f"{error}.{more}", "A larger --tank, or the dip again: --stage dip.")
        return self._fly(plan, number)

    def _plan(self, minutes: float, number: int, found: Identification | None) -> Plan:
        work = self.work
        reference, bollard = known_before(work, found, bool(self.anchors))
        return plan_tests(
            load_vehicle(reference),
            reference,
            minutes,
            work.request.room,
            bollard,
            work.request.seed + number,
            lambda what, share: work.person.progress(f"planning part {number}: {what}", share),
            by_hand=self.hands,
            positions=work.positions() or {},  # where a part measures them: room for a fence all the same
            caution=self.caution,
        )

    def _fly(self, plan: Plan, number: int) -> Check | None:
        scenario = in_tank(self.work, plan)
        asked = _question(plan, number)
        return from_the_middle(
            self.work, f"part-{number}", lambda name: self._flown_from_here(scenario, asked, number, name)
        )

    def _flown_from_here(self, scenario: Scenario, asked: str, number: int, name: str) -> Check | None:
        work, folder, seconds = self.work, self.work.folder / name, scenario.duration
        refused: list[Check] = []

        def arm(readiness: Readiness) -> bool:
            if text := outside(scenario, readiness.start.position):
                refused.append(Check("stop", "place", text, PLACE))
                return False
            if not work.may_move(asked):
                refused.append(
                    Check("stop", f"part {number}", "not confirmed: nothing was flown", "Repeat this stage.")
                )
                return False
            return True

        # A twin is the vehicle as it was described, whatever has been identified of it since.
        twin = scenario.model_copy(update={"vehicle": work.request.vehicle})
        with work.connected(twin) as there:
            flight = fly_live(
                scenario,
                there.link,
                there.sources,
                there.clock,
                folder,
                arm=arm,
                progress=lambda t, phase: work.person.progress(f"part {number}: {phase}", min(t / seconds, 1.0)),
                say=work.person.progress,
                tell=lambda cue: _tell(work, cue),
                warn=lambda line: work.person.say(f"part {number}: {line}"),
            )
        work.at_rest()
        return refused[0] if refused else self._judged(flight, number)

    def _judged(self, flight: Flight, number: int) -> Check | None:
        """What became of a part; a reason to stop, None where the next may come."""
        summary, what = flight.figures, f"part {number}"
        flown = float(summary.get("duration_s") or 0.0)
        self.seconds += flown
        if summary["completed"]:
            self.checks.append(Check("ok", what, f"flown as planned, {flown:.0f} s"))
            return None
        reason = str(summary["reason"])
        text = f"ended early, after {flown:.0f} s: {reason}; what was flown is used where it can be"
        if any(reason.startswith(word) for word in GRAVE):
            return Check("stop", what, text, "See to it, then repeat this stage: it goes on with what is flown.")
        self.early += 1
        more = f"The next one has {self.caution:.2g} times as much room to walls and to the attitude limit."
        self.checks.append(Check("warning", what, f"{text}.", more if self.early < ENDED_EARLY else ""))
        if self.early < ENDED_EARLY:
            return None
        fix = "Watch the next one from the side; a larger --tank, or the dip again: --stage dip."
        return Check("stop", "parts", f"{self.early} parts ended early", fix)

    def _page(self, flown: Flown, found: Identification | None) -> Outcome:
        work, rows = self.work, [] if found is None else intervals(found, self.anchors)
        axes = pushed(work.vehicle.model())
        for row in rows:
            turns = "" if row["axis"] in axes else "; known from turns: no thruster pushes there"
            self.checks.append(Check("note", f"damping in {row['axis']}", _row_in_words(row) + turns))
        if not flown.records:
            self.checks.append(Check("stop", "parts", "nothing was flown that can be used", "Repeat this stage."))
        measured = {
            "logs": [os.path.relpath(log, work.folder) for log in flown.logs],
            "minutes": flown.minutes,
            "intervals": rows,
            "ended_early": self.early,
        }
        files = [str(log.relative_to(work.folder)) for log in flown.logs if work.folder in log.parents]
        if found is not None:
            measured["vehicle_file"] = SO_FAR
            files.append(SO_FAR)
        return Outcome(tuple(_once([*self.checks, *flown.checks])), measured, tuple(files), self.seconds)


def _ended_early(dossier: Dossier) -> int:
    """Parts that ended early in attempts that are over, of the vehicle as it is described now."""
    now = dossier.request.fingerprint()
    own = [one.outcome for one in dossier.attempts("excite") if one.fingerprint == now and one.outcome is not None]
    return sum(int(outcome.measured.get("ended_early", 0)) for outcome in own)


def known_before(work: Work, found: Identification | None, pulled: bool) -> tuple[str, float | None]:
    """File or name of the vehicle that a part is planned for, and how well full thrust is known beside it."""
    if found is not None and not found.doubts:
        return str(work.folder / SO_FAR), None
    if work.request.prior is not None:
        predicted = estimated(work, (), ())
        return str(written(work, predicted, "predicted.yaml")), None
    identified = work.vehicle.file.identified is not None
    return work.request.vehicle, BOLLARD if pulled and not identified else None


def intervals(found: Identification, anchors: list[Any]) -> list[dict[str, Any]]:
    """A row for each damping force: its half-width as a share, and without the common scale of all forces.

    Without a pull the latter is what excitation can make small.
    """
    without = up_to_scale(found)

    def row(one: Quantity) -> dict[str, Any]:
        whole, rest = one.share(found.covariance), one.share(without)
        data = {"axis": one.axis, "speed": one.at, "force": one.value, "unit": one.unit}
        return data | {"half_width_share": whole, "up_to_scale_share": rest, "judged_share": whole if anchors else rest}

    return [row(one) for one in damping_forces(found)]


def too_wide(rows: list[dict[str, Any]], axes: list[str], interval: float) -> list[str]:
    """Axes whose damping is not known as well as was asked for, or was not tested."""
    worst = {axis: max((r["judged_share"] for r in rows if r["axis"] == axis), default=np.inf) for axis in axes}
    return [axis for axis, share in worst.items() if share > interval]


def limited_by_scale(rows: list[dict[str, Any]], wide: list[str], interval: float) -> bool:
    """Whether every axis that is known too poorly would be so if its motion were known exactly: for want of scale."""

    def scale(row: dict[str, Any]) -> float:
        return float(np.sqrt(max(row["half_width_share"] ** 2 - row["up_to_scale_share"] ** 2, 0.0)))

    own = [[row for row in rows if row["axis"] == axis and row["judged_share"] > interval] for axis in wide]
    return bool(own) and all(some and all(scale(row) > interval for row in some) for some in own)


def _in_words(wide: list[str], rows: list[dict[str, Any]]) -> str:
    worst = {r["axis"]: max(x["judged_share"] for x in rows if x["axis"] == r["axis"]) for r in rows}
    known = [f"{axis} to {_percent(worst[axis])}" if axis in worst else f"{axis} not at all" for axis in wide]
    return f"damping is known only in {', '.join(known)}" if known else "damping is known as well as was asked for"


def _row_in_words(row: dict[str, Any]) -> str:
    speed = f"{abs(row['force']):.3g} {row['unit']} at {row['speed']:+.2g} {'m/s' if row['unit'] == 'N' else 'rad/s'}"
    widths = f"known to {_percent(row['half_width_share'])}"
    return f"{speed}, {widths}; with the scale of all forces known {_percent(row['up_to_scale_share'])}"


def _hands(work: Work) -> bool:
    """Whether somebody tilts the vehicle: nobody does of a twin."""
    if on_this_machine(work.request.link):
        return False
    return work.person.confirm(
        "Can somebody at the water tilt the vehicle by hand when asked to, and let go? Thrusters are off then"
    )


def _question(plan: Plan, number: int) -> str:
    minutes = float(plan.expected.minutes[-1])
    return (
        f"Part {number}: {len(plan.manoeuvres)} manoeuvres, {minutes:.1f} min; by the twin the hull stays "
        f"{plan.room:.2f} m off walls, floor and surface. Is it in the middle, and may thrusters turn?"
    )


def _tell(work: Work, cue: Cue) -> None:
    if cue.hand:
        work.person.say(cue.text)


def _percent(share: float) -> str:
    return f"±{100 * share:.2g} %"


def _once(checks: list[Check]) -> Iterator[Check]:
    """Each line once: logs are looked over after each part."""
    yield from dict.fromkeys(checks)
