"""rovtwin thesis: the identification results of the 2021 Double Blueye thesis, derived again from its own data."""

from pathlib import Path
from typing import Annotated, Any

import typer

from rovtwin.cli.output import DONE, AsJson, console, emit, table

Output = Annotated[
    Path | None,
    typer.Option("--output", "-o", help="Folder for the report; runs/thesis unless given.", metavar="FOLDER"),
]
NoReport = Annotated[bool, typer.Option("--no-report", help="Print the tables, write no report.")]

TITLE = "Double Blueye: the thesis's identification, derived again"
CAPTION = "Bands: 95 % of the corrected curve."


def thesis(output: Output = None, no_report: NoReport = False, as_json: AsJson = False) -> None:
    """Derive every identification table of the 2021 Double Blueye thesis again, from the data that it prints.

    Published, derived from its own data by its own formula, corrected, and why they differ. Takes about 10 s.

    Examples: [bold]rovtwin thesis[/bold], [bold]rovtwin thesis -o thesis_again[/bold],
    [bold]rovtwin thesis --json --no-report[/bold]
    """
    from rich.progress import Progress, SpinnerColumn, TextColumn

    from rovtwin.core.errors import ConfigError
    from rovtwin.identification.thesis import rederive

    if output is not None and output.exists() and not output.is_dir():
        raise ConfigError(f"{output}: is a file, expected a folder for the report")
    screen = console(as_json)
    with Progress(SpinnerColumn(), TextColumn("{task.description}"), console=screen, transient=True) as progress:
        task = progress.add_task("deriving")
        study = rederive(lambda done: progress.update(task, description=done))
        page = None
        if not no_report:
            from rovtwin.report.evidence.derivation import write_derivation

            progress.update(task, description="drawing the report")
            page = write_derivation(study, output or Path("runs/thesis"), TITLE, CAPTION)
    if as_json:
        emit({"sections": [_section(s) for s in study.sections], "report": None if page is None else str(page)})
        raise typer.Exit(DONE)
    for section in study.sections:
        _print(screen, section)
    if page is not None:
        screen.print(f"report: {page}", markup=False)


def _section(section: Any) -> dict[str, Any]:
    from dataclasses import asdict

    return {
        "key": section.key,
        "title": section.title,
        "lines": [asdict(line) for line in section.lines],
        "remarks": list(section.remarks),
    }


def _print(screen: Any, section: Any) -> None:
    from rovtwin.report.evidence.derivation import digits

    reasons: list[str] = []
    rows = table(section.title, "quantity", "unit", "thesis", "published", "derived", "corrected", "why")
    for k, column in enumerate(rows.columns):
        column.no_wrap = k > 2  # on a narrow screen names wrap, numbers do not
    for line in section.lines:
        if line.reason and line.reason not in reasons:
            reasons.append(line.reason)
        why = str(reasons.index(line.reason) + 1) if line.reason else ""
        rows.add_row(line.name, line.unit, str(line.where).split(",")[0], digits(line.published), digits(line.derived),
                     digits(line.corrected, line.sd), why)  # fmt: skip
    screen.print(rows)
    for number, reason in enumerate(reasons, start=1):
        screen.print(f"  {number}. {reason}", markup=False, style="dim")
    for remark in section.remarks:
        screen.print(f"  {remark}", markup=False)
    screen.print()
