"""The log of a test while it is flown: how good it is, and what it tells of the vehicle so far; in its own process.

The process is below all others in priority: neither the autopilot nor the pages wait for it. It reads what is on the
disk, a copy of the log so far, and knows nothing of the engine.
"""

import signal
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.errors import LogError, RovtwinError
from rovtwin.core.log import repair
from rovtwin.core.log.reader import is_finished
from rovtwin.core.processes.child import end, started
from rovtwin.identification.checks.check import AXIS_NAMES, check_record
from rovtwin.identification.checks.findings import RANK, Finding
from rovtwin.identification.joint.model.couplings import place_of
from rovtwin.identification.logs.readers import read_records
from rovtwin.identification.logs.record import Record
from rovtwin.identification.quick import Quick
from rovtwin.vehicle import Vehicle

NICE = 15
ENDING = 1.0  # a process that does not end by itself in this time is killed [s]
JUDGED = 10.0  # a shorter record raises false alarms [s]
INFORMED = 0.9  # of the prior's width, from which a parameter counts as informed by the test
# What a test that goes on may still have in store.
NOT_YET = ("no_excitation", "unexcited")


@dataclass(frozen=True)
class Subject:
    """What is tested: the vehicle, how long it takes [s], into how many pieces hands cut it."""

    vehicle: Vehicle
    duration: float
    pieces: int


class Assessor:
    """Judges logs of one test."""

    def __init__(self, tested: Subject):
        self._tested, self._model = tested, tested.vehicle.model()
        self._quick: Quick | None = None
        self._log: Path | None = None
        self._seen: set[tuple[str, str]] = set()

    def records(self, log: Path, final: bool) -> list[Record]:
        """What can be read of a log that may still be written, or whose writer was killed.

        Raises:
            RovtwinError: Nothing yet.
        """
        if log != self._log:
            self._log, self._seen = log, set()
        if final and _is_whole(log):
            return read_records(log, self._tested.vehicle)
        with tempfile.TemporaryDirectory(prefix="rovtwin-") as folder:
            copy = Path(folder) / log.parent.name / log.name
            copy.parent.mkdir()
            return read_records(repair(log, copy).path, self._tested.vehicle)

    def quality(self, records: Sequence[Record], final: bool) -> dict[str, Any]:
        """Rates and gaps of the signals, what the checks of `rovtwin evidence check` find, axes not pushed so far."""
        judged = [record for record in records if record.duration > JUDGED]
        found = [check_record(record, self._model, self._tested.vehicle.thruster_names) for record in judged]
        every = [finding for findings in found for finding in findings]
        kept = [f for f in every if f.what != "unexcited" and (final or f.what not in NOT_YET)]
        once = {(f.what, f.where): f for f in sorted(kept, key=lambda f: -RANK[f.severity])}
        once, self._seen = {key: f if final else self._cautious(key, f) for key, f in once.items()}, set(once)
        still = [{f.where for f in findings if f.what in NOT_YET} for findings in found]
        return {
            "signals": _signals(records),
            "judged": bool(judged),
            "findings": [asdict(f) for f in sorted(once.values(), key=lambda f: RANK[f.severity])],
            "not_pushed": [axis for axis in AXIS_NAMES if still and all(_still(axis, own) for own in still)],
            "verdict": _verdict(list(once.values()), bool(judged)),
        }

    def _cautious(self, key: tuple[str, str], found: Finding) -> Finding:
        """Little data raises false alarms: an error counts once it was found in two looks."""
        if found.severity != "error" or key in self._seen:
            return found
        return replace(found, severity="warning", fix=f"{found.fix} Seen for the first time: the next look tells.")

    def estimate(self, records: Sequence[Record]) -> dict[str, Any]:
        """The quick estimate: rows of parameters, those that the test tells most of first in each family."""
        if self._quick is None:
            self._quick = Quick(self._tested.vehicle, self._tested.duration, self._tested.pieces)
        found = self._quick.estimate(records)
        rows = [row | {"coupling": place_of(row["name"]) is not None} for row in found.rows()]
        informed = sum(row["ratio"] < INFORMED for row in rows)
        return {"rows": rows, "informed": informed, "changes": found.changes}


def _is_whole(log: Path) -> bool:
    try:
        with log.open("rb") as stream:
            return is_finished(stream)
    except OSError as error:
        raise LogError(f"{log}: cannot be read ({error.strerror})") from None


def _still(axis: str, where: set[str]) -> bool:
    return axis in where or "commands" in where


def _signals(records: Sequence[Record]) -> list[dict[str, Any]]:
    """Rate [Hz] and longest time without a reading [s] of each signal."""
    found = []
    for name in dict.fromkeys(name for record in records for name in record.signals):
        own = [record.signals[name].t for record in records if name in record.signals]
        steps = np.concatenate([np.diff(t) for t in own] or [np.zeros(0)])
        if len(steps):
            found.append({"name": name, "rate": len(steps) / steps.sum(), "longest": steps.max()})
    return found


def _verdict(found: Sequence[Finding], judged: bool) -> str:
    """In one word: error, warning, good, or early."""
    if not judged:
        return "early"
    severities = {finding.severity for finding in found}
    return "error" if "error" in severities else "warning" if "warning" in severities else "good"


class AssessProcess:
    """The process, seen from the web server; one log at a time."""

    def __init__(self, tested: Subject):
        self._process, self._pipe = started(_main, tested, name="rovtwin-assess", nice=NICE)

    def ask(self, log: Path, final: bool) -> None:
        """Look at a log; what comes of it are the next answers, until an empty one."""
        self._pipe.send((log, final))

    def answer(self, patience: float) -> dict[str, Any] | None:
        """The next answer: `quality` and the seconds that were looked at, `estimate`, or `error`; {} at the end.

        None: nothing within `patience` [s].

        Raises:
            EOFError, OSError: The process is gone.
        """
        return self._pipe.recv() if self._pipe.poll(patience) else None

    def close(self) -> None:
        """End the process."""
        end(self._process, self._pipe, ENDING)


def _main(pipe: Connection, tested: Subject) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who started it: that closes the pipe
    assessor = Assessor(tested)
    try:
        while True:
            log, final = pipe.recv()
            try:
                _look(pipe, assessor, log, final)
            except RovtwinError as error:
                if final:  # of a log that grows there is nothing yet
                    pipe.send({"error": str(error)})
            except Exception as error:  # a mistake of ours: said there, where a user looks
                pipe.send({"error": f"{type(error).__name__}: {error}"})
            pipe.send({})
    except (EOFError, OSError):
        pass  # nobody is there to see


def _look(pipe: Connection, assessor: Assessor, log: Path, final: bool) -> None:
    records = assessor.records(log, final)
    seconds = {"seconds": sum(record.duration for record in records)}
    pipe.send(seconds | {"quality": assessor.quality(records, final)})
    if not records:  # a hand holds it from the beginning
        return
    began = time.monotonic()
    estimate = assessor.estimate(records)
    pipe.send({"estimate": estimate | seconds | {"took": time.monotonic() - began}})
