"""rovtwin map: a georeferenced mosaic of an imager's lines."""

import math
from pathlib import Path
from typing import Annotated

import typer

from rovtwin.cli.output import AsJson, Overwrite, console, emit, figure, progress_bar, refuse_idle, table
from rovtwin.core.errors import ConfigError


def map_lines(
    run: Annotated[
        Path | None,
        typer.Argument(metavar="[RUN]", help="Folder of the run, or its log. Without: navigation of the lines' file."),
    ] = None,
    lines: Annotated[
        list[Path] | None,
        typer.Option(
            help="File of lines, by `rovtwin scan` or from an imager, or a folder of such files. Repeat the option for "
            "a dive in several files. Default: lines.h5 in RUN."
        ),
    ] = None,
    floor: Annotated[
        str,
        typer.Option(help="altimeter (smooth through its echoes), plane, truth, a raster file of heights, a mesh."),
    ] = "altimeter",
    floor_crs: Annotated[
        str,
        typer.Option(help="Frame of a mesh: ned (north, east, down of the datum), enu, or such as EPSG:32632."),
    ] = "ned",
    floor_std: Annotated[
        float | None,
        typer.Option(help="Of the height of a plane, raster file or mesh [m]; default 0.1, 0.05, 0.05."),
    ] = None,
    depth: Annotated[float | None, typer.Option(help="Of the plane [m]; default the altimeter's median.")] = None,
    dem_values: Annotated[
        str,
        typer.Option(
            help="Numbers of a raster file, or a mesh with --floor-crs EPSG:..: height over the ellipsoid, up, or "
            "depth below the water."
        ),
    ] = "height",
    navigation: Annotated[
        str | None,
        typer.Option(help="smoothed, estimate, lines (in the file), truth; default smoothed where there is a track."),
    ] = None,
    resolution: Annotated[float, typer.Option(help="Side of a cell [m].")] = 0.01,
    crs: Annotated[str, typer.Option(help="Map's coordinate system: utm, or such as EPSG:32632.")] = "utm",
    water: Annotated[
        str | None, typer.Option(help="YAML with constituents, daylight and standard deviations, or truth.")
    ] = None,
    panel: Annotated[
        Path | None, typer.Option(help="YAML of a reference panel in the scene, which scales reflectance by band.")
    ] = None,
    radiance: Annotated[
        bool, typer.Option("--radiance", help="Radiances as they are, where lamps or water are unknown.")
    ] = False,
    blend: Annotated[str, typer.Option(help="best: a cell is of the lines that saw it best; mean: of all.")] = "best",
    max_turn: Annotated[float, typer.Option(help="Lines in faster turns are left out [deg/s].")] = 6.0,
    clock_offset: Annotated[float, typer.Option(help="What the imager's clock is ahead of the run's [s].")] = 0.0,
    begin: Annotated[float | None, typer.Option("--from", help="First line [s].")] = None,
    end: Annotated[float | None, typer.Option("--to", help="Last line [s].")] = None,
    area: Annotated[Path | None, typer.Option(help="Area that was to be seen, for gaps; default the hull.")] = None,
    points: Annotated[
        Path | None, typer.Option(help="CSV of places for spectra: name,north,east or name,latitude,longitude.")
    ] = None,
    register: Annotated[
        bool, typer.Option("--register", help="Put poses and calibration right by overlaps; needs `rovtwin smooth`.")
    ] = False,
    control: Annotated[
        Path | None, typer.Option(help="CSV of known points: name,line,pixel,north,east,sd[,file].")
    ] = None,
    calibrated: Annotated[
        bool, typer.Option("--calibrated", help="Mount and clock are exact; else 1 deg, 10 mm, 20 ms.")
    ] = False,
    formats: Annotated[
        str, typer.Option(help="Besides ENVI: cog (picture, layers, small cubes), cube (always), netcdf.")
    ] = "cog",
    imager: Annotated[str | None, typer.Option(help="Imager's file, where the lines do not describe it.")] = None,
    datum: Annotated[
        str | None, typer.Option(metavar="LAT,LON[,HEIGHT]", help="Where the lines' file has none [deg, deg, m].")
    ] = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Folder to make; else mosaic in RUN.")] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Make a georeferenced mosaic of reflectance of the lines of a hyperspectral imager.

    Rays go through lens and port, turned by the vehicle's pose, to the floor; lamps, water and veil are taken off;
    cells are filled. Out come an ENVI cube, cloud-optimised GeoTIFF, a picture, coverage and gaps, spectra of places,
    and report.html. What is broken off goes on where it was when the same command is given again.

    [bold]rovtwin map runs/survey --lines lines.h5 -o mosaic[/bold]

    [bold]rovtwin map --lines dive.h5 --floor dem.tif --water fjord.yaml --datum 63.45,10.36 -o mosaic[/bold]
    """
    from rovtwin.runs.mapping.checking import check
    from rovtwin.runs.mapping.request import MapRequest

    if run is None and (not lines or out is None):
        raise ConfigError("without a RUN, --lines and --out are needed")
    if blend not in ("best", "mean"):
        raise ConfigError(f"--blend: found '{blend}', expected best or mean")
    if dem_values not in ("height", "depth"):
        raise ConfigError(f"--dem-values: found '{dem_values}', expected height or depth")
    refuse_idle({"--water": radiance and water is not None}, "--radiance takes no water off")
    folder = Path() if run is None else run if run.is_dir() else run.parent
    request = MapRequest(
        tuple(lines or [folder / "lines.h5"]), navigation, floor, depth, dem_values == "height", resolution, crs,
        radiance, water, blend == "best", math.radians(max_turn), clock_offset,
        float("-inf") if begin is None else begin, float("inf") if end is None else end, area, points, register,
        control, calibrated,
        ("envi", *(name.strip() for name in formats.split(",") if name.strip())), imager, _datum(datum),
        floor_crs, floor_std, panel,
    )  # fmt: skip
    check(run, request, out or folder / "mosaic", overwrite)
    from rovtwin.runs.mapping.make import map_run  # heavy: what is wrong is named before

    with progress_bar("{task.percentage:.0f} %") as bar:
        task = bar.add_task("finding", total=None)
        made = map_run(
            run,
            request,
            out or folder / "mosaic",
            overwrite,
            lambda what, done, count: bar.update(task, description=what, completed=done, total=count),
        )
    if as_json:
        emit({"out": str(made.folder), **made.about["figures"], "notes": made.remarks()})
        return
    shown = console(as_json)
    first, *more = request.files
    rows = table(f"mosaic of {first}{f' and {len(more)} more' if more else ''}", "", "")
    for name, value, unit in made.figures_table():
        rows.add_row(name, figure(value, unit))
    shown.print(rows)
    if resumed := made.about["figures"]["resumed_parts"]:
        shown.print(f"went on where an earlier call broke off: {resumed} blocks of lines were there", soft_wrap=True)
    for remark in made.remarks():
        shown.print(f"- {remark}", markup=False, soft_wrap=True)
    shown.print(f"wrote {made.folder}: open {made.folder / 'report.html'}", markup=False, soft_wrap=True)


def _datum(text: str | None):
    if text is None:
        return None
    from rovtwin.core.datum import Datum

    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in (2, 3):
        raise ConfigError(f"--datum: found '{text}', expected LATITUDE,LONGITUDE or LATITUDE,LONGITUDE,HEIGHT")
    latitude, longitude, height = (*values, 0.0)[:3]
    return Datum(latitude, longitude, height)
