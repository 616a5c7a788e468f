"""rovtwin verify: every file of a commissioning's bundle against its hash, and the figures derived again."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from rovtwin.cli.output import DONE, FAILED, AsJson, console, emit, figure, progress_bar, table

if TYPE_CHECKING:
    from rovtwin.commission.certified.verify import Verified

SHOWN = 12  # parameters that are listed where all agree; those that do not are listed all


def verify(
    bundle: Annotated[
        Path,
        typer.Argument(metavar="BUNDLE", help="A bundle, its zip, or a commissioning: its last."),
    ],
    quick: Annotated[
        bool, typer.Option("--quick", help="Only hashes and versions: derive nothing again, which takes minutes.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Check what a commissioning left: every file against its hash, and the figures derived again on this machine.

    Files that differ, are missing or were added are named, and software of another version. Then the identification is
    made once more from the logs in the bundle; each parameter has to come out as certified within a twentieth of its
    standard deviation. Exit code 1 where anything is otherwise.

    The seal is the one on the signed certificate if nothing was changed: a bundle vouches for its own files, the paper
    for the bundle.

    Example: [bold]rovtwin verify commissioned[/bold], or what somebody sent: [bold]rovtwin verify bundle.zip[/bold]
    """
    from rovtwin.commission.certified.verify import verify as check

    screen = console(as_json)
    with progress_bar("") as bar:
        task = bar.add_task("reading", total=1.0)
        found = check(bundle, quick, lambda words, share: bar.update(task, description=words, completed=share))
    if as_json:
        emit(as_object(found))
    else:
        _print(screen, found)
    raise typer.Exit(DONE if found.good else FAILED)


def _print(screen: Console, found: "Verified") -> None:
    def say(line: str, style: str = "") -> None:
        screen.print(line, style=style, markup=False, soft_wrap=True)

    manifest = found.manifest
    say(f"{manifest.vehicle}, certified {manifest.issued} by rovtwin {manifest.versions.get('rovtwin', '?')}")
    if found.seal == manifest.seal:
        say(f"seal {found.seal}")
    else:
        say(f"seal {found.seal or 'none: files are missing or have another size'}", "bold red")
        say(f"     expected {manifest.seal}", "bold red")
    for one in found.findings:
        say(str(one), "bold red")
    if not found.findings:
        say(f"{len(manifest.files)} files: each is as its hash says", "green")
    for one in manifest.left_out:
        say(f"never in it: {one.path}: {one.why}", "dim")
    for line in found.versions:
        say(f"version: {line}", "dim")
    _print_rows(screen, found)
    if found.contradiction:
        say(f"not derived: {found.contradiction}", "bold red")
    elif found.not_derived:
        say(f"not derived again: {found.not_derived}", "yellow")
    say(_last_line(found), "bold green" if found.good else "bold red")


def _last_line(found: "Verified") -> str:
    if not found.good:
        return "NOT VERIFIED: this is not what was certified"
    return "VERIFIED: files and figures" if found.rows else "VERIFIED: files; no figure was derived again"


def _print_rows(screen: Console, found: "Verified") -> None:
    from rovtwin.commission.certified.again import TOLERANCE

    if not found.rows:
        return
    shown = table("derived again", "parameter", "unit", "certified", "here", "apart [sd]", "width")
    rows = sorted(found.off or found.rows, key=lambda row: -abs(row.apart))
    for row in rows if found.off else rows[:SHOWN]:
        figures = (figure(row.given), figure(row.found), f"{row.apart:+.4f}", f"{100 * row.wider:+.1f} %")
        shown.add_row(row.name, row.unit, *figures)
    screen.print(shown)
    worst = max(abs(row.apart) for row in found.rows)
    words = (
        f"{len(found.rows)} parameters, {len(found.off)} otherwise; the farthest {worst:.2g} sd, within {TOLERANCE:g}"
    )
    screen.print(words, style="green" if not found.off else "bold red", markup=False, soft_wrap=True)


def as_object(found: "Verified") -> dict[str, Any]:
    """For --json."""
    manifest = found.manifest
    return {
        "verified": found.good,
        "vehicle": manifest.vehicle,
        "issued": manifest.issued,
        "seal": found.seal,
        "certified_seal": manifest.seal,
        "files": len(manifest.files),
        "findings": [{"kind": one.kind, "path": one.path, "text": one.text} for one in found.findings],
        "versions": list(found.versions),
        "derived": [
            {
                "name": row.name,
                "unit": row.unit,
                "certified": row.given,
                "here": row.found,
                "apart_sd": row.apart,
                "width_change": row.wider,
                "same": row.same,
            }
            for row in found.rows
        ],
        "not_derived": found.not_derived or found.contradiction,
    }
