"""A vehicle for tests of MAVLink: readings in a steady pose, and free ports for its endpoint."""

import math
import socket
import time
from collections.abc import Callable

import numpy as np

from rovtwin.core.flow import Measurement
from rovtwin.links.mavlink.server import MavlinkServer

ATTITUDE = [0.1, -0.2, 2.0]
PLACE = [3.0, -4.0, 2.5]


def free_port(kind: int = socket.SOCK_DGRAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def endpoint(**options) -> MavlinkServer:
    """A server on free ports that calls a ground station on a free port."""
    ports = {"udp_port": free_port(), "ground_station": f"127.0.0.1:{free_port()}"}
    return MavlinkServer(**({"tcp_port": free_port(socket.SOCK_STREAM)} | ports | options))


def measured(t: float, estimate: bool = False) -> list[Measurement]:
    """What the vehicle measures at a time."""
    values = {
        "attitude": ATTITUDE,
        "gyro": [0.01, -0.02, 0.03],
        "accelerometer": [1.0, 0.5, -9.7],
        "pressure": [PLACE[2]],
        "position": PLACE[:2],
        "dvl": [0.4, 0.0, 0.0],
        "battery": [0.83, 120.0],
        "altimeter": [7.25],
        "thrusters": [0.5, -0.25, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
        "leak": [0.0],
    }
    if estimate:
        values["estimate"] = [*PLACE, *ATTITUDE, 0.4, 0.0, 0.0, 0.01, -0.02, 0.03]
    return [Measurement(name, np.array(value, dtype=float), t) for name, value in values.items()]


def soon(done: Callable[[], bool], limit: float = 3.0) -> bool:
    """Whether something comes true in time."""
    end = time.monotonic() + limit
    while not done() and time.monotonic() < end:
        time.sleep(0.005)
    return done()


def close(a: float, b: float, tolerance: float = 1e-6) -> bool:
    return math.isclose(a, b, abs_tol=tolerance)
