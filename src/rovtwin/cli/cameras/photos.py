"""rovtwin photos: geotagged photographs of a run, for photogrammetry."""

import math
from pathlib import Path
from typing import Annotated

import typer

from rovtwin.cli.output import AsJson, Overwrite, console, emit, progress_bar, refuse_idle
from rovtwin.core.errors import ConfigError


def photos(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or its log; scenario.yaml lies beside.")],
    camera: Annotated[str | None, typer.Option(help="The vehicle's camera; default its first.")] = None,
    every: Annotated[
        float | None, typer.Option(min=0.01, help="Way between pictures, by the vehicle's own navigation [m].")
    ] = None,
    overlap: Annotated[
        float | None, typer.Option(min=0.0, max=0.95, help="Share that the next picture sees too; default 0.7.")
    ] = None,
    scene: Annotated[str | None, typer.Option(help="That is drawn: a scene or a file; default the run's.")] = None,
    pictures: Annotated[
        Path | None, typer.Option(help="Folder with the JPEG files of a real camera, in place of drawn ones.")
    ] = None,
    clock_offset: Annotated[
        float | None, typer.Option(help="By which that camera's clock is ahead of UTC [s]; 0 if it was set.")
    ] = None,
    navigation: Annotated[str, typer.Option(help="Poses that the tags say: estimate, smoothed or truth.")] = "estimate",
    floor: Annotated[float | None, typer.Option(help="Depth of the floor [m]; default the run's.")] = None,
    scale: Annotated[float, typer.Option(min=0.05, max=2.0, help="Pixels a side over the camera's own.")] = 1.0,
    begin: Annotated[float, typer.Option("--from", min=0.0, help="First picture [s].")] = 0.0,
    end: Annotated[float | None, typer.Option("--to", min=0.0, help="Last picture [s]; default with the run.")] = None,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder to write.")] = Path("photos"),
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Take photographs of a run every so many metres, or tag those of a real camera: place, time, angles, uncertainty.

    EXIF and XMP in each JPEG file, geo.txt for OpenDroneMap, reference.csv for Metashape; and whether pictures overlap.

    [bold]rovtwin photos runs/survey --camera down.camera --scene shoal --every 0.3 -o photos[/bold]

    [bold]rovtwin photos runs/dive --pictures DCIM/100GOPRO --clock-offset 2.4 --navigation smoothed -o photos[/bold]
    """
    from rovtwin.runs.recording.photo_sources import PhotoRequest
    from rovtwin.runs.recording.photo_track import SOURCES
    from rovtwin.runs.recording.photos import photos_of_run

    if navigation not in SOURCES:
        raise ConfigError(f"--navigation: found '{navigation}', expected {', '.join(SOURCES)}")
    if every is not None and overlap is not None:
        raise ConfigError("--every and --overlap: found both, expected one")
    if pictures is not None:
        idle = {"--every": every is not None, "--overlap": overlap is not None, "--scene": scene is not None,
                "--scale": scale != 1.0}  # fmt: skip
        refuse_idle(idle, "the pictures are taken already")
    elif clock_offset is not None:
        raise ConfigError("--clock-offset: nothing would come of it: pictures that are drawn have the run's clock")
    request = PhotoRequest(camera, every, overlap, scene, scale, navigation, begin, math.inf if end is None else end,
                           pictures, clock_offset, floor)  # fmt: skip
    with progress_bar("{task.completed} of {task.total} pictures") as bar:
        task = bar.add_task("photographs", total=None)
        found = photos_of_run(
            run, request, out, overwrite, lambda done, count: bar.update(task, completed=done, total=count)
        )
    if as_json:
        emit(found.figures())
        return
    screen, figures = console(as_json), found.figures()
    for note in found.notes:
        screen.print(f"note: {note}", markup=False, soft_wrap=True)
    text = f"wrote {found.folder}: {figures['pictures']} pictures"
    if figures["overlap_median"] is not None:
        text += f", overlap {figures['overlap_median']:.0%} (median), at least {figures['overlap_least']:.0%}"
    screen.print(text, markup=False, soft_wrap=True)
