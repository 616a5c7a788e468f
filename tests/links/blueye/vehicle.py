"""A vehicle of made-up readings behind a Blueye server, for tests that talk to it with the vendor's SDK."""

import threading
import time

import numpy as np
from tests.links.serving import Served

from rovtwin.core.flow import Measurement

PERIOD = 0.02
TRUTH = {
    "pressure": [3.5],
    "attitude": [0.1, -0.2, 3.0],
    "gyro": [0.01, -0.02, 0.3],
    "accelerometer": [0.5, -0.25, -9.75],
    "battery": [0.75, 60.0],
    "leak": [0.0],
    "dvl": [0.5, 0.25, -0.125],
    "altimeter": [2.5],
    "position": [12.0, -7.0],
    "force": [4.0, -2.0, 5.5, 0.0, 0.0, 1.5],
}


def readings(t: float, drone: str = "", **changed) -> list[Measurement]:
    """One of each sensor at a time [s]."""
    head = f"{drone}/" if drone else ""
    return [Measurement(head + name, np.array(value, dtype=float), t) for name, value in (TRUTH | changed).items()]


class Feeder:
    """The vehicle's time, which moves on only when the test says so."""

    def __init__(self, served: Served, pace: float = 0.5):
        """`pace`: real seconds a simulated one takes."""
        self.served, self.t, self._k, self._pace = served, 0.0, 0, pace

    def feed(self, seconds: float, **changed) -> None:
        for _ in range(round(seconds / PERIOD)):
            self._k += 1
            self.t = self._k * PERIOD
            self.served.feed(self.t, [r for d in self.served.station.drones for r in readings(self.t, d, **changed)])
            time.sleep(self._pace * PERIOD)


def wait_for_farewells() -> None:
    """Closed links take leave in threads of their own. A request to disconnect that meets no server any more waits in
    the SDK's socket, and would send away the first client of the next server at this address.
    """
    for thread in threading.enumerate():
        if thread.name.startswith("leave"):
            thread.join(2)
