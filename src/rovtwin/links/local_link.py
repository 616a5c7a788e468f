"""LocalLink: what a link within our own process does with commands: it keeps the newest one, for COMMAND_LIFE."""

import abc

import numpy as np
from jaxtyping import Float

from rovtwin.core.flow import Command
from rovtwin.core.link import COMMAND_LIFE, Link

ROUNDING = 1e-9  # of times that are multiples of a period [s]


class LocalLink(Link):
    """Keeps the newest command, clipped; `stop` latches."""

    def __init__(self, thrusters: int):
        self._off = np.zeros(thrusters)
        self._u, self._sent = self._off, 0.0
        self._stopped = self._closed = False

    @abc.abstractmethod
    def _now(self) -> float:
        """Time by which commands age [s]."""

    def send(self, command: Command) -> None:
        u = np.asarray(command.u, dtype=float)
        if not np.all(np.isfinite(u)):
            self.stop()
        if not self._stopped:
            self._u, self._sent = np.clip(u, -1.0, 1.0), self._now()

    @property
    def command(self) -> Float[np.ndarray, " n"]:
        """What thrusters are sent now."""
        live = not self._stopped and self._now() - self._sent <= COMMAND_LIFE + ROUNDING
        return self._u if live else self._off

    @property
    def age(self) -> float:
        return 0.0

    def stop(self) -> None:
        self._stopped = True

    def close(self) -> None:
        self.stop()
        self._closed = True
