"""rovtwin track: where the vehicle was, from its video and printed markers."""

from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import Progress, TextColumn, TimeElapsedColumn

from rovtwin.cli.output import AsJson, console, emit, table
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
        typer.Option(help="Film or folder of pictures, one for each camera; else those beside the log."),
    ] = None,
    video_start: Annotated[float, typer.Option(help="Time of a film's first frame by the log's clock [s].")] = 0.0,
    method: Annotated[str, typer.Option(help="ekf, luenberger or smoother.")] = "ekf",
    vehicle: Annotated[str, typer.Option(help="That carries the cameras.")] = "double_blueye",
    camera: Annotated[list[str] | None, typer.Option(help="Of the vehicle, in the order of the videos.")] = None,
    lens: Annotated[list[Path] | None, typer.Option(help="Camera file in place of the vehicle's lens.")] = None,
    layout: Annotated[Path | None, typer.Option(help="Markers of known place; else the start fixes the frame.")] = None,
    dictionary: Annotated[str, typer.Option(help="Of the markers, without a layout.")] = "DICT_4X4_50",
    size: Annotated[str, typer.Option(help="Side of markers that are not in the layout.")] = "150mm",
    start: Annotated[str, typer.Option(help="Place at the first frame, x,y,z in n [m].")] = "0,0,0",
    attitude_noise: Annotated[float, typer.Option(min=1e-5, help="Of one reading of an angle [rad].")] = 1e-3,
    heading_offset: Annotated[
        float, typer.Option(min=0, max=20, help="How far the compass's north may be off the layout's, std [deg].")
    ] = 0.0,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what is there.")] = False,
    as_json: AsJson = False,
) -> None:
    """Estimate the track of a vehicle from recorded video, printed markers and its attitude.

    The log written has the track and, frame by frame, positions that [bold]rovtwin identify[/bold] reads as those of a
    sensor, beside the commands and other sensors of LOG.

    Example: [bold]rovtwin track log.mcap --video port.mp4 --camera port --method smoother[/bold]
    """
    from rovtwin.core.log import Log
    from rovtwin.core.quantity import LENGTH, point, positive
    from rovtwin.positioning.camera_file import choose
    from rovtwin.positioning.ekf_tuning import SlamTuning
    from rovtwin.positioning.track import METHODS, track
    from rovtwin.positioning.track_log import track_log
    from rovtwin.vehicle import load_vehicle

    if method not in METHODS:
        raise ConfigError(f"--method: found '{method}', expected one of {', '.join(METHODS)}")
    if out.exists() and not overwrite:
        raise ConfigError(f"{out}: exists already; give another --out, or --overwrite")
    side, begin = positive(size, LENGTH, "--size"), point(start, "--start")
    markers = _layout(layout, dictionary)
    source = Log.read(log)
    cameras = choose(load_vehicle(vehicle), camera or [], lens or [])
    cameras, videos = _videos(log, cameras, video or [], video_start)
    recording = _record(source, videos, cameras, markers, side, as_json)
    if heading_offset and not markers.markers:
        raise ConfigError("--heading-offset: without --layout north is the compass's; leave it out, or give a layout")
    offset = [0.0, 0.0, radians(heading_offset)]
    place = 10.0 if markers.markers else 0.0
    tuning = SlamTuning.of(attitude=attitude_noise, start_position=place, offset=offset)
    known = markers if markers.markers else None
    found = track(recording, cameras, method, known, tuning, side, begin)
    track_log(found, source, {"cameras": [c.name for c in cameras]}).write(out, overwrite=overwrite)
    if as_json:
        emit(_as_data(found) | {"log": str(out)})
    else:
        _print(found, out)


def _layout(path: Path | None, dictionary: str) -> Any:
    from rovtwin.core.config import parse
    from rovtwin.core.markers import Layout, read_layout

    return read_layout(path) if path else parse(Layout, {"dictionary": dictionary}, "--dictionary")


def _videos(log: Path, cameras: list[Any], given: list[Path], start: float) -> tuple[list[Any], list[Any]]:
    """Cameras that have a video, and their videos."""
    from rovtwin.positioning.video import FILMS, Video

    if given:
        if len(given) != len(cameras):
            raise ConfigError(
                f"--video: found {len(given)} for {len(cameras)} cameras ({', '.join(c.name for c in cameras)}); give "
                "--camera for each video"
            )
        paths: list[Path | None] = list(given)
    else:
        paths = []
        for one in cameras:
            stem = log.parent / one.name.replace(".", "_")
            beside = [stem.with_suffix(".mcap"), stem, *(stem.with_suffix(ending) for ending in FILMS)]
            paths.append(next((path for path in beside if path.exists()), None))
    both = [(c, Video(p, c.lens.size, start)) for c, p in zip(cameras, paths, strict=True) if p is not None]
    if not both:
        names = ", ".join(c.name.replace(".", "_") + ".mp4" for c in cameras)
        raise ConfigError(
            f"{log.parent}: found no video, expected {names} (or .mcap), a folder of pictures of that name, or --video"
        )
    return [c for c, _ in both], [v for _, v in both]


def _record(source: Any, videos: list[Any], cameras: list[Any], layout: Any, side: float, as_json: bool) -> Any:
    import numpy as np

    from rovtwin.positioning.detection import Detector
    from rovtwin.positioning.recording import record
    from rovtwin.positioning.sight import sizes_of

    sizes = np.asarray(sizes_of({marker.id: marker.size for marker in layout.markers}, default=side))
    columns = TextColumn("{task.description}"), TimeElapsedColumn()
    with Progress(*columns, console=console(True), transient=True) as bar:
        task = bar.add_task("looking for markers", total=None)

        def step(t: float) -> None:
            bar.update(task, description=f"looking for markers, {t:.0f} s")

        return record(source, videos, cameras, Detector(layout.dictionary), sizes, progress=step)


def _print(found: "Track", out: Path) -> None:
    from numpy import degrees, isfinite, nanmedian

    screen = console(False)
    seen, used, _ = found.counts.sum(axis=0)
    lit = int((found.counts[:, 1] > 0).sum())
    screen.print(
        f"{len(found.t)} frames from {found.t[0]:g} to {found.t[-1]:g} s; {lit} with a marker; "
        f"{used} of {seen} sightings used"
    )
    if isfinite(found.std).all():
        p, v = nanmedian(found.std, axis=0).reshape(2, 3)
        screen.print(f"standard deviation, median: position {1e3 * p.max():.1f} mm, velocity {1e3 * v.max():.1f} mm/s")
    rows = table("map", "marker", "north [m]", "east [m]", "down [m]", "std [mm]", "tilt std [deg]")
    for marker in found.markers:
        place = [f"{x:.3f}" for x in marker.position]
        rows.add_row(
            str(marker.id), *place, f"{1e3 * marker.std[:3].max():.1f}", f"{degrees(marker.std[3:].max()):.2f}"
        )
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
