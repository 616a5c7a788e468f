"""Photographs of a run, geotagged: rendered where the vehicle truly was, or taken by a real camera on the dive.

Tags, and the tables beside them, say what the navigation knows: a picture of the twin is drawn from the truth and
tagged by the estimate or the smoothed track, as a real one would be.
"""

import json
import math
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.datum import Datum, datum_of
from rovtwin.core.errors import ConfigError, LogError
from rovtwin.core.log import Log
from rovtwin.core.user_files.files import write_text
from rovtwin.imaging.floor import Floor, Plane
from rovtwin.imaging.photographs.jpeg import exif_in, jpeg_of, tagged, taken_at
from rovtwin.imaging.photographs.overlap import Overlap, length_on, overlap_of
from rovtwin.imaging.photographs.tags import Shot, direction_of, exif_of, focal_in_water, picture_angles, xmp_of
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.runs.compose.world import on_world_floor
from rovtwin.runs.recording.photo_tables import write_tables
from rovtwin.runs.recording.photo_track import Track, track_of
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.camera.renderer import Renderer
from rovtwin.simulation.camera.sensor import camera_named
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


@dataclass(frozen=True, eq=False)
class Photos:
    """Pictures that were tagged.

    Attributes:
        folder: That holds them.
        names: Of the files.
        t: When each was taken, by the run's clock [s].
        overlap: On the floor; None where no floor is known.
        error: Of the tags' places where the truth is known, 3D rms [m]; None where it is not.
        notes: What is worth knowing, overlaps that are missing among them.
    """

    folder: Path
    names: list[str]
    t: Float[np.ndarray, " n"]
    overlap: Overlap | None
    error: float | None
    notes: list[str] = field(default_factory=list)

    def figures(self) -> dict[str, Any]:
        """Plain numbers, SI."""
        forward = None if self.overlap is None else self.overlap.forward[np.isfinite(self.overlap.forward)]
        side = None if self.overlap is None else self.overlap.side[np.isfinite(self.overlap.side)]
        return {
            "folder": str(self.folder),
            "pictures": len(self.names),
            "from_s": float(self.t[0]),
            "to_s": float(self.t[-1]),
            "overlap_median": None if forward is None or not len(forward) else float(np.median(forward)),
            "overlap_least": None if forward is None or not len(forward) else float(forward.min()),
            "side_overlap_median": None if side is None or not len(side) else float(np.median(side)),
            "place_error_rms_m": self.error,
            "notes": self.notes,
        }


def photos_of_run(
    run: Path,
    request: PhotoRequest,
    out: Path,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Photos:
    """Write the pictures, `geo.txt` for OpenDroneMap, `reference.csv` for Metashape, and `photos.json`.

    Args:
        run: Folder of the run, or its log; `scenario.yaml` lies beside it.
        request: What is asked for.
        out: Folder to write.
        overwrite: Whether one that is there may be replaced.
        progress: Called with pictures done and pictures in all.

    Raises:
        ConfigError: No such camera or scene, no datum, no clock offset, or pictures that cannot be read.
        LogError: The log lacks the poses that tags are made of.
    """
    log, scenario, folder = _read(run)
    datum = _datum(log, scenario, request)
    vehicle = vehicle_of(scenario)
    camera = camera_named(vehicle, request.camera, request.scale)
    track = track_of(log, folder, request.navigation)
    floor = _floor(scenario, request)
    notes: list[str] = []
    if request.pictures is None:
        t, draw = _triggered(track, camera, floor, request), _rendered(log, scenario, camera, request)
        names = [f"{camera.name.replace('.', '_')}_{i + 1:05d}.jpg" for i in range(len(t))]
    else:
        paths, t = _real(request, track, datum, notes)
        # geo.txt separates its columns by spaces: files are named as it can name them, and the folder is a copy.
        names, draw = ["_".join(path.name.split()) for path in paths], lambda i, when: paths[i]
        if len(set(names)) < len(names):
            raise ConfigError(f"{request.pictures}: names that differ by spaces alone become one; rename the pictures")
        if any(name != path.name for name, path in zip(names, paths, strict=True)):
            notes.append("spaces in names of pictures became _, as geo.txt separates its columns by spaces")
    _make(out, overwrite)
    position, R, std = track.at(t)
    shots = [_shot(camera, vehicle.name, datum, float(t[i]), position[i], R[i], None if std is None else std[i])
             for i in range(len(t))]  # fmt: skip
    for i, (name, shot) in enumerate(zip(names, shots, strict=True)):
        (out / name).write_bytes(_with_tags(draw(i, float(t[i])), shot, name))
        if progress:
            progress(i + 1, len(t))
    write_tables(out, names, shots, std)
    overlap = None if floor is None else overlap_of(camera, position, R, floor)
    notes += ["no floor is known: overlaps are not judged; say --floor"] if overlap is None else overlap.words(t)
    found = Photos(out, names, t, overlap, _error(log, camera, t, position, R), notes)
    write_text(out / "photos.json", json.dumps(found.figures() | {"navigation": request.navigation}, indent=1) + "\n")
    return found


def _read(run: Path) -> tuple[Log, Scenario, Path]:
    path = run / "log.mcap" if run.is_dir() else run
    log, beside = Log.read(path), path.with_name("scenario.yaml")
    if not beside.exists():
        raise ConfigError(f"{beside}: not there; the scenario beside a log says which vehicle and camera it is of")
    return log, load_scenario(beside), path.parent


def _datum(log: Log, scenario: Scenario, request: PhotoRequest) -> Datum:
    """Of the log; a twin's without one has its scenario's, a real dive's has no place on the map."""
    found = datum_of(log.metadata)
    if found is None and request.pictures is not None:
        raise ConfigError("the log has no datum: nothing says where on the map, or when, the dive was")
    return found or scenario.origin


def _floor(scenario: Scenario, request: PhotoRequest) -> Floor | None:
    depth = scenario.world.floor if request.floor is None else request.floor
    return None if depth is None else Plane(float(depth))


def _triggered(track: Track, camera: Camera, floor: Floor | None, request: PhotoRequest) -> Float[np.ndarray, " n"]:
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


def _rendered(log: Log, scenario: Scenario, camera: Camera, request: PhotoRequest) -> Callable[[int, float], bytes]:
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


def _real(
    request: PhotoRequest, track: Track, datum: Datum, notes: list[str]
) -> tuple[list[Path], Float[np.ndarray, " n"]]:
    """Pictures of a folder that were taken on the track, in order of time [s]."""
    folder = request.pictures
    assert folder is not None
    paths = sorted(p for p in folder.iterdir() if p.suffix.lower() in (".jpg", ".jpeg")) if folder.is_dir() else []
    if not paths:
        raise ConfigError(f"{folder}: has no pictures; expected a folder of .jpg files")
    stamps = [taken_at(exif_in(path), path.name) for path in paths]
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
    order = np.argsort(t[good], kind="stable")
    return [paths[i] for i in np.flatnonzero(good)[order]], t[good][order]


def _make(out: Path, overwrite: bool) -> None:
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        if not overwrite:
            raise ConfigError(f"{out}: is there already; choose another folder, or --overwrite")
        if not (out / "photos.json").is_file():
            raise ConfigError(f"{out}: holds other things than photographs made here; choose another folder")
        shutil.rmtree(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{out}: cannot be made ({error.strerror})") from None


def _shot(
    camera: Camera,
    vehicle: str,
    datum: Datum,
    t: float,
    position: Float[np.ndarray, "3"],
    R_nb: Float[np.ndarray, "3 3"],
    std: Float[np.ndarray, "6"] | None,
) -> Shot:
    eye, R_nc = position + R_nb @ camera.position, R_nb @ camera.R_bc
    latitude, longitude, _ = (float(x) for x in datum.geodetic(eye))
    yaw, pitch, roll = (math.degrees(angle) for angle in picture_angles(R_nc))
    return Shot(
        np.datetime64(str(datum.utc(t)), "ns"), latitude, longitude, -float(eye[2]), yaw, pitch, roll,
        None if std is None else float(np.hypot(std[0], std[1])), None if std is None else float(std[2]),
        math.degrees(direction_of(R_nc)), focal_in_water(camera.lens), "rovtwin", f"{vehicle} {camera.name}",
    )  # fmt: skip


def _with_tags(picture: bytes | Path, shot: Shot, name: str) -> bytes:
    if isinstance(picture, bytes):
        return tagged(picture, exif_of(shot), xmp_of(shot), name)
    # A real camera's focal length is its own affair, as it has written it.
    return tagged(picture.read_bytes(), exif_of(replace(shot, focal=None), exif_in(picture)), xmp_of(shot), name)


def _error(
    log: Log, camera: Camera, t: Float[np.ndarray, " n"], position: Float[np.ndarray, "n 3"], R: Any
) -> float | None:
    """Of the places of the camera that tags say, 3D rms [m]."""
    if "truth/eta" not in log:
        return None
    place, turned, _ = track_of(log, Path(), "truth").at(t)
    off = position + R @ camera.position - place - turned @ camera.position
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
