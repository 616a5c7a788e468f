"""Predict, then fly: four corners in the tank with bands, written down before the flight; the flight against them."""

import csv
import io
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.campaign.tuning.plants import plants_of
from rovtwin.commission.proving.bands import (
    AXES,
    DRAWS,
    UNITS,
    Band,
    Held,
    Track,
    band_of,
    held,
    track_of,
    track_of_flown,
)
from rovtwin.commission.proving.flights import drawn, fly_all
from rovtwin.commission.proving.missions import in_tank
from rovtwin.commission.proving.tuned import autopilot_of
from rovtwin.commission.request import sha256
from rovtwin.commission.stage import Check, Outcome
from rovtwin.commission.work import Work
from rovtwin.core.datum import utc_now
from rovtwin.core.errors import ConfigError
from rovtwin.core.log import Log
from rovtwin.core.user_files.files import write_text
from rovtwin.live.flight import fly_live
from rovtwin.planning.tank import Tank
from rovtwin.report.parts.page import save
from rovtwin.report.studies.prediction import prediction_figure
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.fly import Flight
from rovtwin.runs.scoring.scores import Flown, finished
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Vehicle, load_vehicle

STREAM = 82  # of random numbers: no flight here is one of the proof
CLEAR = 0.1  # least distance from the walls of the hull's circle in a drawn flight, in metres
PREDICTION, FLIGHT = "prediction.csv", "flight"
LABELS = tuple(zip(AXES, UNITS, strict=True))


def run(work: Work) -> Outcome:
    """The page of the prediction and its flight."""
    path = work.file("identify", "vehicle_file")
    if path is None:
        text = "no identified file of this commissioning: nothing says how sure the model is."
        return Outcome((Check("stop", "model", text, "Pass the stage identify first."),))
    vehicle = load_vehicle(str(path))
    scenario = work.scenario(in_tank(vehicle, work.request.room) | autopilot_of(work), str(path))
    band, checks, figures = _predicted(work, scenario, vehicle)
    if band is None or any(check.verdict == "stop" for check in checks):
        return Outcome(tuple(checks), figures)
    _write(work.folder / PREDICTION, band)
    figures |= {"prediction_file": PREDICTION, "predicted_utc": utc_now(), "sha256": sha256(work.folder / PREDICTION)}
    save(_figure(band, None, ()), work.folder, "prediction")
    files = [PREDICTION, "figures/prediction.png", "figures/prediction.svg"]
    checks.append(Check("ok", "written down", f"{PREDICTION}, SHA-256 {figures['sha256'][:16]}.., before the flight"))
    flight, notes = _flown(work, scenario, band)
    checks += notes
    if flight is None:
        return Outcome(tuple(checks), figures, tuple(files))
    log = f"{FLIGHT}/log.mcap"
    judged, more = _judged(work, band, flight)
    seconds = float(flight.log.end - flight.log.start)
    return Outcome((*checks, *judged), figures | more | {"log": log}, (*files, log), seconds)


def _predicted(work: Work, scenario: Scenario, vehicle: Vehicle) -> tuple[Band | None, list[Check], dict[str, Any]]:
    """The band of flights of drawn vehicles, and whether they all end well."""
    work.person.progress("predicting: drawing vehicles")
    plants, began = plants_of(scenario), time.monotonic()
    base = compose(scenario, vehicle=vehicle)
    runs = [drawn(base, plants, (work.request.seed, STREAM, i)) for i in range(DRAWS)]
    flown = fly_all(runs, lambda share: work.person.progress(f"predicting: {DRAWS} flights of the twin", share))
    wall = time.monotonic() - began
    tracks = [track_of_flown(one) for one in flown]
    came = [track for track, one in zip(tracks, flown, strict=True) if track is not None and finished(one)]
    figures = {
        "draws": DRAWS,
        "drawn_from": plants.description,
        "prediction_wall_s": wall,
        "missions_per_min": 60.0 * DRAWS / wall,
    }
    if len(came) < DRAWS:
        text = f"{DRAWS - len(came)} of {DRAWS} drawn vehicles do not complete it in the twin, expected none."
        return None, [Check("stop", "mission", text, "Test more, or use a larger tank.")], figures
    band = band_of(came)
    room = min(_room(one, vehicle, work.request.room) for one in flown)
    figures |= {"room_m": room, "level": band.level, "half_width": _half_widths(band)}
    widths = ", ".join(f"{axis} {figures['half_width'][axis]:.2g} {unit}" for axis, unit in LABELS)
    text = f"{DRAWS} flights of vehicles drawn from {plants.description}; half of the band's width: {widths}"
    return band, [Check("ok", "prediction", text), _clear(room)], figures


def _clear(room: float) -> Check:
    text = f"drawn flights stay {room:.2f} m or more off the walls (hull turned any way)"
    if room < CLEAR:
        return Check("stop", "room", f"{text}, expected {CLEAR:g} m.", "Use a larger tank, or test more.")
    return Check("ok", "room", text)


def _room(flown: Flown, vehicle: Vehicle, tank: Tank) -> float:
    """Least distance of the circle about the hull from the tank's walls on a true path [m]."""
    around = float(np.hypot(*np.asarray(vehicle.model().hull.corners)[:, :2].T).max())
    away = np.abs(flown.eta[:, :2] - np.array(tank.middle[:2]))
    return float((0.5 * np.array(tank.sizes[:2]) - away).min() - around)


def _half_widths(band: Band) -> dict[str, float]:
    widths = 0.5 * np.median(band.high - band.low, axis=0)
    return dict(zip(AXES, (float(one) for one in widths), strict=True))


def _flown(work: Work, scenario: Scenario, band: Band) -> tuple[Flight | None, list[Check]]:
    """The flight over the link once the person says yes; None without."""
    notes: list[Check] = []
    asked = f"Fly the four corners now? Thrusters will turn for about {band.t[-1] + 30.0:.0f} s; keep hands away."

    def arm(readiness: Any) -> bool:
        if readiness.missing:
            text = f"no readings of {', '.join(readiness.missing)}: predicted with them, flown without."
            notes.append(Check("warning", "sensors", text, "Take them out of the vehicle's file, or mend them."))
        return work.may_move(asked)

    with work.connected(scenario) as there:
        flight = fly_live(
            scenario,
            there.link,
            there.sources,
            there.clock,
            work.folder / FLIGHT,
            arm=arm,
            progress=lambda t, phase: work.person.progress(f"flying: {phase}", min(t / (band.t[-1] + 30.0), 1.0)),
            say=work.person.progress,
            warn=work.person.say,
        )
    if flight.summary["reason"] == "not armed":
        fix = "Repeat this stage when the vehicle may move."
        return None, [*notes, Check("stop", "flight", "not flown: it was not confirmed.", fix)]
    return flight, notes


def _judged(work: Work, band: Band, flight: Flight) -> tuple[list[Check], dict[str, Any]]:
    """Each axis against its band, with a figure."""
    track = _track_of_log(flight.log)
    completed = bool(flight.summary["completed"])
    checks: list[Check] = []
    if not completed:
        reason = flight.summary["reason"] or "not finished"
        fix = "Look at the log, then repeat this stage."
        checks.append(Check("stop", "flight", f"the mission was not completed: {reason}.", fix))
    if track is None:
        return checks, {"completed": completed}
    rows = held(band, track)
    checks += list(_axes(rows))
    save(_figure(band, track, [f"{100 * one.inside:.1f} % inside" for one in rows]), work.folder, "prediction")
    figures = {
        "completed": completed,
        "inside": {one.axis: one.inside for one in rows},
        "verdict": "inside" if all(one.agrees for one in rows) else "outside",
        "axes": [_row(one) for one in rows],
        "time_zero_s": track.began,
    }
    return checks, figures


def _axes(rows: list[Held]) -> Iterator[Check]:
    for one in rows:
        low, high = one.usual
        text = (
            f"{100 * one.inside:.1f} % of {one.samples} samples inside the 95 % band; drawn flights have "
            f"{100 * low:.0f} to {100 * high:.0f} % (correlated: as good as {one.effective:.0f} independent ones)"
        )
        if one.agrees:
            yield Check("ok", one.axis, text)
        else:
            fix = "The model does not predict this flight: repeat excite and identify, and look for what has changed."
            yield Check("stop", one.axis, f"{text}; up to {one.outside_by:.1f} half-widths beyond it.", fix)


def _row(one: Held) -> dict[str, Any]:
    return {
        "axis": one.axis,
        "inside": one.inside,
        "samples": one.samples,
        "effective_samples": one.effective,
        "drawn_95": list(one.usual),
        "chance": one.chance,
        "beyond_half_widths": one.outside_by,
        "verdict": "inside" if one.agrees else "outside",
    }


def _track_of_log(log: Log) -> Track | None:
    eta, mode = log["autopilot/eta"], log["autopilot/mode"]
    pose = np.column_stack([eta[name] for name in ("x", "y", "z", "phi", "theta", "psi")])
    return track_of(eta.t, pose, np.interp(eta.t, mode.t, mode["waypoint"]))


def _figure(band: Band, track: Track | None, captions: Any) -> Any:
    flown = None if track is None else (track.t, _same_turn(track.pose, band))
    return prediction_figure(band.t, band.low, band.high, band.middle, flown, LABELS, captions or [""] * len(AXES))


def _same_turn(pose: np.ndarray, band: Band) -> np.ndarray:
    """Heading by whole turns as the band has it."""
    pose = pose.copy()
    pose[:, 3] += 360.0 * np.round((band.middle[0, 3] - pose[0, 3]) / 360.0)
    return pose


def _write(path: Path, band: Band) -> None:
    """The band as a table: its lower end, its upper end and its median for each axis."""
    text = io.StringIO()
    writer = csv.writer(text)
    names = [f"{axis}_{what}_{unit}" for axis, unit in LABELS for what in ("low", "high", "median")]
    writer.writerow(["t_s", *names])
    for i, t in enumerate(band.t):
        rows = np.column_stack([band.low[i], band.high[i], band.middle[i]]).ravel()
        writer.writerow([f"{t:.1f}", *(f"{value:.4f}" for value in rows)])
    try:
        write_text(path, text.getvalue())
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written ({error.strerror})") from None
