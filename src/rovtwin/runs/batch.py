"""Many runs, scored, nothing written: one after the other, or side by side under vmap."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from rovtwin.core.arrays.flat import Layout
from rovtwin.core.numerics import jax, jnp
from rovtwin.runs.compose.composition import Simulation, compose
from rovtwin.runs.feasibility.mission import require_feasible
from rovtwin.runs.loop import SHORT, advance_batch, stack, start_batch
from rovtwin.runs.recording.recorder import Recorder
from rovtwin.runs.run import CHUNK, chunks, ticks_in, until_the_end
from rovtwin.runs.scoring.scores import Flown, nees_interval
from rovtwin.runs.scoring.summary import summarise
from rovtwin.scenario.schema import Scenario

FEW = 16  # runs of one program: to optimise it takes 25 s, and a mission of 180 s flies 1.5 s sooner then
Progress = Callable[[float, str], None]  # share of the work done, 0 to 1, and what is going on


def _nothing(*_: Any) -> None:
    """For those who need not know how far it is."""


def score_seeds(scenario: Scenario, seeds: Sequence[int], progress: Progress = _nothing) -> list[dict[str, Any]]:
    """Fly one scenario with several seeds, one after the other; on a processor this is the faster way.

    Args:
        scenario: What to fly; its own seed does not count.
        seeds: One run each.
        progress: Called about once a simulated second.

    Returns:
        The summary of each run, in the order of the seeds.

    Raises:
        ConfigError: It cannot be composed, or the vehicle can do nothing useful of its mission.
    """
    results, short = [], SHORT if len(seeds) <= FEW else 0
    for i, seed in enumerate(seeds):
        run = _feasible(scenario, seed)
        results.append(
            {"seed": seed}
            | score_run(run, lambda share, i=i, seed=seed: progress((i + share) / len(seeds), f"seed {seed}"), short)
        )
    return results


def _feasible(scenario: Scenario, seed: int) -> Simulation:
    """The scenario composed with a seed.

    Raises:
        ConfigError: It cannot be, or the vehicle can do nothing useful of its mission.
    """
    run = compose(scenario.model_copy(update={"seed": seed}))
    require_feasible(run.scenario, run.loop.twin.model)
    return run


def score_run(run: Simulation, progress: Callable[[float], None] = _nothing, short: int = SHORT) -> dict[str, Any]:
    """Fly one run; its summary, which is that of `fly` with the same `short` to the last bit.

    Args:
        run: Composed scenario.
        progress: Called about once a simulated second with the share of the work done, 0 to 1.
        short: From this tick on the program is optimised; 0 for many runs of one program, which are over sooner so.
    """
    scenario = run.scenario
    recorder = Recorder(scenario)
    for record in chunks(run.loop, run.key, run.start, scenario.control_dt, scenario.duration, short):
        recorder.take(record)
        progress(recorder.seconds / scenario.duration)
    progress(1.0)
    return summarise(recorder.flown(), run, interrupted=False)


def score_batch(scenario: Scenario, seeds: Sequence[int], progress: Progress = _nothing) -> list[dict[str, Any]]:
    """The same with all seeds side by side: the loop under vmap, as on a GPU. It compiles longer.

    Arguments and result are those of `score_seeds`.
    """
    runs = [_feasible(scenario, seed) for seed in seeds]

    def report(share: float, flying: int) -> None:
        progress(share, f"{flying} of {len(seeds)} still flying")

    return [{"seed": seed} | one for seed, one in zip(seeds, score_together(runs, report), strict=True)]


def same_program(runs: Sequence[Simulation]) -> Iterator[list[int]]:
    """Numbers of the runs that one compiled program flies: those that differ in nothing but numbers."""
    groups: dict[Any, list[int]] = {}
    for i, run in enumerate(runs):
        groups.setdefault((Layout(run.loop), run.scenario.control_dt), []).append(i)
    yield from groups.values()


def score_together(
    runs: Sequence[Simulation], progress: Callable[[float, int], None] = _nothing
) -> list[dict[str, Any]]:
    """Fly runs of one program side by side under vmap; scores agree with `score_run` to rounding.

    Arguments are those of `flown_together`.

    Returns:
        The summary of each.
    """
    flown = flown_together(runs, progress)
    return [summarise(one, run, interrupted=False) for run, one in zip(runs, flown, strict=True)]


def flown_together(runs: Sequence[Simulation], progress: Callable[[float, int], None] = _nothing) -> list[Flown]:
    """Fly runs of one program side by side under vmap.

    Args:
        runs: Of one group of `same_program`; each is as long as its own scenario says.
        progress: Called once a simulated second with the share of the work done, 0 to 1, and how many still fly.

    Returns:
        What scores need of each.
    """
    dt = runs[0].scenario.control_dt
    recorders = [Recorder(run.scenario) for run in runs]
    totals = [ticks_in(run.scenario.duration, dt) + 1 for run in runs]
    loops, keys, starts = stack([(run.loop, run.key, run.start) for run in runs])
    memories = start_batch(loops, keys, starts, control_dt=dt)
    ticks, total = ticks_in(CHUNK, dt), max(totals)
    flying = set(range(len(runs)))
    for k in range(0, total, ticks):
        memories, records = advance_batch(loops, memories, jnp.asarray(k), ticks=ticks, control_dt=dt)
        records = jax.device_get(records)
        for i in sorted(flying):
            kept, over = until_the_end(jax.tree.map(lambda leaf, i=i: leaf[i], records), totals[i] - k)
            recorders[i].take(kept)
            if over:
                flying.discard(i)
        progress((k + ticks) / total if flying else 1.0, len(flying))
        if not flying:
            break
    return [recorder.flown() for recorder in recorders]


COLUMNS = (
    "done",
    "cross-track\nrms / max [m]",
    "depth\nrms [m]",
    "time\n[s]",
    "error\n[m]",
    "bound\n[m]",
    "NEES",
    "if consistent\n(samples)",
    "saturated",
    "effort\n[N2 s]",
)


def table_row(runs: list[dict[str, Any]]) -> list[str]:
    """A row of the table of scores under COLUMNS: means over the runs, the largest of the maxima.

    A run that stays at one place has its distance from there instead of the cross-track distance, and says so. NEES
    stands beside the interval of its mean over these runs if the filter were consistent, and the effective number of
    samples.
    """
    done = sum(run["completed"] for run in runs)
    path = "station" if any(run["station_rms_m"] is not None for run in runs) else "cross_track"
    largest = [run[f"{path}_max_m"] for run in runs if run[f"{path}_max_m"] is not None]
    low, high = nees_interval(runs)
    return [
        f"{done}/{len(runs)}",
        f"{mean_over(runs, f'{path}_rms_m'):.2f} / {max(largest, default=float('nan')):.2f}"
        + (" off its place" if path == "station" else ""),
        f"{mean_over(runs, 'depth_rms_m'):.3f}",
        f"{mean_over(runs, 'duration_s'):.0f}",
        f"{mean_over(runs, 'position_error_rms_m'):.3f}",
        f"{mean_over(runs, 'bound_position_m'):.3f}",
        f"{mean_over(runs, 'nees_position_mean'):.3g}",
        f"{low:.2f} to {high:.2f} ({sum(run['nees_effective_samples'] or 0 for run in runs):.0f})",
        f"{100 * mean_over(runs, 'saturated_share'):.1f} %",
        f"{mean_over(runs, 'effort_n2s'):.0f}",
    ]


def mean_over(scores: list[dict[str, Any]], name: str) -> float:
    """Mean of a figure over the runs that have it; of a per-axis figure the root mean square over axes first."""
    values = [s[name] for s in scores if s[name] is not None]
    flat = [float(np.sqrt(np.mean(np.square(v)))) if isinstance(v, list) else float(v) for v in values]
    return float(np.mean(flat)) if flat else float("nan")
