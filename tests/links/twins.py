"""A twin, served as `rovtwin serve` does it, but with its physics in a thread of the test that may look at them."""

import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rovtwin.links.servers import protocol_process as apart
from rovtwin.links.servers.server import Server
from rovtwin.live.serving.host import ServedVehicle
from rovtwin.live.serving.protocols import places_of, servers_of, world_for
from rovtwin.live.serving.serve import serve
from rovtwin.runs.pace import Pace
from rovtwin.runs.trimmed import trimmed


def free_port() -> int:
    """A TCP port of the loopback that nobody has now."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@dataclass
class ServedTwin:
    """A twin that is being served.

    Attributes:
        vehicle: Its physics.
        speed: Simulated seconds a second.
        messages: What its servers said.
        history: Time and truth (eta, nu, thrust, command) of every period.
        failed: What ended it.
    """

    vehicle: ServedVehicle
    speed: float
    messages: list[str] = field(default_factory=list)
    history: list[tuple[float, dict[str, np.ndarray]]] = field(default_factory=list)
    failed: list[BaseException] = field(default_factory=list)
    pace: Pace | None = None

    @property
    def eta(self) -> np.ndarray:
        """True pose now, shape (6,)."""
        return self.history[-1][1]["eta"].copy()

    @property
    def command(self) -> np.ndarray:
        """Commands of the thrusters now, shape (n,)."""
        return self.history[-1][1]["command"].copy()

    def until(self, true: Callable[[], object], seconds: float = 10.0) -> object:
        """Whatever `true` gives once it gives something, within so many real seconds."""
        end = time.monotonic() + seconds
        while not (result := true()):
            assert not self.failed, f"the twin ended: {self.failed[0]}"
            assert time.monotonic() < end, f"it never happened; {self.eta.round(2)}, {self.messages[-3:]}"
            time.sleep(0.01)
        return result


class _Watched:
    """The vehicle with a look at every period."""

    def __init__(self, twin: ServedTwin):
        self._twin = twin
        self.dt, self.drones, self.thrusters = twin.vehicle.dt, twin.vehicle.drones, twin.vehicle.thrusters

    @property
    def now(self) -> float:
        return self._twin.vehicle.now

    def advance(self, commands):
        readings = self._twin.vehicle.advance(commands)
        truth = {name: np.array(value) for name, value in self._twin.vehicle.truth.items()}
        self._twin.history.append((self.now, truth))
        return readings


@contextmanager
def twin_served(
    what: str,
    protocols: Sequence[str],
    addresses: Sequence[str] = (),
    *,
    overrides: Sequence[str] = (),
    speed: float = 1.0,
    more: Sequence[Server] = (),
    log: Path | None = None,
) -> Iterator[ServedTwin]:
    """A served twin until the block is left."""
    scenario, _ = trimmed(world_for(what, overrides, None))
    twin = ServedTwin(ServedVehicle(scenario), speed)
    servers = [*servers_of(protocols, scenario, twin.vehicle, places_of(protocols, addresses)).values(), *more]
    over = threading.Event()

    def run() -> None:
        try:
            twin.pace = serve(_Watched(twin), servers, speed=speed, say=twin.messages.append, over=over.is_set, log=log)
        except BaseException as error:
            twin.failed.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        end = time.monotonic() + apart.STARTING + 10.0
        while len(twin.messages) < len(servers) and not twin.failed and time.monotonic() < end:
            time.sleep(0.02)
        assert not twin.failed, twin.failed
        assert len(twin.messages) >= len(servers), f"servers are silent: {twin.messages}"
        yield twin
    finally:
        over.set()
        thread.join(10.0)
        assert not thread.is_alive()
