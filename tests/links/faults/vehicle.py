"""A vehicle without physics, served as `rovtwin serve` serves one: protocols in a process of their own.

python -m tests.links.faults.vehicle blueye|mavlink TOLD JUMP

Every change of what its thrusters are commanded goes to the file TOLD: time [s, monotonic], then the motion of each
drone, zeros where it is not armed. The file JUMP holds seconds that its clock is put forward by.
"""

import os
import sys
import time
from pathlib import Path

import numpy as np
from tests.links.blueye.vehicle import readings
from tests.links.faults.clock import jump_in

from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Measurement
from rovtwin.links.servers.pilot_command import PilotCommand
from rovtwin.live.serving.serve import serve

BLUEYE_HOSTS, MAVLINK_HOST = ("127.0.0.30", "127.0.0.31"), "127.0.0.40"
HTTP, UDP, TCP = 8795, 14795, 14796
BEGIN = 4000.0  # of its clock [s]: it may be set back by an hour
DRONES = {"blueye": ("port", "starboard"), "mavlink": ("",)}


class FaultVehicle:
    """Obeys wishes at once and measures always the same."""

    dt = 0.02

    def __init__(self, drones: tuple[str, ...], reported: Path, jump: Path):
        self.drones, self._jump = drones, jump
        self._sent = reported.open("a")
        self._tick, self._last = 0, None

    @property
    def now(self) -> float:
        return BEGIN + self._tick * self.dt + jump_in(self._jump)

    def advance(self, commands: dict[str, PilotCommand]) -> list[Measurement]:
        self._tick += 1
        still = PilotCommand()
        obeyed = [commands.get(drone, still) for drone in self.drones]
        motion = tuple(m for command in obeyed for m in (command.motion if command.armed else still.motion))
        if motion != self._last:
            self._last = motion
            self._sent.write(f"{time.monotonic()} {' '.join(map(str, motion))}\n")
            self._sent.flush()
        return [reading for drone in self.drones for reading in readings(self.now, drone)] + [
            Measurement("thrusters", np.array(motion), self.now)
        ]


def servers(kind: str) -> list:
    if kind == "blueye":
        from rovtwin.links.blueye.server import BlueyeServer

        return [BlueyeServer(BLUEYE_HOSTS, http_port=HTTP)]
    from rovtwin.links.mavlink.server import MavlinkServer

    return [MavlinkServer(MAVLINK_HOST, ground_station="", udp_port=UDP, tcp_port=TCP)]


def main(kind: str, reported: str, jump: str) -> int:
    vehicle = FaultVehicle(DRONES[kind], Path(reported), Path(jump))
    parent = int(os.environ.get("FAULT_BENCH", os.getppid()))
    try:
        # Who started it may be killed: nobody must be left at these addresses.
        serve(vehicle, servers(kind), say=lambda text: print(text, flush=True), over=lambda: os.getppid() != parent)
    except LinkError as error:
        print(f"ended: {error}", flush=True)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
