"""Predict, then fly: four corners in the tank with bands, written down before the flight; the flight against them."""

import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from rovtwin.commission.evidence.room import LASTING, PLACE, from_the_middle, outside
from rovtwin.commission.proving.bands import DRAWS, TOGETHER, Track, held, together, track_of
from rovtwin.commission.proving.missions import CLEAR, in_tank, open_water
from rovtwin.commission.proving.prediction import BANDS, LABELS, Prediction, predicted
from rovtwin.commission.proving.tuned import autopilot_of
from rovtwin.commission.request import sha256
from rovtwin.commission.stage import Check, Outcome
from rovtwin.commission.work import Work
from rovtwin.core.datum import utc_now
from rovtwin.core.log import Log
from rovtwin.core.user_files.config import parse
from rovtwin.live.flight import fly_live
from rovtwin.runs.compose.composition import compose, vehicle_of
from rovtwin.runs.ensemble.bands import Held, Verdict
from rovtwin.runs.ensemble.efforts import Foreseen, agrees, effort
from rovtwin.runs.ensemble.flights import drawn
from rovtwin.runs.ensemble.plants import plants_of
from rovtwin.runs.flight import Flight
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Vehicle, load_vehicle
from rovtwin.vehicle.constants import AXES

STREAM = 82  # of random numbers: no flight here is one of the proof
FLIGHT = "flight"
AGAIN = 2  # times that the corners may be moved inwards
INWARDS = 0.1  # by how much more than drawn flights lacked to the walls [m]
Predicted = tuple[Prediction | None, list[Check], dict[str, Any]]
UNSTATED = (
    "Something that no parameter stands for acts on it, such as a firmware's dead zone at small commands or a delay: "
    "rely on the path to that distance, not to the band."
)
UNTRUE = "The model does not predict this flight: look for what has changed, then repeat excite and identify."


def run(work: Work) -> Outcome:
    """The page of the prediction and its flight."""
    path = work.identified()
    vehicle = load_vehicle(str(path))
    scenario, (made, checks, figures) = _clear_of_walls(work, vehicle, str(path))
    if made is None or any(check.verdict == "stop" for check in checks):
        return Outcome(tuple(checks), figures)
    files = made.write(work.folder)
    sums = {name: sha256(work.folder / name) for name in files[:2]}
    figures |= {"prediction_file": BANDS, "predicted_utc": utc_now(), "sha256": sums}
    checks.append(Check("ok", "written down", f"before the flight: {BANDS}, SHA-256 {sums[BANDS][:16]}.."))
    flight, notes = _flown(work, scenario, made.lasting)
    checks += notes
    if flight is None:
        return Outcome(tuple(checks), figures, tuple(files))
    assert flight.folder is not None  # what was flown over a link has one
    log = str((flight.folder / "log.mcap").relative_to(work.folder))
    judged, more = _judged(work, made, flight)
    seconds = float(flight.log.end - flight.log.start)
    return Outcome((*checks, *judged), figures | more | {"log": log}, (*files, log), seconds)


def _clear_of_walls(work: Work, vehicle: Vehicle, path: str) -> tuple[Scenario, Predicted]:
    """The mission, and what drawn vehicles do: corners are moved inwards where these come too near to the walls."""
    work.person.progress("predicting: sizing the mission")
    accuracy, strays = _accuracy(work, vehicle, path), 0.0
    scenario = _sized(work, vehicle, path, accuracy)
    found = _predicted(work, scenario, vehicle)
    for _ in range(AGAIN):
        if found[0] is None or found[0].room >= CLEAR:
            break
        strays += CLEAR - found[0].room + INWARDS
        work.person.say(
            f"Drawn flights come within {found[0].room:z.2f} m of the walls: the corners are moved inwards by "
            f"{strays:.2f} m, and the flights are made again."
        )
        scenario = _sized(work, vehicle, path, accuracy, strays)
        found = _predicted(work, scenario, vehicle)
    return scenario, found


def _sized(work: Work, vehicle: Vehicle, path: str, accuracy: float, strays: float = 0.0) -> Scenario:
    """The four corners as a scenario, for a vehicle that `strays` [m] further off its path than its positions err."""
    mission = in_tank(vehicle, work.request.room, accuracy, strays)
    return work.scenario(mission | autopilot_of(work), path)


def _accuracy(work: Work, vehicle: Vehicle, path: str) -> float:
    """Standard deviation of the estimated position with the vehicle's sensors, in the worse direction [m]."""
    anywhere = work.scenario({"world": {}} | open_water(vehicle.model()), path)
    simulation = compose(anywhere, vehicle=vehicle)
    return max(simulation.bound(simulation.scenario.waypoints[0].speed))


def _predicted(work: Work, scenario: Scenario, vehicle: Vehicle) -> Predicted:
    """What drawn vehicles do, and whether they all do it well."""
    work.person.progress("predicting: drawing vehicles")
    plants, began = plants_of(scenario), time.monotonic()
    base = compose(scenario, vehicle=vehicle)
    runs = [drawn(base, plants, (work.request.seed, STREAM, i)) for i in range(DRAWS)]
    text = f"predicting: {DRAWS} flights of the twin"
    made, why = predicted(runs, work.request.room, lambda share: work.person.progress(text, share))
    wall = time.monotonic() - began
    figures: dict[str, Any] = {
        "draws": DRAWS,
        "drawn_from": plants.description,
        "wall_s": wall,
        "missions_per_min": 60.0 * DRAWS / wall,
    }
    if made is None:
        return None, [Check("stop", "mission", line, "Test more, or use a larger tank.") for line in why], figures
    figures |= {"room_m": made.room, "level": made.band.level, "half_width": made.half_widths}
    widths = ", ".join(f"{axis} {made.half_widths[axis]:.2g} {unit}" for axis, unit in LABELS)
    text = f"{DRAWS} flights of vehicles drawn from {plants.description}; half of the 95 % band's width: {widths}"
    return made, [Check("ok", "prediction", text), _clear(made.room)], figures


def _clear(room: float) -> Check:
    text = f"drawn flights stay {room:.2f} m or more off the walls, the hull turned any way"
    if room < CLEAR:
        return Check("stop", "room", f"{text}; expected {CLEAR:g} m.", "Use a larger tank, or test more.")
    return Check("ok", "room", text)


def _flown(work: Work, scenario: Scenario, lasting: float) -> tuple[Flight | None, list[Check]]:
    """The flight over the link once the vehicle is in the middle and the person says yes; None without."""
    flight, notes = None, list[Check]()

    def fly(name: str) -> Check | None:
        nonlocal flight, notes
        flight, notes = _flown_from_here(work, scenario, lasting, name)
        return next((note for note in notes if note.verdict == "stop"), None)

    from_the_middle(work, FLIGHT, fly)
    return flight, notes


def _flown_from_here(work: Work, scenario: Scenario, lasting: float, name: str) -> tuple[Flight | None, list[Check]]:
    notes: list[Check] = []

    def arm(readiness: Any) -> bool:
        if place := outside(fenced, readiness.start.position):
            notes.append(Check("stop", "place", place, PLACE))
            return False
        if readiness.missing:
            text = f"no readings of {', '.join(readiness.missing)}: predicted with them, flown without."
            notes.append(Check("warning", "sensors", text, "Take them out of the vehicle's file, or mend them."))
        return work.may_move(f"Fly the four corners now? Thrusters will turn for about {lasting:.0f} s; hands away.")

    fenced = _fenced(work, scenario)
    # A twin is the vehicle as it was described: flown as it was identified it would agree with itself.
    with work.connected(fenced.model_copy(update={"vehicle": work.request.vehicle})) as there:
        flight = fly_live(
            fenced,
            there.link,
            there.sources,
            there.clock,
            work.folder / name,
            arm=arm,
            progress=lambda t, phase: work.person.progress(f"flying: {phase}", min(t / lasting, 1.0)),
            say=work.person.progress,
            warn=work.person.say,
        )
    work.at_rest()
    if any(note.verdict == "stop" for note in notes):
        return None, notes
    if flight.figures["reason"] == "not armed":
        fix = "Repeat this stage when the vehicle may move."
        return None, [*notes, Check("stop", "flight", "not flown: it was not confirmed.", fix)]
    return flight, notes


def _fenced(work: Work, scenario: Scenario) -> Scenario:
    """The scenario with a fence where the hull would touch walls or floor, whichever way it points."""
    tank, corners = work.request.room, np.asarray(vehicle_of(scenario).model().hull.corners)
    half = 0.5 * np.array(tank.sizes[:2]) - float(np.hypot(*corners[:, :2].T).max())
    polygon = [[north * half[0], east * half[1]] for north, east in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
    rules = {
        "geofence": {"polygon": polygon, "after": LASTING, "action": "stop"},
        "depth_limit": {"limit": tank.depth - float(corners[:, 2].max())},
    }
    data = scenario.model_dump(mode="json", exclude_unset=True)
    section = dict(data.get("autopilot") or {})
    data["autopilot"] = section | {"supervisor": dict(section.get("supervisor") or {}) | rules}
    return parse(Scenario, data, "commission")


def _judged(work: Work, made: Prediction, flight: Flight) -> tuple[list[Check], dict[str, Any]]:
    """Each axis of path and effort against its band, with the figure."""
    track, completed = _track_of_log(flight.log), bool(flight.figures["completed"])
    checks: list[Check] = []
    if not completed:
        reason = flight.figures["reason"] or "not finished"
        fix = "Look at the log, then repeat this stage."
        checks.append(Check("stop", "flight", f"the mission was not completed: {reason}.", fix))
    if track is None:
        return checks, {"completed": completed}
    rows, chance = held(made.band, track), together(made.band, track)
    whole = _together(rows, chance)
    efforts = _efforts(made, flight.log, track)
    checks += [*(_path(one) for one in rows), _all_axes(whole, chance), *(_effort(*one) for one in efforts)]
    made.draw(work.folder, track, [f"{100.0 * one.inside:.1f} % inside" for one in rows])
    verdicts = {whole, *(one.verdict for one in rows), *(_verdict(*one) for one in efforts)}
    figures = {
        "completed": completed,
        "inside": {one.axis: one.inside for one in rows},
        "together": chance,
        "inside_all": float(np.mean([one.inside for one in rows])),
        "verdict": next(word for word in ("outside", "near", "inside") if word in verdicts),
        "axes": [_row(one) for one in rows],
        "effort": list(_effort_rows(efforts)),
        "time_zero_s": track.began,
    }
    return checks, figures


def _path(one: Held) -> Check:
    low, high = (100.0 * share for share in one.usual)
    text = (
        f"{100.0 * one.inside:.1f} % of {one.samples} samples inside the 95 % band; of drawn flights 95 % have "
        f"{low:.0f} to {high:.0f} %, and {100.0 * one.chance:.1f} % so few or fewer (samples are correlated: as good "
        f"as {one.effective:.0f} independent ones)"
    )
    if one.agrees:
        return Check("ok", one.axis, text)
    unit = next(unit for axis, unit in LABELS if axis == one.axis)
    away = f"up to {one.beyond:.2g} {unit}, {one.outside_by:.1f} half-widths, beyond it"
    if one.verdict == "near":
        return Check("warning", one.axis, f"{text}; {away}: less than matters for such a flight.", UNSTATED)
    return Check("stop", one.axis, f"{text}; {away}.", UNTRUE)


def _together(rows: Sequence[Held], chance: float) -> Verdict:
    """Of the path as a whole: each axis alone may pass a flight that no true model flies."""
    if chance > TOGETHER + 1e-9:
        return "inside"
    return "near" if all(one.beyond <= one.near for one in rows) else "outside"


def _all_axes(verdict: Verdict, chance: float) -> Check:
    text = f"of drawn flights {100.0 * chance:.1f} % are as far from their bands on all axes together, or farther"
    if verdict == "inside":
        return Check("ok", "path, all axes", text)
    if verdict == "near":
        return Check("warning", "path, all axes", f"{text}: by less than matters for such a flight.", UNSTATED)
    return Check("stop", "path, all axes", f"{text}.", UNTRUE)


def _efforts(made: Prediction, log: Log, track: Track) -> list[tuple[Foreseen, float, int]]:
    """What was foreseen of each axis, what was flown, and how many axes there are."""
    nu, tau = log["autopilot/nu"], log["autopilot/tau"]
    end = track.began + float(made.band.t[-1])
    during = (nu.t >= track.began - 1e-6) & (nu.t <= end + 1e-6)
    wrench = np.column_stack([np.interp(nu.t[during], tau.t, tau[name]) for name in tau.channel.fields])
    flown = effort(np.column_stack([nu[name][during] for name in nu.channel.fields]), wrench)
    return [(one, float(flown[AXES.index(one.axis)]), len(made.efforts)) for one in made.efforts]


def _effort(one: Foreseen, flown: float, axes: int) -> Check:
    low, high = (100.0 * (ratio - 1.0) for ratio in one.ratio())
    text = (
        f"it takes {100.0 * (flown / one.middle - 1.0):+z.0f} % against the prediction, whose 95 % band is {low:+z.0f} "
        f"to {high:+z.0f} %"
    )
    name = f"effort, {one.axis}"
    if _verdict(one, flown, axes) == "inside":
        return Check("ok", name, text)
    return Check("stop", name, f"{text}.", UNTRUE)


def _verdict(one: Foreseen, flown: float, axes: int) -> Verdict:
    return "inside" if agrees(one, flown, axes) else "outside"


def _effort_rows(efforts: list[tuple[Foreseen, float, int]]) -> Iterator[dict[str, Any]]:
    for one, flown, axes in efforts:
        yield {
            "axis": one.axis,
            "ratio": flown / one.middle,
            "interval_95": list(one.ratio()),
            "chance": one.chance(flown),
            "verdict": _verdict(one, flown, axes),
        }


def _row(one: Held) -> dict[str, Any]:
    return {
        "axis": one.axis,
        "inside": one.inside,
        "samples": one.samples,
        "effective_samples": one.effective,
        "drawn_95": list(one.usual),
        "chance": one.chance,
        "beyond_half_widths": one.outside_by,
        "beyond": one.beyond,
        "verdict": one.verdict,
    }


def _track_of_log(log: Log) -> Track | None:
    eta, mode = log["autopilot/eta"], log["autopilot/mode"]
    if not len(eta.t) or not len(mode.t):  # lost at once
        return None
    pose = np.column_stack([eta[name] for name in eta.channel.fields])
    return track_of(eta.t, pose, np.interp(eta.t, mode.t, mode["waypoint"]))
