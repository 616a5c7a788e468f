"""Vehicles for tests of links, to be opened in other processes: what their thrusters do is reported to a file."""

import multiprocessing
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Command, Measurement
from rovtwin.core.link import Link
from rovtwin.links import host
from rovtwin.links.remote_link import RemoteLink

PERIOD = 0.02


class PlainLink(Link):
    """A vehicle with a depth sensor at 50 Hz; it believes every command for ever, as the worst firmware would."""

    def __init__(self, reported: Path | None = None, dies_after: float = 1e9):
        self.sent, self.dies_after = reported, dies_after
        self.u = np.zeros(3)
        self.stopped = False
        self._began = time.monotonic()
        self._read = 0

    def read(self) -> list[Measurement]:
        since = time.monotonic() - self._began
        if since > self.dies_after:
            raise LinkError("the vehicle is gone")
        ticks = int(since / PERIOD)
        first, self._read = self._read, max(ticks, self._read)
        return [Measurement("pressure", np.array([2.0]), (k + 1) * PERIOD) for k in range(first, ticks)]

    def send(self, command: Command) -> None:
        if not self.stopped:
            self._obey(np.array(command.u, dtype=float))

    @property
    def age(self) -> float:
        return 0.0

    def stop(self) -> None:
        self.stopped = True
        self._obey(np.zeros(3))

    def close(self) -> None:
        self.stop()

    def _obey(self, u: np.ndarray) -> None:
        self.u = u
        if self.sent is not None:
            with self.sent.open("a") as stream:
                stream.write(f"{time.monotonic()} {' '.join(str(x) for x in u)}\n")


@dataclass(frozen=True)
class Opener:
    """Opens a PlainLink in the process that it is called in."""

    sent: Path | None = None
    dies_after: float = 1e9
    refuses: str = ""

    def __call__(self) -> PlainLink:
        if self.refuses:
            raise LinkError(self.refuses)
        return PlainLink(self.sent, self.dies_after)


def last_sent(path: Path) -> tuple[float, np.ndarray]:
    """When the thrusters were last sent something [s, monotonic], and what: NaN before the first whole line."""
    lines = path.read_text().split("\n")[:-1] if path.exists() else []
    words = [float(word) for word in lines[-1].split()] if lines else [np.nan, np.nan]
    return words[0], np.array(words[1:])


def resting(path: Path) -> bool:
    return bool((last_sent(path)[1] == 0.0).all())


def moving(path: Path) -> bool:
    return bool((np.abs(last_sent(path)[1]) > 0.0).any())


class ThreadHosted(RemoteLink):
    """The host in a thread of this process: what it does with a link, without the time that a process takes."""

    def _start(self, opener, thrusters, stop_at):
        self._pipe, theirs = multiprocessing.Pipe()
        thread = threading.Thread(target=self._run, args=(theirs, opener, thrusters, stop_at), daemon=True)
        thread.start()
        return thread

    @staticmethod
    def _run(pipe, opener, thrusters, stop_at):
        with pipe:
            host.host(pipe, opener, thrusters, stop_at)
