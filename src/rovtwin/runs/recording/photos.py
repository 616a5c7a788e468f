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
from jaxtyping import Float

from rovtwin.core.datum import Datum, datum_of
from rovtwin.core.errors import ConfigError
from rovtwin.core.log import Log
from rovtwin.core.user_files.files import write_text
from rovtwin.imaging.floor import Floor, Plane
from rovtwin.imaging.photographs.jpeg import exif_in, tagged
from rovtwin.imaging.photographs.overlap import Overlap, overlap_of
from rovtwin.imaging.photographs.tags import Shot, direction_of, exif_of, focal_in_water, picture_angles, xmp_of
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.runs.recording.photo_sources import PhotoRequest, real, rendered, triggered
from rovtwin.runs.recording.photo_tables import write_tables
from rovtwin.runs.recording.photo_track import track_of
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.camera.sensor import camera_named
from rovtwin.vehicle.description.cameras import Camera


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
        spread = 0.0
        t, draw = triggered(track, camera, floor, request), rendered(log, scenario, camera, request)
        names = [f"{camera.name.replace('.', '_')}_{i + 1:05d}.jpg" for i in range(len(t))]
    else:
        paths, t, spread = real(request, track, datum, notes)
        # geo.txt separates its columns by spaces: files are named as it can name them, and the folder is a copy.
        names, draw = ["_".join(path.name.split()) for path in paths], lambda i, when: paths[i]
        if len(set(names)) < len(names):
            raise ConfigError(f"{request.pictures}: names that differ by spaces alone become one; rename the pictures")
        if any(name != path.name for name, path in zip(names, paths, strict=True)):
            notes.append("spaces in names of pictures became _, as geo.txt separates its columns by spaces")
    _make(out, overwrite)
    position, R, std = track.at(t, spread)
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
