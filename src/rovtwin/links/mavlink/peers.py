"""Who is connected to the endpoint: UDP addresses that were heard, and TCP connections."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rovtwin.links.mavlink.telemetry import Schedule
from rovtwin.links.mavlink.wire import Encoder

MOST = 8  # peers at a time; further ones are not answered
FORGOTTEN = 30.0  # a UDP address that is silent for so long is dropped [s]


@dataclass
class Peer:
    """One connection.

    Attributes:
        name: Host and port, for people.
        write: Takes a frame; never blocks, drops what the other side does not take.
        encoder: Numbers the frames to this peer.
        schedule: Its telemetry.
        heard_at: When it was last heard, real time [s].
        stays: Whether it is kept however silent it is: the ground station that the endpoint calls by itself.
    """

    name: str
    write: Callable[[bytes], None]
    encoder: Encoder
    schedule: Schedule
    heard_at: float
    stays: bool = False

    def send(self, message: Any) -> None:
        self.write(self.encoder.frame(message))


@dataclass
class Peers:
    """All of them, by an address of any kind.

    Attributes:
        make: Makes the peer of a name and its `write`.
    """

    make: Callable[[str, Callable[[bytes], None]], Peer]
    by_address: dict[Any, Peer] = field(default_factory=dict)

    def get(self, address: Any, name: str, write: Callable[[bytes], None]) -> Peer | None:
        """The peer at an address, a new one where there is room, or None."""
        if address not in self.by_address:
            if len(self.by_address) >= MOST:
                return None
            self.by_address[address] = self.make(name, write)
        return self.by_address[address]

    def drop(self, address: Any) -> None:
        self.by_address.pop(address, None)

    def forget(self, now: float) -> list[Peer]:
        """Drop who was silent for too long; who that was."""
        old = {a: p for a, p in self.by_address.items() if not p.stays and now - p.heard_at > FORGOTTEN}
        for address in old:
            del self.by_address[address]
        return list(old.values())

    def all(self) -> list[Peer]:
        return list(self.by_address.values())
