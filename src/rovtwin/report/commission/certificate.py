"""The certificate of a commissioning as one HTML page: its first sheet has the figures, the rest is the appendix."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from rovtwin.core.user_files.quantity import is_number, named_unit
from rovtwin.report.parts.page import write_page
from rovtwin.report.parts.tables import Table, text, words
from rovtwin.report.parts.verdict import Verdict

MOST_ROWS = 200  # of a table in the appendix
State = Literal["go", "no-go", "cut off"]
INTERVAL = "interval_95"


@dataclass(frozen=True)
class CheckLine:
    """A line of a stage's page: ok, note, warning or stop; what was checked, what was found, what to do about it."""

    verdict: str
    what: str
    text: str
    fix: str = ""


@dataclass(frozen=True)
class AttemptPage:
    """One attempt at a stage.

    Attributes:
        number: From 1.
        began: UTC.
        state: How it ended.
        seconds: Of the vehicle's time.
        checks: Its lines.
        tables: What it measured.
        files: Written by it.
        skipped: What later stages do without, "" if nothing.
    """

    number: int
    began: str
    state: State
    seconds: float = 0.0
    checks: tuple[CheckLine, ...] = ()
    tables: tuple[Table, ...] = ()
    files: tuple[str, ...] = ()
    skipped: str = ""


@dataclass(frozen=True)
class StagePage:
    """A stage with all attempts at it, oldest first."""

    number: int
    name: str
    title: str
    purpose: str
    attempts: tuple[AttemptPage, ...]


@dataclass(frozen=True)
class Certificate:
    """What the page and the PDF say.

    Attributes:
        vehicle: Its name.
        verdict: On top.
        unknown: What is not known and why; it comes first.
        facts: Dates, place, link, versions, hashes: label and value.
        figures: Tables in two columns.
        proofs: Tables over the whole width, below.
        signatures: What is to be filled in by hand, label each.
        stages: The appendix.
    """

    vehicle: str
    verdict: Verdict
    unknown: tuple[tuple[str, str], ...]
    facts: tuple[tuple[str, str], ...]
    figures: tuple[Table, ...]
    proofs: tuple[Table, ...]
    signatures: tuple[str, ...]
    stages: tuple[StagePage, ...]

    @property
    def title(self) -> str:
        return f"Certificate of commissioning: {self.vehicle}"


def write_certificate_page(certificate: Certificate, path: Path, letters: float = 9.0) -> Path:
    """Write the page; `letters` is their size on the first sheet in print [pt]."""
    context = {"title": certificate.title, "certificate": certificate, "letters": f"{letters:.1f}"}
    return write_page(path, "certificate.html.j2", **context)


def measured_tables(measured: Mapping[str, Any]) -> tuple[Table, ...]:
    """Whatever a stage measured: single figures in one table, lists of mappings in one each."""
    single, several = [], []
    for key, value in measured.items():
        if rows := rows_of(value):
            several += _tables(heading(key), rows)
        else:
            single.append([labelled(key), cell(key, value)])
    head = [Table("", ["Figure", "Value"], single)] if single else []
    return (*head, *several)


def _tables(title: str, rows: Sequence[Mapping[str, Any]]) -> list[Table]:
    """A table of rows; columns that are tables themselves come behind it, with the first column before theirs."""
    columns = list(dict.fromkeys(column for row in rows for column in row))
    inner = [column for column in columns if any(mappings(row.get(column)) for row in rows)]
    machine = {"key"} if "label" in columns else set()  # a name for programs beside one for people
    own = [column for column in columns if column not in inner and column not in machine]
    cells = [[cell(column, row.get(column)) for column in own] for row in rows[:MOST_ROWS]]
    more = len(rows) - len(cells)
    note = f"{more} more rows are in the attempt's outcome.json." if more else ""
    found = [Table(title, [heading(column) for column in own], cells, note)] if own else []
    for column in inner:
        lead = {own[0]: None} if own else {}
        nested = [{key: row.get(key) for key in lead} | dict(one) for row in rows for one in mappings(row.get(column))]
        found += _tables(f"{title}: {labelled(column)}", nested)
    return found


def rows_of(value: Any) -> list[Mapping[str, Any]]:
    """Rows of a list of mappings, or of mappings by name; [] of anything else."""
    if isinstance(value, Mapping) and value and all(isinstance(one, Mapping) for one in value.values()):
        return [{"name": name} | dict(one) for name, one in value.items()]
    return mappings(value)


def heading(key: str) -> str:
    """A key at the head of a column."""
    found = labelled(key)
    return f"{found[:1].upper()}{found[1:]}"


def labelled(key: str) -> str:
    """A key as people read it, its unit in brackets: `rate_hz` is `rate [Hz]`."""
    if key == INTERVAL:
        return "95 % interval"
    name, unit = named_unit(key)
    return f"{words(name)} [{'%' if unit == '1' else unit}]" if unit else words(key)


def cell(key: str, value: Any) -> str:
    """A value in a cell, shares as per cent."""
    if is_number(value):
        percent = key.endswith("_share")
        return (
            f"{100.0 * value:.3g}"
            if percent
            else f"{float(value) + 0.0:.4g}"
            if isinstance(value, float)
            else str(value)
        )
    if key == INTERVAL and isinstance(value, list | tuple):
        return " to ".join(cell("", one) for one in value)
    return text(value)


def mappings(value: Any) -> list[Mapping[str, Any]]:
    """The rows of a list of mappings; [] of anything else."""
    many = isinstance(value, Sequence) and not isinstance(value, str)
    return list(value) if many and value and all(isinstance(one, Mapping) for one in value) else []
