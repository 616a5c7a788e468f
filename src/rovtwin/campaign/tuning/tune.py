"""Tuning from beginning to end: search on drawn plants, choose on others, and judge on plants that neither has seen."""

import time
from collections.abc import Callable, Sequence

import numpy as np

from rovtwin.campaign.tuning.cost import FAILED, Cost, floors_of
from rovtwin.campaign.tuning.flights import (
    CHOOSING,
    HELD_OUT,
    TUNING,
    Crew,
    Figures,
    Fleet,
    crew_of,
    failures,
    fleet_of,
    seas_of,
)
from rovtwin.campaign.tuning.parameters import Space, start_of, value_of, with_values
from rovtwin.campaign.tuning.result import Judged, Tuned, TuningRequest
from rovtwin.campaign.tuning.search import Search, population, search
from rovtwin.campaign.tuning.time_limit import Clock, least_seconds
from rovtwin.core.errors import ConfigError, RovtwinError
from rovtwin.runs.ensemble.plants import Plants, plants_of
from rovtwin.runs.interrupt import Interrupt
from rovtwin.scenario.schema import ModelBasedSection

Progress = Callable[[str, float], None]  # what is going on, share of it, 0 to 1
WRITING = 6.0  # what files and report take [s]


def tune(request: TuningRequest, progress: Progress = lambda *_: None) -> Tuned:
    """Search, choose, judge.

    Args:
        request: What is requested.
        progress: Told what is going on.

    Returns:
        The tuned autopilot with its verdict. Ctrl-C ends the search, and what was found is judged.

    Raises:
        ConfigError: The autopilot is not `model_based`, a number is out of range, the scenario cannot be composed, the
            hand-tuned autopilot fails throughout, or the budget is too short for a single generation.
        RovtwinError: Ctrl-C came before the first generation.
    """
    section = _checked(request)
    with crew_of(request.workers) as crew, Interrupt() as interrupt:
        return _Tuning(request, section, crew, progress, lambda: interrupt.asked).run()


def _checked(request: TuningRequest) -> ModelBasedSection:
    if request.scenario.mission is None:
        raise ConfigError(f"{request.scenario.name}: is a test, not a mission: it has no scores to tune for")
    section = start_of(request.scenario)
    if not request.budget > 0:
        raise ConfigError(f"--budget-s: found {request.budget:g}, expected more than 0 seconds; the usual is 170")
    numbers = (
        ("--plants", 1, request.plants),
        ("--held-out", 2, request.held_out),
        ("--evaluations", 1, request.evaluations),
    )
    for name, least, number in numbers:
        if number < least:
            raise ConfigError(f"{name}: found {number}, expected at least {least}")
    return section


class _Tuning:
    """One tuning under way."""

    def __init__(
        self,
        request: TuningRequest,
        section: ModelBasedSection,
        crew: Crew,
        progress: Progress,
        interrupted: Callable[[], bool],
    ):
        self.request, self.crew, self.progress, self.interrupted = request, crew, progress, interrupted
        self.clock, self.marks = Clock(request.budget), {}
        self.space = Space.around(request.tunables, section.model_copy(update={"tuned": None}))
        self.floors = floors_of(section)
        plants = plants_of(request.scenario)
        self.plants_text = plants.description
        self.generation = population(len(self.space.tunables))
        self.fleets = self._fleets(plants)
        self.hand: dict[int, list[Figures]] = {}  # scores of the hand-tuned autopilot
        self.judging = 0.0  # wall time of one autopilot over the held-out plants [s]
        self.pace = 0.0  # wall time of LANES flights of the search [s]

    def _fleets(self, plants: Plants) -> dict[int, Fleet]:
        request = self.request
        seas = seas_of(request.seas, request.scenario)
        self._step("composing", 0.0)
        counts = {TUNING: request.plants, CHOOSING: request.plants, HELD_OUT: request.held_out}
        return {
            stream: fleet_of(
                request.scenario, plants, seas, stream, n, request.seed, short=stream != HELD_OUT and not request.own
            )
            for stream, n in counts.items()
        }

    def _step(self, what: str, share: float) -> None:
        self.marks.setdefault(what, self.clock.gone)
        self.progress(what, share)

    def _flown(
        self, stream: int, sections: Sequence[ModelBasedSection], what: str, share: float | None = None
    ) -> list[list[Figures]]:
        """Scores by autopilot and plant; the first autopilot that a stream's plants fly is the hand-tuned one."""
        total, done = len(sections) * len(self.fleets[stream].runs), 0
        self._step(what, share or 0.0)

        def tell() -> None:
            nonlocal done
            done += 1
            self.progress(what, done / total if share is None else share)

        fleet = self.fleets[stream]
        flown = self.crew.fly(fleet, sections, tell)
        hand = self.hand.setdefault(stream, flown[0])
        return [fleet.excused(one, hand) for one in flown]

    def run(self) -> Tuned:
        """All steps."""
        self._compiled()
        cost, start_cost = self._scaled()
        held_out_before = self._hand_tuned()
        found = self._searched(cost)
        section, chosen = self._choose(cost, found)
        influence = self._influences(cost, section)
        held_out = self._judged(section, held_out_before)
        self._step("writing", 0.0)
        return Tuned(
            self.request,
            self.plants_text,
            section,
            cost,
            found,
            start_cost,
            chosen,
            influence,
            held_out,
            self._seconds(),
        )

    def _compiled(self) -> None:
        """What has to be compiled is compiled first, by one thread, if there is time for what comes after it."""
        self._step("compiling", 0.0)
        self.clock.require_start(WRITING)
        self.crew.compile([run for fleet in self.fleets.values() for run in fleet.runs])
        self.clock.require(*self._least())

    def _hand_tuned(self) -> list[Figures]:
        """The hand-tuned autopilot's held-out flights, if there is time for all that comes after them."""
        once = self.crew.rounds(len(self.fleets[HELD_OUT].runs)) * self._brief(HELD_OUT)
        what = "a single generation, choosing and judging"
        self.clock.require(2.0 * once + self._after() + self._lasting(self.generation), what)
        began = time.monotonic()
        before = self._flown(HELD_OUT, [self.space.section], "hand-tuned, held-out plants")[0]
        self.judging = time.monotonic() - began
        self.clock.require(self._after() + self._lasting(self.generation), what)
        return before

    def _least(self) -> tuple[float, str]:
        """Wall time of all that comes after compiling, at the least [s], and what that is."""
        n, generation = len(self.fleets[HELD_OUT].runs), self.generation
        judging = 2 * self.crew.rounds(n) * self._brief(HELD_OUT)
        text = f"flying {2 * n} held-out flights and a single generation of {generation}"
        return judging + self._flights_after() * self._brief(TUNING), text

    def _flights_after(self) -> int:
        """How often each thread flies LANES for: hand-tuned, one generation, choosing, putting back."""
        counts, each = (1, self.generation, 3, 1 + len(self.space.tunables)), len(self.fleets[TUNING].runs)
        return sum(self.crew.rounds(each * count) for count in counts)

    def _brief(self, stream: int) -> float:
        """Wall time of LANES of the stream's flights at the least [s]."""
        runs = self.fleets[stream].runs
        return least_seconds(runs) * self.crew.pace(runs[0])

    def _scaled(self) -> tuple[Cost, float]:
        """The cost in units of the hand-tuned autopilot, and what that costs; flown first, for it may fail."""
        fleet = self.fleets[TUNING]
        began = time.monotonic()
        figures = self._flown(TUNING, [self.space.section], "hand-tuned")[0]
        self.pace = time.monotonic() - began
        cost = Cost.against(self.request.weights, fleet.seas, figures, self.floors)
        start = float(np.mean(cost.all_of(fleet.seas, figures)))
        if start >= FAILED:
            raise ConfigError(
                f"{self.request.scenario.name}: no flight of the hand-tuned autopilot arrives, so there is nothing to "
                f"measure against. It failed on {failures(figures)}. Check the scenario with rovtwin fly"
                + ("" if set(fleet.seas) == {"calm"} else ", or try calmer seas (--sea calm)")
            )
        return cost, start

    def _left(self) -> float:
        """Time for the search [s]: the budget less what comes after."""
        return self.request.budget - self.clock.gone - self._after()

    def _after(self) -> float:
        """Wall time of what comes after the search [s]."""
        return self.judging + self._lasting(3) + self._lasting(1 + len(self.space.tunables)) + WRITING

    def _lasting(self, autopilots: int) -> float:
        """Wall time of so many autopilots over the plants of the search [s]."""
        return self.pace * self.crew.rounds(autopilots * len(self.fleets[TUNING].runs))

    def _searched(self, cost: Cost) -> Search:
        fleet, tried, began = self.fleets[TUNING], 0, time.monotonic()

        def out_of_time(points: int) -> bool:
            each = (time.monotonic() - began) / max(tried, 1)
            return self.interrupted() or (tried > 0 and self._left() < each * points)  # the first has its time

        def of(points: list[np.ndarray]) -> list[float]:
            nonlocal tried
            share = min(tried / self.request.evaluations, 1.0)
            flown = self._flown(TUNING, [self.space.at(x) for x in points], "searching", share)
            tried += len(points)
            return [float(np.mean(cost.all_of(fleet.seas, one))) for one in flown]

        found = search(
            of,
            self.space.start,
            self.space.bounds,
            seed=self.request.seed,
            evaluations=self.request.evaluations,
            out_of_time=out_of_time,
        )
        if not found.points and self.interrupted():
            raise RovtwinError("interrupted before anything was tried: nothing to write")
        return found

    def _choose(self, cost: Cost, found: Search) -> tuple[ModelBasedSection, tuple[str, float, float]]:
        """The cheapest of hand-tuned, best point and middle of the last generation, on plants of their own.

        The best point of a search was also lucky with its plants; the middle is less so.
        """
        fleet = self.fleets[CHOOSING]
        offered = {
            "the hand-tuned values": self.space.section,
            "the best point of the search": self.space.at(found.best),
            "the middle of the last generation": self.space.at(found.mean),
        }
        flown = self._flown(CHOOSING, list(offered.values()), "choosing")
        own = Cost.against(cost.weights, fleet.seas, flown[0], self.floors)
        costs = [float(np.mean(own.all_of(fleet.seas, one))) for one in flown]
        i = int(np.argmin(costs))
        return list(offered.values())[i], (list(offered)[i], costs[0], costs[i])

    def _influences(self, cost: Cost, section: ModelBasedSection) -> dict[str, float]:
        """What each parameter is worth: the cost with it put back, less the cost of the tuned ones."""
        fleet, start, names = self.fleets[TUNING], self.space.section, self.space.names
        if section == start:
            return dict.fromkeys(names, 0.0)
        back = [with_values(section, {name: value_of(start, name)}) for name in names]
        flown = self._flown(TUNING, [section, *back], "putting one back at a time")
        costs = [float(np.mean(cost.all_of(fleet.seas, one))) for one in flown]
        return {name: value - costs[0] for name, value in zip(names, costs[1:], strict=True)}

    def _judged(self, section: ModelBasedSection, before: list[Figures]) -> Judged:
        fleet = self.fleets[HELD_OUT]
        after = self._flown(HELD_OUT, [section], "tuned, held-out plants")[0]
        cost = Cost.against(self.request.weights, fleet.seas, before, self.floors)
        return Judged(fleet.seas, before, after, cost.all_of(fleet.seas, before), cost.all_of(fleet.seas, after))

    def _seconds(self) -> dict[str, float]:
        """How long each step took, and all of it."""
        names, ends = list(self.marks), [*list(self.marks.values())[1:], self.clock.gone]
        steps = {name: end - self.marks[name] for name, end in zip(names, ends, strict=True)}
        return steps | {"all": self.clock.gone}
