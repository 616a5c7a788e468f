"""The stage: push, and let STOP, silence and a cut line end it; say how long the vehicle took to come to rest."""

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from rovtwin.commission.drill.again import look_again, require_turn
from rovtwin.commission.drill.exercises import CUT, PUSH, REST, SILENT, STOP, Exercise, Push, flown, push_of
from rovtwin.commission.drill.off_time import OffTime, off_time
from rovtwin.commission.stage import Check, Outcome
from rovtwin.commission.work import Work
from rovtwin.core.errors import ConfigError, IdentificationError, LinkError
from rovtwin.identification.logs.readers import read_records
from rovtwin.live.connect import may_be_watched, on_this_machine
from rovtwin.live.pulses import Pulsed
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.constants import AXES

BY_HAND = "Pull its plug while it turns slowly, and count: note the time on the certificate."


def run(work: Work) -> Outcome:
    """Fly the exercises, one after the other, and look when thrusters went off."""
    scenario = work.scenario({}, vehicle=work.request.vehicle)
    vehicle = vehicle_of(scenario)
    exercises = (STOP, SILENT, CUT)
    seconds = sum(REST + PUSH + exercise.watched for exercise in exercises)
    question = (
        f"The vehicle is pushed three times for {PUSH:g} s, within about a minute. Then come STOP, silence, and a cut "
        "line, and its thrusters must rest by themselves. Is it in the middle of the tank below the surface, tether "
        "slack, and are all hands away?"
    )
    if not work.may_move(question):
        return Outcome((Check("stop", "drill", "it was not confirmed.", "Repeat this stage."),))
    checks: list[Check] = []
    rows: list[dict[str, Any]] = []
    files: list[str] = []
    for exercise in exercises:
        work.person.say(f"Drill: {exercise.words}.")
        push = push_of(vehicle.model(), exercise)
        if push is None:
            checks.append(Check("warning", exercise.name, "no push moves it that the tank has room for.", BY_HAND))
            continue
        found, row = _one(work, scenario, vehicle, exercise, push)
        checks += found
        rows += [row] if row else []
        log = f"{exercise.name}/log.mcap"
        files += [log] if (work.folder / log).exists() else []
        if any(check.verdict == "stop" for check in found):
            break  # what does not stop is not pushed once more
    return Outcome(tuple(checks), {"thrusters_off": rows}, tuple(files), seconds)


def _one(
    work: Work, scenario: Scenario, vehicle: Vehicle, exercise: Exercise, push: Push
) -> tuple[list[Check], dict[str, Any]]:
    """Lines about one exercise, and its figures."""
    blind = exercise is CUT and not may_be_watched(work.request.link)
    try:
        if blind:
            require_turn(push)
        pulsed = flown(work, scenario, exercise, push, vehicle.model())
        if blind and pulsed.ended.startswith("link lost") and len(pulsed.spans) == 3:
            return _seen_again(work, scenario, pulsed, push)
    except ConfigError as error:
        known = on_this_machine(work.request.link)
        return [
            Check("note" if known else "warning", exercise.name, f"not tried: {error}.", "" if known else BY_HAND)
        ], {}
    except LinkError as error:
        return [Check("stop", exercise.name, f"{error}.", "Then repeat this stage.")], {}
    if pulsed.ended or len(pulsed.spans) < 3:
        return [Check("stop", exercise.name, f"ended early: {pulsed.ended}.", "Put it right, then repeat.")], {}
    try:
        found = _felt(work, vehicle, pulsed, push)
    except IdentificationError as error:
        return [Check("stop", exercise.name, f"{error}.", "Repeat this stage.")], {}
    row = {} if found is None else _row(exercise, push, found)
    checks = list(_judged(exercise, push, found))
    if found is not None and found.lasted:
        checks.append(_halted(work, scenario))
    return checks, row


def _seen_again(work: Work, scenario: Scenario, pulsed: Pulsed, push: Push) -> tuple[list[Check], dict[str, Any]]:
    """The same of a line that was cut while nobody watched."""
    found = look_again(work, scenario, pulsed, push, time.monotonic())
    before, after = np.degrees([found.before, found.after])
    text = (
        f"{found.within:.1f} s after the cut it turned by {after:.1f} deg/s over a new line, at the cut by {before:.1f}"
    )
    if not found.off:
        text = f"{text}: thrusters may still be on, expected off within {CUT.within:.1f} s."
        return [Check("stop", CUT.name, text, CUT.culprit), _halted(work, scenario)], {}
    row = {"event": CUT.words, "axis": push.axis, "seconds": None, "interval_95": [0.0, found.within]}
    return [Check("ok", CUT.name, f"{text}: thrusters are off")], row | {"within_s": CUT.within}


def _halted(work: Work, scenario: Scenario) -> Check:
    """A vehicle that nothing stopped, stopped over a new line."""
    try:
        with work.connected(scenario) as there:
            there.link.arm()
            there.link.stop()
    except LinkError as error:
        return Check("stop", "vehicle", f"it could not be stopped over a new line ({error}).", "Switch it off NOW.")
    return Check("note", "vehicle", "stopped over a new line")


def _felt(work: Work, vehicle: Vehicle, pulsed: Pulsed, push: Push) -> OffTime | None:
    record = read_records(pulsed.log, vehicle)[0]
    (began, event, _), end = pulsed.spans[1], pulsed.spans[2][1]
    lag = float(work.dossier.measured("dip").get("lag_s", 0.0))
    return off_time(vehicle.model(), record, AXES.index(push.axis), push.u, began, event, end, lag)


def _row(exercise: Exercise, push: Push, found: OffTime) -> dict[str, Any]:
    return {
        "event": exercise.words,
        "axis": push.axis,
        "seconds": found.seconds,
        "interval_95": [found.low, found.high],
        "within_s": exercise.within,
        "command": float(np.abs(push.u).max()),
    }


def _judged(exercise: Exercise, push: Push, found: OffTime | None) -> Iterator[Check]:
    if found is None:
        text = f"the push in {push.axis} ({np.abs(push.u).max():.0%}) was not felt, so nobody knows when it ended."
        yield Check("warning", exercise.name, text, BY_HAND)
        return
    if found.lasted:
        text = f"thrusters were still on after {found.high:.1f} s, expected off within {exercise.within:.1f} s."
        yield Check("stop", exercise.name, text, exercise.culprit)
        return
    text = f"thrusters off after {found.seconds:.2f} s ({found.low:.2f} to {found.high:.2f} s)"
    if found.low > exercise.within:
        yield Check("stop", exercise.name, f"{text}, expected within {exercise.within:.1f} s.", exercise.culprit)
    elif found.high > exercise.within:
        yield Check("warning", exercise.name, f"{text}, expected within {exercise.within:.1f} s.", "Repeat this stage.")
    else:
        yield Check("ok", exercise.name, f"{text}, expected within {exercise.within:.1f} s")
