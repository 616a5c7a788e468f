"""rovtwin watch: what has changed of a vehicle, from the logs of its runs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rovtwin.cli.output import DONE, AsJson, console, emit, progress_bar, table

if TYPE_CHECKING:
    from rich.console import Console

    from rovtwin.runs.watch import Watch


def watch(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN...", help="Folders of runs, or logs, the oldest first: any log that identify reads."
        ),
    ],
    vehicle: Annotated[
        str | None,
        typer.Option(metavar="VEHICLE", help="Description that all are compared with; else the first run's."),
    ] = None,
    baseline: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="The first N runs are what later ones are compared with; else 3, or all but the last.",
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FOLDER", help="Write an HTML report with figures.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Report what has changed of a vehicle: drag, added mass, forces, top speed, buoyancy, each with its error.

    A filter goes over each log with the parameters of the description, and its innovations show by which factors
    these are off. No test is needed: any run with turns, dives and legs at speed will do.

    One run is compared with the identification of the vehicle, several with the first of them:

    [bold]rovtwin watch runs/today[/bold]

    [bold]rovtwin watch runs/monday runs/tuesday runs/wednesday runs/today -o watch[/bold]

    [bold]rovtwin watch --vehicle bluerov2_heavy 00000041.BIN 00000042.BIN[/bold]
    """
    from rovtwin.runs.watch import watch_runs

    with progress_bar("{task.percentage:.0f} %") as bar:
        tasks: dict[str, Any] = {}

        def progress(name: str, share: float) -> None:
            if name not in tasks:
                tasks[name] = bar.add_task(name, total=1.0)
            bar.update(tasks[name], completed=share)

        found = watch_runs(runs, vehicle, baseline, progress)
    page = None
    if output is not None:
        from rovtwin.report.studies.watch import write_watch

        page = write_watch(found, output)
    if as_json:
        emit(_as_data(found, page))
    else:
        _print(found, console(False))
        if page is not None:
            console(False).print(f"report: {page}", markup=False, soft_wrap=True)
    raise typer.Exit(DONE)


def _print(found: "Watch", screen: "Console") -> None:
    screen.print(_table(found))
    for text, changed in found.words():
        screen.print(text, style="bold red" if changed else "", markup=False, soft_wrap=True)


def _table(found: "Watch") -> Any:
    """What the newest run has learnt, and what it is compared with."""
    newest, before = found.runs[-1], found.before
    title = f"{newest.run.name}: {newest.seconds:.0f} s, against the description {found.vehicle.name}"
    head = ["quantity", "this run", *([] if before is None else ["before", "difference, in std"])]
    rows = table(title, *head)
    unknown = []
    for i, reading in enumerate(newest.run.readings):
        if not reading.learnt:
            unknown.append(reading.quantity.words.rstrip(","))
            continue
        cells = [reading.quantity.words.rstrip(","), reading.figures]
        if before is not None:
            known = reading.with_values(float(before.value[i]), float(before.std[i]))
            z = (reading.value - known.value) / (reading.std**2 + known.std**2) ** 0.5
            cells += [known.figures, "–"] if known.std != known.std else [known.figures, f"{z:+.1f}"]
        rows.add_row(*cells)
    if unknown:
        rows.caption = f"not learnt in this run: {', '.join(unknown)}"
        rows.caption_justify = "left"
    return rows


def _as_data(found: "Watch", page: Path | None) -> dict[str, Any]:
    from rovtwin.monitoring.change import causes

    runs = [
        {
            "run": one.run.name,
            "log": str(one.path),
            "seconds": one.seconds,
            "quantities": {
                r.quantity.name: {"value": r.value, "std": r.std, "unit": r.quantity.unit, "learnt": r.learnt}
                for r in one.run.readings
            },
            "changed": [
                {"quantity": c.reading.quantity.name, "difference": c.difference.value, "std": c.std, "z": c.z}
                for c in changed
            ],
            "causes": [lost.look for lost in one.lost] + causes(changed),
            "lost_thrusters": [{"thruster": lost.name, "since": lost.since, "left": lost.left} for lost in one.lost],
            "first_learnt": [c.reading.quantity.name for c in new],
            "notes": list(one.notes),
        }
        for one, changed, new in zip(found.runs, found.changes, found.first_learnt, strict=True)
    ]
    drifts = [{"quantity": d.reading.quantity.name, "a_run": d.slope, "std": d.std} for d in found.drifts]
    return {
        "vehicle": found.vehicle.name,
        "against": found.against,
        "baseline_runs": found.first,
        "runs": runs,
        "drifts": drifts,
        "report": None if page is None else str(page),
    }
