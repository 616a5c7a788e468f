"""The process of a stage: it goes through the stage, asks over its pipe, and is ended by STOP."""

import os
import signal
import time
import traceback
from dataclasses import dataclass
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from rovtwin.console.commissioning.person import ENDING, RemotePerson
from rovtwin.core.errors import RovtwinError
from rovtwin.core.processes.child import started

STAGES = "rovtwin.commission.stages:STAGES"
NICE = 5  # of a stage that computes only: the pages come first


@dataclass(frozen=True)
class Job:
    """What a process does.

    Attributes:
        folder: Of the commissioning, which was begun.
        stage: That is to be done.
        stop_at: Socket at which any message stops the thrusters.
        stages: Module and name of the stages in their order.
    """

    folder: Path
    stage: str
    stop_at: Path
    stages: str = STAGES


def stages_of(address: str) -> Any:
    """The stages at an address, `module:name`; they import all that computes."""
    module, _, name = address.partition(":")
    return getattr(import_module(module), name)


def count_of(address: str) -> int:
    """How many stages there are, once all that they need is imported."""
    return len(stages_of(address))


def main(pipe: Connection, job: Job) -> None:
    """What the process runs: the stage, and what came of it as the last message."""
    os.setsid()  # Ctrl-C in the terminal is for the console, which then ends this process in order
    person = RemotePerson(pipe)
    person.attend()
    try:
        ending = _done(person, job)
    except KeyboardInterrupt:
        ending = "stopped", ""
    except RovtwinError as error:
        ending = "refused", str(error)
    except Exception as error:  # a mistake of ours: whoever stands at the water has to see it
        traceback.print_exc()
        ending = "failed", f"{type(error).__name__}: {error}"
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # there is nothing left to end
    person.send("ended", ending)


def _done(person: RemotePerson, job: Job) -> tuple[str, str]:
    """`go` or `no-go`, once the stage has its page."""
    person.progress("starting")
    from rovtwin.commission.dossier import Dossier
    from rovtwin.commission.run import commission

    stages = stages_of(job.stages)
    begun = Dossier.open(job.folder)
    found = commission(
        begun.request,
        job.folder,
        stages,
        person,
        only=[job.stage],
        stop_at=job.stop_at,
        enter=lambda phase: person.send("phase", phase),
    )
    last = found.attempts(job.stage)[-1].outcome
    return "go" if last is not None and last.go else "no-go", ""


class StageProcess:
    """A stage that is being done, seen from the console."""

    def __init__(self, job: Job, nice: int | None):
        """Starts the process; `nice`: how much below this one it is."""
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `rovtwin commission`: NumPy reads it when imported
        self._process, self._pipe = started(main, job, name="rovtwin-stage", nice=nice, daemon=False)
        self._stopped_at: float | None = None

    @property
    def pid(self) -> int | None:
        """Of the process."""
        return self._process.pid

    @property
    def stopped(self) -> bool:
        """Whether it was asked to end."""
        return self._stopped_at is not None

    def message(self, seconds: float) -> tuple[str, Any] | None:
        """The next message, None where none comes in so many seconds; the last one is `ended`.

        A process that was to end and does not is killed.
        """
        if self._stopped_at is not None and time.monotonic() - self._stopped_at > ENDING:
            self._kill()
        try:
            return self._pipe.recv() if self._pipe.poll(seconds) else None
        except (EOFError, OSError):
            self._process.join(ENDING)
            code = self._process.exitcode
            if self.stopped:
                return "ended", ("stopped", "")
            why = ": is there memory left?" if code == -signal.SIGKILL else ""
            return "ended", ("died", f"its process ended (exit code {code}{why})")

    def answer(self, question: int, value: Any) -> None:
        """Answer a question."""
        self._send("answer", (question, value))

    def stop(self) -> None:
        """End it at once; the attempt is kept. May be called from the event loop, and twice."""
        if self._stopped_at is not None:
            return
        self._stopped_at = time.monotonic()
        if self._process.is_alive() and self._process.pid is not None:
            os.kill(self._process.pid, signal.SIGINT)
        self._send("stop", None)

    def close(self) -> None:
        """Let go of it, once it has ended or shall be killed."""
        self._pipe.close()
        self._process.join(1.0)
        if self._process.is_alive():
            self._kill()

    def _send(self, kind: str, content: Any) -> None:
        try:
            self._pipe.send((kind, content))
        except OSError:  # it is gone, which its next message tells
            pass

    def _kill(self) -> None:
        """It and what it started; the process that holds the vehicle's line is apart, and stops the thrusters."""
        try:
            if self._process.pid is not None:
                os.killpg(self._process.pid, signal.SIGKILL)
        except (ProcessLookupError, PermissionError):  # it has no group of its own yet
            self._process.kill()
        self._process.join()
