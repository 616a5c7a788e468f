"""The stage: push each thruster in turn, and say what is not as the file has it."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from rovtwin.commission.dip.balance import balance
from rovtwin.commission.dip.consistency import compared
from rovtwin.commission.dip.correction import corrected
from rovtwin.commission.dip.diagnosis import Diagnosis, Verdict, diagnose
from rovtwin.commission.dip.schedule import pulses
from rovtwin.commission.stage import Check, Outcome, sentence
from rovtwin.commission.work import Work
from rovtwin.core.errors import IdentificationError
from rovtwin.core.log import Log
from rovtwin.identification.checks.check import check_record
from rovtwin.identification.logs.readers import read_records
from rovtwin.live.pulses import Guard, Pulsed, fly_pulses
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.vehicle import Vehicle

CORRECTED = "corrected.yaml"
LATE = 0.25  # of the whole answer, beyond the lag of the thrusters [s]
WHOLE = "Mend it before the tests: what is estimated takes it that whole commands arrive."
FIX = {
    "reversed": "Turn its sign in the vehicle's set-up, or use the corrected file.",
    "dead": "Look for weed, a loose wire, a dead controller.",
    "weak": "Look for weed and damage; a motor or controller may be of another kind.",
    "strong": "Check its type and curve in the file.",
    "swapped": "Swap the wires (or outputs), or use the corrected file.",
    "rotated": "Mount it as the file says, or use the corrected file.",
    "unseen": "Check that it turns at all; add a sensor that tells the motion it makes.",
}


def run(work: Work) -> Outcome:
    """Push each thruster in turn and compare."""
    scenario = work.scenario({}, vehicle=work.request.vehicle)
    vehicle, depth = vehicle_of(scenario), work.request.room.depth
    planned = pulses(vehicle.model(), vehicle.thruster_names, 0.5 * depth)
    seconds = sum(pulse.seconds for pulse in planned if pulse.down_to is None)
    question = (
        f"Thrusters turn one at a time for {seconds:.0f} s, at 5 to 80 % of their range, and push it down again where "
        "it floats. Is the vehicle in the middle of the tank below the surface, tether slack, and are all hands away?"
    )
    with work.connected(scenario) as there:
        flown = fly_pulses(
            scenario, there.link, there.sources, there.clock, work.folder, planned, Guard(deepest=depth + 0.1),
            lambda: work.may_move(question),
            lambda t, what: work.person.progress(what, min(t / seconds, 1.0)),
        )  # fmt: skip
        limits, reach = there.link.limits, there.link.reach
    work.at_rest()
    checks = [
        *_ended(flown, work.request.too_busy),
        *(Check("warning", "commands", f"{one}.", WHOLE) for one in limits),
        *([Check("stop", "reach", f"{reach:.0%} of full command arrives at most.", WHOLE)] if reach < 1.0 else []),
    ]
    if flown.ended:
        return Outcome((*checks, *_cut_short(flown, vehicle)), files=("log.mcap",))
    checks += _heading(work, flown)
    work.person.progress("comparing with the file")
    record = read_records(flown.log, vehicle)[0]
    balanced = list(balance(vehicle, record, depth))
    try:
        found = diagnose(vehicle.model(), record, vehicle.thruster_names, depth)
    except IdentificationError as error:
        return Outcome((*checks, *balanced, Check("stop", "pushes", sentence(error))), files=("log.mcap",))
    checks += [*_axes(found), *_thrusters(found.thrusters), *_lag(found), *compared(record), *balanced]
    named = any(check.verdict == "stop" for check in checks)
    checks += [] if named else _others(record, vehicle)
    files, measured = ["log.mcap"], _measured(found)
    if corrected(vehicle, found.thrusters, work.folder / CORRECTED):
        files.append(CORRECTED)
        measured["corrected_file"] = CORRECTED
        text = "thrusters as they were found stand in corrected.yaml, beside the log."
        checks.append(Check("note", "file", text, "Compare (`rovtwin vehicle diff`), then commission that file."))
    return Outcome(tuple(checks), measured, tuple(files), flown.spans[-1][1])


def _ended(flown: Pulsed, too_busy: str) -> Iterator[Check]:
    if flown.ended:
        fix = "Put it right, then repeat this stage."
        late = "silent" in flown.ended and too_busy
        yield Check("stop", "pushes", sentence(flown.ended), f"{too_busy} {fix}" if late else fix)


def _cut_short(flown: Pulsed, vehicle: Vehicle) -> Iterator[Check]:
    """What readings say of pushes that ended early: a tilt may be one of the sensor's units."""
    if not flown.readings:
        return
    try:
        found = _others(read_records(flown.log, vehicle)[0], vehicle)
    except IdentificationError:  # too short to tell
        return
    yield from (check for check in found if check.verdict == "stop")


def _heading(work: Work, flown: Pulsed) -> Iterator[Check]:
    """Which way the bow points: nothing on board can tell when the compass is off by a quarter turn."""
    log = Log.read(flown.log)
    if "sensor/attitude" not in log or not len(log["sensor/attitude"]):
        return
    psi = round(float(np.degrees(log["sensor/attitude"].values[0, 2]))) % 360
    names = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
    name = names[round(psi / 45) % 8]
    if not work.person.confirm(f"At the start its compass read {psi} deg: did the bow point {name}, within 30 deg?"):
        text = f"it read {psi} deg ({name}), and the bow did not point there."
        yield Check("stop", "compass", text, "Calibrate it away from steel; check how it is mounted, and declination.")


def _axes(found: Diagnosis) -> Iterator[Check]:
    for one in found.axes:
        text = f"{one.words}: pushes then fit with {one.after:.2f} in place of {one.before:.2f} (1: exactly)."
        yield Check("stop", one.sensor, text, "Check how it is mounted (`attitude_deg`), its frame and driver.")


def _thrusters(found: Sequence[Verdict]) -> Iterator[Check]:
    for one in found:
        share = f"{100 * one.gain:.0f} % of the force that the file says, beside the others"
        text = {
            "ok": f"pushes as described, with {share}",
            "reversed": "pushes the other way.",
            "dead": f"does not push ({share}).",
            "weak": f"pushes with {share}.",
            "strong": f"pushes with {share}.",
            "swapped": f"moves the vehicle as {one.other} should, and the other way round: they are swapped.",
            "rotated": f"pushes along {_direction(one)}, not as the file says (likeness {one.alike:.2f}).",
            "unseen": "the motion that it makes is too small for the sensors on board to judge it.",
        }[one.what]
        verdict = "ok" if one.what == "ok" else "warning" if one.what in ("strong", "unseen") else "stop"
        yield Check(verdict, one.name, text, FIX.get(one.what, ""))


def _direction(one: Verdict) -> str:
    if one.direction is None:
        return "another direction"
    x, y, z = one.direction
    azimuth, elevation = np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(-z, np.hypot(x, y)))
    return f"azimuth {azimuth:.0f} deg, {elevation:.0f} deg upwards"


def _lag(found: Diagnosis) -> Iterator[Check]:
    if (lag := found.columns.lag) > LATE:
        text = f"the vehicle answers {lag:.1f} s later than its thrusters' lag explains."
        yield Check("stop", "clock", text, "Look for a slow link, or for a clock that is off (NTP).")


def _others(record: Any, vehicle: Vehicle) -> list[Check]:
    """What the checks of logs find besides; their notes about excitation are of no use here."""
    findings = check_record(record, vehicle.model(), vehicle.thruster_names)
    words = {"error": "stop", "warning": "warning"}
    return [
        Check(words[f.severity], f.where, f.message, f.fix)  # type: ignore[arg-type]  (of VERDICTS)
        for f in findings
        if f.severity in words and f.what not in ("clipped", "gap")
    ]


def _measured(found: Diagnosis) -> dict[str, Any]:
    return {
        "thrusters": [
            {"name": one.name, "what": one.what, "gain": one.gain, "likeness": one.alike, "other": one.other}
            for one in found.thrusters
        ],
        "lag_s": found.columns.lag,
        "explained": [None if x != x else float(x) for x in found.columns.explained],
    }
