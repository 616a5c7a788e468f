"""Logs of `rovtwin identify`: read, split, looked over, and what was left out or trusted said in words."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from rovtwin.core.errors import ConfigError, IdentificationError

if TYPE_CHECKING:
    from rovtwin.identification.logs.readers import Test
    from rovtwin.identification.logs.record import Record


@dataclass(eq=False)
class Logs:
    """What identification works with.

    Attributes:
        tests: Each with its use, and the whole log where it is a part of one.
        left_out: Held-out logs that are not used, as rows of a result's `records`, with the reason in their notes.
        remarks: What checks found of logs that are left out or trusted, one line each.
    """

    tests: list["Test"] = field(default_factory=list)
    left_out: list[dict[str, Any]] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    @property
    def fitted(self) -> list["Record"]:
        return [test.record for test in self.tests if test.use == "fit"]

    @property
    def held_out(self) -> list["Record"]:
        return [test.record for test in self.tests if test.use != "fit"]

    def leave_out(self, name: str, source: str, why: list[str], record: "Record | None" = None) -> None:
        """Say of a held-out log that, and why, nothing is predicted of it."""
        self.left_out.append({
            "name": name, "use": "left out", "duration": 0.0 if record is None else record.duration, "source": source,
            "signals": {} if record is None else {n: len(s.t) for n, s in record.signals.items()},
            "water_density": None if record is None else record.water_density,
            "tether_length": None if record is None else record.tether_length, "notes": why,
        })  # fmt: skip
        self.remarks.append(f"{name} was to be held out and is left out: {' '.join(why)}")


def share_of(screen: Console, given: float | None, tests: dict[Path, bool], validated: bool) -> float | None:
    """The share of each log that is fitted; None: as usual.

    The pulls of a test are each of their own strength: its last part is no sample of what was fitted, it is the
    strongest pull, which then would be missing where it tells most.
    """
    if given is not None or validated or not tests or not all(tests.values()):
        return given
    screen.print(
        "nothing is held out: the last part of a test is a pull of its own. Give another run with --validate, or "
        "--fit-share 0.8",
        style="dim",
        markup=False,
    )
    return 1.0


def read_logs(vehicle: Any, evidence: Any, logs: list[Path], validate: list[Path], fit_share: float | None) -> Logs:
    """Tests of an evidence file and of the command line, those of the latter split where nothing else is held out.

    Raises:
        IdentificationError: A log that is to be fitted cannot be read, a file is missing or given twice.
    """
    from rovtwin.identification.logs.readers import Test, read_records, read_tests, split

    if fit_share is not None and not 0 < fit_share <= 1:
        raise IdentificationError(f"--fit-share: found {fit_share:g}, expected more than 0 and at most 1")
    logs, validate = files_of(logs), files_of(validate)
    for path in {p for p in [*logs, *validate] if [*logs, *validate].count(p) > 1}:
        raise IdentificationError(f"{path}: given twice; a log is either fitted or held out, and once")
    found = Logs()

    def unread(name: str, path: Path, error: IdentificationError) -> None:
        found.leave_out(name, str(path), [str(error)])

    found.tests = read_tests(evidence, vehicle, unread) if evidence else []
    own = [record for path in logs for record in read_records(path, vehicle)]
    for path in validate:
        try:
            found.tests += [Test(record, "validate") for record in read_records(path, vehicle)]
        except IdentificationError as error:
            if not path.exists():
                raise
            unread(path.stem, path, error)
    share = fit_share if fit_share is not None else (1.0 if found.held_out or found.left_out or not own else 0.8)
    for record in own:
        found.tests += [Test(record, "fit")] if share == 1.0 else split(record, share)
    return found


def files_of(paths: list[Path]) -> list[Path]:
    """A run's folder stands for the log in it."""
    return [p / "log.mcap" if p.is_dir() and (p / "log.mcap").is_file() else p for p in paths]


def looked_over(screen: Console, vehicle: Any, logs: Logs, trust: Sequence[str] | None, trust_all: bool) -> Logs:
    """What looks wrong with the logs, before minutes are spent on them; held-out logs that are wrong are taken out.

    Args:
        screen: What is found is said there.
        vehicle: The one that was tested.
        logs: As read.
        trust: Files or names of logs that are used whatever the checks say.
        trust_all: Whether all are.

    Raises:
        IdentificationError: A log that is to be fitted cannot be what it is said to be: units, axes, signs, clocks.
        ConfigError: `trust` names no log.
    """
    from rovtwin.identification.checks.check import check_record

    model, wrong = vehicle.model(), {}
    wholes = {id(whole): whole for whole in map(_whole, logs.tests)}
    trusted = _trusted(list(wholes.values()), trust or [])
    for text in logs.remarks:
        screen.print(text, style="yellow", markup=False)
    for record in wholes.values():
        for note in record.notes:
            screen.print(f"{record.name}: {note}", style="dim", markup=False)
        found = check_record(record, model, vehicle.thruster_names)
        for f in found:
            if f.severity == "warning":
                screen.print(f"{record.name}: {f.where}: {f.message} {f.fix}", style="yellow", markup=False)
        errors = [f"{f.where}: {f.message} {f.fix}" for f in found if f.severity == "error"]
        if errors and not _set_aside(screen, logs, record, errors, trust_all or record.name in trusted):
            wrong[record.name] = errors
    if wrong:
        lines = [f"{name}: {text}" for name, errors in wrong.items() for text in errors]
        fix = " ".join(f"--trust '{name}'" for name in wrong)
        raise IdentificationError("\n".join([*lines, f"if they are right after all, add {fix}"]))
    return logs


def _whole(test: "Test") -> "Record":
    return test.record if test.whole is None else test.whole


def _set_aside(screen: Console, logs: Logs, record: "Record", errors: list[str], trusted: bool) -> bool:
    """Whether the fit can go on: the log is trusted, or nothing of it was to be fitted and it is left out."""
    own = [test for test in logs.tests if _whole(test) is record]
    if trusted:
        logs.remarks.append(f"{record.name} is used though the checks say: {' '.join(errors)}")
    elif all(test.use != "fit" for test in own):
        logs.tests = [test for test in logs.tests if test not in own]
        logs.leave_out(record.name, record.source, errors, record)
    else:
        return False
    screen.print(logs.remarks[-1], style="yellow", markup=False)
    return True


def _trusted(records: list["Record"], names: Sequence[str]) -> set[str]:
    """Names of the records that are meant by names, files, or folders of runs.

    Raises:
        ConfigError: One means none of them.
    """
    from rovtwin.core.user_files.config import near

    spelled: dict[str, set[str]] = {}
    for record in records:
        for source in record.source.split(", "):
            path = Path(source)
            folder = (str(path.parent), path.parent.name) if path.stem == "log" else ()
            for word in (record.name, record.name.partition(", ")[0], source, path.name, path.stem, *folder):
                spelled.setdefault(word, set()).add(record.name)
    trusted: set[str] = set()
    for name in names:
        word = name.rstrip("/")
        if word not in spelled:
            raise ConfigError(f"--trust {name}: no such log.{near(name, [record.name for record in records])}")
        trusted |= spelled[word]
    return trusted
