"""Who is connected to a drone, and who of them controls it: the first that came and is no observer.

The protocol names the client in its watchdog and in requests to disconnect, but not in motion inputs. So a motion
counts when the client in control feeds its watchdog, and when it comes from the same network address; two clients on
one computer cannot be distinguished.
"""

from dataclasses import dataclass

from rovtwin.links.blueye.wire import Client

MOST = 16  # clients at a time; one more takes the place of the one that has been silent longest


@dataclass
class Connected:
    """A client: its id, what it says of itself, its network address and when it last sent [s]."""

    id: int
    client: Client
    address: str
    last_at: float


class Clients:
    """Connected clients in order of arrival. Times are real [s], of any clock that the caller keeps to."""

    def __init__(self) -> None:
        self.all: dict[int, Connected] = {}
        self.in_control = 0
        self._last = 0

    @property
    def pilot(self) -> Connected | None:
        """The client in control."""
        return self.all.get(self.in_control)

    def connect(self, client: Client, address: str, now: float, silence: float) -> int:
        """A new client and its id; those silent for longer than `silence` [s] make way for it."""
        self.forget(now, silence)
        if len(self.all) >= MOST:
            others = [c for c in self.all.values() if c.id != self.in_control]
            del self.all[min(others, key=lambda c: c.last_at).id]
        self._last += 1
        self.all[self._last] = Connected(self._last, client, address, now)
        self._promote()
        return self._last

    def disconnect(self, client_id: int) -> None:
        """Any client may disconnect any other: that is how control is taken over."""
        self.all.pop(client_id, None)
        self._promote()

    def feed(self, client_id: int, now: float) -> bool:
        """A watchdog of a client; whether it is the one in control."""
        if client_id in self.all:
            self.all[client_id].last_at = now
        return client_id == self.in_control and client_id in self.all

    def forget(self, now: float, silence: float) -> list[Connected]:
        """Drop the clients that have been silent for longer [s]; those that were dropped."""
        gone = [c for c in self.all.values() if now - c.last_at > silence]
        for client in gone:
            del self.all[client.id]
        self._promote()
        return gone

    def _promote(self) -> None:
        if self.in_control not in self.all:
            self.in_control = next((c.id for c in self.all.values() if not c.client.observer), 0)
