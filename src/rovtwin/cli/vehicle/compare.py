"""rovtwin compare: parameters and force curves of vehicle files, side by side."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from rovtwin.cli.output import DONE, AsJson, console, emit, table
from rovtwin.core.errors import IdentificationError


def compare(
    vehicles: Annotated[
        list[str], typer.Argument(metavar="VEHICLE...", help="Names of the library or files, identified or not.")
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FOLDER", help="Write an HTML report with figures.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Parameters and damping forces of vehicle files side by side; the others are compared with the first.

    Where files were identified: 95 % intervals, bands of the forces, and differences in standard deviations, for
    each parameter and for all together. Forces are what counts: coefficients make good for each other.

    Example: [bold]rovtwin compare double_blueye double_blueye_thesis[/bold]

    Example: [bold]rovtwin compare before.yaml after.yaml -o comparison[/bold]
    """
    from rovtwin.identification.diagnostics.differences import as_a_whole, difference
    from rovtwin.identification.diagnostics.stated import stated
    from rovtwin.report.vehicles.comparison import compare_files, write_vehicle_comparison
    from rovtwin.vehicle import load_vehicle

    if len(vehicles) < 2:
        raise IdentificationError(f"found one vehicle, {vehicles[0]}; give two or more to compare")
    loaded = [load_vehicle(name) for name in vehicles]
    files = [stated(vehicle, label) for vehicle, label in zip(loaded, labels(vehicles), strict=True)]
    comparison = compare_files(files, difference, as_a_whole)
    page = write_vehicle_comparison(comparison, output) if output else None
    if as_json:
        emit(_as_data(comparison, page))
    else:
        _print(comparison, page)
    raise typer.Exit(DONE)


def labels(names: list[str]) -> list[str]:
    """Short and different: file names without ending, then with their folder, then numbered."""
    short = [Path(name).stem for name in names]
    longer = [
        s if short.count(s) == 1 else str(Path(n).with_suffix("")) for s, n in zip(short, names, strict=True)
    ]  # fmt: skip
    return [s if longer.count(s) == 1 else f"{s} ({k})" for k, s in enumerate(longer, start=1)]


def _print(comparison: Any, page: Path | None) -> None:
    from rovtwin.report.vehicles.comparison import agreement, force_table, parameter_table

    screen = console(False)
    _print_table(screen, "parameters", parameter_table, comparison)
    _print_table(screen, "damping forces", force_table, comparison)
    for line in agreement(comparison):
        screen.print(line, markup=False)
    if page:
        screen.print(f"report: {page}", markup=False)


def _print_table(screen: Any, title: str, made: Callable[[Any, bool], Any], comparison: Any) -> None:
    """All files beside each other; where the screen is too narrow for that, one after the other beside the first."""
    whole = made(comparison, True)
    tables = [_rows(title, whole.head, whole.rows)]
    if _width(screen, tables[0]) > screen.width:
        tables = [_pair(screen, title, made(pair, True), *(f.label for f in pair.files)) for pair in comparison.pairs()]
    for one in tables:
        screen.print(one, "")
    screen.print(f"{whole.note}\n", style="dim", markup=False)


def _pair(screen: Any, title: str, values: Any, first: str, other: str) -> Any:
    rows = _rows(f"{title}: {other} beside {first}", values.head, values.rows)
    if _width(screen, rows) <= screen.width:
        return rows
    # Narrower still: no names in the head, and lines that break before a bracket or an interval only.
    close = [[cell.replace(" %", "%").replace(" sd)", "sd)") for cell in row] for row in values.rows]
    return _rows(
        f"{title}: {first} (first), {other} (other)", [*values.head[:-3], "first", "other", values.head[-1]], close
    )


def _rows(title: str, head: list[str], cells: list[list[str]]) -> Any:
    rows = table(title, *head)
    for row in cells:
        rows.add_row(*row)
    for column in rows.columns[1 : 3 if head[1] == "Speed" else 2]:
        column.no_wrap = True
    return rows


def _width(screen: Any, rows: Any) -> int:
    """That a table would like to have."""
    return screen.measure(rows, options=screen.options.update(width=10_000)).maximum


def _as_data(comparison: Any, page: Path | None) -> dict[str, Any]:
    from dataclasses import asdict

    files = comparison.files
    return {
        "files": [
            {"label": f.label, "vehicle": f.vehicle.name, "identified": f.covariance is not None,
             "tested": dict(f.tested)} for f in files
        ],
        "parameters": [
            {
                "name": name,
                "values": [_value(f.values.get(name)) for f in files],
                "differences": [asdict(d[name]) if name in d else None for d in comparison.differences],
            }
            for name in comparison.rows
        ],
        "forces": [asdict(force) for force in comparison.forces()],
        "as_a_whole": [None if whole is None else asdict(whole) for whole in comparison.wholes],
        "report": None if page is None else str(page),
    }  # fmt: skip


def _value(value: Any) -> dict[str, Any] | None:
    if value is None:
        return None
    low, high = value.interval()
    return {"value": value.value, "unit": value.unit, "low": low, "high": high}
