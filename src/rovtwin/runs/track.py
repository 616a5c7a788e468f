"""The track of a recorded run: its log, the pictures beside it, and the markers that hang there.

`fly --camera` leaves beside the log of a run, for each camera, its pictures and its lens (`port_camera.mcap`,
`port_camera.yaml`), and where the markers hang (`layout.yaml`). Whoever records a real vehicle lays the same files
there, or names others.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.core.log import Log
from rovtwin.core.markers import Layout, read_layout
from rovtwin.core.user_files.config import parse
from rovtwin.positioning.calibration.camera_file import choose, read_lens
from rovtwin.positioning.estimators.ekf_tuning import SlamTuning
from rovtwin.positioning.images.camera_model import sizes_of
from rovtwin.positioning.images.detection import Detector
from rovtwin.positioning.images.video import FILMS, Video
from rovtwin.positioning.recording import record
from rovtwin.positioning.track import Method, Track, track
from rovtwin.positioning.track_log import track_log
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.description.cameras import Camera

LAYOUT = "layout.yaml"
USUAL = "DICT_4X4_50"  # of markers without a layout
SOMEWHERE = 10.0  # how far from the given start a vehicle may be, where markers of known place say where it is [m]


@dataclass(frozen=True)
class TrackOptions:
    """What a user says of a recording; what is left out lies beside the log.

    Attributes:
        videos: One for each camera.
        video_start: Of films [s].
        cameras: Names, in the order of the videos; empty: all that have a video.
        lenses: Camera files in place of the vehicle's lenses.
        layout: Markers of known place; None: `layout.yaml` beside the log, if there is one.
        known_layout: False: no marker's place is known, the start fixes the frame.
        dictionary: Without a layout; None: DICT_4X4_50.
        size: Side of markers that are not in the layout [m].
        start: Place at the first frame, n [m].
        attitude_noise: Of one reading of an angle [rad].
        acceleration: Of the vehicle along n's axes, rms, as filter and smoother believe [m/s2]; None: the tuning's.
        scale_std: How well lengths of prints and layout are known, a share; None: as the layout says.
        heading_offset: How far the compass's north may be off the layout's, standard deviation [rad].
    """

    videos: Sequence[Path] = ()
    video_start: float = 0.0
    cameras: Sequence[str] = ()
    lenses: Sequence[Path] = ()
    layout: Path | None = None
    known_layout: bool = True
    dictionary: str | None = None
    size: float = 0.15
    start: Sequence[float] = field(default=(0.0, 0.0, 0.0))
    attitude_noise: float = 1e-3
    acceleration: Sequence[float] | None = None
    scale_std: float | None = None
    heading_offset: float = 0.0


def track_run(
    log: Path,
    vehicle: Vehicle,
    method: Method = "ekf",
    options: TrackOptions | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[Track, Log]:
    """The track, and a log of it that identification reads as one with a position sensor.

    Args:
        log: With the attitude.
        vehicle: That carries the cameras.
        method: One of `positioning.track.METHODS`.
        options: Default: all that lies beside the log.
        progress: Told the time of each frame [s].

    Raises:
        ConfigError: No video, or a file that says what cannot be.
        LogError: The log has no attitude, or no frame has a marker.
    """
    options = options or TrackOptions()
    layout = _layout(log, options)
    known = bool(layout.markers) and options.known_layout
    if options.heading_offset and not known:
        raise ConfigError("--heading-offset: without --layout north is the compass's; leave it out, or give a layout")
    if options.heading_offset and method == "luenberger":
        raise ConfigError("--heading-offset: --method luenberger takes north as measured; use ekf or smoother")
    source = Log.read(log)
    cameras, videos = _videos(log, vehicle, options)
    sizes = np.asarray(sizes_of({marker.id: marker.size for marker in layout.markers}, default=options.size))
    seen = record(source, videos, cameras, Detector(layout.dictionary), sizes, progress=progress)
    chosen: dict[str, Any] = {} if options.acceleration is None else {"acceleration": options.acceleration}
    tuning = SlamTuning.of(
        attitude=options.attitude_noise,
        start_position=SOMEWHERE if known else 0.0,
        offset=[0.0, 0.0, options.heading_offset],
        **chosen,
    )
    found = track(seen, cameras, method, layout if known else None, tuning, sizes, options.start)
    scale = layout.scale_std if options.scale_std is None else options.scale_std
    return found, track_log(
        found, source, {"cameras": [camera.name for camera in cameras], "track_scale_std": str(scale)}
    )


def _layout(log: Path, options: TrackOptions) -> Layout:
    beside = log.parent / LAYOUT
    path = options.layout or (beside if beside.is_file() else None)
    if path and options.dictionary:
        raise ConfigError(
            f"--dictionary {options.dictionary}: {path} says which it is; leave it out, or change it there"
        )
    return read_layout(path) if path else parse(Layout, {"dictionary": options.dictionary or USUAL}, "--dictionary")


def _videos(log: Path, vehicle: Vehicle, options: TrackOptions) -> tuple[list[Camera], list[Video]]:
    """Cameras that have a video, with the lens that lies beside it, and their videos."""
    cameras = choose(vehicle, list(options.cameras), list(options.lenses))
    stems = [log.parent / camera.name.replace(".", "_") for camera in cameras]
    if options.videos and len(options.videos) != len(cameras):
        raise ConfigError(
            f"--video: found {len(options.videos)} for {len(cameras)} cameras ({', '.join(c.name for c in cameras)}); "
            "give --camera for each video"
        )
    paths = list(options.videos) or [_beside(stem) for stem in stems]
    found = []
    for camera, stem, path in zip(cameras, stems, paths, strict=True):
        if path is None:
            continue
        lens = stem.with_suffix(".yaml")
        if not options.lenses and not options.videos and lens.is_file():
            camera = Camera(camera.name, read_lens(lens), camera.position, camera.R_bc)
        found.append((camera, Video(path, camera.lens.size, options.video_start)))
    if not found:
        names = ", ".join(f"{stem.name}.mcap" for stem in stems)
        raise ConfigError(
            f"{log.parent}: found no video, expected {names} (as rovtwin fly --camera writes), .mp4, a folder of "
            "pictures of that name, or --video"
        )
    return [camera for camera, _ in found], [video for _, video in found]


def _beside(stem: Path) -> Path | None:
    candidates = [stem.with_suffix(".mcap"), stem, *(stem.with_suffix(ending) for ending in FILMS)]
    return next((path for path in candidates if path.exists()), None)
