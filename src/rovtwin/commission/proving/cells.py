"""Missions in currents and seas, flown by drawn vehicles: how many of each succeed, and what that shows."""

import itertools
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rovtwin.campaign.shares import at_least, needed, share_interval
from rovtwin.commission.proving.missions import sea
from rovtwin.runs.compose.composition import Simulation
from rovtwin.runs.ensemble.flights import drawn, fly_all
from rovtwin.runs.ensemble.plants import Plants
from rovtwin.runs.scoring.depths import not_at_depth
from rovtwin.runs.scoring.scores import Flown, score
from rovtwin.runs.scoring.summary import ending

ASKED = 0.99  # share of missions that shall succeed
STREAM = 81  # of random numbers: no mission here is one of the prediction
FAR = 1e4  # walls and floor of open water [m]: so that the program of the flight in the tank flies here, too
OPEN: dict[str, Any] = {"floor": FAR, "tank": {"north": [-FAR, FAR], "east": [-FAR, FAR]}}
Place = tuple[float, float]  # significant wave height [m], speed of the water [m/s]


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


@dataclass(frozen=True, eq=False)
class Proof:
    """All missions.

    Attributes:
        cells: A row for each place.
        places, runs, reasons: Of each mission: where, what was flown, why it did not succeed ("" if it did).
    """

    cells: list[Cell]
    places: list[Place]
    runs: list[Simulation]
    reasons: list[str]


def flown_in(
    places: Sequence[Place],
    samples: int,
    seed: int,
    base: Simulation,
    plants: Plants,
    progress: Callable[[float], None],
) -> Proof:
    """So many missions in each place, all flown together; what is drawn for one depends on its numbers alone."""
    return flown_beside(places, samples, seed, base, [plants], progress)[0]


def flown_beside(
    places: Sequence[Place],
    samples: int,
    seed: int,
    base: Simulation,
    kinds: Sequence[Plants],
    progress: Callable[[float], None],
) -> list[Proof]:
    """The same missions by each of some kinds of plants, drawn by the same numbers, all flown together."""
    drawn_for = [(k, i) for k in range(len(places)) for i in range(samples)]
    runs = [
        drawn(base, plants, (seed, STREAM, k, i), _world(seed, k, i, places[k]))
        for plants in kinds
        for k, i in drawn_for
    ]
    flown = fly_all(runs, progress)
    reasons = [_ended(one, run) for one, run in zip(flown, runs, strict=True)]
    n = len(drawn_for)
    return [_proof(places, samples, runs[i * n : i * n + n], reasons[i * n : i * n + n]) for i in range(len(kinds))]


def _proof(places: Sequence[Place], samples: int, runs: list[Simulation], reasons: list[str]) -> Proof:
    """Of missions that are in order of their places, so many in each."""
    cells = [_cell(place, reasons[k * samples : (k + 1) * samples]) for k, place in enumerate(places)]
    return Proof(cells, [place for place in places for _ in range(samples)], runs, reasons)


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


def for_all(currents: Sequence[float | None]) -> float | None:
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
