"""rovtwin watch: what has changed of a vehicle, from the logs of its runs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rovtwin.cli.output import DONE, FAILED, AsJson, console, emit, progress_bar, table
from rovtwin.core.errors import ConfigError

if TYPE_CHECKING:
    from rich.console import Console

    from rovtwin.commission.after.watching import Watched
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
    certificate: Annotated[
        Path | None,
        typer.Option(
            metavar="BUNDLE",
            help="A commissioning, its bundle or zip: each run is compared with what was certified, sensors too.",
        ),
    ] = None,
    prove: Annotated[
        bool,
        typer.Option(help="With --certificate: fly the missions of the proof again on the twin if something changed."),
    ] = True,
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

    With a certificate it says as well whether rates, delays and noise of sensors are still those of then, and whether
    the proven envelope still holds; exit code 1 where something is not as certified:

    [bold]rovtwin watch runs/today --certificate commissioned[/bold]
    """
    from rovtwin.runs.watch import watch_runs

    certified = None
    with progress_bar("{task.percentage:.0f} %") as bar:
        tasks: dict[str, Any] = {}

        def progress(name: str, share: float) -> None:
            if name not in tasks:
                tasks[name] = bar.add_task(name, total=1.0)
            bar.update(tasks[name], completed=share)

        if certificate is None:
            found = watch_runs(runs, vehicle, baseline, progress)
        else:
            certified = _certified(runs, certificate, vehicle, baseline, prove, progress)
            found = certified.watch
    page = None
    if output is not None:
        from rovtwin.report.studies.watch import write_watch

        page = write_watch(found, output, [] if certified is None else _lines(certified))
    if as_json:
        emit(_as_data(found, page) | ({} if certified is None else _certificate_data(certified)))
    else:
        _print(found, console(False))
        if certified is not None:
            _print_certified(certified, console(False))
        if page is not None:
            console(False).print(f"report: {page}", markup=False, soft_wrap=True)
    raise typer.Exit(DONE if certified is None or certified.good else FAILED)


def _certified(
    runs: list[Path], bundle: Path, vehicle: str | None, baseline: int | None, prove: bool, progress: Any
) -> "Watched":
    from rovtwin.commission.after.issued import issued
    from rovtwin.commission.after.watching import watch_certified

    for name, given in (("--vehicle", vehicle), ("--baseline", baseline)):
        if given is not None:
            raise ConfigError(f"{name} {given}: found --certificate beside it, which says what runs are compared with")
    with issued(bundle, lambda words, share: progress("the bundle's files", share)) as certificate:
        return watch_certified(runs, certificate, prove, progress)


def _lines(certified: "Watched") -> list[str]:
    """What there is to say beside the watch."""
    found = [f"certificate: {certified.certificate}"]
    for one, checks in zip(certified.watch.runs, certified.signals, strict=True):
        found += [f"{one.run.name}: {check}" for check in checks if check.verdict != "ok"]
    if certified.envelope is not None:
        found += [str(check) for check in certified.envelope.lines()]
    return [*found, "as certified" if certified.good else "NOT as certified"]


def _print_certified(certified: "Watched", screen: "Console") -> None:
    for line in _lines(certified):
        alarm = line.startswith(("stop", "warning", "NOT")) or ": warning" in line
        screen.print(line, style="bold red" if alarm else "", markup=False, soft_wrap=True)


def _certificate_data(certified: "Watched") -> dict[str, Any]:
    envelope = certified.envelope
    seas = {} if envelope is None else envelope.before
    return {
        "certificate": certified.certificate,
        "as_certified": certified.good,
        "sensors": [
            [{"verdict": c.verdict, "what": c.what, "text": c.text} for c in checks] for checks in certified.signals
        ],
        "envelope": None
        if envelope is None
        else {
            "holds": envelope.holds,
            "largest_currents": [
                {
                    "sea_m": sea,
                    "certified_m_s": then,
                    "unchanged_m_s": envelope.control.get(sea),
                    "now_m_s": envelope.after.get(sea),
                }
                for sea, then in seas.items()
            ],
            "cells": [cell.row() for cell in envelope.cells],
        },
    }


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
