"""The way from files to Records: format found, file read, clocks joined, cut to what is valid."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from rovtwin.core.errors import IdentificationError, RovtwinError
from rovtwin.core.plugins import READERS, installed, load
from rovtwin.core.user_files.config import near
from rovtwin.identification.logs.evidence_file import Evidence, LogSpec, Use
from rovtwin.identification.logs.log_spec import SourceSpec
from rovtwin.identification.logs.readers.assemble import Part, part_of
from rovtwin.identification.logs.readers.autopilots.dataflash import read_dataflash
from rovtwin.identification.logs.readers.autopilots.tlog import read_tlog
from rovtwin.identification.logs.readers.autopilots.ulog import read_ulog
from rovtwin.identification.logs.readers.blueye import read_blueye
from rovtwin.identification.logs.readers.c3d import read_c3d
from rovtwin.identification.logs.readers.qtm import read_qtm
from rovtwin.identification.logs.readers.raw import Raw, no_commands
from rovtwin.identification.logs.readers.ros import read_rosbag
from rovtwin.identification.logs.readers.rovtwin_log import read_rovtwin
from rovtwin.identification.logs.readers.tables import read_csv, read_npz
from rovtwin.identification.logs.record import Ballast, Record, Signal
from rovtwin.identification.logs.response import commanded_motion
from rovtwin.identification.logs.timing import ClockFit, align
from rovtwin.vehicle import Vehicle

SHORTEST = 1.0  # time in nobody's hands that is worth a Record [s]
SUFFIXES = {
    ".csv": "csv",
    ".txt": "csv",
    ".npz": "npz",
    ".tsv": "qtm",
    ".c3d": "c3d",
    ".bag": "rosbag",
    ".db3": "rosbag",
    ".bez": "blueye",
    ".bin": "dataflash",
    ".tlog": "tlog",
    ".ulg": "ulog",
}

# A model that is not identified yet follows the motion less closely than another sensor.
COMMANDS_AGREE = 0.4


Unread = Callable[[str, Path, IdentificationError], None]
"""Told the name of a log, where it lies, and why it cannot be read."""


@dataclass(frozen=True, eq=False)
class Test:
    """A Record and what it is for: fitted, or only predicted.

    Attributes:
        record: What is used.
        use: fit or validate.
        whole: What it is a part of; None where it is all of it. Checks look at the whole: clocks and signs are those
            of a log, and a part of it may be too short to tell them.
    """

    __test__ = False  # not one of pytest's

    record: Record
    use: Use
    whole: Record | None = None


def detect(path: Path) -> str:
    """The format of a file, from its ending and for MCAP from what wrote it.

    Raises:
        IdentificationError: No such file, or an ending that says nothing.
    """
    if not path.exists():
        around = [p.name for p in path.parent.iterdir()] if path.parent.is_dir() else []
        raise IdentificationError(f"{path}: no such file.{near(path.name, around)}")
    if path.is_dir():
        if (path / "metadata.yaml").is_file():
            return "rosbag"
        raise IdentificationError(f"{path}: is a folder, expected a recording or the folder of a ROS 2 bag")
    if path.suffix == ".mcap":
        return "rovtwin" if _is_ours(path) else "rosbag"
    if path.suffix.lower() not in SUFFIXES:
        others = installed(READERS)
        if path.suffix.lower().removeprefix(".") in others:
            return path.suffix.lower().removeprefix(".")
        known = ", ".join([".mcap", *SUFFIXES, *(f".{name}" for name in others)])
        raise IdentificationError(f"{path}: unknown ending {path.suffix!r}, expected {known}; or give 'format'")
    return SUFFIXES[path.suffix.lower()]


def _is_ours(path: Path) -> bool:
    from rovtwin.core.errors import LogError
    from rovtwin.core.log import info

    try:
        return "log_format" in info(path).metadata
    except LogError as error:
        # An unfinished log of ours must say how it is repaired, not that it is no ROS bag.
        return "no channels that rovtwin wrote" not in str(error)


def read_raw(path: Path, source: SourceSpec, vehicle: Vehicle) -> Raw:
    """The tables of one file."""
    kind = detect(path) if source.format == "auto" else source.format
    readers: dict[str, Callable[[], Raw]] = {
        "rovtwin": lambda: read_rovtwin(path, vehicle),
        "csv": lambda: read_csv(path, vehicle.thruster_names),
        "npz": lambda: read_npz(path),
        "qtm": lambda: read_qtm(path, source.body),
        "c3d": lambda: read_c3d(path, source.body, source.markers),
        "rosbag": lambda: read_rosbag(path, vehicle.thruster_names),
        "blueye": lambda: read_blueye(path),
        "dataflash": lambda: read_dataflash(path, vehicle),
        "tlog": lambda: read_tlog(path, vehicle),
        "ulog": lambda: read_ulog(path, vehicle),
    }
    return readers[kind]() if kind in readers else _read_by_plugin(kind, path, vehicle)


def _read_by_plugin(kind: str, path: Path, vehicle: Vehicle) -> Raw:
    """What the reader of another package makes of a file: `read(path, vehicle) -> Raw`.

    Raises:
        IdentificationError: It cannot be loaded, fails, or gives something else.
    """
    try:
        raw = load(kind, READERS, f"{path}: format {kind}")(path, vehicle)
    except RovtwinError as error:
        raise IdentificationError(str(error)) from error
    except Exception as error:  # of somebody else's code: anything
        raise IdentificationError(f"{path}: the reader of {kind} failed: {type(error).__name__}: {error}") from error
    if not isinstance(raw, Raw):
        raise IdentificationError(f"{path}: the reader of {kind} gave {type(raw).__name__}, expected Raw")
    return raw


def read_record(path: str | Path, vehicle: Vehicle, spec: LogSpec | None = None) -> Record:
    """One test as a Record, its clock zero at the first sample; see `read_records` where a hand touched the vehicle.

    Args:
        path: Of the recording; with a spec of several files, the folder to which their names are relative.
        vehicle: The one that was tested; its thrusters' names and order count.
        spec: What is in the file; None where the format says that itself.

    Raises:
        IdentificationError: What was found, what was expected, the fix.
    """
    return _read(path, vehicle, spec)[0]


def read_records(path: str | Path, vehicle: Vehicle, spec: LogSpec | None = None) -> list[Record]:
    """The same, cut where somebody held the vehicle, as before a decay test: one Record for each time it was let go."""
    record, touched = _read(path, vehicle, spec)
    starts = [record.start, *(end for _, end in touched)]
    ends = [*(start for start, _ in touched), record.end]
    free = [(max(a, record.start), min(b, record.end)) for a, b in zip(starts, ends, strict=True)]
    kept = [(a, b) for a, b in free if b - a > SHORTEST]
    if not touched:
        return [record]
    return [replace(record.cut(a, b), name=f"{record.name}, {a:.0f} to {b:.0f} s") for a, b in kept]


def _read(path: str | Path, vehicle: Vehicle, spec: LogSpec | None) -> tuple[Record, list[tuple[float, float]]]:
    """The Record, and from when to when it was touched, by its clock."""
    path = Path(path)
    spec = spec or LogSpec.model_validate({"file": path.name})
    located = [path / source.file if spec.files else path for source in spec.sources]
    raws = [read_raw(p, source, vehicle) for p, source in zip(located, spec.sources, strict=True)]
    density = spec.water_density or next((raw.water_density for raw in raws if raw.water_density), None)
    length = spec.tether_length
    if length is None:
        length = next((raw.tether_length for raw in raws if raw.tether_length is not None), None)
    parts = [part_of(raw, s, vehicle.thruster_names, density) for raw, s in zip(raws, spec.sources, strict=True)]
    parts = _on_one_clock(parts, spec.sources, vehicle)
    if all(part.t_command is None for part in parts):
        raise no_commands(raws, vehicle.thruster_names)
    merged = _joined(parts)
    origin = merged.first
    name = spec.name or _name_of(located[0])
    record = _record(name, merged.on_clock(-origin, 0.0), spec, origin, density, length)
    intervals = [raw.command_interval for raw in raws if raw.command_interval is not None]
    record = replace(
        record, scale_std=max(raw.scale_std for raw in raws), command_interval=max(intervals, default=None)
    )
    return record, [(a - origin, b - origin) for a, b in raws[0].touched]


def _on_one_clock(parts: list[Part], sources: list[SourceSpec], vehicle: Vehicle) -> list[Part]:
    """All files on the clock of the first, which keeps its own."""
    moved: list[Part] = []
    for part, source in zip(parts, sources, strict=True):
        if source.clock is None:
            moved.append(part)
        elif source.clock != "estimate":
            moved.append(part.on_clock(source.clock.offset, source.clock.drift))
        elif not moved:
            raise IdentificationError(
                f"{part.source}: clock: estimate: the first file has the clock that the others get; take clock away"
            )
        else:
            fit = _estimated(moved[0], part, vehicle)
            moved.append(replace(part.on_clock(fit.offset, fit.drift), notes=(*part.notes, f"{part.source}: {fit}")))
    return moved


def _estimated(reference: Part, part: Part, vehicle: Vehicle) -> ClockFit:
    """From what both saw of the motion; of commands alone, from the motion that the vehicle's model makes of them."""
    if part.signals:
        return align(reference.signals, part.signals, part.source)
    assert part.t_command is not None and part.command is not None
    expected = commanded_motion(vehicle.model(), part.t_command, part.command)
    return align(reference.signals, expected, part.source, agree=COMMANDS_AGREE)


def _joined(parts: list[Part]) -> Part:
    """Files of one test as one; a signal or the commands given twice is a mistake."""
    signals: dict[str, Signal] = {}
    for part in parts:
        for name, signal in part.signals.items():
            if name in signals:
                raise IdentificationError(f"{part.source}: {name} is in another file already; keep one of them")
            signals[name] = signal
    commanding = [part for part in parts if part.t_command is not None]
    source = ", ".join(part.source for part in parts)
    notes = tuple(note for part in parts for note in part.notes)
    if len(commanding) > 1:
        raise IdentificationError(f"{commanding[1].source}: commands are in {commanding[0].source} already; keep one")
    return Part(commanding[0].t_command, commanding[0].command, signals, source, notes)


def _record(name: str, part: Part, spec: LogSpec, origin: float, density: float | None, length: float | None) -> Record:
    assert part.t_command is not None and part.command is not None
    if not len(part.t_command) or not part.signals:
        raise IdentificationError(f"{part.source}: found no {'signals' if len(part.t_command) else 'commands'}")
    last = max(signal.t[-1] for signal in part.signals.values())
    notes = list(part.notes)
    if abs(origin) > 1e-9:
        notes.append(f"time zero is {origin:.3f} s of the recording's clock")
    record = Record(
        name=name,
        t_command=part.t_command,
        command=part.command,
        signals=part.signals,
        end=float(max(last, part.t_command[-1])),
        water_density=density,
        tether_length=length,
        ballast=tuple(Ballast(b.mass, b.volume, (b.position[0], b.position[1], b.position[2])) for b in spec.ballast),
        current=(spec.current[0], spec.current[1], spec.current[2]),
        source=part.source,
        notes=tuple(notes),
    )
    return _cut(record, spec, float(last))


def _cut(record: Record, spec: LogSpec, last: float) -> Record:
    """Between the commands and within the signals, or as the spec says; a command held beyond is not used."""
    first = min(signal.t[0] for signal in record.signals.values())
    if isinstance(spec.span, list):
        start, end = max(spec.span[0], record.start), min(spec.span[1], record.end)
    elif spec.span == "commands":
        start, end = max(record.start, first), min(float(record.t_command[-1]), last)
    else:
        start, end = max(record.start, first), last
    if not start < end:
        raise IdentificationError(
            f"{record.source}: commands from {record.start:g} to {record.t_command[-1]:g} s and signals from "
            f"{first:g} to {last:g} s have no time in common within span {spec.span}. Check the clocks, or give span"
        )
    return record.cut(start, end)


def read_tests(evidence: Evidence, vehicle: Vehicle, unread: Unread | None = None) -> list[Test]:
    """Every test of an evidence file in its order; a log with `fit_share` gives two, the first part and the rest.

    Args:
        evidence: The file.
        vehicle: The one that was tested.
        unread: Told of a log that is never fitted, is there and cannot be read; without it such a log is refused.

    Raises:
        IdentificationError: What was found, what was expected, the fix.
    """
    tests = []
    for spec in evidence.file.logs:
        path = evidence.path.parent if spec.files else evidence.locate(spec.file)
        try:
            records = read_records(path, vehicle, spec)
        except IdentificationError as error:
            if unread is None or spec.use == "fit" or not path.exists():
                raise
            unread(spec.name or _name_of(path), path, error)
            continue
        for record in records:
            tests += _for_use(record, spec)
    return tests


def _for_use(record: Record, spec: LogSpec) -> list[Test]:
    if spec.fit_share is None:
        return [Test(record, spec.use)]
    return [
        replace(test, record=replace(test.record, name=f"{record.name} ({part})"))
        for test, part in zip(split(record, spec.fit_share), ("fitted part", "held out"), strict=True)
    ]


def split(record: Record, share: float) -> list[Test]:
    """The first share of a record to be fitted, and the rest to be predicted."""
    at = record.start + share * record.duration
    first, rest = record.cut(record.start, at), record.cut(at, record.end)
    return [Test(first, "fit", record), Test(rest, "validate", record)]


def _name_of(file: Path) -> str:
    """A run's log goes by the name of its folder, all are called log.mcap: `pool`, and its track `pool_aruco`."""
    what, _, more = file.stem.partition("_")
    folder = file.absolute().parent.name
    return f"{folder}_{more}".rstrip("_") if what == "log" and folder else file.stem


__all__ = ["Test", "detect", "read_raw", "read_record", "read_records", "read_tests", "split"]
