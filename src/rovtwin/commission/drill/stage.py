"""The stage: push, and let STOP, silence and a cut line end it; say how long the vehicle took to come to rest."""

from typing import Any

import numpy as np

from rovtwin.commission.drill.again import LATER, look_again, may_look_again
from rovtwin.commission.drill.exercises import CUT, PUSH, REST, SILENT, STOP, Exercise, Push, flown, halted, push_of
from rovtwin.commission.drill.off_time import OffTime, off_time
from rovtwin.commission.stage import Check, Outcome, sentence
from rovtwin.commission.work import Work
from rovtwin.core.errors import RovtwinError
from rovtwin.identification.logs.readers import read_records
from rovtwin.live.connect import is_computed, may_be_watched
from rovtwin.live.pulses import Pulsed
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.constants import AXES
from rovtwin.vehicle.physics.model import Model

BY_HAND = "Pull its plug while it turns slowly, and count: note the time on the certificate."
LOOK = "Press STOP while it turns slowly in the water, and look: without a STOP that works nothing more is flown."
NOW = "SWITCH THE VEHICLE OFF NOW."


def run(work: Work) -> Outcome:
    """Fly the exercises, one after the other, and look when thrusters went off."""
    scenario = work.scenario({}, vehicle=work.request.vehicle)
    vehicle, computed = vehicle_of(scenario), is_computed(work.request.link)
    blind = not (computed or may_be_watched(work.request.link))
    exercises = (STOP, SILENT) if computed else (STOP, SILENT, CUT)
    work.person.progress("foreseeing pushes")
    pushes = [push_of(vehicle.model(), one, LATER if blind and one is CUT else 0.0) for one in exercises]
    checks = [Check("note", CUT.name, "not tried: a computed vehicle hangs on no line")] if computed else []
    rows: list[dict[str, Any]] = []
    for exercise, push in zip(exercises, pushes, strict=True):
        work.person.say(f"Drill: {exercise.words}.")
        try:
            found, row = _one(work, scenario, vehicle, exercise, push)
        except RovtwinError as error:
            found, row = [Check("stop", exercise.name, sentence(error), "Then repeat this stage.")], {}
        checks += found
        rows += [row] if row else []
        if any(check.verdict == "stop" for check in found):
            break  # what does not stop is not pushed once more
    files = [f"{one.name}/log.mcap" for one in exercises if (work.folder / one.name / "log.mcap").exists()]
    seconds = sum(REST + PUSH + one.watched for one in exercises[: len(files)])
    return Outcome(tuple(checks), {"thrusters_off": rows}, tuple(files), seconds)


def _one(
    work: Work, scenario: Scenario, vehicle: Vehicle, exercise: Exercise, push: Push | None
) -> tuple[list[Check], dict[str, Any]]:
    """Lines about one exercise, and its figures."""
    blind = exercise is CUT and not may_be_watched(work.request.link)
    if push is None or (blind and not may_look_again(push)):
        return [_unproven(exercise, "no push moves it that the tank has room for and that its sensors show.")], {}
    if exercise is CUT:
        return _cut(work, scenario, vehicle, push, blind)
    pulsed = flown(work, scenario, exercise, push, vehicle.model())
    if pulsed.ended:
        return [
            Check("stop", exercise.name, sentence(f"ended early: {pulsed.ended}"), "Put it right, then repeat.")
        ], {}
    return _judged(exercise, push, _felt(work, vehicle.model(), vehicle, pulsed, push))


def _cut(
    work: Work, scenario: Scenario, vehicle: Vehicle, push: Push, blind: bool
) -> tuple[list[Check], dict[str, Any]]:
    """The same of a line that is cut: whatever happens, the vehicle is stopped over a new one before anything else."""
    looked, pulsed, why = None, None, ""
    cut_at: list[float] = []
    try:
        pulsed = flown(work, scenario, CUT, push, vehicle.model(), cut_at)
        ended = pulsed.ended
        if blind and cut_at and ended.startswith("link lost"):
            ended = ""
            looked = look_again(work, scenario, pulsed, push, cut_at[0])
    except RovtwinError as error:
        ended = str(error)
    finally:
        if cut_at:
            why = halted(work, scenario)
    if pulsed is None or not cut_at:
        return [Check("stop", CUT.name, sentence(f"ended early: {ended}"), "Put it right, then repeat.")], {}
    if why:
        text = sentence(f"it could not be stopped over a new line: {why}")
        return [Check("stop", "vehicle", text, f"If a thruster turns: {NOW} Then repeat this stage.")], {}
    stopped = Check("ok", "new line", "after the cut a new line takes over, and stops it")
    if ended:
        return [Check("stop", CUT.name, sentence(f"ended early: {ended}"), "Put it right, then repeat."), stopped], {}
    if looked is not None:
        return _seen_again(looked, push, stopped)
    checks, row = _judged(CUT, push, _felt(work, vehicle.model(), vehicle, pulsed, push))
    return [*checks, stopped], row


def _seen_again(found: Any, push: Push, stopped: Check) -> tuple[list[Check], dict[str, Any]]:
    before, after = np.degrees([found.before, found.after])
    text = f"{found.within:.1f} s after the cut it turned by {after:.1f} deg/s, at the cut by {before:.1f}"
    if not found.felt:
        return [_unproven(CUT, f"the push in {push.axis} was not felt."), stopped], {}
    if not found.off:
        text = f"{text}: its thrusters were on, expected off within {CUT.within:.1f} s."
        return [Check("stop", CUT.name, text, CUT.culprit), stopped], {}
    row = {"event": CUT.words, "axis": push.axis, "seconds": None, "at_most_s": found.within, "within_s": CUT.within}
    return [Check("ok", CUT.name, f"{text}: thrusters were off by then"), stopped], row


def _felt(work: Work, model: Model, vehicle: Vehicle, pulsed: Pulsed, push: Push) -> OffTime | str | None:
    """When thrusters went off; None: the push was not felt; words: readings cannot be used."""
    (began, event, _), end = pulsed.spans[1], pulsed.spans[2][1]
    lag = float(work.dossier.measured("dip").get("lag_s", 0.0))
    try:
        record = read_records(pulsed.log, vehicle)[0]
        return off_time(model, record, AXES.index(push.axis), push.u, began, event, end, lag)
    except RovtwinError as error:
        return str(error)


def _unproven(exercise: Exercise, text: str) -> Check:
    """A STOP that nobody has seen to work ends the commissioning; the others are for a person to try."""
    return Check("stop", STOP.name, text, LOOK) if exercise is STOP else Check("warning", exercise.name, text, BY_HAND)


def _judged(exercise: Exercise, push: Push, found: OffTime | str | None) -> tuple[list[Check], dict[str, Any]]:
    if isinstance(found, str):
        return [Check("stop", exercise.name, f"{found}.", "Repeat this stage.")], {}
    if found is None:
        size = f"{np.abs(push.u).max():.0%}"
        return [_unproven(exercise, f"the push in {push.axis} ({size}) was not felt: nobody knows when it ended.")], {}
    row = {
        "event": exercise.words,
        "axis": push.axis,
        "seconds": found.seconds,
        "interval_95": [found.low, found.high],
        "within_s": exercise.within,
        "command": float(np.abs(push.u).max()),
    }
    limit = f"expected within {exercise.within:.1f} s"
    text = f"thrusters off after {found.seconds:.2f} s ({found.low:.2f} to {found.high:.2f} s)"
    if found.lasted:
        text, fix = f"thrusters were still on after {found.high:.1f} s, {limit}.", exercise.culprit
        return [Check("stop", exercise.name, text, f"If they turn now: {NOW} {fix}")], row
    if found.low > exercise.within:
        return [Check("stop", exercise.name, f"{text}, {limit}.", exercise.culprit)], row
    if found.high > exercise.within:
        return [Check("warning", exercise.name, f"{text}, {limit}.", "Repeat this stage.")], row
    return [Check("ok", exercise.name, f"{text}, {limit}")], row
