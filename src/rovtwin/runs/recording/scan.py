"""The lines that a hyperspectral imager would have taken on a run already flown: from its log's truth, over a scene."""

import hashlib
import json
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from rovtwin.core.datum import Datum, datum_of
from rovtwin.core.errors import ConfigError, LogError
from rovtwin.core.log import Log
from rovtwin.core.log.files import exists_error
from rovtwin.core.user_files.yamlfile import dump_yaml
from rovtwin.imaging.files import imager_as_data, list_imagers
from rovtwin.imaging.imager import Imager, Mount, load_imager, mount_of
from rovtwin.imaging.lines import Truth
from rovtwin.imaging.lines_writer import Head, Navigation, write_lines
from rovtwin.imaging.path import POSES, PosePath
from rovtwin.imaging.unfinished import Unfinished
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.runs.compose.world import on_world_floor
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.imager.scan import BLOCK, LONGEST, Scan
from rovtwin.simulation.scene import Scene, list_scenes, load_scene

_FORMAT = 2  # of what the lines are made of: a change of the model that changes them raises it
_ROOM = 2.1  # of the file's size that the disk must have free: it is put together from lines kept beside it


@dataclass(frozen=True)
class ScanRequest:
    """What is asked for.

    Attributes:
        imager: That takes the lines, name or file; None: the one that the vehicle file names.
        scene: A scene of the library or a file; None: that of the run's cameras.
        sensor: Of the vehicle, where the imager sits; None: its first of kind imager.
        begin: First line at the earliest [s].
        end: Last line at the latest [s]; inf: with the run.
        misalignment: Roll, pitch and yaw about b by which it sits otherwise than stated [rad].
        displacement: By which it sits elsewhere than stated, b [m].
        navigation: Whose poses the file holds beside the lines, of `imaging.path.POSES`.
        seed: Of noise; None: the run's.
    """

    imager: Imager | str | None = None
    scene: str | None = None
    sensor: str | None = None
    begin: float = 0.0
    end: float = np.inf
    misalignment: tuple[float, float, float] = (0.0, 0.0, 0.0)
    displacement: tuple[float, float, float] = (0.0, 0.0, 0.0)
    navigation: str = "estimate"
    seed: int | None = None


@dataclass(frozen=True)
class Scanned:
    """A file of lines that was made.

    Attributes:
        path: Of the file.
        lines: How many.
        resumed: How many of them an earlier, broken call had made.
        seconds: How long it took.
        saturated: Share of the counts that are full.
        unseen: Lines whose middle sees no floor.
        notes: What is worth knowing.
    """

    path: Path
    lines: int
    resumed: int
    seconds: float
    saturated: float
    unseen: int
    notes: list[str]


def scan_run(
    run: Path,
    request: ScanRequest,
    out: Path,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Scanned:
    """Make the file of lines; one that was broken off goes on where it was.

    Args:
        run: Folder of the run, or its log; `scenario.yaml` lies beside it.
        request: What is asked for.
        out: File to write.
        overwrite: Whether one that is there may be replaced.
        progress: Called with lines done and lines in all.

    Raises:
        ConfigError: The scenario is missing, has no such vehicle or scene, or the disk has no room.
        LogError: The log has no truth, or the file cannot be written.
    """
    if out.exists() and not overwrite:
        raise exists_error(out)
    begun, folder = time.monotonic(), run if run.is_dir() else run.parent
    scenario, log = _read(run)
    scan, mount, notes = _prepare(scenario, log, request)
    shape = (scan.imager.pixels, len(scan.imager.wavelengths))
    _check_room(out, 2 * len(scan.t) * shape[0] * shape[1])
    kept = Unfinished(out, _key(scan), shape)
    resumed = min(kept.done, len(scan.t)) // BLOCK * BLOCK if kept.done < len(scan.t) else len(scan.t)
    kept.cut(resumed)
    for block in scan.blocks(resumed):
        kept.append(block.counts)
        if progress:
            progress(block.first + len(block.counts), len(scan.t))
    full, head = 0, _head(scan, mount, log, folder, scenario, request)

    def counted():
        nonlocal full
        for counts in kept.blocks():
            full += int((counts >= scan.detector.full).sum())
            yield counts

    write_lines(out, head, counted(), overwrite=overwrite)
    kept.remove()
    assert head.truth is not None
    unseen = int((~np.isfinite(head.truth.floor)).sum())
    if unseen:
        notes.append(f"{unseen} of {len(scan.t)} lines see no floor within {LONGEST:g} m")
    share = full / (len(scan.t) * shape[0] * shape[1])
    if share > 0.01:
        notes.append(f"{share:.0%} of the counts are full: a shorter exposure or less light would see more")
    return Scanned(out, len(scan.t), resumed, time.monotonic() - begun, share, unseen, notes)


def _read(run: Path) -> tuple[Scenario, Log]:
    path = run / "log.mcap" if run.is_dir() else run
    log, beside = Log.read(path), path.with_name("scenario.yaml")
    if not beside.exists():
        raise ConfigError(f"{beside}: not there; the scenario beside a log says which vehicle and floor it is of")
    if "truth/eta" not in log:
        raise LogError(f"{path}: has no truth/eta. Lines are made of where the vehicle truly was: of a simulated run")
    return load_scenario(beside), log


def _prepare(scenario: Scenario, log: Log, request: ScanRequest) -> tuple[Scan, Mount, list[str]]:
    vehicle = vehicle_of(scenario)
    mount = mount_of(vehicle, request.sensor)
    imager = _imager(request.imager or mount.imager, vehicle.name, mount.name)
    turned = Rotation.from_rotvec(request.misalignment).as_matrix() @ mount.rotation
    true = Mount(mount.position + np.array(request.displacement), turned, mount.name)
    scene, notes = _scene(scenario, request.scene)
    truth = log["truth/eta"]
    path = PosePath.of(truth.t, truth.values[:, :6], "truth/eta")
    t = _times(request, imager, path)
    seed = scenario.seed if request.seed is None else request.seed
    return Scan(imager, true, path, scene, t, seed), mount, notes


def _imager(given: Imager | str, vehicle: str, sensor: str) -> Imager:
    if isinstance(given, Imager):
        return given
    if not given:
        raise ConfigError(
            f"{vehicle}: does not say which imager {sensor} is. Say --imager, one of {', '.join(list_imagers())} or a "
            "file, or add 'imager: uhi' to that sensor"
        )
    return load_imager(given)


def _scene(scenario: Scenario, name: str | None) -> tuple[Scene, list[str]]:
    if name is None and not scenario.cameras:
        raise ConfigError(f"{scenario.name}: names no scene; say --scene, one of {', '.join(list_scenes())} or a file")
    given = load_scene(name or scenario.cameras[0].scene)
    scene, notes = on_world_floor(given, scenario.world), []
    if given.file.bottom is not None and scenario.world.floor is None:
        notes.append(f"the run has no floor of its own; seen is that of the scene, {given.depth:g} m deep")
    if scene.meshes and (names := [one.name for one in scene.meshes if one.name != "bottom"]):
        notes.append(f"not seen are {', '.join(names)}: an imager sees the floor, boxes, plates and markers")
    return scene, notes


def _times(request: ScanRequest, imager: Imager, path: PosePath) -> Float[np.ndarray, " line"]:
    """Middles of the exposures, all within the path."""
    rate, half = imager.file.line_rate_hz, 0.5 * imager.file.exposure
    first = max(request.begin, float(path.t[0])) + half
    last = min(request.end, float(path.t[-1])) - half
    count = int(np.floor((last - first) * rate + 1e-9)) + 1
    if count < 2:
        raise ConfigError(
            f"from {request.begin:g} to {request.end:g} s there is no time for two lines; the run has poses from "
            f"{path.t[0]:.1f} to {path.t[-1]:.1f} s"
        )
    return first + np.arange(count) / rate


def _head(scan: Scan, mount: Mount, log: Log, folder: Path, scenario: Scenario, request: ScanRequest) -> Head:
    position, _, attitude = scan.path.at(scan.t)
    truth = Truth(scan.t, position, attitude, scan.mount, _scene_text(scan.scene), scan.floor_below())
    return Head(
        scan.imager,
        mount,
        datum_of(log.metadata) or Datum(),
        scan.stamps(scan.imager.file.clock),
        np.full(len(scan.t), scan.imager.file.exposure),
        scan.detector.dark_frame,
        scan.detector.response_frame,
        scan.detector.full,
        _navigation(log, folder, request.navigation),
        truth,
        {"vehicle": scenario.name, "run": folder.resolve().name, "seed": str(scan.seed)},
    )


def _navigation(log: Log, folder: Path, source: str) -> Navigation:
    name = POSES[source]
    if source == "smoothed":
        path = folder / "smoothed.mcap"
        if not path.is_file():
            raise ConfigError(f"{path}: not there; make it first: rovtwin smooth {folder}")
        log = Log.read(path)
    if name not in log:
        raise LogError(f"{folder}: the log has no {name}, which --navigation {source} asks for")
    series = log[name]
    return Navigation(series.t, series.values[:, :3], series.values[:, 3:6], source)


def _scene_text(scene: Scene) -> str:
    return dump_yaml(scene.file.model_dump(mode="json", exclude_defaults=True, exclude_none=True))


def _key(scan: Scan) -> str:
    """Of all that the counts depend on."""
    file, floor = scan.imager.file, scan.scene.floor
    assert floor is not None
    place = np.stack(np.meshgrid(np.linspace(-20.0, 20.0, 9), np.linspace(-20.0, 20.0, 9)), axis=-1)
    digest = hashlib.sha256(json.dumps([_FORMAT, imager_as_data(file), _scene_text(scan.scene), scan.seed]).encode())
    arrays = (scan.t, scan.path.t, scan.path.position, scan.path.attitude, scan.mount.position, scan.mount.rotation)
    for array in (*arrays, floor.depth_and_slope(place)[0]):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _check_room(out: Path, size: int) -> None:
    try:
        free = shutil.disk_usage(out.resolve().parent).free
    except OSError as error:
        raise ConfigError(f"{out}: cannot be written: {error.strerror or error}") from None
    if free < _ROOM * size:
        raise ConfigError(
            f"{out}: its lines take {size / 1e9:.1f} GB, twice while they are put together, and the disk has "
            f"{free / 1e9:.1f} GB free. Free some, take fewer lines (--from, --to), or an imager with fewer bands"
        )
