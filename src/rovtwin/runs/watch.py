"""Runs as the monitor sees them: which vehicle flew, what it did, and what of it has changed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.identification.logs.readers import detect, read_records
from rovtwin.monitoring.change import Change, causes
from rovtwin.monitoring.evidence import Estimated, estimated
from rovtwin.monitoring.factors import Factors
from rovtwin.monitoring.lost import Lost
from rovtwin.monitoring.monitor import SHORTEST, watched
from rovtwin.monitoring.quantities import Quantities
from rovtwin.monitoring.reference import identified_std
from rovtwin.monitoring.trend import Baseline, Drift, Run, baseline, changed_since, drifts, first_learnt
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.scenario.files import load_scenario
from rovtwin.vehicle import Vehicle, load_vehicle
from rovtwin.vehicle.description.identified import fingerprint

USUAL = 3  # runs of a baseline, where there are more
ALONE = (
    "Differences from the description may be its own errors: give more runs, or identify the vehicle and watch the "
    "file that comes of it."
)
APPLIED = "All else is found with that taken into account"


@dataclass(frozen=True, eq=False)
class WatchedRun:
    """A run and what it says.

    Attributes:
        path: The log.
        run: Name and readings.
        found: The factors themselves.
        factors: What they are.
        seconds: How much of it was looked at [s].
        notes: What to know of it.
        lost: Thrusters that were dead or reversed; all else was found with that taken into account.
    """

    path: Path
    run: Run
    found: Estimated
    factors: Factors
    seconds: float
    notes: tuple[str, ...]
    lost: tuple[Lost, ...] = ()


@dataclass(frozen=True, eq=False)
class Watch:
    """Runs of one vehicle beside what they are compared with.

    Attributes:
        vehicle: The description that all are compared with.
        runs: In the order given.
        before: What the later ones are compared with; None: there is nothing.
        first: Which of the runs is the first that is compared.
        against: What `before` is, in words.
    """

    vehicle: Vehicle
    runs: list[WatchedRun]
    before: Baseline | None
    first: int
    against: str

    @property
    def changes(self) -> list[list[Change]]:
        """What of each run has changed; nothing of those of the baseline."""
        return self._since(changed_since)

    @property
    def first_learnt(self) -> list[list[Change]]:
        """What of each run is not as described, where nothing that it is compared with tells it."""
        return self._since(first_learnt)

    def _since(self, found: Callable[[Run, Baseline], list[Change]]) -> list[list[Change]]:
        """What is found of each run beside the baseline; nothing of those of the baseline."""
        before = self.before
        if before is None:
            return [[] for _ in self.runs]
        return [found(one.run, before) if k >= self.first else [] for k, one in enumerate(self.runs)]

    @property
    def drifts(self) -> list[Drift]:
        """What goes one way over all runs."""
        return drifts([one.run for one in self.runs])

    def words(self) -> list[tuple[str, bool]]:
        """What there is to say, and whether it is something that has changed."""
        lines = [(f"{one.run.name}: {note}", False) for one in self.runs for note in one.notes]
        for one in self.runs:
            lines += [(f"{one.run.name}: {lost}", True) for lost in one.lost]
            lines += [(f"{one.run.name}: {lost.look}. {APPLIED}", False) for lost in one.lost]
        if self.before is None:
            first = self.runs[-1].run.name
            return [*lines, (f"{first}: there is nothing to compare it with, {self.against}. {ALONE}", False)]
        for one, changed, new in list(zip(self.runs, self.changes, self.first_learnt, strict=True))[self.first :]:
            if not changed and not new:
                nothing = "nothing else" if one.lost else "nothing"
                unchanged = f"{one.run.name}: {nothing} has changed since {self.against} that it can tell"
                lines.append((f"{unchanged}; {_comparable(one.run, self.before)}", False))
            if new:
                figures = ", ".join(str(c.reading) for c in new)
                text = f"{one.run.name}: not as described, where nothing is known from {self.against}: {figures}"
                text += ". Whether it has changed nobody knows; the description may be wrong there"
                lines.append((text, False))
            lines += [
                (f"{one.run.name}: {c.difference} since {self.against} ({abs(c.z):.1f} std)", True) for c in changed
            ]
            lines += [(f"{one.run.name}: {cause}", False) for cause in causes(changed)]
        lines += [(f"drift: {drift} a run, over {len(self.runs)} runs", True) for drift in self.drifts]
        return lines


def _comparable(run: Run, before: Baseline) -> str:
    """How many quantities a run can be compared in, and how many thrusters."""
    judged = [r.learnt and bool(np.isfinite(std)) for r, std in zip(run.readings, before.std, strict=True)]
    thrusters = [
        known for r, known in zip(run.readings, judged, strict=True) if r.quantity.name.startswith("thruster.")
    ]
    some = f"{sum(thrusters)} of {len(thrusters)} thrusters" if any(thrusters) else "no thruster"
    return f"{sum(judged)} of {len(judged)} quantities were learnt in it and before, and {some} could be judged"


def watch_runs(
    paths: Sequence[Path],
    vehicle: str | None = None,
    first_runs: int | None = None,
    progress: Callable[[str, float], None] = lambda name, share: None,
) -> Watch:
    """Look at runs one after the other.

    Args:
        paths: Folders of runs, or logs.
        vehicle: Name or file of the description; None: that of the first run's scenario.
        first_runs: How many of the first runs are the baseline; None: as many as there should be; 0: none of them, but
            the identification of the vehicle.
        progress: Told the name of the run and the share of it that is done.

    Raises:
        ConfigError: No description, or a baseline that leaves no run to be compared.
        IdentificationError: A log that cannot be read or used; which, and why.
    """
    logs = [_log_of(path) for path in paths]
    for log in logs:
        detect(log)  # what is not there is said before anything else
    described = load_vehicle(vehicle) if vehicle else _vehicle_beside(logs[0])
    if first_runs is not None and first_runs >= len(paths):
        raise ConfigError(
            f"--baseline {first_runs}: expected more runs than that, found {len(paths)}: those after the baseline are "
            "compared with it"
        )
    names = _names(logs)
    runs = [
        _watched(described, log, name, lambda share, n=name: progress(n, share))
        for log, name in zip(logs, names, strict=True)
    ]
    if len(runs) > 1 and first_runs != 0:
        n = first_runs or min(USUAL, len(runs) - 1)
        return Watch(described, runs, baseline([one.run for one in runs[:n]]), n, _words(names[:n]))
    std = identified_std(described, [reading.quantity.name for reading in runs[0].run.readings])
    if std is None:
        only = "this is the only run" if len(runs) == 1 else "the runs shall not be compared with each other"
        return Watch(described, runs, None, 0, f"for the vehicle was not identified and {only}")
    nothing = np.zeros(len(std))
    identified = Baseline(nothing, std, nothing, np.inf, 0, np.isnan(std))
    return Watch(described, runs, identified, 0, f"the identification of {described.name}")


def _watched(vehicle: Vehicle, log: Path, name: str, progress: Callable[[float], None]) -> WatchedRun:
    model, blocks, seconds, notes = vehicle.model(), [], 0.0, list(_other_vehicle(vehicle, log))
    lost: list[Lost] = []
    records = read_records(log, vehicle)
    long = [record for record in records if record.duration >= SHORTEST]
    if long and len(long) < len(records):
        notes.append(f"{len(records) - len(long)} of {len(records)} parts are shorter than {SHORTEST:g} s: left out")
    for record in long or records:
        monitor = watched(model, vehicle.thruster_names, record, progress)
        blocks += monitor.blocks
        seconds += monitor.time
        notes += monitor.doubts
        lost += monitor.lost
        notes += record.notes
    found = estimated(blocks, monitor.factors.covariance)
    readings = Quantities(model, vehicle.thruster_names, monitor.factors).read(found)
    if not any(reading.learnt for reading in readings):
        notes.append(f"{seconds:.0f} s in which nothing was learnt: fly turns, dives and legs at speed")
    return WatchedRun(log, Run(name, readings), found, monitor.factors, seconds, tuple(notes), tuple(lost))


def _log_of(path: Path) -> Path:
    return path / "log.mcap" if path.is_dir() and (path / "log.mcap").exists() else path


def _names(logs: Sequence[Path]) -> list[str]:
    """Of runs the folder's, of other logs the file's; longer where two are the same."""
    short = [log.parent.name if log.name == "log.mcap" else log.stem for log in logs]
    return [s if short.count(s) == 1 else str(log) for s, log in zip(short, logs, strict=True)]


def _vehicle_beside(log: Path) -> Vehicle:
    beside = log.with_name("scenario.yaml")
    if not beside.exists():
        raise ConfigError(
            f"{log}: no scenario.yaml beside it to say which vehicle flew; give --vehicle, a name of the library or a "
            "file"
        )
    return vehicle_of(load_scenario(beside))


def _other_vehicle(vehicle: Vehicle, log: Path) -> list[str]:
    beside = log.with_name("scenario.yaml")
    if not beside.exists():
        return []
    flown = vehicle_of(load_scenario(beside))
    if fingerprint(flown.file) == fingerprint(vehicle.file):
        return []
    was, now = (f"{one.name} of {one.assembly.solid.mass:.4g} kg" for one in (flown, vehicle))
    return [f"was flown with another description, {was}; it is compared with {now} all the same"]


def _words(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{len(names)} runs, {names[0]} to {names[-1]}"
