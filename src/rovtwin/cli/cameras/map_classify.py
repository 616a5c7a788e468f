"""rovtwin map-classify: what lies where on a mosaic, and how much of it."""

from pathlib import Path
from typing import Annotated

import typer

from rovtwin.cli.output import AsJson, console, emit, figure, progress_bar, table
from rovtwin.core.errors import ConfigError


def map_classify(
    mosaic: Annotated[Path, typer.Argument(help="Folder that `rovtwin map` made.")],
    library: Annotated[
        Path | None,
        typer.Option(
            help="CSV wavelength,name1,name2,.. [nm, 0 to 1] or an ENVI spectral library; else shapes made here."
        ),
    ] = None,
    classes: Annotated[
        str | None, typer.Option(help="Some of the library, such as sand,mud,kelp; default all, or the usual ones.")
    ] = None,
    train: Annotated[
        Path | None,
        typer.Option(help="Classes from the mosaic itself: CSV name,north,east[,radius] or name,latitude,longitude."),
    ] = None,
    check: Annotated[
        Path | None,
        typer.Option(help="Places whose class somebody saw, for areas put right: CSV as --train, or other."),
    ] = None,
    truth: Annotated[
        Path | None, typer.Option(metavar="LINES", help="Lines of a simulation, whose scene is the truth.")
    ] = None,
    variability: Annotated[
        float, typer.Option(min=0.0, max=30.0, help="How far spectra of one material lie apart, rms angle [deg].")
    ] = 2.0,
    threshold: Annotated[
        str | None,
        typer.Option(help="Limit of the angle [deg], such as 6 or kelp=9,sand=5; else by errors and variability."),
    ] = None,
    fixed_brightness: Annotated[
        bool,
        typer.Option("--fixed-brightness", help="Spectra are as bright as the library's; else each cell's is fitted."),
    ] = False,
    draws: Annotated[int, typer.Option(min=0, max=2000, help="Of the errors of areas: 40 or more; 0: none.")] = 80,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="New folder; default classes in MOSAIC.")] = None,
    as_json: AsJson = False,
) -> None:
    """Classify a mosaic by its spectra, and say the area of each class with its interval.

    Spectral angles name a class where one explains a cell, linear unmixing the shares of classes; what neither explains
    is not of the library. Out come a map of classes and shares (GeoTIFF, ENVI), areas.csv, and report.html.

    Example: [bold]rovtwin map-classify mosaic --classes sand,mud,maerl,kelp,rock -o classes[/bold]
    """
    from rovtwin.runs.mapping.classification.make import classify
    from rovtwin.runs.mapping.classification.request import ClassifyRequest
    from rovtwin.runs.mapping.result import Mosaic

    names = tuple(name.strip() for name in (classes or "").split(",") if name.strip())
    request = ClassifyRequest(
        library, names, train, check, truth, variability, _thresholds(threshold), fixed_brightness, draws
    )
    with progress_bar("{task.percentage:.0f} %") as bar:
        task = bar.add_task("reading", total=None)
        made = classify(
            Mosaic.read(mosaic), request, out or mosaic / "classes",
            lambda what, done, count: bar.update(task, description=what, completed=done, total=count),
        )  # fmt: skip
    if as_json:
        emit({"out": str(made.folder), **made.about["figures"], "areas": made.about["areas"], "notes": made.remarks()})
        return
    shown = console(as_json)
    rows = table(f"classes of {mosaic}", "", "m2", "95 %", "truth" if truth else "")
    for area in made.about["areas"]:
        interval = f"{area['low_m2']:.3g} to {area['high_m2']:.3g}"
        rows.add_row(area["class"], figure(area["area_m2"]), interval, figure(area["true_m2"]) if truth else "")
    for name in ("mixed_m2", "not_of_library_m2", "classified_m2"):
        rows.add_row(name.removesuffix("_m2").replace("_", " "), figure(made.about["figures"][name]), "", "")
    shown.print(rows)
    for remark in made.remarks():
        shown.print(f"- {remark}", markup=False, soft_wrap=True)
    shown.print(f"wrote {made.folder}: open {made.folder / 'report.html'}", markup=False, soft_wrap=True)


def _thresholds(text: str | None) -> dict[str, float]:
    found = {}
    for part in (text or "").split(","):
        name, _, number = part.rpartition("=")
        if not part.strip():
            continue
        try:
            found[name.strip()] = float(number)
        except ValueError:
            found[name.strip()] = -1.0
        if not 0.0 < found[name.strip()] <= 90.0:
            raise ConfigError(f"--threshold: found '{part}', expected degrees above 0, such as 6 or kelp=9,sand=5")
    return found
