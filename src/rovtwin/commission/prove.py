"""Prove on the twin: in which currents and seas missions succeed, whatever identification left open."""

import csv
import io
import itertools
import re
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rovtwin.campaign.shares import at_least, needed, share_interval
from rovtwin.campaign.tuning.plants import Plants, plants_of
from rovtwin.commission.proving.flights import drawn, fly_all
from rovtwin.commission.proving.missions import open_water, sea
from rovtwin.commission.proving.tuned import tuned
from rovtwin.commission.stage import Check, Outcome
from rovtwin.commission.work import Work
from rovtwin.core.user_files.files import write_text
from rovtwin.runs.compose.composition import Simulation, compose
from rovtwin.runs.scoring.depths import not_at_depth
from rovtwin.runs.scoring.scores import Flown, score
from rovtwin.runs.scoring.summary import ending
from rovtwin.vehicle import load_vehicle

ASKED = 0.99  # share of missions that shall succeed
STREAM = 81  # of random numbers: no mission here is one of the prediction
MISSIONS = "missions.csv"
FAR = 1e4  # walls and floor of open water [m]: so that the program of the flight in the tank flies here, too
OPEN: dict[str, Any] = {"floor": FAR, "tank": {"north": [-FAR, FAR], "east": [-FAR, FAR]}}


@dataclass(frozen=True)
class Cell:
    """Missions in one current and sea.

    Attributes:
        current: Speed of the water, from any side [m/s].
        sea: Significant wave height, from any side [m].
        missions, succeeded: How many.
        reasons: Why the others did not, with how often, the most frequent first.
    """

    current: float
    sea: float
    missions: int
    succeeded: int
    reasons: tuple[tuple[str, int], ...]

    @property
    def good(self) -> bool:
        """Whether as many succeed as are asked for."""
        return self.succeeded >= ASKED * self.missions

    @property
    def place(self) -> str:
        """Where it is, for people."""
        return f"current {self.current:g} m/s, {f'sea {self.sea:g} m' if self.sea else 'calm'}"

    def row(self) -> dict[str, Any]:
        """For later stages."""
        return {
            "current_m_s": self.current,
            "sea_m": self.sea,
            "missions": self.missions,
            "succeeded": self.succeeded,
            "share": self.succeeded / self.missions,
            "interval_95": list(share_interval(self.succeeded, self.missions)),
            "at_least_95": at_least(self.succeeded, self.missions),
            "reasons": dict(self.reasons),
        }


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
        "largest_current_m_s": _for_all(list(limits.values())),
        "largest_currents": [{"sea_m": height, "current_m_s": current} for height, current in limits.items()],
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
    drawn_for = [(k, i) for k in range(len(places)) for i in range(request.samples)]
    runs = [
        drawn(base, plants, (request.seed, STREAM, k, i), _world(request.seed, k, i, places[k])) for k, i in drawn_for
    ]
    text = f"proving: {len(runs)} missions in {len(places)} waters"
    flown = fly_all(runs, lambda share: work.person.progress(text, share))
    reasons = [_ended(one, run) for one, run in zip(flown, runs, strict=True)]
    _write(work, [places[k] for k, _ in drawn_for], runs, reasons)
    cells = [
        _cell(place, [reason for (n, _), reason in zip(drawn_for, reasons, strict=True) if n == k])
        for k, place in enumerate(places)
    ]
    return cells, time.monotonic() - began


def _world(seed: int, cell: int, mission: int, place: tuple[float, float]) -> dict[str, Any]:
    """Water of a cell: current and waves run to directions of their own in each mission."""
    height, speed = place
    to, waves_to = np.random.default_rng([seed, STREAM, cell, mission, 1]).uniform(-np.pi, np.pi, 2)
    velocity = [float(speed * np.cos(to)), float(speed * np.sin(to)), 0.0]
    return OPEN | {"current": {"velocity": velocity}, "waves": sea(height, float(np.degrees(waves_to)))}


def _ended(flown: Flown, run: Simulation) -> str:
    """Why a mission did not succeed, "" if it did."""
    found = score(flown)
    if not found["completed"]:
        return ending(flown, run, found["reason"])
    return not_at_depth(flown, run.scenario, run.model)


def _cell(place: tuple[float, float], reasons: Sequence[str]) -> Cell:
    failed = Counter(_kind(reason) for reason in reasons if reason)
    return Cell(place[1], place[0], len(reasons), len(reasons) - failed.total(), tuple(failed.most_common()))


def _kind(reason: str) -> str:
    """What several missions may share of a reason: not when, nor where."""
    return re.sub(r" after \d+ s.*", "", reason.split(":")[0])


def largest_current(cells: Sequence[Cell], height: float) -> float | None:
    """The largest current of a sea in which, as in all smaller ones, enough succeed [m/s]; None: not in the least."""
    rising = sorted((cell for cell in cells if cell.sea == height), key=lambda cell: cell.current)
    inside = list(itertools.takewhile(lambda cell: cell.good, rising))
    return inside[-1].current if inside else None


def _for_all(currents: Sequence[float | None]) -> float | None:
    """What holds in all seas; None where one of them has none."""
    return min((one for one in currents if one is not None), default=None) if None not in currents else None


def shown(succeeded: int, missions: int) -> str:
    """What so many missions show, and what they cannot."""
    least = 100.0 * _down(at_least(succeeded, missions))
    text = f"{succeeded} of {missions} succeed; at least {least:.0f} % with 95 % confidence"
    if succeeded == missions and missions < needed(ASKED):
        text += f" ({needed(ASKED)} of {needed(ASKED)} would show {100 * ASKED:g} %)"
    return text


def _down(share: float) -> float:
    """To whole percents, never more than was shown."""
    return np.floor(100.0 * share) / 100.0


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


def _write(
    work: Work, places: Sequence[tuple[float, float]], runs: Sequence[Simulation], reasons: Sequence[str]
) -> None:
    """A row for each mission."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(["sea_m", "current_m_s", "seed", "succeeded", "reason"])
    for place, run, reason in zip(places, runs, reasons, strict=True):
        writer.writerow([*place, run.scenario.seed, int(not reason), reason])
    write_text(work.folder / MISSIONS, text.getvalue())
