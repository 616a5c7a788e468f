"""Prove on the twin: in which currents and seas missions succeed, whatever identification left open."""

import csv
import io
import itertools
import time
from collections.abc import Sequence
from typing import Any

from rovtwin.campaign.shares import needed
from rovtwin.commission.proving.cells import (
    ASKED,
    OPEN,
    Cell,
    Proof,
    flown_in,
    for_all,
    largest_current,
    shown,
)
from rovtwin.commission.proving.missions import open_water
from rovtwin.commission.proving.tuned import tuned
from rovtwin.commission.stage import Check, Outcome
from rovtwin.commission.work import Work
from rovtwin.core.user_files.files import write_text
from rovtwin.runs.compose.composition import Simulation, compose
from rovtwin.runs.ensemble.plants import Plants, plants_of
from rovtwin.vehicle import load_vehicle

MISSIONS = "missions.csv"


def run(work: Work) -> Outcome:
    """The page of the proof."""
    path = work.identified()
    vehicle = load_vehicle(str(path))
    scenario = work.scenario({"world": OPEN} | open_water(vehicle.model()), str(path))
    scenario, tuning, figures = tuned(work, scenario)
    plants = plants_of(scenario)
    work.person.progress("proving: composing")
    cells, wall = _flown(work, compose(scenario, vehicle=vehicle), plants)
    rows = [cell.row() for cell in cells]
    limits = {height: largest_current(cells, height) for height in sorted({cell.sea for cell in cells})}
    figures |= {
        "envelope": rows,
        "largest_current_m_s": for_all(list(limits.values())),
        "largest_currents": [{"sea_m": height, "current_m_s": current} for height, current in limits.items()],
        "seed": work.request.seed,
        "samples": work.request.samples,
        "asked_share": ASKED,
        "missions_needed": needed(ASKED),
        "autopilot": tuning.text,
        "drawn_from": plants.description,
        "wall_s": wall,
        "missions_per_min": 60.0 * sum(cell.missions for cell in cells) / wall,
        "mission": {"side_m": scenario.waypoints[0].depth, "speed_m_s": scenario.waypoints[0].speed},
    }
    checks = [tuning, Check("note", "vehicles", f"drawn from {plants.description}"), *_judged(cells)]
    checks += [*_envelope(cells, limits), Check("note", "computing", _pace(figures))]
    return Outcome(tuple(checks), figures, (MISSIONS, figures["autopilot_file"]))


def _flown(work: Work, base: Simulation, plants: Plants) -> tuple[list[Cell], float]:
    """All cells, flown together, and the wall time that it took [s]."""
    request, began = work.request, time.monotonic()
    places = list(itertools.product(sorted(set(request.seas)), sorted(set(request.currents))))
    work.person.progress("proving: drawing vehicles", 0.0)
    text = f"proving: {len(places) * request.samples} missions in {len(places)} waters"
    found = flown_in(
        places, request.samples, request.seed, base, plants, lambda share: work.person.progress(text, share)
    )
    _write(work, found)
    return found.cells, time.monotonic() - began


def _judged(cells: Sequence[Cell]) -> list[Check]:
    """A line for each cell."""
    lines = []
    for cell in cells:
        reasons = "; ".join(f"{reason} ({count})" for reason, count in cell.reasons)
        text = shown(cell.succeeded, cell.missions) + (f". Not: {reasons}." if reasons else "")
        lines.append(
            Check("ok" if cell.good else "warning", cell.place, text, "" if cell.good else "Do not fly there.")
        )
    return lines


def _envelope(cells: Sequence[Cell], limits: dict[float, float | None]) -> list[Check]:
    """The envelope of each sea; a stop where there is none in the calmest."""
    lines = []
    for height, current in limits.items():
        name = f"envelope, {f'sea {height:g} m' if height else 'calm'}"
        if current is None:
            verdict = "stop" if height == min(limits) else "warning"
            fix = "Lower the task's currents and seas, tune the autopilot, or fit stronger thrusters."
            lines.append(Check(verdict, name, f"not even in the least current {100 * ASKED:g} % succeed.", fix))
            continue
        inside = [cell for cell in cells if cell.sea == height and cell.current <= current]
        together = shown(sum(cell.succeeded for cell in inside), sum(cell.missions for cell in inside))
        text = f"currents up to {current:g} m/s: all of it together, {together}"
        lines.append(Check("ok", name, text))
    return lines


def _pace(figures: dict[str, Any]) -> str:
    return f"{figures['wall_s']:.0f} s, {figures['missions_per_min']:.0f} missions a minute"


def _write(work: Work, found: Proof) -> None:
    """A row for each mission."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(["sea_m", "current_m_s", "seed", "succeeded", "reason"])
    for place, run, reason in zip(found.places, found.runs, found.reasons, strict=True):
        writer.writerow([*place, run.scenario.seed, int(not reason), reason])
    write_text(work.folder / MISSIONS, text.getvalue())
