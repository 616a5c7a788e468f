"""Who is connected to the endpoint: UDP addresses that sent, and TCP connections."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rovtwin.links.mavlink.telemetry.streams import Schedule
from rovtwin.links.mavlink.wire import Encoder

MOST = 8  # peers at a time; further ones are not answered while all of these live
SILENT = 2.0  # a peer that is silent for longer gives its place to a new one; the living send a heartbeat a second [s]
FORGOTTEN = 30.0  # a UDP address that is silent for so long is dropped [s]


@dataclass
class Peer:
    """One connection.

    Attributes:
        name: Host and port, for people.
        write: Takes a frame; never blocks, drops what the other side does not take.
        encoder: Numbers the frames to this peer.
        schedule: Its telemetry.
        received_at: When it last sent, real time [s].
        called: Whether it is the ground station that the endpoint calls by itself: kept however silent it is.
        close: Ends its connection; None over UDP, which has none.
    """

    name: str
    write: Callable[[bytes], None]
    encoder: Encoder
    schedule: Schedule
    received_at: float
    called: bool = False
    close: Callable[[], None] | None = None

    def send(self, message: Any, component: int | None = None) -> None:
        """Send a message; of a component of the vehicle other than the autopilot where one is given."""
        self.write(self.encoder.frame(message, component))


@dataclass
class Peers:
    """All of them, by an address of any kind.

    Attributes:
        make: Makes the peer of a name and its `write`.
    """

    make: Callable[[str, Callable[[bytes], None]], Peer]
    by_address: dict[Any, Peer] = field(default_factory=dict)

    def get(self, address: Any, name: str, write: Callable[[bytes], None], now: float) -> Peer | None:
        """The peer at an address, a new one where there is room, or None; `now` is real time [s].

        Where there is none, the longest silent one goes.
        """
        if address not in self.by_address:
            if len(self.by_address) >= MOST and not self._make_room(now):
                return None
            self.by_address[address] = self.make(name, write)
        return self.by_address[address]

    def _make_room(self, now: float) -> bool:
        others = {a: p for a, p in self.by_address.items() if not p.called}
        oldest = min(others, key=lambda a: others[a].received_at)
        if now - others[oldest].received_at <= SILENT:
            return False
        self.drop(oldest)
        if (close := others[oldest].close) is not None:
            close()
        return True

    def drop(self, address: Any) -> None:
        self.by_address.pop(address, None)

    def forget(self, now: float) -> list[Peer]:
        """Drop who was silent over UDP for too long; who that was."""
        datagrams = {a: p for a, p in self.by_address.items() if not p.called and p.close is None}
        old = {a: p for a, p in datagrams.items() if now - p.received_at > FORGOTTEN}
        for address in old:
            del self.by_address[address]
        return list(old.values())

    def all(self) -> list[Peer]:
        return list(self.by_address.values())
