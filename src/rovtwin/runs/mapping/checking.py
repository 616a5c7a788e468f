"""All that can be refused of a map before anything heavy is loaded, read or compiled."""

import math
from contextlib import ExitStack
from pathlib import Path

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import parse, read_yaml
from rovtwin.core.user_files.files import MOST_TEXT, checked
from rovtwin.imaging.lines import LinesHead
from rovtwin.imaging.lines_of_files import in_order
from rovtwin.mapping.mesh_floor import AXES, MESHES, OTHER_MESHES
from rovtwin.mapping.projection import crs_of, rasterio
from rovtwin.runs.mapping.columns import CONTROL, POINTS, columns_of
from rovtwin.runs.mapping.request import FORMATS, NAVIGATIONS, MapRequest, WaterFile

NO_FILE = ("altimeter", "plane", "truth")  # floors that are no file
_NOTE = "map.json"
_FINEST, _COARSEST = 0.001, 5.0  # cells [m]


def check(run: Path | None, request: MapRequest, out: Path, overwrite: bool) -> None:
    """Refuse what is wrong with options and files.

    Raises:
        ConfigError: An option, or a file that goes with one, cannot be used.
        LogError: The file of lines cannot be used.
    """
    rasterio("rovtwin map")
    for path in (out, run):
        _nameable(path)
    _check_options(request, out, overwrite)
    _check_together(run, request)
    if run is not None:
        _check_run(run, request)
    with ExitStack() as opened:
        files = in_order([opened.enter_context(LinesHead(path)) for path in request.files])
        for lines in files:
            _check_lines(lines, run, request)
        if request.panel is not None:
            _check_panel(request, files[0])
    if request.crs != "utm":
        crs_of(request.crs, "--crs")
    if request.water not in (None, "truth"):
        parse(WaterFile, read_yaml(request.water), Path(request.water).name)
    for option, path, *kinds in (("--points", request.points, *POINTS), ("--control", request.control, CONTROL)):
        if path is not None:
            columns_of(option, path, *kinds)
    if request.area is not None:
        _there("--area", request.area)
    _check_floor(request)


def _nameable(path: Path | None) -> None:
    """Refuse a name that no file can have, such as one that is too long; whether it is there is asked later."""
    try:
        if path is not None:
            path.exists()
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}") from None


def _there(option: str, path: Path, most: float = MOST_TEXT) -> None:
    try:
        checked(path, most)
    except OSError as error:
        raise ConfigError(f"{option} {path}: cannot be read: {error.strerror or error}") from None


def _check_options(request: MapRequest, out: Path, overwrite: bool) -> None:
    if not _FINEST <= request.resolution <= _COARSEST:
        raise ConfigError(
            f"--resolution: found {request.resolution:g}, expected metres from {_FINEST:g} to {_COARSEST:g}"
        )
    if wrong := [name for name in request.formats if name not in FORMATS]:
        raise ConfigError(f"--formats: found '{wrong[0]}', expected some of {', '.join(FORMATS)}")
    if out.exists() and not out.is_dir():
        raise ConfigError(f"{out}: is a file, expected a folder to make")
    if (out / _NOTE).exists() and not overwrite:
        raise ConfigError(f"{out}: holds a mosaic already. Say --overwrite, or another folder")
    if out.is_dir() and not (out / _NOTE).exists() and not (out / ".parts").is_dir() and any(out.iterdir()):
        raise ConfigError(f"{out}: holds other files; say a folder that is empty or not there")
    if not request.begin < request.end:
        found = f"{request.begin:g} and {request.end:g} s"
        raise ConfigError(f"--from, --to: found {found}, expected a beginning before the end")
    if not request.turn > 0:
        raise ConfigError(f"--max-turn: found {request.turn:g} rad/s, expected more than 0")
    if request.navigation is not None and request.navigation not in NAVIGATIONS:
        raise ConfigError(f"--navigation: found '{request.navigation}', expected {', '.join(NAVIGATIONS)}")


def _check_together(run: Path | None, request: MapRequest) -> None:
    """Options that contradict each other."""
    asked = request.register or request.control is not None
    if asked and (run is None or request.navigation not in (None, "smoothed")):
        source = request.navigation or "that of the file of lines"
        raise ConfigError(
            f"--register, --control: found the navigation '{source}', expected smoothed, of a run: only a smoothed "
            f"track says how its errors hang together. First: rovtwin smooth {run or 'RUN'}"
        )
    if run is None and request.navigation in ("smoothed", "estimate"):
        raise ConfigError(f"--navigation {request.navigation}: needs a run; without one there are lines and truth")
    if run is None and request.floor == "altimeter":
        raise ConfigError(
            "--floor altimeter: needs a run, whose log has the altimeter. Say --floor plane with --depth, or a file"
        )


def _check_run(run: Path, request: MapRequest) -> None:
    log = run / "log.mcap" if run.is_dir() else run
    if not log.is_file():
        raise ConfigError(f"{log}: not there; expected the folder of a run, or its log")
    if not (beside := log.with_name("scenario.yaml")).is_file():
        raise ConfigError(f"{beside}: not there; the scenario beside a log says which vehicle and floor it is of")
    needed = ["smoothed.mcap"] if request.navigation == "smoothed" else []
    needed = ["smoothed.mcap", "smoothed_keys.nc"] if request.register or request.control is not None else needed
    for name in needed:
        if not (path := log.with_name(name)).is_file():
            raise ConfigError(f"{path}: not there; make it first: rovtwin smooth {log.parent}")


def _check_lines(lines: LinesHead, run: Path | None, request: MapRequest) -> None:
    if lines.counts:
        _ = lines.frames
    if request.imager is None and not lines.described:
        raise ConfigError(
            f"{lines.path}: does not describe its imager's lens and port. Describe it in a file such as `rovtwin scan "
            "--imager uhi` uses, and say --imager FILE"
        )
    if run is None and lines.datum is None and request.datum is None:
        raise ConfigError(
            f"{lines.path}: says nothing of a datum, the origin of north, east, down. Say --datum "
            "LATITUDE,LONGITUDE[,HEIGHT]"
        )
    if not lines.simulated:
        for option in ("navigation", "floor", "water"):
            if getattr(request, option) == "truth":
                raise ConfigError(f"--{option} truth: {lines.path} knows none: an instrument took its lines")


def is_mesh(floor: str) -> bool:
    """Whether a floor is a file of a mesh, by its ending."""
    return Path(floor).suffix.lower() in MESHES


def _check_panel(request: MapRequest, lines: LinesHead) -> None:
    from rovtwin.runs.mapping.panel import read_panel

    if request.radiance:
        raise ConfigError("--panel: scales reflectance, and --radiance asks for none; leave one of them out")
    assert request.panel is not None
    read_panel(request.panel, None, lines.wavelengths, lines.fwhm)


def _check_floor(request: MapRequest) -> None:
    path = Path(request.floor)
    if request.floor_std is not None and not 0.0 <= request.floor_std < math.inf:
        raise ConfigError(f"--floor-std: found {request.floor_std:g} m, expected 0 or more")
    if request.floor_std is not None and request.floor in ("altimeter", "truth"):
        raise ConfigError(f"--floor-std: --floor {request.floor} says itself how unsure it is; leave it out")
    if request.floor_crs != "ned" and not is_mesh(request.floor):
        raise ConfigError("--floor-crs: says in which frame a mesh is; a raster file says its own. Leave it out")
    if request.floor in NO_FILE:
        return
    if path.suffix.lower() in OTHER_MESHES:
        raise ConfigError(
            f"--floor {path}: meshes are read as {', '.join(MESHES)}; save it as one of them (ParaView, MeshLab)"
        )
    if not is_mesh(request.floor):
        _check_raster(path)
        return
    _there("--floor", path, math.inf)
    if request.floor_crs not in AXES:
        crs_of(request.floor_crs, "--floor-crs")
    elif not request.heights:
        raise ConfigError("--dem-values depth: for a raster file, or a mesh with --floor-crs EPSG:..; leave it out")


def _check_raster(path: Path) -> None:
    from rovtwin.mapping.floors import check_system

    rio = rasterio(f"--floor {path}")
    _there("--floor", path, math.inf)
    try:
        with rio.open(path) as file:
            check_system(file, path)
    except rio.errors.RasterioError as error:
        raise ConfigError(f"{path}: cannot be read as a raster ({error}); expected such as a GeoTIFF") from None
