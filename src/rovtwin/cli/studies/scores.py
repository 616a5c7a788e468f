"""rovtwin score: scenarios over many seeds."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from rovtwin.cli.output import DONE, FAILED, AsJson, console, emit, progress_bar, refuse_idle, table
from rovtwin.cli.scenarios import Overrides
from rovtwin.core.errors import ConfigError

if TYPE_CHECKING:
    pass


def score(
    scenarios: Annotated[list[str] | None, typer.Argument(help="Scenarios; default all that are shipped.")] = None,
    seeds: Annotated[str, typer.Option(help="Seeds, such as 1-10 or 3,5,8.")] = "1-10",
    vehicle: Annotated[str | None, typer.Option(help="Vehicle to fly them with; default the scenario's.")] = None,
    autopilot: Annotated[
        str | None, typer.Option(help="model_based, thesis, thesis_placed, thesis_as_printed; default the scenario's.")
    ] = None,
    overrides: Overrides = None,
    batch: Annotated[bool, typer.Option("--batch", help="All seeds side by side under vmap, as on a GPU.")] = False,
    as_json: AsJson = False,
) -> None:
    """Fly scenarios over many seeds and print the table of scores; nothing is written.

    Exit code 1 if any run did not complete.
    """
    from rovtwin.scenario.files import list_scenarios, load_scenario
    from rovtwin.scenario.seeds import parse_seeds

    numbers = parse_seeds(seeds)
    given = {"vehicle": vehicle, "autopilot": autopilot}
    keys = {text.partition("=")[0].strip() for text in overrides or ()}
    twice = {f"--{key} {value}": value is not None and key in keys for key, value in given.items()}
    refuse_idle(twice, "--set gives the same; leave one of them out")
    extra = [*(f"{key}={value}" for key, value in given.items() if value), *(overrides or ())]
    loaded = {name: load_scenario(name, extra) for name in scenarios or list_scenarios()}
    tests = [name for name, scenario in loaded.items() if scenario.test]
    if scenarios and tests:
        raise ConfigError(f"{tests[0]}: is a test, not a mission: it has no scores. Fly it: rovtwin fly {tests[0]}")
    loaded = {name: scenario for name, scenario in loaded.items() if name not in tests}
    results = {}
    with progress_bar("") as bar:
        for label, scenario in loaded.items():
            task = bar.add_task(f"{label}: compiling", total=1.0)
            from rovtwin.runs.batch import score_batch, score_seeds

            def progress(share: float, what: str, task: Any = task, name: str = label) -> None:
                bar.update(task, completed=share, description=f"{name}: {what}")

            results[label] = (score_batch if batch else score_seeds)(scenario, numbers, progress)
    screen = console(as_json)
    if screen.width < 110:
        screen.width = 110  # broken lines of a table are easier to read than broken words
    title = ", ".join([*(f"{key} {value}" for key, value in given.items() if value), f"seeds {seeds}"])
    screen.print(_score_table(results, title))
    for line in _why_not(results, numbers):
        screen.print(line, markup=False, soft_wrap=True)
    if as_json:
        emit({**given, "seeds": numbers, "scenarios": results})
    completed = all(run["completed"] for runs in results.values() for run in runs)
    raise typer.Exit(DONE if completed else FAILED)


def _why_not(results: dict[str, list[dict[str, Any]]], seeds: list[int]) -> list[str]:
    """A line for each reason for which runs did not complete, with their seeds."""
    lines = []
    for name, runs in results.items():
        missed = [
            (run.get("reason") or "not finished in time", n)
            for run, n in zip(runs, seeds, strict=True)
            if not run["completed"]
        ]
        for reason in dict.fromkeys(reason for reason, _ in missed):
            those = ", ".join(str(n) for other, n in missed if other == reason)
            lines.append(f"{name}, seed {those}: not completed: {reason}")
    return lines


def _score_table(results: dict[str, list[dict[str, Any]]], title: str) -> Any:
    from rovtwin.runs.batch import COLUMNS, table_row

    rows = table(title, "scenario", *COLUMNS)
    for name, runs in results.items():
        row = table_row(runs)
        rows.add_row(name, *(cell.replace("nan", "–") for cell in row))
    return rows
