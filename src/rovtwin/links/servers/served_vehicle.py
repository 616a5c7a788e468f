"""ServedVehicle: what a protocol's server sees of a vehicle, be it simulated or replayed."""

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence

from rovtwin.core.flow import Measurement
from rovtwin.links.servers.pilot_command import PilotCommand

BACKLOG = 64  # batches of readings that a slow server may be behind before it loses the oldest


class ServedVehicle:
    """A vehicle's readings as they come, and where commands for it go.

    A vehicle of several drones names what one of them measures `<drone>/<sensor>`; what measures the whole vehicle has
    the sensor's name alone. Beside the sensors of a scenario (SI and radians, see `simulation.sensors`) there are:

    - `<drone>/force`: forces that the drone gives: surge, sway, heave [N], roll, pitch, yaw [N m], shape (6,)
    - `thrusters`: commands that its thrusters have, normalised, shape (n,)
    - `mocap`: pose as motion capture sees it, n and zyx Euler angles, shape (6,)
    - `estimate`: the vehicle's own estimate: eta, nu, shape (12,)

    Attributes:
        drones: Names; `("",)` for a vehicle that is one.
        speed: Simulated seconds a second.
        now: The vehicle's time of the newest readings [s].
        latest: The newest reading of each sensor, by name.
    """

    def __init__(
        self,
        drones: Sequence[str] = ("",),
        send: Callable[[PilotCommand], None] = lambda command: None,
        say: Callable[[str], None] = lambda text: None,
        speed: float = 1.0,
    ):
        """`send` takes commands to the vehicle, `say` what a user should know (addresses, clients that come and go)."""
        self.drones = tuple(drones)
        self.speed = speed
        self.now = 0.0
        self.latest: dict[str, Measurement] = {}
        self._send, self._say = send, say
        self._listeners: list[asyncio.Queue[list[Measurement]]] = []

    def say(self, text: str) -> None:
        """Tell the user something; what a client is called must not steer their terminal."""
        self._say("".join(c if c.isprintable() else "?" for c in text))

    def command(self, command: PilotCommand) -> None:
        """Take a command to the vehicle. It holds for 0.3 s: a server repeats it while its client lives."""
        self._send(command)

    def feed(self, now: float, readings: list[Measurement]) -> None:
        """The vehicle's newest readings, for all who listen; `now` is its time [s]."""
        self.now = now
        self.latest.update((reading.sensor, reading) for reading in readings)
        for queue in self._listeners:
            if queue.full():
                queue.get_nowait()
            queue.put_nowait(readings)

    async def readings(self) -> AsyncIterator[list[Measurement]]:
        """Batches of readings from now on, as they come."""
        queue: asyncio.Queue[list[Measurement]] = asyncio.Queue(BACKLOG)
        self._listeners.append(queue)
        try:
            while True:
                yield await queue.get()
        finally:
            self._listeners.remove(queue)

    @staticmethod
    def name(drone: str, sensor: str) -> str:
        """What a drone's sensor is called here."""
        return f"{drone}/{sensor}" if drone else sensor
