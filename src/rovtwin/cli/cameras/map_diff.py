"""rovtwin map-diff: what changed between two mosaics of one place."""

from pathlib import Path
from typing import Annotated

import typer

from rovtwin.cli.output import AsJson, console, emit, figure, progress_bar, table
from rovtwin.core.errors import ConfigError, exists_already


def map_diff(
    first: Annotated[Path, typer.Argument(metavar="MOSAIC_1", help="Folder that `rovtwin map` made.")],
    second: Annotated[Path, typer.Argument(metavar="MOSAIC_2", help="The place later: same cells, bands, CRS.")],
    least: Annotated[
        float, typer.Option(min=0.005, max=100.0, help="Size of the smallest thing that is looked for [m].")
    ] = 0.1,
    contrast: Annotated[
        float, typer.Option(min=0.0, max=10.0, help="Least change of reflectance that is of interest, as a share.")
    ] = 0.1,
    false_share: Annotated[
        float, typer.Option(min=1e-6, max=0.5, help="Share of the named places that may be false.")
    ] = 0.05,
    relief: Annotated[
        float,
        typer.Option(
            min=0.0,
            max=10.0,
            help="How far things may stand above the mosaics' floor, or lie below it [m]; 0: all are changes.",
        ),
    ] = 0.3,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="New folder; default change in MOSAIC_2.")] = None,
    as_json: AsJson = False,
) -> None:
    """Lay two mosaics of one place upon each other and map what changed beyond their errors.

    The second is registered to the first by its own pictures; noise, light, grain and what is left of the displacement
    are measured on the cells that did not change. What both show, only elsewhere, is listed apart as standing (above
    the floor) or moved. Out come the changes as GeoJSON with place, size and contrast, layers, and report.html.

    Example: [bold]rovtwin map-diff may/mosaic june/mosaic -o change[/bold]
    """
    from rovtwin.runs.mapping.change.difference import compared
    from rovtwin.runs.mapping.change.files import written
    from rovtwin.runs.mapping.change.page import write_change_page
    from rovtwin.runs.mapping.result import Mosaic

    one, other = Mosaic.read(first), Mosaic.read(second)
    folder = out or second / "change"
    if folder.exists():
        raise ConfigError(exists_already(folder))
    with progress_bar("{task.percentage:.0f} %") as bar:
        task = bar.add_task("reading", total=5)
        found = compared(
            one, other, least, contrast, false_share, relief,
            lambda what, done, count: bar.update(task, description=what, completed=done, total=count),
        )  # fmt: skip
    written(found, one, other, folder)
    write_change_page(folder, found, one, other)
    if as_json:
        emit({"out": str(folder), **found.figures})
        return
    shown = console(as_json)
    rows = table(f"{first} and {second}", "", "")
    for name, value in found.figures.items():
        rows.add_row(name.replace("_", " "), figure(value))
    shown.print(rows)
    shown.print(f"wrote {folder}: open {folder / 'report.html'}", markup=False, soft_wrap=True)
