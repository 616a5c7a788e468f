"""Flights of one scenario by vehicles as they may truly be, side by side on all cores."""

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from rovtwin.core.processes.cores import cores_here
from rovtwin.core.user_files.config import parse
from rovtwin.runs.batch import flown_together, same_program
from rovtwin.runs.compose.composition import Simulation, keys_of, start_of
from rovtwin.runs.compose.world import plant_of, world_of
from rovtwin.runs.ensemble.plants import Plants
from rovtwin.runs.loop import SHORT
from rovtwin.runs.recording.recorder import Recorder
from rovtwin.runs.run import CHUNK, chunks
from rovtwin.runs.scoring.scores import Flown
from rovtwin.scenario.schema import WorldSection

LANES = 10  # flights under vmap: half the time of one by one, and a generation of a tuning has so many of each plant
LOOK = 0.5  # between looks at how far the flights are [s]
T = TypeVar("T")
Progress = Callable[[float], None]  # share of the flights done, 0 to 1


def drawn(base: Simulation, plants: Plants, stream: Sequence[int], world: dict[str, Any] | None = None) -> Simulation:
    """A flight of a vehicle, with noise and (by `world`) water, drawn from a stream of random numbers.

    What the autopilot is made of is taken over: it does not know what is drawn, and takes a second to derive.

    Args:
        base: Composed scenario; its tethers, batteries and forces of one's own, had it any, would stay as they are.
        plants: What the true vehicle is drawn from.
        stream: Seed, and numbers of cell and flight.
        world: Section in place of the scenario's.
    """
    rng, scenario = np.random.default_rng(list(stream)), base.scenario
    changed: dict[str, Any] = {"seed": int(rng.integers(2**31))}
    if world is not None:
        changed["world"] = parse(WorldSection, world, scenario.name)
    scenario = scenario.model_copy(update=changed)
    key_plant, key_run = keys_of(scenario.seed)
    plant = plant_of(scenario.world, base.vehicle, base.model, key_plant, plants.drawn(rng))
    twin = replace(base.loop.twin, model=plant, world=world_of(scenario.world))
    loop = replace(base.loop, twin=twin)
    return replace(base, scenario=scenario, loop=loop, key=key_run, start=start_of(scenario, plant))


def fly_all(runs: Sequence[Simulation], progress: Progress = lambda share: None) -> list[Flown]:
    """What scores need of each flight, in their order; LANES of one program side by side in each thread.

    Args:
        runs: Ready to fly.
        progress: Called now and then from this thread; what it raises ends all.
    """
    portions = [group[i : i + LANES] for group in same_program(runs) for i in range(0, len(group), LANES)]

    def fly(portion: Sequence[int], look: Progress) -> list[Flown]:
        several = [runs[i] for i in portion]
        full = [*several, *[several[-1]] * (LANES - len(several))]  # one shape, one program
        return flown_together(full, lambda share, flying: look(share))[: len(several)]

    _compile([runs[portion[0]] for portion in portions])
    return _in_threads(portions, fly, progress)


def fly_each(
    runs: Sequence[Simulation],
    then: Callable[[Flown, Simulation], T],
    progress: Progress = lambda share: None,
    short: Callable[[], int] = lambda: SHORT,
) -> list[T]:
    """What `then` makes of each flight, in their order; one by one in each thread.

    Args:
        runs: Ready to fly.
        then: Called in the thread that flew; the flight itself is not kept.
        progress: Called now and then from this thread; what it raises ends all.
        short: From which tick on a flight that begins now is flown by the optimised program, see `loop.SHORT`.
    """

    def fly(portion: Sequence[int], look: Progress) -> list[T]:
        return [then(fly_one(runs[i], look, short()), runs[i]) for i in portion]

    return _in_threads([[i] for i in range(len(runs))], fly, progress)


def fly_one(run: Simulation, progress: Progress = lambda share: None, short: int = SHORT) -> Flown:
    """One flight, that of `rovtwin fly`; arguments as of `fly_each`."""
    scenario, recorder = run.scenario, Recorder(run.scenario)
    for record in chunks(run.loop, run.key, run.start, scenario.control_dt, scenario.duration, short):
        recorder.take(record)
        progress(min(recorder.seconds / scenario.duration, 1.0))
    return recorder.flown()


def _in_threads(
    portions: Sequence[Sequence[int]], fly: Callable[[Sequence[int], Progress], list[T]], progress: Progress
) -> list[T]:
    """What `fly` gives of the flights of all portions, in the order of their numbers."""
    shares, ended = [0.0] * len(portions), threading.Event()

    def work(number: int) -> list[T]:
        def look(share: float) -> None:
            shares[number] = share
            if ended.is_set():
                raise InterruptedError

        results = fly(portions[number], look)
        shares[number] = 1.0
        return results

    results: dict[int, T] = {}
    with ThreadPoolExecutor(cores_here()) as pool:
        flying = {pool.submit(work, number): portion for number, portion in enumerate(portions)}
        try:
            waiting = set(flying)
            while waiting:
                done, waiting = wait(waiting, timeout=LOOK, return_when=FIRST_COMPLETED)
                for future in done:
                    results |= dict(zip(flying[future], future.result(), strict=True))
                progress(sum(shares) / len(shares))
        finally:
            ended.set()  # Ctrl-C and errors end the other threads, too
            pool.shutdown(cancel_futures=True)
    return [results[i] for i in range(len(results))]


def _compile(firsts: Sequence[Simulation]) -> None:
    """Fly a second with each program, so that threads find it compiled and don't all compile it."""
    for group in same_program(firsts):
        one = firsts[group[0]]
        brief = replace(one, scenario=one.scenario.model_copy(update={"duration": CHUNK}))
        flown_together([brief] * LANES)
