"""Link: one face to any vehicle, simulated, replayed or real; Source: one to what only measures."""

import abc
from typing import Self

from rovtwin.core.flow import Command, Measurement

COMMAND_LIFE = 0.3  # a command older than this counts as thrusters off [s]


class Source(abc.ABC):
    """Something that measures: a vehicle, or an instrument beside it (acoustic positions, motion capture, a DVL).

    All methods return at once and never raise for a quiet instrument (`read` returns an empty list); `LinkError` means
    that it cannot be used any more. Times of readings are those of the clock that the source was given [s].

    Attributes:
        provides: Sensors that an autopilot takes from here and from nowhere else, whether it is received or not.
    """

    provides: frozenset[str] = frozenset()

    @abc.abstractmethod
    def read(self) -> list[Measurement]:
        """Readings that arrived since the last call, those of each sensor in order of arrival."""

    @abc.abstractmethod
    def close(self) -> None:
        """Let go of it; may be called twice. Nothing is read any more."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Link(Source):
    """What an autopilot needs of a vehicle.

    Before `arm` nothing is sent that moves the vehicle or takes it from its pilot, and closing a link that was never
    armed leaves it as it was. A command lives for COMMAND_LIFE. `send` after `stop` is ignored: stop latches until the
    link is closed. All methods but `arm` return at once.

    Attributes:
        limits: What of a command does not reach the vehicle, or may not, a sentence each; known once it is armed.
        reach: Share of full command along an axis that arrives at most; likewise.
    """

    limits: tuple[str, ...] = ()
    reach: float = 1.0

    def arm(self) -> None:
        """Make the vehicle ready to obey. One that needs no such step does nothing here.

        Raises:
            LinkError: It refuses.
        """

    @property
    @abc.abstractmethod
    def age(self) -> float:
        """Since anything came from the vehicle [s], real time; of several lines that of the quietest. 0 of a twin."""

    @abc.abstractmethod
    def send(self, command: Command) -> None:
        """Hand over thruster commands; values beyond +-1 are clipped, a non-finite command counts as `stop`."""

    @abc.abstractmethod
    def stop(self) -> None:
        """Thrusters off, until the link is closed."""

    @abc.abstractmethod
    def close(self) -> None:
        """Stop and let go of the vehicle; may be called twice."""
