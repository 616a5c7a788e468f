"""rovtwin evidence check: what test logs hold, and what is wrong with them."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rovtwin.cli.output import DONE, FAILED, AsJson, console, emit, figure, table
from rovtwin.core.errors import IdentificationError

if TYPE_CHECKING:
    from rovtwin.identification.checks.findings import Finding
    from rovtwin.identification.logs.readers import Test
    from rovtwin.identification.logs.record import Record

Checked = list[tuple["Record", str, list["Finding"]]]


def check(
    files: Annotated[
        list[Path], typer.Argument(metavar="EVIDENCE.yaml | LOG...", help="An evidence file, or logs of any format.")
    ],
    vehicle: Annotated[str | None, typer.Option(help="The vehicle that flew; else the evidence file's.")] = None,
    notes: Annotated[bool, typer.Option("--notes", help="Also what is only good to know.")] = False,
    as_json: AsJson = False,
) -> None:
    """Look over test logs before they become parameters: units, signs, axes, frames, clocks, gaps, clipping.

    Exit code 1 when a log must not be used as it is described.

    Examples: [bold]rovtwin evidence check examples/bluerov_liu/evidence.yaml[/bold],
    [bold]rovtwin evidence check runs/pool_1/log.mcap --vehicle double_blueye --notes[/bold]
    """
    checked = _checked(files, vehicle, as_json)
    failed = any(finding.severity == "error" for _, _, found in checked for finding in found)
    if as_json:
        emit({"records": [_as_data(*row) for row in checked], "usable": not failed})
    else:
        _show(checked, notes)
    raise typer.Exit(FAILED if failed else DONE)


def _checked(files: list[Path], name: str | None, as_json: bool) -> Checked:
    from rovtwin.identification.checks.check import check_record
    from rovtwin.identification.logs.evidence_file import read_evidence
    from rovtwin.identification.logs.readers import Test, read_records, read_tests
    from rovtwin.vehicle import load_vehicle

    evidence = read_evidence(files[0]) if files[0].suffix in (".yaml", ".yml") else None
    if evidence is not None and len(files) > 1:
        raise IdentificationError(f"{files[1]}: give one evidence file, or logs; list further logs in {files[0].name}")
    known = name or (evidence.vehicle if evidence else None)
    if known is None:
        raise IdentificationError("no vehicle; give --vehicle NAME, or 'vehicle' in the evidence file")
    vehicle = load_vehicle(known)
    model = vehicle.model()
    tests = (
        read_tests(evidence, vehicle) if evidence else [Test(r, "fit") for f in files for r in read_records(f, vehicle)]
    )
    rows: Checked = []
    with console(as_json).status("checking") as status:
        for whole, use in _wholes(tests):
            status.update(f"checking {whole.name}")
            rows.append((whole, use, check_record(whole, model, vehicle.thruster_names)))
    return rows


def _wholes(tests: list["Test"]) -> list[tuple["Record", str]]:
    """Logs as they were recorded, with their use: clocks and signs are those of a log, not of a part of it."""
    uses: dict[int, list[str]] = {}
    records = {id(test.whole or test.record): test.whole or test.record for test in tests}
    for test in tests:
        uses.setdefault(id(test.whole or test.record), []).append(test.use)
    return [(record, ", ".join(uses[key])) for key, record in records.items()]


def _show(checked: Checked, notes: bool) -> None:
    out = console(False)
    rows = table("Test logs", "record", "use", "length", "signals", "errors", "warnings")
    for record, use, found in checked:
        signals = ", ".join(f"{name} {len(s.t) / record.duration:.0f} Hz" for name, s in record.signals.items())
        counts = [str(sum(f.severity == severity for f in found)) for severity in ("error", "warning")]
        rows.add_row(record.name, use, figure(record.duration, "s"), signals, *counts)
    out.print(rows)
    for record, _, found in checked:
        for finding in found:
            if finding.severity != "note" or notes:
                out.print(f"{record.name}: {finding}", markup=False)
        if notes:
            for note in record.notes:
                out.print(f"{record.name}: {note}", markup=False)


def _as_data(record: "Record", use: str, found: list["Finding"]) -> dict[str, Any]:
    return {
        "name": record.name,
        "use": use,
        "duration": record.duration,
        "signals": {name: len(signal.t) for name, signal in record.signals.items()},
        "notes": list(record.notes),
        "findings": [asdict(finding) for finding in found],
    }
