"""RemoteLink: a real vehicle's link in a process of its own, so that the vehicle outlives whatever becomes of ours.

What goes on in that process is in `host`.
"""

import time
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Command, Measurement
from rovtwin.core.link import Link
from rovtwin.core.processes.child import end, started
from rovtwin.links import host
from rovtwin.links.host import Opener, writable

GONE = "the link's process is gone: thrusters stop by the vehicle's own watchdog"
ENDING = 2.0  # a process that does not end by itself in this time is killed [s]
ARMING = 10.0  # longest wait for a vehicle to arm [s]
CONNECTING = 30.0  # longest wait for a vehicle [s]


class RemoteLink(Link):
    """A link that runs elsewhere, behind a pipe.

    Attributes:
        age: Since anything came from the vehicle [s]; that of the quieter drone of two.
        stopped_at: When the host was last asked to stop, by whomever [s, monotonic]; -inf if never.
    """

    def __init__(self, opener: Opener, thrusters: int, stop_at: Path | None = None, patience: float = CONNECTING):
        """Starts the host and waits until the vehicle answers.

        Args:
            opener: Opens the link, in the host's process.
            thrusters: How many it has.
            stop_at: Where the host makes a socket at which any message stops the thrusters.
            patience: Longest wait for the vehicle [s].

        Raises:
            LinkError: The vehicle cannot be reached.
        """
        self._process = self._start(opener, thrusters, stop_at)
        self._failed: str | None = None
        self._readings: list[Measurement] = []
        self._begun, self._open, self._stopped, self._closed = False, False, False, False
        self._armed: str | None = None
        self._asked_at, self.stopped_at, self._stop_pending = -np.inf, -np.inf, False
        self._reported_age, self._reported_at = 0.0, time.monotonic()
        until = time.monotonic() + patience
        while not self._open and self._failed is None and time.monotonic() < until:
            self._pipe.poll(0.1)
            self._listen()
        if not self._open:
            self.close()
            raise LinkError(self._failed or self._nobody(patience))

    def _start(self, opener: Opener, thrusters: int, stop_at: Path | None) -> Any:
        """Start the host at the other end of `_pipe`; what it runs in."""
        process, self._pipe = started(host.main, opener, thrusters, stop_at, name="rovtwin-link")
        return process

    def _nobody(self, patience: float) -> str:
        """What to say when nothing came in time."""
        if self._begun:
            return (
                f"no answer within {patience:g} s. Is the vehicle on, and the address right, and this machine not too "
                "busy with other things to listen?"
            )
        return (
            f"the process that holds the link was not up within {patience:g} s: the vehicle was not asked. Is "
            "this machine busy with other things?"
        )

    @property
    def stopped(self) -> bool:
        """Whether it was asked to stop from here, and has not been armed since."""
        return self._stopped

    @property
    def pid(self) -> int | None:
        """Of the host process."""
        return self._process.pid

    @property
    def age(self) -> float:
        return self._reported_age + time.monotonic() - self._reported_at

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
        self.begin_arming()
        while self.refused is None:
            self._pipe.poll(0.05)
        if self.refused:
            raise LinkError(self.refused)

    def begin_arming(self, asked_at: float | None = None) -> None:
        """Arm without waiting for it: `refused` says what came of it.

        Args:
            asked_at: When the operator asked for it [s, monotonic]; a stop since then is the graver order. None: now.
        """
        self._armed, self._asked_at = None, time.monotonic() if asked_at is None else asked_at
        self._until = time.monotonic() + ARMING
        self._tell("arm", self._asked_at)

    @property
    def refused(self) -> str | None:
        """Why the vehicle did not arm, "" if it did, None while nobody knows."""
        self._listen()
        if self._armed is None and (self._failed or time.monotonic() > self._until):
            return self._failed or f"arming: found no answer within {ARMING:g} s"
        return self._armed

    def tell(self, order: Any) -> None:
        """Something for the link itself: only a twin takes orders, see its `tell`."""
        self._tell("tell", order)

    def stop(self) -> None:
        self._stopped, self._asked_at, self._stop_pending = True, -np.inf, True
        self._say_stop()

    def _say_stop(self) -> None:
        """A stop that a host did not hear because it hung is the first thing that it hears when it listens again."""
        if self._stop_pending and not self._closed and writable(self._pipe):
            self._stop_pending = False
            self._put("stop", None)

    def cut(self) -> None:
        """Kill the process that holds the link, as a crash would, for a drill: nothing tells the vehicle."""
        self._process.kill()

    def close(self) -> None:
        if self._closed:
            return
        self.stop()
        self._closed = True
        # The host stops and closes the link when it sees the pipe closed, whatever it has received.
        end(self._process, self._pipe, ENDING)

    def _tell(self, kind: str, content: object) -> None:
        # A host that hangs does not read: what it would not hear in time is not said, so that nobody hangs with it.
        self._say_stop()
        if not self._closed and not self._stop_pending and writable(self._pipe):
            self._put(kind, content)

    def _put(self, kind: str, content: object) -> None:
        try:
            self._pipe.send((kind, content))
        except OSError:
            self._failed = self._failed or GONE

    def _listen(self) -> None:
        self._say_stop()
        try:
            while self._pipe.poll():
                kind, content = self._pipe.recv()
                if kind == "begun":
                    self._begun = True
                elif kind == "open":
                    self._open = True
                elif kind == "failed":
                    self._failed = content
                elif kind == "limits":
                    self.limits, self.reach = content
                elif kind == "armed":
                    self._armed = content
                    # A vehicle that may be armed again after a stop obeys again, unless it was stopped meanwhile.
                    self._stopped = self._stopped and (content != "" or self._asked_at == -np.inf)
                else:
                    self._reported_age, self.stopped_at, readings = content
                    self._reported_at = time.monotonic()
                    self._readings += [Measurement(*reading) for reading in readings]
        except (EOFError, OSError):
            self._failed = self._failed or GONE
