"""The demonstration: the lawn-mower in waves, beside what the thesis says of it; then with a payload bolted on."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from rovtwin.core.errors import ConfigError, RovtwinError
from rovtwin.core.flow import FINISHED
from rovtwin.core.log import Log
from rovtwin.core.processes.aside import Aside
from rovtwin.demo.camera import film_and_identify
from rovtwin.demo.payload import Refitted, refit_and_identify
from rovtwin.report import write_comparison
from rovtwin.report.parts.tables import Table
from rovtwin.runs.flight import Flight
from rovtwin.runs.under_way import remove_unfinished, under_way
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Model

RUNS: dict[str, tuple[str, tuple[str, ...]]] = {
    "waves, thesis": ("lawnmower_waves", ("autopilot=thesis", "name=lawnmower_waves_thesis")),
    "waves, model-based": ("lawnmower_waves", ()),
}
"""Label -> scenario and overrides: the baseline, which has the thesis's gains, and the default autopilot."""
REFITTED = "waves, with a Doppler log and a sonar"
"""Label of the same flight with the payload, by the default autopilot."""


def run_demo(
    folder: Path, fly: Callable[[Scenario, Path, Model | None], Flight], say: Callable[[str], None] = lambda what: None
) -> dict[str, Any]:
    """Fly the runs of the demonstration and write the page that compares them.

    Args:
        folder: Where the page goes; each run has a folder in it.
        fly: Flies a scenario into a folder, with the vehicle as it truly is, or None for the scenario's own.
        say: Told what is going on besides flights.

    Returns:
        Path of the page, and the summary of each run; `completed` says that all runs were flown, not that all arrived.

    Raises:
        RovtwinError: Ctrl-C. Steps that were done are kept, the rest is removed.
    """
    try:
        flights, payload, camera, seen = _steps(folder, fly, say)
        page = write_comparison(
            {label: flight.log for label, flight in flights.items()},
            published_beside(flights),
            folder,
            title="Double Blueye: the lawn-mower of thesis chapter 8, and a payload bolted on",
            reports={label: f"{flight.scenario.name}/report.html" for label, flight in flights.items()},
            camera=camera,
            payload=(payload.changes, payload.learnt),
        )
    except KeyboardInterrupt:
        kept = ", ".join(remove_unfinished(folder))
        done = f"what was done is in {folder}: {kept}; the rest is removed" if kept else "no step was done"
        raise RovtwinError(f"interrupted before the demonstration was over: {done}") from None
    return {
        "completed": True,
        "report": str(page),
        "run_dir": str(folder),
        "camera": seen,
        "payload": payload.summary,
        "runs": {label: flight.figures | {"run_dir": str(flight.folder)} for label, flight in flights.items()},
    }


def _steps(
    folder: Path, fly: Callable[[Scenario, Path, Model | None], Flight], say: Callable[[str], None]
) -> tuple[dict[str, Flight], Refitted, tuple[Figure, Table] | str, dict[str, Any]]:
    """Flights by label, what came of the payload, and of the camera: what to show of it, and its summary.

    Raises:
        KeyboardInterrupt: Also where a flight ended early by it, with a whole log.
    """
    flights: dict[str, Flight] = {}

    def flown(label: str, name: str, overrides: Sequence[str], truth: Model | None) -> None:
        scenario = load_scenario(name, overrides)
        with under_way(folder / scenario.name):
            flights[label] = fly(scenario, folder / scenario.name, truth)
            if flights[label].figures["interrupted"]:
                raise KeyboardInterrupt

    # Half of the first run is compiling, on one core: what needs no flight of these goes on beside them.
    with Aside([partial(_refitted, folder / "payload"), partial(_filmed, folder / "camera")]) as aside:
        for label, (name, overrides) in RUNS.items():
            flown(label, name, overrides, None)
        payload = aside.result(say)
        changes = [f"vehicle={payload.file}", "name=lawnmower_waves_payload"]
        flown(REFITTED, "lawnmower_waves", changes, payload.truth)
        camera, seen = aside.result(say)
    return flights, payload, camera, seen


def _refitted(folder: Path, say: Callable[[str], None]) -> Refitted:
    with under_way(folder):
        return refit_and_identify(folder, say)


def _filmed(folder: Path, say: Callable[[str], None]) -> tuple[tuple[Figure, Table] | str, dict[str, Any]]:
    """Figure, table and summary of the step with the camera; why there is none where a library is missing."""
    try:
        with under_way(folder):
            done = film_and_identify(folder, say)
    except ConfigError as error:
        if "pip install" not in str(error):
            raise  # that is no missing library
        return str(error), {"left_out": str(error)}
    head = ["Parameter", "Guess", "Found (95 % interval)", "Truth"]
    note = (
        "Chapter 8.1 in short: the twin pushes itself ahead and astern before a wall with printed markers; its own "
        "rendered pictures give the track, the track the parameters. The thrust curve is given."
    )
    return (done.figure, Table("", head, done.rows, note)), done.summary


def published_beside(flights: dict[str, Flight]) -> list[list[str]]:
    """Rows of statement, what the thesis published, what each run measured, and a note.

    The thesis shows figures 8.4 to 8.8 and prints no number of these runs; its words are the data.
    """
    rows: list[tuple[str, str, Callable[[Flight], str], str]] = [
        (
            "Way-points reached",
            "all 7, in calm water (8.2) and in waves (8.3)",
            _reached,
            "Its gains have no integral in surge, sway and heave: a steady force F leaves an offset F / K_p, and "
            "beyond 0.2 m the way-point is never reached.",
        ),
        (
            "Time to finish",
            "no number; in waves much more than in calm water (8.3)",
            lambda f: ("" if f.completed else "not within ") + f"{f.figures['duration_s']:.0f} s",
            "1.5 N/m of surge gain makes the approach slow: the vehicle has 20 N and uses few of them.",
        ),
        (
            "Path over ground",
            "works very well; not straight at corners, for way-points switch within 0.2 m (8.2)",
            lambda f: _number(f, "cross_track_rms_m", "m rms") + ", " + _number(f, "cross_track_max_m", "m at most"),
            "From the truth, on legs, after the first dive.",
        ),
        (
            "Depth",
            "held (fig. 8.6, 8.8)",
            lambda f: _number(f, "depth_rms_m", "m rms"),
            "The thesis's waves push horizontally only.",
        ),
        (
            "Wave force",
            "-2 to 2 N (fig. 5.7, Hs 4.1 m, Tz 8.7 s)",
            _wave_force,
            "The height's spectrum taken as a force's; sigma and frequency of (5.5), (5.6) put right; with drift.",
        ),
        (
            "Sideways offset on the legs to the east",
            "a bias in sway, which the sway controller mends (8.3)",
            _offset_on_east_legs,
            "Mean of north minus way-point on these legs: waves and drift come from the side there.",
        ),
        (
            "Estimate",
            "tracks the truth very well (7.3)",
            lambda f: f"{max(f.figures['position_error_rms_m']):.2f} m rms, NEES {f.figures['nees_position_mean']:.1f}",
            "NEES of the position is 2 on average for a filter that knows its own error.",
        ),
    ]
    return [[what, text, *(measure(f) for f in flights.values()), note] for what, text, measure, note in rows]


def _number(flight: Flight, key: str, unit: str) -> str:
    value = flight.figures[key]
    return "none" if value is None else f"{value:.2f} {unit}"


def _reached(flight: Flight) -> str:
    total = len(flight.scenario.waypoints)
    mode = flight.log["autopilot/mode"]
    reached = total if mode["phase"][-1] == FINISHED else int(mode["waypoint"][-1])
    return f"{reached} of {total}"


def _wave_force(flight: Flight) -> str:
    if flight.scenario.world.waves is None:
        return "none"
    force = _horizontal_force(flight.log)
    return f"{force.min():.1f} to {force.max():.1f} N along north"


def _horizontal_force(log: Log) -> Float[np.ndarray, " n"]:
    """External force along north [N], from the body-frame wrench and the heading; roll and pitch are small."""
    wrench, psi = log["truth/external_wrench"], log["truth/eta"]["psi"]
    return wrench["X"] * np.cos(psi) - wrench["Y"] * np.sin(psi)


def _offset_on_east_legs(flight: Flight) -> str:
    leg, mode, eta = flight.log["autopilot/leg"], flight.log["autopilot/mode"], flight.log["truth/eta"]
    east = (mode["on_leg"] > 0.5) & (np.abs(leg["y1"] - leg["y0"]) > np.abs(leg["x1"] - leg["x0"]))
    return f"{np.mean(eta['x'][east] - leg['x1'][east]):+.2f} m" if east.any() else "no such leg flown"
