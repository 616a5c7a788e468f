"""What a notebook needs, from names, paths and plain data: `import rovtwin` shows these functions.

Each does one job of the command line and returns the object that the command prints. A vehicle or a scenario is named
(`"double_blueye"`), lies in a file (`"my.yaml"`), or is a dictionary as the file would hold it.
"""

import copy
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from rovtwin.core.errors import ConfigError
from rovtwin.core.extras import require
from rovtwin.core.link import Link
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle.description.vehicle import Vehicle

if TYPE_CHECKING:
    from rovtwin.campaign.session import CampaignSession
    from rovtwin.campaign.tuning.result import Tuned
    from rovtwin.core.block import Block
    from rovtwin.core.log import Log
    from rovtwin.identification.logs.record import Record
    from rovtwin.identification.result import Identification
    from rovtwin.planning.plan import Plan
    from rovtwin.runs.flight import Flight
    from rovtwin.runs.mapping.classification.result import Classification
    from rovtwin.runs.mapping.result import Mosaic
    from rovtwin.runs.smooth import SmoothedRun
    from rovtwin.simulation.roll_out import Trajectory

LONGEST_STEP = 0.1  # of `simulate` [s]: vehicles of this size move within a second
RANGE = "commands: expected at least one step, and numbers from -1 to 1"
VehicleLike = Vehicle | str | Path | Mapping[str, Any]
ScenarioLike = Scenario | str | Path | Mapping[str, Any]


def load_vehicle(vehicle: VehicleLike, *, identified: bool = True) -> Vehicle:
    """A vehicle of the library, of a file, or of a dictionary as the file would hold it.

    Args:
        vehicle: `"double_blueye"`, `"my_vehicle.yaml"`, `{"name": "tube", "mass": 9.8, ...}`.
        identified: Whether what tests found counts; False: the parts alone.

    Raises:
        ConfigError: With a line per mistake: file, place, what was found, what was expected, the fix.

    Example:
        >>> vehicle = rovtwin.load_vehicle("double_blueye")
        >>> vehicle.name, len(vehicle.thruster_names)
        ('double_blueye', 6)
    """
    from rovtwin.vehicle.description import vehicle as description

    if isinstance(vehicle, Vehicle):
        return vehicle if identified else vehicle.without_identification()
    if not isinstance(vehicle, str | Path | Mapping):
        raise ConfigError(f"vehicle: found {type(vehicle).__name__}, expected a name, a path or a dictionary")
    if not isinstance(vehicle, Mapping):
        return description.load_vehicle(vehicle, identified=identified)
    found = description.vehicle_from_dict(copy.deepcopy(dict(vehicle)), str(vehicle.get("name", "vehicle")))
    return found if identified else found.without_identification()


def load_scenario(scenario: ScenarioLike, overrides: Sequence[str] = (), seed: int | None = None) -> Scenario:
    """A scenario of the library, of a file, or of a dictionary as the file would hold it.

    Args:
        scenario: `"square"`, `"mine.yaml"`, `{"vehicle": "gladius_mini", "mission": [...]}`.
        overrides: `key.path=value` texts; the value is read as YAML. Code that they name may be run; code that a file
            or dictionary names needs the environment variable ROVTWIN_TRUST_CODE.
        seed: In place of the scenario's.

    Raises:
        ConfigError: It cannot be used; the message says where and why.

    Example:
        >>> rovtwin.load_scenario("square", ["vehicle=gladius_mini"]).vehicle
        'gladius_mini'
    """
    from rovtwin.scenario import files

    overrides = [overrides] if isinstance(overrides, str) else overrides
    if isinstance(scenario, str | Path):
        return files.load_scenario(scenario, overrides, seed)
    if not isinstance(scenario, Scenario | Mapping):
        raise ConfigError(f"scenario: found {type(scenario).__name__}, expected a name, a path or a dictionary")
    data = _as_written(scenario) if isinstance(scenario, Scenario) else copy.deepcopy(dict(scenario))
    return files.overridden(data, str(data.setdefault("name", "scenario")), None, overrides, seed)


def _as_written(scenario: Scenario) -> dict[str, Any]:
    """As its file would hold it: what was left out stays so, since the vehicle or the mission has its own of it."""
    return scenario.model_dump(mode="json", exclude_unset=True)


def fly(
    scenario: ScenarioLike,
    folder: str | Path | None = None,
    *,
    seed: int | None = None,
    overrides: Sequence[str] = (),
    autopilot: "Block | Mapping[str, Any] | str | None" = None,
    report: bool = False,
    realtime: bool = False,
    say: Callable[[str], None] = print,
    progress: Callable[[float, str], None] | None = None,
) -> "Flight":
    """Fly a scenario with the twin.

    Args:
        scenario: See `load_scenario`.
        folder: New folder for log, scenario and report; None keeps all in memory.
        seed: In place of the scenario's.
        overrides: `key.path=value` texts.
        autopilot: In place of the scenario's: a preset or file, what may stand in its section, where Blocks may stand
            for addresses of Blocks (`{"controller": SlidingMode(..)}`), or a Block that is a whole autopilot.
        report: Write the HTML report (needs a folder).
        realtime: By the wall clock.
        say: Told before the start what the vehicle cannot do of the mission, and what it does instead.
        progress: Called about once a simulated second with the time [s] and the phase.

    Raises:
        ConfigError: The scenario cannot be composed, its mission is refused, or there is no folder for a report.
        LogError: The folder cannot be written.

    Example:
        >>> flight = rovtwin.fly("square", overrides=["autopilot=thesis", "duration=5"], say=lambda line: None)
        >>> flight.log["truth/eta"].to_xarray().sizes["time"] > 50
        True
    """
    from rovtwin.core.trust import consent_to_addresses
    from rovtwin.runs import fly as flying
    from rovtwin.runs.compose.own_blocks import separated

    if report and folder is None:
        raise ConfigError("fly: a report needs a folder")
    found, own = load_scenario(scenario, overrides, seed), None
    if autopilot is not None:
        section, own = (autopilot, None) if isinstance(autopilot, str) else separated(autopilot)
        if not isinstance(section, str):
            consent_to_addresses(section)
        found = load_scenario(_as_written(found) | {"autopilot": section})
    return flying.fly(found, folder, realtime=realtime, progress=progress, report=report, say=say, own=own)


def simulate(
    vehicle: VehicleLike,
    commands: ArrayLike | Mapping[str, ArrayLike],
    *,
    dt: float = 0.01,
    position: Sequence[float] = (0.0, 0.0, 0.0),
    heading: float = 0.0,
    current: Sequence[float] = (0.0, 0.0, 0.0),
) -> "Trajectory":
    """The equations of motion alone: no sensors, no autopilot, endless water.

    Args:
        vehicle: See `load_vehicle`.
        commands: From -1 to 1, shape (steps, thrusters); or by thruster's name, shape (steps,), the others at rest.
        dt: Step of the integration (RK4) [s]; a command holds for one.
        position: CO at the start, n [m]; at rest and level.
        heading: At the start [rad].
        current: Velocity of the water, n [m/s].

    Returns:
        The trajectory, with the start at 0 first: by `time` `position` in n [m], `attitude` (quaternion R_nb), `nu` in
        b at CO [m/s, rad/s], `thrust` [N], and `command` (of the step that begins; NaN at the end).

    Raises:
        ConfigError: Another shape, a thruster that is not there, or a command beyond 1.

    Example:
        >>> path = rovtwin.simulate("double_blueye", {"port.surge": [0.5] * 200, "starboard.surge": [0.5] * 200})
        >>> bool(path.nu.sel(axis="u")[-1] > 0.1)
        True
    """
    from rovtwin.simulation.roll_out import roll_out

    one = load_vehicle(vehicle)
    step = float(_numbers(dt, "dt", ()))
    if not 0.0 < step <= LONGEST_STEP:
        raise ConfigError(f"dt: found {step:g} s, expected more than 0 and at most {LONGEST_STEP:g}")
    start, water = _numbers(position, "position", (3,)), _numbers(current, "current", (3,))
    u = _commands(one, commands)
    angle = float(_numbers(heading, "heading", ()))
    path = roll_out(one.model(), u, step, start, angle, water, one.thruster_names, one.name)
    if not np.all(np.isfinite(path.states["nu"])):
        raise ConfigError(f"dt: the motion of {one.name} does not stay finite with {step:g} s; take a shorter step")
    return path


def _numbers(given: Any, name: str, shape: tuple[int, ...] | None = None) -> np.ndarray:
    """Finite numbers of a shape; ConfigError otherwise."""
    try:
        found = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        raise ConfigError(f"{name}: found {given!r:.60}, expected numbers") from None
    if shape is not None and found.shape != shape:
        expected = "one number" if shape == () else f"{shape[0]} numbers"
        raise ConfigError(f"{name}: found the shape {found.shape}, expected {expected}")
    if not np.all(np.isfinite(found)):
        raise ConfigError(f"{name}: expected finite numbers" if name != "commands" else RANGE)
    return found


def _commands(vehicle: Vehicle, commands: ArrayLike | Mapping[str, ArrayLike]) -> np.ndarray:
    names = vehicle.thruster_names
    if isinstance(commands, Mapping):
        if unknown := [name for name in commands if name not in names]:
            raise ConfigError(f"commands: no thruster '{unknown[0]}'; {vehicle.name} has {', '.join(names)}")
        columns = {name: np.atleast_1d(_numbers(column, "commands")) for name, column in commands.items()}
        if any(column.ndim != 1 for column in columns.values()):
            raise ConfigError("commands: expected one number a step for each thruster")
        if len(lengths := {len(column) for column in columns.values()}) != 1:
            raise ConfigError(f"commands: found {sorted(lengths)} steps, expected as many for each thruster")
        return _within(np.stack([columns.get(n, np.zeros(next(iter(lengths)))) for n in names], axis=1))
    u = _numbers(commands, "commands")
    if u.ndim != 2 or u.shape[1] != len(names):
        raise ConfigError(f"commands: found the shape {u.shape}, expected (steps, {len(names)}): {', '.join(names)}")
    return _within(u)


def _within(u: np.ndarray) -> np.ndarray:
    if not len(u) or not np.all(np.abs(u) <= 1.0):
        raise ConfigError(RANGE)
    return u


def identify(
    vehicle: VehicleLike,
    logs: "Iterable[str | Path | Record] | str | Path | Record" = (),
    *,
    validate: "Iterable[str | Path | Record] | str | Path | Record" = (),
    **settings: Any,
) -> "Identification":
    """Parameters of a vehicle from its tests, with their uncertainty.

    Args:
        vehicle: Its file gives the starting values; see `load_vehicle`.
        logs: To fit; recordings in a format that says itself what is in it (MCAP, BIN, tlog, ulg, rosbag2), or Records.
        validate: Predicted, never fitted.
        settings: `free`, `prior`, `anchors`, `old`, `options`, `progress`, see `identification.identify.identify`.

    Raises:
        IdentificationError: The evidence cannot be turned into parameters: where, what was found, the fix.

    Example:
        >>> before = rovtwin.identify("double_blueye")  # no test yet: what parts and formulas say
        >>> before.verdicts[0]
        'prior only'
    """
    from rovtwin.core.trust import consent_to_addresses
    from rovtwin.identification import identify as identification

    one = load_vehicle(vehicle)
    consent_to_addresses([dict(a) for a in settings.get("anchors", ()) if isinstance(a, Mapping)])
    return identification.identify(one, _records(logs, one), validate=_records(validate, one), **settings)


def _records(logs: Any, vehicle: Vehicle) -> "list[Record]":
    from rovtwin.identification.logs.readers import read_records
    from rovtwin.identification.logs.record import Record

    several = [logs] if isinstance(logs, str | Path | Record) else logs
    return [r for log in several for r in (read_records(log, vehicle) if isinstance(log, str | Path) else [log])]


def plan_experiment(
    vehicle: str | Path,
    minutes: float,
    tank: str | None = None,
    *,
    seed: int = 1,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> "Plan":
    """The test of so many minutes that is expected to tell most about a vehicle, within a tank.

    Args:
        vehicle: Of the library or in a file.
        minutes: Of test, ways home and hands included.
        tank: Length x width x depth of the water, `"6x3x1.5"` [m]; None: one that suits the vehicle.
        seed: Of the candidates.
        progress: Called with what is being done and how far it is, 0 to 1.

    Raises:
        ConfigError: The vehicle does not fit the tank, or no candidate does.
        IdentificationError: Too little time for a single manoeuvre.

    Example:
        >>> plan = rovtwin.plan_experiment("double_blueye", 3.0, "8x4x2")  # doctest: +SKIP
        >>> rovtwin.fly(plan.scenario)  # doctest: +SKIP
    """
    from rovtwin.planning.experiments import plan_tests
    from rovtwin.planning.tank import Tank

    if not isinstance(vehicle, str | Path):
        raise ConfigError(f"vehicle: found {type(vehicle).__name__}, expected a name or a path, which the plan names")
    one = load_vehicle(vehicle)
    room = Tank.parse(tank) if tank else Tank.of(one.model())
    return plan_tests(one, str(vehicle), minutes, room, seed=seed, progress=progress)


def track(log: str | Path, vehicle: VehicleLike, method: Any = "ekf", **recording: Any) -> "Log":
    """The track of a vehicle from its video, printed markers and attitude.

    Args:
        log: With the attitude; videos and the layout of markers lie beside it, if `recording` names no others.
        vehicle: That carries the cameras; see `load_vehicle`.
        method: `ekf`, `luenberger` or `smoother`.
        recording: What differs, by the names of `runs.track.EngineConfig`.

    Returns:
        A log of the track, which `identify` reads as one with a position sensor.

    Raises:
        ConfigError: No video, or a file that says what cannot be.
        LogError: The log has no attitude, or no frame has a marker.

    Example:
        >>> found = rovtwin.track("runs/pool/log.mcap", "double_blueye")  # doctest: +SKIP
    """
    from rovtwin.positioning.track import METHODS
    from rovtwin.runs.track import TrackOptions, track_run

    if method not in METHODS:
        raise ConfigError(f"method: found '{method}', expected one of {', '.join(METHODS)}")
    _known(recording, TrackOptions)
    for name in ("videos", "lenses"):
        if name in recording:
            recording[name] = [Path(one) for one in recording[name]]
    return track_run(Path(log), load_vehicle(vehicle), method, TrackOptions(**recording))[1]


def _known(settings: Mapping[str, Any], kind: Any) -> None:
    """ConfigError where a setting is none of a dataclass."""
    names = [field.name for field in fields(kind)]
    if unknown := [name for name in settings if name not in names]:
        raise ConfigError(f"{unknown[0]}: no such setting; known: {', '.join(names)}")


def map(
    run: str | Path | None,
    lines: str | Path | Sequence[str | Path],
    folder: str | Path = "mosaic",
    overwrite: bool = False,
    **settings: Any,
) -> "Mosaic":
    """A georeferenced mosaic of an imager's lines, in a folder of files that other programs open.

    Args:
        run: Folder of the run on which they were taken, or its log; None: the file of lines has its own navigation.
        lines: File of lines, of `rovtwin scan` or of an instrument; or several of one dive, or a folder of them.
        folder: To make.
        overwrite: Whether a mosaic that is there may be replaced.
        settings: What differs, by the names of `runs.mapping.request.MapRequest`: floor, navigation, resolution, ..

    Raises:
        ConfigError: Something that is asked for is not there or cannot be.
        LogError: A file cannot be read or written.

    Example:
        >>> mosaic = rovtwin.map("runs/survey", "lines.h5", "mosaic", resolution=0.02)  # doctest: +SKIP
        >>> mosaic.spectrum(567820.5, 7036450.2)  # doctest: +SKIP
    """
    from rovtwin.runs.mapping.checking import check
    from rovtwin.runs.mapping.request import MapRequest

    _known(settings, MapRequest)
    for name in ("area", "points", "control", "panel"):
        if settings.get(name) is not None:
            settings[name] = Path(settings[name])
    several = (lines,) if isinstance(lines, str | Path) else lines
    request = MapRequest(tuple(Path(one) for one in several), **settings)
    path = None if run is None else Path(run)
    check(path, request, Path(folder), overwrite)
    from rovtwin.runs.mapping.make import map_run  # heavy: what is wrong is named before

    return map_run(path, request, Path(folder), overwrite)


def map_classify(mosaic: str | Path, folder: str | Path | None = None, **settings: Any) -> "Classification":
    """What lies where on a mosaic, by spectral angle and linear unmixing, and the area of each class with its interval.

    Args:
        mosaic: Folder of a mosaic, as `map` makes it.
        folder: To make; None: `classes` in the mosaic's.
        settings: What differs, by the names of `runs.mapping.classification.request.ClassifyRequest`: library, classes,
            train, check, variability, ..

    Raises:
        ConfigError: Something that is asked for is not there or does not go together.
        LogError: A file cannot be read or written.

    Example:
        >>> found = rovtwin.map_classify("mosaic", classes=("sand", "kelp"))  # doctest: +SKIP
        >>> found.to_pandas()["area_m2"]  # doctest: +SKIP
    """
    from rovtwin.runs.mapping.classification.make import classify
    from rovtwin.runs.mapping.classification.request import ClassifyRequest
    from rovtwin.runs.mapping.result import Mosaic

    _known(settings, ClassifyRequest)
    for name in ("library", "train", "check", "truth"):
        if settings.get(name) is not None:
            settings[name] = Path(settings[name])
    out = Path(mosaic) / "classes" if folder is None else Path(folder)
    return classify(Mosaic.read(mosaic), ClassifyRequest(**settings), out)


def smooth(run: str | Path) -> "SmoothedRun":
    """The track of a finished run, each instant judged by what came after it, too.

    Args:
        run: Folder of a run, or its log; `scenario.yaml` lies beside.

    Raises:
        ConfigError: The scenario is missing.
        LogError: The log lacks what a filter needs.

    Example:
        >>> rovtwin.smooth("runs/survey").log.write("track.mcap")  # doctest: +SKIP
    """
    from rovtwin.runs.smooth import smooth_run

    return smooth_run(Path(run))


def tune(
    scenario: ScenarioLike,
    only: Sequence[str] = (),
    *,
    seas: Sequence[str] = (),
    weights: Sequence[str] = (),
    progress: Callable[[str, float], None] = lambda what, share: None,
    **settings: Any,
) -> "Tuned":
    """Tune the `model_based` autopilot of a scenario over vehicles as they may truly be, and over seas.

    Args:
        scenario: See `load_scenario`; its autopilot is where the search begins.
        only: Names of what is searched; empty: the usual.
        seas: Such as `calm`, `waves`, `sea`; empty: `calm` and `waves`.
        weights: `TERM=NUMBER` texts, in place of the usual.
        progress: Called with what is being done and how far it is, 0 to 1.
        settings: `plants`, `held_out`, `seed`, `evaluations`, `budget` [s], `own`, `workers`.

    Raises:
        ConfigError: The autopilot is not `model_based`, a name is unknown, or the budget is too short.

    Example:
        >>> tuned = rovtwin.tune("lawnmower_calm", budget=120.0)  # doctest: +SKIP
    """
    require("cmaes", "campaign", "tune")
    from rovtwin.campaign.tuning.cost import weights_of
    from rovtwin.campaign.tuning.parameters import chosen
    from rovtwin.campaign.tuning.result import TuningRequest
    from rovtwin.campaign.tuning.tune import tune as search

    _known(settings, TuningRequest)
    request = TuningRequest(
        load_scenario(scenario), chosen(list(only)), list(seas), weights_of(list(weights)), **settings
    )
    return search(request, progress)


def run_campaign(
    file: str | Path,
    folder: str | Path,
    *,
    samples: int | None = None,
    workers: int | None = None,
    progress: Callable[[Any], None] = lambda now: None,
) -> "CampaignSession":
    """Fly a scenario many times, with what varies drawn for each mission, and judge all of them.

    Args:
        file: Of the campaign, or a folder of results whose campaign it is.
        folder: Of the results; an earlier session of the same campaign is gone on with.
        samples: In place of the file's.
        workers: Processes on this machine; None: one for each core.
        progress: Called at the start and after each portion.

    Raises:
        ConfigError: The file cannot be used, or the folder is another campaign's.

    Example:
        >>> session = rovtwin.run_campaign("examples/campaign.yaml", "runs/many", samples=20)  # doctest: +SKIP
    """
    require("pyarrow", "campaign", "run_campaign")
    from rovtwin.campaign.run import run_campaign as flown
    from rovtwin.campaign.schema import load_campaign
    from rovtwin.campaign.workers import on_this_machine
    from rovtwin.core.processes.cores import cores_here

    whole = load_campaign(file, samples)
    crew = on_this_machine(workers or min(cores_here(), whole.samples))
    return flown(whole, Path(folder), crew, progress=progress)


def connect(url: str, scenario: ScenarioLike, *, observe: bool = False) -> Link:
    """The vehicle at a URL, open: `read`, `arm`, `send`, `stop`, `close`.

    Args:
        url: `mavlink://...`, `blueye://...`, `ros2://...`, `twin://`; see docs/links.md.
        scenario: Its vehicle says which thrusters there are: that of another one would push the wrong way. Its world is
            that of `twin://`.
        observe: Only look: where the protocol tells pilots from watchers, be one of these.

    Raises:
        ConfigError: The URL cannot be used, or not for this vehicle.
        LinkError: Nobody answers there.

    Example:
        >>> with rovtwin.connect("twin://", "square") as link:
        ...     readings = link.read()
    """
    from rovtwin.live.connect import connect as opened
    from rovtwin.runs.pace import Clock

    return opened(url, load_scenario(scenario), Clock(1.0), observe)
