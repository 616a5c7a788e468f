"""Which photographs of a run: drawn each time that the vehicle has gone so far, or those of a real camera."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError, LogError
from rovtwin.core.log import Log
from rovtwin.imaging.floor import Floor
from rovtwin.imaging.photographs.jpeg import exif_in, jpeg_of, taken_at, whole_seconds
from rovtwin.imaging.photographs.overlap import length_on
from rovtwin.runs.compose.world import on_world_floor
from rovtwin.runs.recording.photo_track import Track, track_of
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.camera.renderer import Renderer
from rovtwin.simulation.scene import load_scene
from rovtwin.vehicle.description.cameras import Camera

MOST = 20_000  # pictures


@dataclass(frozen=True)
class PhotoRequest:
    """What is asked for.

    Attributes:
        camera: Of the vehicle; None: its first.
        every: Way between pictures by the navigation [m]; None: what the overlap makes of it.
        overlap: Share of a picture that the next one is to see, in place of `every`.
        scene: That is drawn; None: that of the run's cameras.
        scale: Pixels a side over the camera's own.
        navigation: Whose poses the tags say, of `SOURCES`.
        begin: First picture at the earliest [s].
        end: Last picture at the latest [s].
        pictures: Folder of a real camera's pictures; None: they are rendered.
        clock_offset: That the camera's clock is ahead of UTC [s]; None: nobody has said.
        floor: Depth of the floor [m]; None: the scenario's.
    """

    camera: str | None = None
    every: float | None = None
    overlap: float | None = None
    scene: str | None = None
    scale: float = 1.0
    navigation: str = "estimate"
    begin: float = 0.0
    end: float = math.inf
    pictures: Path | None = None
    clock_offset: float | None = None
    floor: float | None = None


def triggered(track: Track, camera: Camera, floor: Floor | None, request: PhotoRequest) -> Float[np.ndarray, " n"]:
    """Times at which the camera has gone far enough since its last picture, as the navigation knows it."""
    every = request.every
    if every is None:
        if floor is None:
            raise ConfigError("--overlap: no floor is known; say --floor, or --every in metres")
        share = 0.7 if request.overlap is None else request.overlap
        height = float(np.median(floor.depth_and_slope(track.position[:, :2])[0] - track.position[:, 2]))
        every = (1.0 - share) * length_on(camera, max(height - float(camera.position[2]), 0.1))
    chosen = _far_enough(track, every, (track.t >= request.begin) & (track.t <= request.end))
    if len(chosen) < 2:
        raise ConfigError(f"--every: the vehicle does not go {every:.3g} m between {request.begin:g} s and the end")
    if len(chosen) > MOST:
        raise ConfigError(f"--every: {every:.3g} m makes {len(chosen):,} pictures, expected at most {MOST:,}")
    return np.array(chosen)


def _far_enough(track: Track, every: float, inside: Bool[np.ndarray, " k"]) -> list[float]:
    """The first instant within, and each at which the vehicle is so far from where it was at the last one [s]."""
    place, chosen, last, before = track.position[:, :2], [], None, 0.0
    for i in np.flatnonzero(inside):
        away = 0.0 if last is None else float(np.hypot(*(place[i] - last)))
        if last is None or away >= every:
            share = 1.0 if last is None else (every - before) / (away - before)
            chosen.append(float(track.t[i] if last is None else track.t[i - 1] + share * (track.t[i] - track.t[i - 1])))
            last = place[i] if share == 1.0 else place[i - 1] + share * (place[i] - place[i - 1])
            away = float(np.hypot(*(place[i] - last)))
        before = away
    return chosen


def rendered(log: Log, scenario: Scenario, camera: Camera, request: PhotoRequest) -> Callable[[int, float], bytes]:
    """Draws picture number i at a time, from where the vehicle truly was."""
    if "truth/eta" not in log:
        raise LogError("the log has no truth/eta to render from; give a real camera's pictures: --pictures FOLDER")
    if request.scene is None and not scenario.cameras:
        raise ConfigError(f"{scenario.name}: names no scene; say --scene, a name or a file")
    scene = on_world_floor(load_scene(request.scene or scenario.cameras[0].scene), scenario.world)
    truth, speeds = track_of(log, Path(), "truth"), log["truth/nu"]
    renderer = Renderer(scene, camera)

    def draw(i: int, when: float) -> bytes:
        position, R, _ = truth.at(np.array([when]))
        nu = np.array([np.interp(when, speeds.t, column) for column in speeds.values.T])
        return jpeg_of(renderer.image(position[0], R[0], nu, seed=scenario.seed * MOST + i))

    return draw


def real(
    request: PhotoRequest, track: Track, datum: Datum, notes: list[str]
) -> tuple[list[Path], Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Pictures of a folder that were taken on the track, in order of time; times and their standard deviations [s]."""
    folder = request.pictures
    assert folder is not None
    paths = sorted(p for p in folder.iterdir() if p.suffix.lower() in (".jpg", ".jpeg")) if folder.is_dir() else []
    if not paths:
        raise ConfigError(f"{folder}: has no pictures; expected a folder of .jpg files")
    tags = [exif_in(path) for path in paths]
    stamps = [taken_at(one, path.name) for one, path in zip(tags, paths, strict=True)]
    spread = np.where([whole_seconds(one) for one in tags], 1.0 / math.sqrt(12.0), 0.0)
    begin = datum.utc(0.0)
    t = 1e-9 * np.array([stamp.astype("datetime64[ns]") - begin for stamp in stamps]).astype(np.int64)
    if request.clock_offset is None:
        raise ConfigError(
            "--clock-offset: nobody has said how far the camera's clock is ahead of UTC, and pictures alone do not "
            f"tell. By it they lie {t.min():.1f} to {t.max():.1f} s after the log's beginning, the track from "
            f"{track.t[0]:.1f} to {track.t[-1]:.1f} s. Take a picture of a clock beside the vehicle's; 0 if it was set"
        )
    t = t - request.clock_offset
    good = track.covers(t) & (t >= request.begin) & (t <= request.end)
    if not good.any():
        raise ConfigError(
            f"{folder}: none of {len(t)} pictures was taken on the track: they lie from {t.min():.1f} to {t.max():.1f} "
            f"s, the track from {track.t[0]:.1f} to {track.t[-1]:.1f} s. Is --clock-offset right, and the time zone?"
        )
    if not good.all():
        notes.append(f"{int((~good).sum())} of {len(t)} pictures lie outside the track and are left out")
    if coarse := int((spread[good] > 0.0).sum()):
        notes.append(
            f"{coarse} pictures have stamps of whole seconds: 0.29 s rms, which counts in the accuracies as the speed "
            "makes it. A camera that cuts off parts of a second is late by half a second on average: measure "
            "--clock-offset over several pictures"
        )
    order = np.flatnonzero(good)[np.argsort(t[good], kind="stable")]
    return [paths[i] for i in order], t[order], spread[order]
