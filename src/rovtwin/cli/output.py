"""What all commands share: where output goes, how figures are shown, how errors are said."""

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from rovtwin.core.errors import ConfigError, exists_already
from rovtwin.core.user_files.jsontext import to_json

AsJson = Annotated[bool, typer.Option("--json", help="One machine-readable object on standard output.")]

Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace what is there.")]

DONE, FAILED = 0, 1


def check_free(path: Path, overwrite: bool) -> None:
    """That nothing is at a path that is about to be written, before the work begins.

    Raises:
        ConfigError: There is.
    """
    if path.exists() and not overwrite:
        raise ConfigError(exists_already(path, "--overwrite"))


def refuse_idle(given: Mapping[str, bool], why: str) -> None:
    """That no option is given which would do nothing.

    Args:
        given: By option, whether it is.
        why: What it would take, or why nothing can come of it.

    Raises:
        ConfigError: One is.
    """
    if idle := [option for option, there in given.items() if there]:
        raise ConfigError(f"{', '.join(idle)}: nothing would come of it: {why}")


def progress_bar(counter: str) -> Progress:
    """A bar with description, counter (rich markup) and time so far, on standard error; it goes away at the end."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn(counter),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
    )


def console(as_json: bool) -> Console:
    """For people: standard output, or standard error when standard output is for a machine."""
    screen = Console(stderr=as_json, highlight=False)
    if not screen.is_terminal and "COLUMNS" not in os.environ:
        screen.width = 120  # a file or a pipe has no edge to wrap at
    return screen


def emit(data: Any) -> None:
    """One JSON object on standard output."""
    sys.stdout.write(to_json(data) + "\n")


def report_error(error: Exception, as_json: bool) -> None:
    """The message on standard error, and as an object on standard output if asked."""
    print(f"rovtwin: {error}", file=sys.stderr)
    if as_json:
        emit({"error": str(error), "kind": type(error).__name__})


def figure(value: Any, unit: str = "") -> str:
    """A number for people: 3 significant digits, a dash for none."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return " / ".join(figure(v) for v in value) + (f" {unit}" if unit else "")
    if isinstance(value, float):
        text = f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}" if abs(value) < 1e6 else f"{value:.2e}"
        return f"{text} {unit}".strip()
    return f"{value} {unit}".strip()


def table(title: str, *columns: str) -> Table:
    """An empty table in the house's style: first column left, the others right."""
    out = Table(
        title=escape(title), title_justify="left", title_style="bold", box=None, pad_edge=False, header_style="dim"
    )
    for i, name in enumerate(columns):
        out.add_column(escape(name), justify="left" if i == 0 else "right", no_wrap=i == 0)
    return out
