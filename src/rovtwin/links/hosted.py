"""HostedLink: a real vehicle's link in a process of its own, so that the vehicle outlives whatever becomes of ours.

The process keeps the newest command for 0.3 s and no longer. When the pipe to the autopilot closes (it ended, crashed,
was killed), or nothing comes through it, thrusters stop; `stop` latches there.
"""

import logging
import multiprocessing
import os
import select
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any

import numpy as np

from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Command, Measurement
from rovtwin.core.link import COMMAND_LIFE, Link

logger = logging.getLogger(__name__)

GONE = "the link's process is gone: thrusters stop by the vehicle's own watchdog"
ENDING = 2.0  # a process that does not end by itself in this time is killed [s]
POLL = 0.004  # how often the host looks at both sides [s]
SIGN_OF_LIFE = 0.05  # the autopilot hears of a quiet vehicle as often [s]
AT_ONCE = 100  # readings in one message: more might fill the pipe
BACKLOG = 2000  # readings kept for an autopilot that does not read
NAP = 1.0  # a computer that slept longer flies nothing on [s]
ARMING = 10.0  # longest wait for a vehicle to arm [s]
CONNECTING = 30.0  # longest wait for a vehicle [s]

Opener = Callable[[], Link]  # picklable: it opens the link within the host process


class HostedLink(Link):
    """A link that runs elsewhere, behind a pipe.

    Attributes:
        age: Since anything was last heard of the vehicle [s]; that of the quieter drone of two.
    """

    def __init__(self, opener: Opener, thrusters: int):
        """Starts the host and waits until the vehicle answers.

        Raises:
            LinkError: The vehicle cannot be reached.
        """
        self._process = self._start(opener, thrusters)
        self._failed: str | None = None
        self._readings: list[Measurement] = []
        self._open, self._stopped, self._closed = False, False, False
        self._armed: str | None = None
        self._told_age, self._told_at = 0.0, time.monotonic()
        until = time.monotonic() + CONNECTING
        while not self._open and self._failed is None and time.monotonic() < until:
            self._pipe.poll(0.1)
            self._listen()
        if not self._open:
            self.close()
            raise LinkError(
                self._failed or f"no answer within {CONNECTING:g} s. Is the vehicle on, and the address right?"
            )

    def _start(self, opener: Opener, thrusters: int) -> Any:
        """Start the host at the other end of `_pipe`; what it runs in."""
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        process = context.Process(target=_main, args=(theirs, opener, thrusters), daemon=True, name="rovtwin-link")
        process.start()
        theirs.close()  # or it would never be seen closed here
        return process

    @property
    def pid(self) -> int | None:
        """Of the host process."""
        return self._process.pid

    @property
    def age(self) -> float:
        return self._told_age + time.monotonic() - self._told_at

    def read(self) -> list[Measurement]:
        if self._closed:
            return []
        self._listen()
        if self._failed is not None:
            raise LinkError(self._failed)
        readings, self._readings = self._readings, []
        return readings

    def send(self, command: Command) -> None:
        u = np.asarray(command.u, dtype=float)
        if not np.all(np.isfinite(u)):
            self.stop()
        if not self._stopped:
            self._tell("command", (time.monotonic(), np.clip(u, -1.0, 1.0)))

    def arm(self) -> None:
        self._armed = None
        self._tell("arm", None)
        until = time.monotonic() + ARMING
        while self._armed is None and self._failed is None and time.monotonic() < until:
            self._pipe.poll(0.05)
            self._listen()
        if self._armed != "":
            raise LinkError(self._failed or self._armed or f"arming: found no answer within {ARMING:g} s")

    def stop(self) -> None:
        self._stopped = True
        self._tell("stop", None)

    def close(self) -> None:
        if self._closed:
            return
        self.stop()
        self._closed = True
        self._pipe.close()  # the host stops and closes the link when it sees this, whatever it has heard
        self._process.join(ENDING)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()

    def _tell(self, kind: str, content: object) -> None:
        # A host that hangs does not read: what it would not hear in time is not said, so that nobody hangs with it.
        if self._closed or not _writable(self._pipe):
            return
        try:
            self._pipe.send((kind, content))
        except OSError:
            self._failed = self._failed or GONE

    def _listen(self) -> None:
        try:
            while self._pipe.poll():
                kind, content = self._pipe.recv()
                if kind == "open":
                    self._open = True
                elif kind == "failed":
                    self._failed = content
                elif kind == "armed":
                    self._armed = content
                else:
                    self._told_age, readings = content
                    self._told_at = time.monotonic()
                    self._readings += [Measurement(*reading) for reading in readings]
        except (EOFError, OSError):
            self._failed = self._failed or GONE


def _main(pipe: Connection, opener: Opener, thrusters: int) -> None:
    # Ctrl-C, a closed terminal and job control are for the autopilot: it ends, the pipe says so here, and the link is
    # closed in order. Who ends this process itself gets the same.
    os.setsid()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: sys.exit(0))
    threading.excepthook = _ended
    host(pipe, opener, thrusters)


def host(pipe: Connection, opener: Opener, thrusters: int) -> None:
    """Open a link and mind it until the autopilot at the other end of the pipe is gone; what fails is said there."""
    try:
        with opener() as link:
            pipe.send(("open", None))
            _Host(pipe, link, np.zeros(thrusters)).mind()
    except LinkError as error:
        _last_words(pipe, str(error))
    except Exception as error:  # a driver's mistake: said where a user looks
        _last_words(pipe, f"{type(error).__name__}: {error}")


def _ended(what: threading.ExceptHookArgs) -> None:
    """A vendor's thread ended by what came over the wire: one line instead of a traceback. The link notices itself."""
    name = what.thread.name if what.thread else "?"
    logger.warning("a thread of the link ended (%s): %s: %s", name, what.exc_type.__name__, what.exc_value)


class _Host:
    """Hands on commands and readings; commands that got old become zeros."""

    def __init__(self, pipe: Connection, link: Link, off: np.ndarray):
        self._pipe, self._link, self._off = pipe, link, off
        self._came, self._live, self._told, self._slept = 0.0, False, 0.0, _asleep()
        self._heard: deque[tuple[str, np.ndarray, float]] = deque(maxlen=BACKLOG)
        self._answers: SimpleQueue[str] = SimpleQueue()

    def mind(self) -> None:
        """Until the autopilot is gone.

        Raises:
            LinkError: The vehicle is lost, or this computer has slept.
        """
        while True:
            try:
                self._obey(self._newest())
                self._heard += [(r.sensor, r.value, r.t_valid) for r in self._link.read()]
                self._report()
            except (EOFError, OSError):
                return

    def _newest(self) -> tuple[float, np.ndarray] | None:
        """The newest command that came, with when it was decided; arming and stopping are done at once."""
        newest = None
        if self._pipe.poll(POLL):
            while self._pipe.poll():
                kind, content = self._pipe.recv()
                if kind == "command":
                    newest = content
                elif kind == "stop":
                    self._link.stop()
                elif kind == "arm":
                    # It takes seconds, and commands must go on expiring.
                    threading.Thread(target=lambda: self._answers.put(_arm(self._link)), daemon=True).start()
        return newest

    def _obey(self, newest: tuple[float, np.ndarray] | None) -> None:
        if (nap := _asleep() - self._slept) > NAP:
            self._link.stop()
            raise LinkError(f"this computer slept for {nap:.0f} s: thrusters are off. Fly again")
        now = time.monotonic()
        if newest is not None:
            self._came, u = newest  # one that waited in the pipe is as old as when it was decided
            if now - self._came <= COMMAND_LIFE:
                self._link.send(Command(u))  # type: ignore[arg-type]  (NumPy: it goes to a link)
                self._live = True
        if self._live and now - self._came > COMMAND_LIFE:
            self._link.send(Command(self._off))  # type: ignore[arg-type]  (NumPy, as above)
            self._live = False

    def _report(self) -> None:
        """Readings, and a sign of life. An autopilot that does not read must not keep us from minding the thrusters."""
        now = time.monotonic()
        if not (self._heard or now - self._told > SIGN_OF_LIFE) or not _writable(self._pipe):
            return
        slice_ = [self._heard.popleft() for _ in range(min(len(self._heard), AT_ONCE))]
        self._pipe.send(("heard", (self._link.age, slice_)))
        if not self._answers.empty():
            self._pipe.send(("armed", self._answers.get()))
        self._told = now


def _writable(pipe: Connection) -> bool:
    return bool(select.select([], [pipe], [], 0.0)[1])


def _arm(link: Link) -> str:
    """Arm a link; why it refused, or nothing."""
    try:
        link.arm()
    except LinkError as error:
        return str(error)
    return ""


def _asleep() -> float:
    """For how long this computer has slept since it was started [s], as when its lid was closed."""
    return time.clock_gettime(time.CLOCK_BOOTTIME) - time.monotonic()


def _last_words(pipe: Connection, text: str) -> None:
    try:
        pipe.send(("failed", text))
    except OSError:
        pass
