"""rovtwin scan: the lines that a hyperspectral imager would have taken on a run already flown."""

import math
from pathlib import Path
from typing import Annotated

import typer

from rovtwin.cli.output import AsJson, Overwrite, check_free, console, emit, progress_bar
from rovtwin.core.errors import ConfigError


def scan(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its log; scenario.yaml lies beside.")],
    imager: Annotated[
        str | None,
        typer.Option(help="An imager of the library (uhi) or a YAML file; default the one the vehicle names."),
    ] = None,
    scene: Annotated[
        str | None,
        typer.Option(help="What is seen: a scene of the library or a file; default that of the run's cameras."),
    ] = None,
    sensor: Annotated[
        str | None, typer.Option(help="Where it sits: the vehicle's sensor of kind imager; default its first.")
    ] = None,
    begin: Annotated[float, typer.Option("--from", min=0.0, help="First line [s].")] = 0.0,
    end: Annotated[float | None, typer.Option("--to", min=0.0, help="Last line [s]; default with the run.")] = None,
    misalignment: Annotated[
        str, typer.Option(metavar="ROLL,PITCH,YAW", help="By which it truly sits otherwise than stated [deg].")
    ] = "0,0,0",
    displacement: Annotated[
        str, typer.Option(metavar="X,Y,Z", help="By which it truly sits elsewhere than stated [m].")
    ] = "0,0,0",
    navigation: Annotated[
        str, typer.Option(help="Poses written beside the lines: estimate, smoothed or truth.")
    ] = "estimate",
    seed: Annotated[int | None, typer.Option(min=0, help="Of the noise; default the run's.")] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="File to write; else lines.h5 beside the log.")
    ] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Make the lines of a hyperspectral imager on a run already flown, from the truth in its log.

    The floor is the run's own where it has one. A file in the layout of gref4hsi comes out, with the truth beside the
    lines. What is broken off goes on where it was when the same command is given again.

    [bold]rovtwin scan runs/survey --imager uhi --scene shoal -o lines.h5[/bold]
    """
    from rovtwin.imaging.path import POSES
    from rovtwin.runs.recording.scan import ScanRequest, scan_run

    if navigation not in POSES:
        raise ConfigError(f"--navigation: found '{navigation}', expected {', '.join(POSES)}")
    out = out or (run if run.is_dir() else run.parent) / "lines.h5"
    check_free(out, overwrite)
    roll, pitch, yaw = (math.radians(x) for x in _three(misalignment, "--misalignment", 45.0))
    x, y, z = _three(displacement, "--displacement", 10.0)
    request = ScanRequest(
        imager,
        scene,
        sensor,
        begin,
        math.inf if end is None else end,
        (roll, pitch, yaw),
        (x, y, z),
        navigation,
        seed,
    )
    with progress_bar("{task.completed} of {task.total} lines") as bar:
        task = bar.add_task("scan", total=None)
        found = scan_run(
            run, request, out, overwrite, lambda done, count: bar.update(task, completed=done, total=count)
        )
    if as_json:
        emit(
            {
                "out": str(found.path),
                "lines": found.lines,
                "resumed": found.resumed,
                "seconds": found.seconds,
                "saturated": found.saturated,
                "unseen": found.unseen,
                "notes": found.notes,
            }
        )
        return
    shown = console(as_json)
    for note in found.notes:
        shown.print(f"note: {note}", markup=False, soft_wrap=True)
    again = f", {found.resumed} of them made before" if found.resumed else ""
    shown.print(f"wrote {found.path}: {found.lines} lines{again}, {found.seconds:.0f} s", markup=False, soft_wrap=True)


def _three(text: str, option: str, most: float) -> tuple[float, float, float]:
    """Three numbers of "a,b,c"."""
    try:
        a, b, c = (float(part) for part in text.split(","))
    except ValueError:
        raise ConfigError(f"{option}: found '{text}', expected three numbers such as 0.5,0,-0.2") from None
    if not all(math.isfinite(x) and abs(x) <= most for x in (a, b, c)):
        raise ConfigError(f"{option}: found '{text}', expected numbers between -{most:g} and {most:g}")
    return a, b, c
