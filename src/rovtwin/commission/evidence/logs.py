"""Logs of the flown parts as records: those of killed attempts are repaired, those that cannot be used are named."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from rovtwin.commission.dossier import Dossier
from rovtwin.commission.stage import Check
from rovtwin.core.errors import IdentificationError, LogError
from rovtwin.core.log import repair
from rovtwin.identification.checks.check import check_record
from rovtwin.identification.logs.readers import read_records
from rovtwin.identification.logs.record import Record
from rovtwin.vehicle import Model, Vehicle

LEAST = 5.0  # of a test that is used [s]: one that ended as it began has neither motion nor a clock to check
FIX = "Look at it with `rovtwin evidence check`; to fly it again, mend the cause and move the log out of the folder."


@dataclass(frozen=True, eq=False)
class Flown:
    """What was flown so far.

    Attributes:
        logs: Files that are used.
        records: Their tests.
        checks: What is odd about them, or why one is left out.
    """

    logs: tuple[Path, ...]
    records: tuple[Record, ...]
    checks: tuple[Check, ...]

    @property
    def minutes(self) -> float:
        """Of vehicle time in all."""
        return sum(record.duration for record in self.records) / 60.0


def logs_of(dossier: Dossier, stage: str = "excite") -> list[Path]:
    """Logs of a stage's attempts, killed ones too, that were made with the vehicle as it is described now."""
    now = dossier.request.fingerprint()
    own = [one.folder for one in dossier.attempts(stage) if one.fingerprint == now]
    return [log for log in dossier.logs(stage) if any(folder in log.parents for folder in own)]


def read_logs(vehicle: Vehicle, logs: Sequence[Path], folder: Path) -> Flown:
    """The records of logs, looked over.

    Args:
        vehicle: That flew.
        logs: Files, whole or not.
        folder: Where repaired ones are written.
    """
    model, used, records = vehicle.model(), list[Path](), list[Record]()
    checks: list[Check] = []
    for log in logs:
        try:
            file, own, notes = _read(log, vehicle, folder)
        except IdentificationError as error:
            checks.append(Check("warning", _name(log), f"left out: {error}"))
            continue
        long = [record for record in own if record.duration >= LEAST]
        if own and not long:
            text = f"left out: {own[0].duration:.1f} s long, less than {LEAST:g} s tell nothing"
            checks.append(Check("note", _name(log), text))
        if long:
            checks += [*notes, *_looked_over(long, model, vehicle.thruster_names)]
            used.append(file)
            records += long
    return Flown(tuple(used), tuple(records), tuple(checks))


def _read(log: Path, vehicle: Vehicle, folder: Path) -> tuple[Path, list[Record], list[Check]]:
    """The file that is used, its tests (none where nothing was armed), and what was done to it."""
    try:
        return log, read_records(log, vehicle), []
    except IdentificationError as error:
        if "no commands" in str(error):
            return log, [], []
        out = folder / f"{_name(log).replace('/', '-')}.repaired.mcap"
        try:
            mended = repair(log, out, overwrite=True)
        except LogError:
            raise error from None
        if not mended.messages.get("autopilot/command"):
            return out, [], []
        if mended.finished:  # it is whole: something else is wrong with it
            out.unlink()
            raise
        text = f"its flight was cut off; {(mended.last_time or 0.0):.0f} s of it are saved and used"
        return out, read_records(out, vehicle), [Check("note", _name(log), text)]


def _looked_over(records: Sequence[Record], model: Model, thrusters: Sequence[str]) -> Iterator[Check]:
    """What cannot be right stops; what is unusual warns."""
    for record in records:
        for one in check_record(record, model, thrusters):
            if one.severity == "error":
                yield Check("stop", f"{record.name}, {one.where}", one.message, f"{one.fix} {FIX}".strip())
            elif one.severity == "warning":
                yield Check("warning", f"{record.name}, {one.where}", one.message, one.fix)


def _name(log: Path) -> str:
    """Attempt and part: `1/part-2`."""
    return f"{log.parent.parent.name}/{log.parent.name}"
