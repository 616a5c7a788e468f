"""rovtwin track: where the vehicle was, from its video and printed markers."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import Progress, TextColumn, TimeElapsedColumn

from rovtwin.cli.output import AsJson, Overwrite, check_free, console, emit, table
from rovtwin.core.errors import ConfigError

if TYPE_CHECKING:
    from rovtwin.positioning.track import Track


def track(
    log: Annotated[
        Path, typer.Argument(metavar="LOG", help="MCAP log with the attitude, such as runs/<run>/log.mcap.")
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="Log to write.")] = Path("track.mcap"),
    video: Annotated[
        list[Path] | None,
        typer.Option(help="MCAP, film or folder of pictures, one for each camera; else those beside the log."),
    ] = None,
    video_start: Annotated[float, typer.Option(help="Time of a film's first frame by the log's clock [s].")] = 0.0,
    method: Annotated[str, typer.Option(help="ekf, luenberger or smoother.")] = "ekf",
    vehicle: Annotated[str, typer.Option(help="Vehicle that carries the cameras.")] = "double_blueye",
    camera: Annotated[
        list[str] | None, typer.Option(help="Names of the vehicle's cameras, in the order of the videos.")
    ] = None,
    lens: Annotated[list[Path] | None, typer.Option(help="Camera file in place of the vehicle's lens.")] = None,
    layout: Annotated[
        Path | None, typer.Option(help="Markers of known place; else layout.yaml beside the log.")
    ] = None,
    no_layout: Annotated[
        bool, typer.Option("--no-layout", help="No marker's place is known: the start fixes the frame.")
    ] = False,
    dictionary: Annotated[
        str | None, typer.Option(help="Dictionary of the markers, without a layout; default DICT_4X4_50.")
    ] = None,
    size: Annotated[str, typer.Option(help="Side of markers that are not in the layout.")] = "150mm",
    start: Annotated[str, typer.Option(help="Place at the first frame, x,y,z in n [m].")] = "0,0,0",
    attitude_noise: Annotated[
        float, typer.Option(min=1e-5, help="Noise of one reading of an angle [rad], std.")
    ] = 1e-3,
    acceleration: Annotated[
        str, typer.Option(help="Acceleration of the vehicle, rms, or x,y,z along north, east and down [m/s2].")
    ] = "0.1",
    marker_scale_std: Annotated[
        float | None,
        typer.Option(min=0, max=0.2, help="How well lengths of prints and layout are known, a share; else as it says."),
    ] = None,
    heading_offset: Annotated[
        float, typer.Option(min=0, max=20, help="How far the compass's north may be off the layout's, std [deg].")
    ] = 0.0,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Estimate the track of a vehicle from recorded video, printed markers and its attitude.

    The log written has the track and, frame by frame, positions that [bold]rovtwin identify[/bold] reads as those of a
    sensor, beside the commands and other sensors of LOG.

    For a run that was flown with --camera: [bold]rovtwin track runs/pool/log.mcap -o track.mcap[/bold]

    For any recording: [bold]rovtwin track log.mcap --video port.mp4 --camera port --lens camera.yaml[/bold]
    """
    from rovtwin.core.user_files.quantity import LENGTH, point, positive
    from rovtwin.positioning.track import METHODS
    from rovtwin.runs.track import TrackOptions, track_run
    from rovtwin.vehicle import load_vehicle

    if method not in METHODS:
        raise ConfigError(f"--method: found '{method}', expected one of {', '.join(METHODS)}")
    check_free(out, overwrite)
    options = TrackOptions(
        videos=video or (),
        video_start=video_start,
        cameras=camera or (),
        lenses=lens or (),
        layout=layout,
        known_layout=not no_layout,
        dictionary=dictionary,
        size=positive(size, LENGTH, "--size"),
        start=point(start, "--start"),
        attitude_noise=attitude_noise,
        acceleration=_acceleration(acceleration),
        scale_std=marker_scale_std,
        heading_offset=radians(heading_offset),
    )
    with looking_for_markers() as progress:
        found, written = track_run(log, load_vehicle(vehicle), method, options, progress)
    written.write(out, overwrite=overwrite)
    if as_json:
        emit(_as_data(found) | {"log": str(out)})
    else:
        _print(found, out)


def _acceleration(text: str) -> list[float]:
    """Three figures, or one for all axes."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in (1, 3) or not all(0.0 < value < 10.0 for value in values):
        raise ConfigError(
            f"--acceleration: found {text!r}, expected one or three figures above 0, such as 0.03,0.03,0.01"
        )
    return values * 3 if len(values) == 1 else values


@contextmanager
def looking_for_markers() -> Iterator[Callable[[float], None]]:
    """A progress line that is given the time of each frame [s]."""
    columns = TextColumn("{task.description}"), TimeElapsedColumn()
    with Progress(*columns, console=console(True), transient=True) as bar:
        task = bar.add_task("looking for markers", total=None)
        yield lambda t: bar.update(task, description=f"looking for markers, {t:.0f} s")


def summary(found: "Track") -> list[str]:
    """What a track rests on and how sure it is, a line each."""
    from numpy import isfinite, nanmedian

    seen, used, _ = found.counts.sum(axis=0)
    lit = int((found.counts[:, 1] > 0).sum())
    lines = [
        f"{len(found.t)} frames from {found.t[0]:g} to {found.t[-1]:g} s; {lit} with a marker; "
        f"{used} of {seen} sightings used"
    ]
    if isfinite(found.std).all():
        p, v = nanmedian(found.std, axis=0).reshape(2, 3)
        lines.append(f"standard deviation, median: position {1e3 * p.max():.1f} mm, velocity {1e3 * v.max():.1f} mm/s")
    return lines


def _print(found: "Track", out: Path) -> None:
    from numpy import degrees

    screen = console(False)
    for line in summary(found):
        screen.print(line)
    rows = table("map", "marker", "north [m]", "east [m]", "down [m]", "std [mm]", "tilt std [deg]")
    for marker in found.markers:
        place = [f"{x:.3f}" for x in marker.position]
        sure = [f"{1e3 * marker.std[:3].max():.1f}", f"{degrees(marker.std[3:].max()):.2f}"]
        rows.add_row(str(marker.id), *place, *(sure if marker.std.any() else ["given", "given"]))
    screen.print(rows)
    for note in found.notes:
        screen.print(f"- {note}", markup=False, soft_wrap=True)
    screen.print(f"wrote {out}", markup=False)


def _as_data(found: "Track") -> dict[str, Any]:
    from numpy import isfinite, nanmedian

    std = nanmedian(found.std, axis=0).tolist() if isfinite(found.std).all() else None
    return {
        "method": found.method,
        "frames": len(found.t),
        "with_markers": int((found.counts[:, 1] > 0).sum()),
        "std": std,
        "markers": [{"id": m.id, "position": m.position.tolist(), "std": m.std.tolist()} for m in found.markers],
        "notes": list(found.notes),
    }
