"""The folder of a commissioning: attempts at each stage, in the order in which they were made; nothing is overwritten.

    commissioned/
      commission.json          what was asked for, and a line for each attempt
      3-dip/1/outcome.json     the page of the first attempt at the third stage; its logs lie beside it

An attempt is written down before it begins and once more when it has ended, each time whole or not at all: a process
that is killed leaves an attempt without an outcome, whose logs stay.
"""

import fcntl
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rovtwin._version import __version__
from rovtwin.commission.request import Request
from rovtwin.commission.stage import Outcome, Stage
from rovtwin.core.datum import utc_now
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.files import cannot, read_text, write_text
from rovtwin.core.user_files.jsontext import to_json

INDEX, OUTCOME, LOCK, FORMAT = "commission.json", "outcome.json", "lock", 1


@dataclass(frozen=True)
class Attempt:
    """One attempt at a stage.

    Attributes:
        stage: Its name.
        folder: Where its files lie.
        began: UTC.
        fingerprint: Of the vehicle as it was described then.
        outcome: Its page, None: it never ended.
    """

    stage: str
    folder: Path
    began: str
    fingerprint: str
    outcome: Outcome | None


class Dossier:
    """What is known so far.

    Attributes:
        folder: Of the commissioning.
        request: What was asked for.
    """

    def __init__(self, folder: Path, request: Request, attempts: list[Attempt]):
        self.folder, self.request = folder, request
        self._attempts = attempts

    @classmethod
    def begin(cls, folder: Path, request: Request) -> "Dossier":
        """A new one. Raises ConfigError where the folder holds something already or cannot be made."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if any(folder.iterdir()):
                raise ConfigError(
                    f"-o {folder}: found other files in it, expected a new folder, or one of a commissioning, which "
                    "goes on where it was left"
                )
        except OSError as error:
            raise ConfigError(f"-o {folder}: cannot be used ({cannot(error)})") from None
        made = cls(folder, request.absolute(), [])
        made._write()
        return made

    @classmethod
    def open(cls, folder: Path) -> "Dossier":
        """One that was begun before. Raises ConfigError where there is none, or where it was damaged."""
        index = folder / INDEX
        try:
            data = json.loads(read_text(index))
            if data["format"] != FORMAT:
                raise ConfigError(f"{index}: found format {data['format']}, expected {FORMAT}: use the same rovtwin")
            request = Request.from_dict(data["request"])
            attempts = [
                Attempt(one["stage"], folder / one["folder"], one["began"], one["fingerprint"], _outcome(folder, one))
                for one in data["attempts"]
            ]
        except OSError as error:
            raise ConfigError(f"{index}: cannot be read ({cannot(error)})") from None
        except (KeyError, TypeError, ValueError) as error:
            raise ConfigError(f"{index}: found {error!r:.80}, expected what rovtwin commission writes") from None
        return cls(folder, request, attempts)

    def changed(self, request: Request) -> None:
        """Go on with another link, tank or task; stages that are passed stay so."""
        self.request = request.absolute()
        self._write()

    def attempts(self, stage: str) -> list[Attempt]:
        """At a stage, oldest first."""
        return [one for one in self._attempts if one.stage == stage]

    def passed(self, stage: str, fingerprint: str | None = None) -> Attempt | None:
        """The last attempt at a stage if it is a go, and if the vehicle's description is still that of then.

        Args:
            stage: Its name.
            fingerprint: Of the description now; None: whatever it was.
        """
        found = self.attempts(stage)
        last = found[-1] if found else None
        if last is None or last.outcome is None or not last.outcome.go:
            return None
        return last if fingerprint is None or last.fingerprint == fingerprint else None

    def measured(self, stage: str) -> dict[str, Any]:
        """Figures of the last passed attempt at a stage, empty where there is none."""
        found = self.passed(stage)
        return {} if found is None or found.outcome is None else dict(found.outcome.measured)

    def logs(self, stage: str) -> list[Path]:
        """All logs of all attempts at a stage that begin with this description, those of killed ones too."""
        return sorted(log for one in self.attempts(stage) for log in one.folder.glob("**/log.mcap"))

    def next_attempt(self, number: int, stage: Stage) -> Attempt:
        """Written down before it begins."""
        folder = self.folder / f"{number}-{stage.name}" / str(len(self.attempts(stage.name)) + 1)
        folder.mkdir(parents=True, exist_ok=True)
        made = Attempt(stage.name, folder, utc_now(), self.request.fingerprint(), None)
        self._attempts.append(made)
        self._write()
        return made

    def end(self, attempt: Attempt, outcome: Outcome) -> None:
        """Written down once it has ended: first the page, then the line that says so."""
        write_text(attempt.folder / OUTCOME, to_json(outcome.to_dict()) + "\n")
        self._attempts = [
            Attempt(one.stage, one.folder, one.began, one.fingerprint, outcome) if one is attempt else one
            for one in self._attempts
        ]
        self._write()

    def _write(self) -> None:
        attempts = [
            {
                "stage": one.stage,
                "folder": str(one.folder.relative_to(self.folder)),
                "began": one.began,
                "fingerprint": one.fingerprint,
            }
            for one in self._attempts
        ]
        data = {"format": FORMAT, "rovtwin": __version__, "request": self.request.to_dict(), "attempts": attempts}
        try:
            write_text(self.folder / INDEX, to_json(data) + "\n")
        except OSError as error:
            raise ConfigError(f"{self.folder / INDEX}: cannot be written ({cannot(error)})") from None

    @contextmanager
    def locked(self) -> Iterator[None]:
        """While it is worked on. Raises ConfigError where another process does so already."""
        try:
            lock = (self.folder / LOCK).open("w")
        except OSError as error:
            raise ConfigError(f"-o {self.folder}: cannot be used ({cannot(error)})") from None
        with lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # falls with the process, however it ends
            except OSError:
                raise ConfigError(
                    f"{self.folder}: another process is commissioning here; end it, or take another folder"
                ) from None
            yield


def _outcome(folder: Path, one: dict[str, Any]) -> Outcome | None:
    path = folder / one["folder"] / OUTCOME
    if not path.exists():
        return None
    return Outcome.from_dict(json.loads(read_text(path)))


def status(dossier: Dossier, stages: Sequence[Stage]) -> list[tuple[Stage, str, Attempt | None]]:
    """Each stage, its last attempt, and one of `passed`, `no-go`, `cut off`, `out of date`, `to do`."""
    rows: list[tuple[Stage, str, Attempt | None]] = []
    now, stale = dossier.request.fingerprint(), False
    for stage in stages:
        last = dossier.attempts(stage.name)[-1:]
        words = "to do"
        if last:
            outcome = last[0].outcome
            words = "cut off" if outcome is None else "passed" if outcome.go else "no-go"
            if words == "passed" and (stale or last[0].fingerprint != now):
                words = "out of date"
        stale = stale or words != "passed"
        rows.append((stage, words, last[0] if last else None))
    return rows
