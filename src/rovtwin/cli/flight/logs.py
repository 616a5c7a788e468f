"""rovtwin log: look at logs, export them, rescue unfinished ones."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from rovtwin.cli.output import AsJson, Overwrite, check_free, console, emit, figure, table
from rovtwin.core.errors import LogError

log_app = typer.Typer(
    no_args_is_help=True, help="Look at logs, export them (netCDF, CSV, maps), rescue unfinished ones."
)

PROVENANCE = ("name", "seed", "version", "created", "command")  # of a log's metadata, as far as they are there

LogFile = Annotated[Path, typer.Argument(metavar="LOG", help="An MCAP log, or the folder of a run.")]


@log_app.command("info")
def info(
    paths: Annotated[
        list[Path], typer.Argument(metavar="LOG...", help="MCAP logs, or folders of runs, such as runs/<run>.")
    ],
    as_json: AsJson = False,
) -> None:
    """List the channels with rate, unit and frame, and where the log comes from; of several logs a line each.

    Examples: [bold]rovtwin log info runs/today[/bold], [bold]rovtwin log info runs/*[/bold]
    """
    from rovtwin.core.log.info import log_of, summary

    found = [summary(log_of(path)) for path in paths]
    if as_json:
        emit(found[0] if len(found) == 1 else {"logs": found})
    elif len(found) == 1:
        _print_one(found[0])
    else:
        _print_several(found)


def _print_one(found: dict[str, Any]) -> None:
    """Its channels, and where it comes from."""
    from rovtwin.core.datum import Datum

    rows = table(found["path"], "channel", "messages", "rate [Hz]", "first [s]", "last [s]", "unit", "frame", "fields")
    for row in found["rows"]:
        unit = row["unit"] if isinstance(row["unit"], str) else ", ".join(dict.fromkeys(row["unit"]))
        numbers = [f"{row[key]:.4g}" if row[key] is not None else "–" for key in ("rate", "first", "last")]
        rows.add_row(row["name"], str(row["messages"]), *numbers, unit, row["frame"] or "–", in_short(row["fields"]))
    out = console(False)
    out.print(rows)
    for key in PROVENANCE:
        if found["metadata"].get(key):
            out.print(f"{key}: {found['metadata'][key]}", markup=False)
    if found["datum"]:
        out.print(f"datum: {Datum(**found['datum'])}", markup=False)


def _print_several(found: list[dict[str, Any]]) -> None:
    """A row for each log, and the channels that not all of them have."""
    rows = table(f"{len(found)} logs", "log", "seconds", "channels", "messages", "MB", *PROVENANCE[:-1])
    for one in found:
        numbers = (f"{one['duration']:.4g}", str(len(one["rows"])), str(one["messages"]), f"{one['size'] / 1e6:.3g}")
        rows.add_row(one["path"], *numbers, *(str(one["metadata"].get(key) or "–") for key in PROVENANCE[:-1]))
    out = console(False)
    out.print(rows)
    there = {one["path"]: {row["name"] for row in one["rows"]} for one in found}
    for channel in sorted(set().union(*there.values())):
        lacking = [path for path, channels in there.items() if channel not in channels]
        if lacking:
            out.print(f"- {channel} is not in {', '.join(lacking)}", markup=False, soft_wrap=True)


def in_short(fields: list[str]) -> str:
    """Names of the fields; of very many, as the places along a tether are, the first and the last."""
    return " ".join(fields) if len(fields) <= 20 else f"{fields[0]} … {fields[-1]} ({len(fields)})"


@log_app.command("export")
def export(
    path: LogFile,
    target: Annotated[
        Path,
        typer.Argument(
            help="run.nc for netCDF (CF), track.geojson, .gpx or .kml for a map, or a folder for CSV files or a bag."
        ),
    ],
    to: Annotated[
        str | None,
        typer.Option(help="rosbag2: a folder for `ros2 bag play`, Foxglove and PlotJuggler, in ENU and FLU."),
    ] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Export a log: netCDF opens in xarray and MATLAB, GeoJSON in QGIS, GPX and KML on other maps, CSV anywhere."""
    from rovtwin.core.log import Log
    from rovtwin.core.log.export import export_csv, export_netcdf
    from rovtwin.core.log.info import log_of
    from rovtwin.core.log.maps import WRITERS, export_map

    if to not in (None, "rosbag2"):
        raise LogError(f"--to {to}: expected rosbag2; all other kinds follow from the ending of the target")
    if to is None and target.suffix not in (".nc", "", *WRITERS):
        raise LogError(
            f"{target}: found the ending {target.suffix!r}, expected .nc for netCDF, {', '.join(WRITERS)} for a map, "
            "or a folder for CSV files"
        )
    written = target / "channels.csv" if to is None and not target.suffix else target
    if to is not None or not written.is_dir():
        check_free(written, overwrite)
    log = Log.read(log_of(path))
    if to == "rosbag2":
        from rovtwin.links.ros2.bag import export_rosbag2

        export_rosbag2(log, target, overwrite=overwrite)
    elif target.suffix == ".nc":
        export_netcdf(log, target, overwrite=overwrite)
    elif target.suffix in WRITERS:
        export_map(log, target, overwrite=overwrite)
    else:
        export_csv(log, target, overwrite=overwrite)
    if as_json:
        emit({"written": str(target)})
    else:
        console(False).print(f"wrote {target}", markup=False)


@log_app.command("repair")
def repair(
    path: LogFile,
    out: Annotated[Path | None, typer.Option(help="Where to write; default <name>.repaired.mcap.")] = None,
    as_json: AsJson = False,
) -> None:
    """Rebuild an unfinished log (crash, power cut) from what reached the disk; the original is left as it is."""
    from rovtwin.core.log.info import log_of
    from rovtwin.core.log.repair import repair as rebuild

    result = rebuild(log_of(path), out)
    total = sum(result.messages.values())
    if as_json:
        emit({**asdict(result), "path": str(result.path)})
        return
    screen = console(False)
    screen.print(f"wrote {result.path}: {total} messages, up to {figure(result.last_time, 's')}", markup=False)
    for note in result.notes:
        screen.print(f"- {note}", markup=False)
