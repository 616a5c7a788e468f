"""Flights that judge an autopilot: the same plants, seas and noise for each, by loops that are compiled once.

What is tuned are arrays of the composed loop, so that one compiled program flies all autopilots and all plants of a
sea, LANES of them side by side. It computes outside of the Python lock: threads fill the cores, and share programs.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rovtwin.campaign.tuning.cost import terms_of
from rovtwin.core.arrays.rotations import heading_rotation
from rovtwin.core.block import Block
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import FAIL_SAFE_PHASES
from rovtwin.core.processes.cores import cores_here
from rovtwin.core.user_files.config import parse
from rovtwin.gnc.scales import VehicleScales
from rovtwin.runs.batch import flown_together, same_program
from rovtwin.runs.compose.autopilot import autopilot_of
from rovtwin.runs.compose.composition import Simulation, compose, vehicle_of, way_points
from rovtwin.runs.compose.fitting import own_values
from rovtwin.runs.compose.world import in_water
from rovtwin.runs.ensemble.flights import LANES
from rovtwin.runs.ensemble.plants import Plants
from rovtwin.runs.limits import Limits
from rovtwin.runs.run import CHUNK
from rovtwin.runs.scoring.scores import Flown, score
from rovtwin.runs.scoring.summary import ending
from rovtwin.scenario.files import find_scenario
from rovtwin.scenario.schema import ModelBasedSection, Scenario
from rovtwin.simulation.mismatch import drawn

TUNING, CHOOSING, HELD_OUT = range(3)  # streams of random numbers, so that no plant of one is met in another
SEAS = {"waves": "lawnmower_waves", "sea": "lawnmower_sea"}
# So calm that nothing moves, but flown by the program of `waves`: half a minute of compiling less.
CALM = {"model": "thesis", "significant_height": 1e-6, "zero_crossing_period": 8.7, "drift": 0.0}
USUAL_SEAS = ("calm", "waves")
LONGEST = 300.0  # of a held-out flight [s]
TIMED = 4.0 * CHUNK  # simulated, by which the pace of flights is known before they are flown [s]
SHOWN = 4  # failed flights in a message
Figures = dict[str, Any]


@dataclass(frozen=True)
class Fleet:
    """Plants, each in its sea, ready to be flown by any autopilot.

    Attributes:
        runs: Composed simulations, one for each plant.
        seas: Name of each one's sea.
        cut: Whether flights are shorter than the scenario allows them to be.
    """

    runs: list[Simulation]
    seas: list[str]
    cut: bool

    def autopilot(self, section: ModelBasedSection) -> Block:
        """The blocks of a section; the same for all plants, which it cannot know."""
        one = self.runs[0]
        scenario = one.scenario.model_copy(update={"autopilot": section})
        mission = way_points(scenario, one.model)
        return autopilot_of(scenario, one.model, one.loop.twin.sensors, mission, list(one.vehicle.thruster_names))

    def _which(self, i: int) -> str:
        run = self.runs[i]
        there = drawn(run.loop.twin.model, in_water(run.scenario.world, run.vehicle, run.model))
        return (
            f"plant {i + 1} of {len(self.runs)} ({self.seas[i]}, seed {run.scenario.seed}, mass x {there['mass']:.2f}, "
            f"thrust x {there['thrust']:.2f})"
        )

    def flights(self, sections: Sequence[ModelBasedSection]) -> list[Simulation]:
        """Every plant with every autopilot, all plants of the first autopilot first."""
        return [
            replace(run, loop=replace(run.loop, autopilot=autopilot))
            for autopilot in map(self.autopilot, sections)
            for run in self.runs
        ]

    def excused(self, figures: Sequence[Figures], hand_tuned: Sequence[Figures]) -> list[Figures]:
        """Scores with the note `cut` where a flight that was cut short did not arrive, nor did the hand-tuned one.

        And with `which` flight it is.
        """
        late = [self.cut and not one["completed"] and one["phase"] not in FAIL_SAFE_PHASES for one in hand_tuned]
        return [
            one | {"cut": so, "which": self._which(i)} for i, (one, so) in enumerate(zip(figures, late, strict=True))
        ]


def seas_of(names: Sequence[str], scenario: Scenario) -> dict[str, Any]:
    """The `world.waves` of seas by name: `calm`, `waves`, `sea`, `own`, or those of another scenario.

    Raises:
        ConfigError: A name is no scenario's.
    """
    found: dict[str, Any] = {}
    for name in names or USUAL_SEAS:
        if name == "own":
            found[name] = scenario.world.waves.model_dump() if scenario.world.waves else None
        elif name == "calm":
            found[name] = CALM
        else:
            try:
                found[name] = (find_scenario(SEAS.get(name, name))[0].get("world") or {}).get("waves")
            except ConfigError as error:
                raise ConfigError(f"--sea: {error} Expected calm, waves, sea, own, or a scenario with waves") from None
    return found


def short_mission(scenario: Scenario) -> dict[str, Any]:
    """Two legs with a corner, a dive and a hold, from where the scenario starts, at its fastest leg's speed.

    Depths, acceptance and the time limit are the vehicle's, with 0.5 m, 0.2 m and 75 s for a Double Blueye.

    Returns:
        `mission` and `duration` of a scenario.
    """
    model = vehicle_of(scenario).model()
    fastest = max(w.speed for w in scenario.waypoints)
    scales, acceptance = VehicleScales.of(model), own_values(Limits.of(model), fastest)["acceptance"]
    dive = round(max(2.5 * scales.dive_speed, acceptance), 2)
    north, east, depth = scenario.start.position
    long, short = 15.0 * fastest, 10.0 * fastest
    ahead, right = heading_rotation(scenario.heading).T
    places = [long * ahead, long * ahead + short * right, long * ahead + short * right]
    rows: list[dict[str, Any]] = [
        {"position": [north + float(p[0]), east + float(p[1]), depth + d], "speed": fastest, "acceptance": acceptance}
        for p, d in zip(places, (dive, dive, 2.0 * dive), strict=True)
    ]
    # A hold begins wherever the filter was when it came: how near is for the cost to say.
    rows[-1] |= {"hold_time": 10.0, "acceptance": 10.0 * acceptance}
    mission = {"name": "tuning", "description": "two legs, a corner, a dive, a hold", "waypoints": rows}
    return {"mission": mission, "duration": 40.0 + 17.5 / scales.level_bandwidth}


def fleet_of(
    scenario: Scenario, plants: Plants, seas: dict[str, Any], stream: int, count: int, seed: int, short: bool
) -> Fleet:
    """Plants of a stream, in the seas by turns.

    Args:
        scenario: What is to be flown.
        plants: What they are drawn from.
        seas: `world.waves` by name.
        stream: TUNING, CHOOSING or HELD_OUT.
        count: How many plants.
        seed: Master seed.
        short: Fly the short mission; else the scenario's own, for at most LONGEST seconds.

    Raises:
        ConfigError: The scenario cannot be composed in a sea.
    """
    data = scenario.model_dump()
    data["world"]["mismatch"] = None
    if short:
        data |= short_mission(scenario) | {"faults": [], "battery": None}
    cut = not short and scenario.duration > LONGEST
    data["duration"] = min(data["duration"], LONGEST)
    runs, names = [], []
    where = f"{scenario.name}{': short mission of the search (or give --own-mission)' if short else ''}"
    for i in range(count):
        rng = np.random.default_rng([seed, stream, i])
        name = list(seas)[i % len(seas)]
        data["seed"] = int(rng.integers(2**31))
        data["world"]["waves"] = seas[name]
        try:
            runs.append(compose(parse(Scenario, data, scenario.name), plants.drawn(rng)))
        except ConfigError as error:
            raise ConfigError(f"{where}: {error}") from None
        names.append(name)
    return Fleet(runs, names, cut)


def fly_some(runs: Sequence[Simulation]) -> list[Figures]:
    """Scores of at most LANES flights of one program, from the truth; those of `rovtwin fly` to rounding."""
    full = [*runs, *[runs[-1]] * (LANES - len(runs))]  # one shape, one program
    return [_scored(flown, run) for run, flown in zip(runs, flown_together(full)[: len(runs)], strict=True)]


def _scored(flown: Flown, run: Simulation) -> Figures:
    """Scores, and, of a flight that did not arrive, the words of `rovtwin fly` for how it ended."""
    figures = score(flown)
    if figures["completed"]:
        return figures | {"ended": "it left a figure that is no number"}
    return figures | {"ended": ending(flown, run, figures["reason"])}


class Crew:
    """Threads that fly, as many as asked for."""

    def __init__(self, pool: ThreadPoolExecutor, workers: int):
        self._pool, self.workers = pool, workers

    def rounds(self, flights: int) -> int:
        """How often each thread flies LANES until so many flights of one program are over."""
        return -(-flights // (LANES * self.workers))

    def compile(self, runs: Sequence[Simulation]) -> None:
        """Fly a second with each program of these runs, so that threads find it compiled and don't all compile it."""
        firsts = [runs[group[0]] for group in same_program(runs)]
        brief = [replace(run, scenario=run.scenario.model_copy(update={"duration": CHUNK})) for run in firsts]
        list(self._pool.map(fly_some, [[run] for run in brief]))

    def pace(self, run: Simulation) -> float:
        """Wall time of one simulated second of LANES flights of a program that is compiled, of runs like this [s]."""

        def taken(seconds: float) -> float:
            began = time.monotonic()
            fly_some([replace(run, scenario=run.scenario.model_copy(update={"duration": seconds}))])
            return time.monotonic() - began

        few, more = taken(CHUNK), taken(CHUNK + TIMED)
        return max(more - few, 0.0) / TIMED

    def fly(
        self, fleet: Fleet, sections: Sequence[ModelBasedSection], tell: Callable[[], None] = lambda: None
    ) -> list[list[Figures]]:
        """Scores of every plant under every autopilot, the plants of one autopilot in a list.

        Args:
            fleet: Who is flown.
            sections: The autopilots.
            tell: Called after each flight.
        """
        flights, n = fleet.flights(sections), len(fleet.runs)
        alike = [[k + i for k in range(0, len(flights), n) for i in group] for group in same_program(fleet.runs)]
        portions = [group[i : i + LANES] for group in alike for i in range(0, len(group), LANES)]
        figures: list[Figures] = [{}] * len(flights)
        scores = self._pool.map(lambda portion: fly_some([flights[i] for i in portion]), portions)
        for portion, found in zip(portions, scores, strict=True):
            for i, one in zip(portion, found, strict=True):
                figures[i] = one
                tell()
        return [figures[i : i + n] for i in range(0, len(figures), n)]


def failures(figures: Sequence[Figures]) -> str:
    """Which flights of one autopilot failed and how, the first SHOWN of them; of the first also why."""
    failed = [one for one in figures if terms_of(one) is None]
    rows = [f"{one['which']}: {_briefly(one) if i else one['ended']}" for i, one in enumerate(failed[:SHOWN])]
    return "; ".join(rows) + (f"; and {len(failed) - SHOWN} more" if len(failed) > SHOWN else "")


def _briefly(figures: Figures) -> str:
    return f"{figures['reason'] or 'not finished'} after {figures['duration_s']:.0f} s"


@contextmanager
def crew_of(workers: int | None = None) -> Iterator[Crew]:
    """Threads for as many cores as this process may use, or as said."""
    count = workers or cores_here()
    with ThreadPoolExecutor(count) as pool:
        yield Crew(pool, count)
