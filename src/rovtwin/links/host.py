"""The process that holds a RemoteLink's link: it minds the thrusters whatever becomes of the autopilot.

It keeps the newest command for 0.3 s and no longer. When the pipe to the autopilot closes (it ended, crashed, was
killed), or nothing comes through it, thrusters stop. Whoever writes to its stop socket stops them too: a way that
leads past an autopilot that hangs.
"""

import contextlib
import logging
import os
import select
import signal
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from queue import SimpleQueue

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Command
from rovtwin.core.link import COMMAND_LIFE, Link
from rovtwin.core.processes.urgent import settle, urgent

logger = logging.getLogger(__name__)

POLL = 0.004  # how often the host looks at both sides while nothing comes [s]
SIGN_OF_LIFE = 0.05  # the autopilot hears of a quiet vehicle as often [s]
AT_ONCE = 100  # readings in one message: more might fill the pipe
BACKLOG = 2000  # readings kept for an autopilot that does not read
NAP = 1.0  # a computer that slept longer flies nothing on [s]

Opener = Callable[[], Link]  # picklable: it opens the link within the host process


def main(pipe: Connection, opener: Opener, thrusters: int, stop_at: Path | None) -> None:
    """What the process runs, see `host`."""
    # Ctrl-C, a closed terminal and job control are for the autopilot: it ends, the pipe says so here, and the link is
    # closed in order. Who ends this process itself gets the same.
    os.setsid()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: sys.exit(0))
    threading.excepthook = _ended
    with contextlib.suppress(OSError):  # nobody waits any more
        pipe.send(("begun", None))  # whoever waits knows by it who is slow: this process or the vehicle
    host(pipe, opener, thrusters, stop_at)


def host(pipe: Connection, opener: Opener, thrusters: int, stop_at: Path | None = None) -> None:
    """Open a link and mind it until the autopilot at the other end of the pipe is gone; what fails is said there.

    Args:
        pipe: To the autopilot.
        opener: Opens the link.
        thrusters: How many it has.
        stop_at: Where to make a socket at which any message stops the thrusters, whatever it says; it goes back to its
            sender once they are.
    """
    try:
        with opener() as link:
            minding = _Host(pipe, link, np.zeros(thrusters))
            if stop_at is not None:
                _listen_for_stop(stop_at, minding.stop)
            settle()
            pipe.send(("open", None))
            with urgent():
                minding.mind()
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

    def __init__(self, pipe: Connection, link: Link, off: Float[np.ndarray, " n"]):
        self._pipe, self._link, self._off = pipe, link, off
        self._came, self._live, self._reported_at, self._slept = 0.0, False, 0.0, _asleep()
        self._received: deque[tuple[str, np.ndarray, float]] = deque(maxlen=BACKLOG)
        self._answers: SimpleQueue[str] = SimpleQueue()
        self._busy = False
        self._stopped_at = -np.inf  # when it was last asked to stop; arming that was asked for before counts no more
        self._armed_for = -np.inf  # when arming was asked for that it last began

    def mind(self) -> None:
        """Until the autopilot is gone.

        Raises:
            LinkError: The vehicle is lost, or this computer has slept.
        """
        while True:
            try:
                self._obey(self._newest())
                news = self._link.read()
                self._busy = bool(news)
                self._received += [(r.sensor, r.value, r.t_valid) for r in news]
                self._report()
            except (EOFError, OSError):
                return

    def stop(self) -> None:
        """Thrusters off; from any thread."""
        self._stopped_at = time.monotonic()
        self._link.stop()

    def _newest(self) -> tuple[float, Float[np.ndarray, " n"]] | None:
        """The newest command that came, with when it was decided; arming and stopping are done at once."""
        newest = None
        # A twin that runs behind its clock is read again at once.
        if self._pipe.poll(0.0 if self._busy else POLL):
            while self._pipe.poll():
                kind, content = self._pipe.recv()
                if kind == "command":
                    newest = content
                elif kind == "stop":
                    self.stop()
                elif kind == "arm":
                    # It takes seconds, and commands must go on expiring.
                    threading.Thread(target=self._arm, args=(content,), daemon=True).start()
                elif kind == "tell":
                    self._link.tell(content)  # type: ignore[attr-defined]  (only a twin takes orders)
        return newest

    def _arm(self, asked_at: float) -> None:
        """Arm the link, unless it was asked to stop since that was asked for; why it refused, or nothing, is said."""
        if asked_at < self._stopped_at:
            self._answers.put("it was stopped since arming was asked for")
            return
        self._armed_for = asked_at
        answer = _arm(self._link)
        if not answer and self._halted:  # while it armed
            self._link.stop()
            answer = "stopped while it was being armed"
        self._answers.put(answer)

    @property
    def _halted(self) -> bool:
        """Whether it was asked to stop and has not been armed since: then zeros go to the link, even if that broke."""
        return self._stopped_at > self._armed_for

    def _obey(self, newest: tuple[float, Float[np.ndarray, " n"]] | None) -> None:
        if (nap := _asleep() - self._slept) > NAP:
            self._link.stop()
            raise LinkError(f"this computer slept for {nap:.0f} s: thrusters are off. Fly again")
        now = time.monotonic()
        if newest is not None:
            self._came, u = newest  # one that waited in the pipe is as old as when it was decided
            if now - self._came <= COMMAND_LIFE and not self._halted:
                self._link.send(Command(u))  # type: ignore[arg-type]  (NumPy: it goes to a link)
                self._live = True
        if self._live and (self._halted or now - self._came > COMMAND_LIFE):
            self._link.send(Command(self._off))  # type: ignore[arg-type]  (NumPy, as above)
            self._live = False

    def _report(self) -> None:
        """Readings, and a sign of life. An autopilot that does not read must not keep us from minding the thrusters."""
        now = time.monotonic()
        if not (self._received or now - self._reported_at > SIGN_OF_LIFE) or not writable(self._pipe):
            return
        slice_ = [self._received.popleft() for _ in range(min(len(self._received), AT_ONCE))]
        self._pipe.send(("readings", (self._link.age, self._stopped_at, slice_)))
        if not self._answers.empty():
            self._pipe.send(("limits", (self._link.limits, self._link.reach)))
            self._pipe.send(("armed", self._answers.get()))
        self._reported_at = now


def _listen_for_stop(path: Path, stop: Callable[[], None]) -> None:
    """A thread that calls `stop` for every message to a socket of this machine, and then sends it back."""
    path.unlink(missing_ok=True)
    ear = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    ear.bind(str(path))

    def listen() -> None:
        with urgent():
            while True:
                text, sender = ear.recvfrom(64)
                try:
                    stop()
                    if sender:
                        ear.sendto(text, socket.MSG_DONTWAIT, sender)
                except Exception as error:  # a driver's, or a sender is gone: the next STOP must arrive all the same
                    logger.warning("STOP: %s: %s", type(error).__name__, error)

    threading.Thread(target=listen, daemon=True, name="stop").start()


def writable(pipe: Connection) -> bool:
    """Whether the other side still takes messages."""
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
