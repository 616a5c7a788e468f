"""A mission before it is flown: by the vehicle as it is known, then by vehicles as it may truly be."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from rovtwin.core.flow import NO_REASON, REASONS
from rovtwin.runs.compose.composition import Simulation, compose
from rovtwin.runs.compose.fitting import PATIENCE, travel
from rovtwin.runs.ensemble.course import LEFT, Course, times_of
from rovtwin.runs.ensemble.efforts import effort_of_flown
from rovtwin.runs.ensemble.exertion import Supply, margins
from rovtwin.runs.ensemble.flights import Progress, drawn, fly_each, fly_one
from rovtwin.runs.ensemble.plants import Plants, plants_of
from rovtwin.runs.loop import SHORT
from rovtwin.runs.run import CHUNK
from rovtwin.runs.scoring.contacts import FLOOR, beyond_walls, touched
from rovtwin.runs.scoring.depths import not_at_depth
from rovtwin.runs.scoring.headings import unmet_headings
from rovtwin.runs.scoring.scores import Flown, finished
from rovtwin.runs.scoring.summary import ending
from rovtwin.scenario.schema import Scenario

DRAWS, RANK = 39, 1  # the band of all 39 holds a 40th with 95 %
STREAM = 291  # of random numbers: no flight here is one of a tuning or of a commissioning
MORE_TIME = 60.0  # beside what the ways take at their speeds [s]


def as_known(scenario: Scenario) -> Scenario:
    """The scenario for the vehicle as its file describes it: nothing hidden is wrong with it, and nothing breaks.

    What the world adds in ballast stays: an operator trims a vehicle before a dive. The time limit is the mission's.
    """
    world = scenario.world.model_copy(update={"mismatch": None, "thruster_health": {}})
    scenario = scenario.model_copy(update={"world": world, "faults": [], "operator": [], "cameras": []})
    held = sum(point.hold_time for point in scenario.waypoints)
    longest = min(MORE_TIME + held + PATIENCE * travel(scenario), 86_400.0)
    return scenario.model_copy(update={"duration": longest})


@dataclass(frozen=True)
class Figures:
    """What is kept of a flight.

    Attributes:
        times: Of each way-point, see `course.times_of` [s].
        curves: The estimated path sampled along the course, `course.AXES`.
        place: North and east there [m].
        clearance: From the hull's lowest corner to the floor there [m]; None without a floor.
        margin: Least share of thrust left on the way to each way-point.
        used: Energy used when each way-point is left [J].
        left: Share of charge left then in the emptiest battery; None without one.
        whole: Energy of the whole flight [J].
        remains: Share left at its end; None without a battery.
        lasting: From the start to the end [s].
        effort: Along each axis, see `efforts`.
        aimed: Number of the way-point that was headed for last.
        ended: Why it did not complete the mission; empty where it did.
        touched: A line for each thing that the hull touched, see `contacts.touched`.
        unmet: Headings that were not kept.
        nearest: Least distance of the hull to each of walls and floor [m].
    """

    times: Float[np.ndarray, "count 4"]
    curves: Float[np.ndarray, "n 3"]
    place: Float[np.ndarray, "n 2"]
    clearance: Float[np.ndarray, " n"] | None
    margin: Float[np.ndarray, " count"]
    used: Float[np.ndarray, " count"]
    left: Float[np.ndarray, " count"] | None
    whole: float
    remains: float | None
    lasting: float
    effort: Float[np.ndarray, "6"]
    aimed: int
    ended: str
    touched: list[str]
    unmet: list[str]
    nearest: dict[str, float]

    @property
    def completed(self) -> int:
        """Way-points that were reached and left."""
        return int(np.sum(np.isfinite(self.times[:, LEFT])))


def figures_of(flown: Flown, run: Simulation, course: Course, supply: Supply, charge: float) -> Figures:
    """Of a flight of the twin that began with a charge, 0 to 1."""
    plant, dt = run.loop.twin.model, flown.control_dt
    times = times_of(flown.t, flown.mode, course.count)
    at = course.instants(times)
    used = supply.used(flown.thrust, dt)
    ticks = dt * np.arange(len(used))
    leaving = np.column_stack([np.interp(times[:, LEFT], ticks, one) for one in used.T])
    assert flown.pose is not None  # every recorder keeps it
    beyond = dict(beyond_walls(flown.pose, plant, run.loop.twin.world))
    floor = beyond.get(FLOOR)
    left = supply.left(leaving, charge)
    remains = supply.left(used[-1], charge)
    return Figures(
        times=times,
        curves=course.sampled(flown.t, flown.eta_hat, times),
        place=np.column_stack([np.interp(at, flown.t, flown.eta_hat[:, i]) for i in (0, 1)]),
        clearance=None if floor is None else -np.interp(at, ticks, floor),
        margin=margins(flown.thrust, dt, plant, times),
        used=leaving.sum(axis=1),
        left=left,
        whole=float(used[-1].sum()),
        remains=None if remains is None else float(remains),
        lasting=flown.duration,
        effort=effort_of_flown(flown, 0.0, flown.duration),
        aimed=int(np.clip(flown.mode[-1, 2], 0, course.count - 1)),
        ended=_ended(flown, run),
        touched=touched(flown, plant, run.loop.twin.world, False),
        unmet=[one.line for one in unmet_headings(flown, run.scenario)],
        nearest={name: float(-away.max()) for name, away in beyond.items()},
    )


def _ended(flown: Flown, run: Simulation) -> str:
    """Why a flight did not complete its mission, with the way-point; empty where it did."""
    if finished(flown):
        return not_at_depth(flown, run.scenario, run.model)
    _, reason, aimed, _ = (int(value) for value in flown.mode[-1])
    text = ending(flown, run, "" if reason == NO_REASON else REASONS[reason])
    return (
        text if "way-point" in text else f"{text}, on its way to way-point {aimed + 1} of {len(run.scenario.waypoints)}"
    )


class Rehearsal:
    """A mission composed, its flight as the vehicle is known, and those of drawn vehicles.

    Attributes:
        scenario: As it is flown, see `as_known`.
        base: It, composed.
        plants: What the drawn vehicles are drawn from.
        course: Its legs.
        supply: Its batteries.
        charge: Of them at the start, 0 to 1.
    """

    def __init__(self, scenario: Scenario, charge: float = 1.0):
        """Composes.

        Raises:
            ConfigError: The scenario cannot be composed, or has no way-points.
        """
        self.scenario, self.charge = as_known(scenario), charge
        self.base = compose(self.scenario)
        self.scenario = self.base.scenario
        self.plants: Plants = plants_of(self.scenario)
        self.supply = Supply.of(self.base.vehicle)
        places = [self.base.start.position, *(p.placed(self.scenario.origin) for p in self.scenario.waypoints)]
        self.course = Course.of(np.array([np.asarray(p, dtype=float) for p in places]), self.scenario.heading)

    def nominal(self, progress: Progress = lambda share: None) -> Figures:
        """The flight of the vehicle as it is known; the same as `rovtwin fly` makes of this scenario."""
        return self.figures(fly_one(self.base, progress), self.base)

    def drawn(
        self, progress: Progress = lambda share: None, count: int = DRAWS, short: Callable[[], int] = lambda: SHORT
    ) -> list[Figures]:
        """Flights of drawn vehicles, each with noise of its own; `progress` and `short` as of `fly_each`."""
        return fly_each([self.drawn_run(i) for i in range(count)], self.figures, progress, short)

    def drawn_run(self, number: int) -> Simulation:
        """The number-th drawn vehicle, ready to fly."""
        return drawn(self.base, self.plants, (self.scenario.seed, STREAM, number))

    def optimise(self) -> None:
        """Compile the optimised program, or find it kept: from then on flights are three times as fast."""
        brief = self.base.scenario.model_copy(update={"duration": CHUNK})
        fly_one(replace(self.base, scenario=brief), short=0)

    def figures(self, flown: Flown, run: Simulation) -> Figures:
        """Of a flight, and who flew it."""
        return figures_of(flown, run, self.course, self.supply, self.charge)
