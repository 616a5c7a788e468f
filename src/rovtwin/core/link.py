"""Link: one face to any vehicle, simulated, replayed or real."""

import abc

from rovtwin.core.flow import Command, Measurement


class Link(abc.ABC):
    """What an autopilot needs of a vehicle.

    `send` after `stop` is ignored: stop latches until the link is closed. All methods return at once and never raise
    for a quiet vehicle (`read` returns an empty list); `LinkError` means that the vehicle cannot be used any more.
    """

    @abc.abstractmethod
    def read(self) -> list[Measurement]:
        """Readings that arrived since the last call, those of each sensor in order of arrival."""

    @abc.abstractmethod
    def send(self, command: Command) -> None:
        """Hand over thruster commands; values beyond +-1 are clipped, a non-finite command counts as `stop`."""

    @abc.abstractmethod
    def stop(self) -> None:
        """Thrusters off, until the link is closed."""

    @abc.abstractmethod
    def close(self) -> None:
        """Stop and let go of the vehicle; may be called twice."""

    def __enter__(self) -> "Link":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
