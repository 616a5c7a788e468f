"""What a worker does: fly some samples of a campaign and say how they went."""

import time
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

from rovtwin._version import __version__
from rovtwin.campaign.rows import row_of, row_of_failure
from rovtwin.campaign.samples import draws, scenario_at
from rovtwin.campaign.schema import Campaign
from rovtwin.core.errors import ConfigError, RovtwinError
from rovtwin.core.trust import consent_to
from rovtwin.runs.batch import same_program, score_run, score_together
from rovtwin.runs.compose.composition import Simulation, compose
from rovtwin.runs.feasibility.mission import require_feasible

Row = dict[str, Any]


def fly_samples(
    text: str,
    indices: list[int],
    lanes: int,
    version: str,
    look: Callable[[], None] = lambda: None,
    consent: str = "",
) -> list[Row]:
    """Fly samples, side by side where one compiled program flies them all.

    Args:
        text: The complete campaign as JSON.
        indices: Of the samples.
        lanes: How many fly side by side; 1: one after the other, with the scores of `fly --replay` to the last bit.
        version: Of rovtwin where the results go to.
        look: Called about once a simulated second; what it raises ends the flight.
        consent: Where the results go to, to run code that the campaign names (`core/trust.py`).

    Returns:
        A row for each sample, in their order. A sample that cannot be flown has a row too, with the reason.

    Raises:
        ConfigError: This worker has another version: its results would not be those of the others.
    """
    if version != __version__:
        raise ConfigError(f"a worker has rovtwin {__version__}, expected {version}: install the same on all machines")
    consent_to(consent)
    campaign = _campaign(text)
    began, wall, cpu = time.time(), time.perf_counter(), time.process_time()
    rows: dict[int, Row] = {}
    runs: dict[int, Simulation] = {}
    for index in indices:
        try:
            run = compose(scenario_at(campaign, index))
            require_feasible(run.scenario, run.loop.twin.model)
            runs[index] = run
        except (RovtwinError, ArithmeticError, ValueError) as error:  # one bad sample must not ground the others
            rows[index] = row_of_failure(index, draws(campaign, index), _error_text(error))
    numbers = list(runs)
    for group in same_program(list(runs.values())):
        rows |= _fly_group(campaign, {numbers[i]: runs[numbers[i]] for i in group}, lanes, look)
    cost = {
        "lanes": lanes,
        "began": began,
        "wall_s": (time.perf_counter() - wall) / len(indices),
        "cpu_s": (time.process_time() - cpu) / len(indices),
    }
    return [rows[index] | cost for index in indices]


@lru_cache(maxsize=4)
def _campaign(text: str) -> Campaign:
    return Campaign.model_validate_json(text)


def _fly_group(campaign: Campaign, runs: dict[int, Simulation], lanes: int, look: Callable[[], None]) -> dict[int, Row]:
    """Rows of samples that one compiled program flies."""
    summaries: Sequence[dict[str, Any] | str]
    try:
        if lanes == 1:
            summaries = [score_run(run, lambda _: look(), short=0) for run in runs.values()]
        else:
            # Filled up to the full number, so that there is one program and not one for each size.
            padded = [*runs.values(), *[next(iter(runs.values()))] * (lanes - len(runs))]
            summaries = score_together(padded, lambda *_: look())[: len(runs)]
    except (RovtwinError, ArithmeticError, ValueError) as error:  # numpy's LinAlgError is a ValueError
        summaries = [_error_text(error)] * len(runs)
    rows = {}
    for index, summary in zip(runs, summaries, strict=True):
        drawn = draws(campaign, index)
        rows[index] = (
            row_of_failure(index, drawn, summary) if isinstance(summary, str) else row_of(index, drawn, summary)
        )
    return rows


def _error_text(error: Exception) -> str:
    text = str(error).splitlines()[0] if str(error) else type(error).__name__
    return text if isinstance(error, RovtwinError) else f"{type(error).__name__}: {text}"
