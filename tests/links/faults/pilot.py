"""A client in a process of its own that keeps a vehicle's thrusters turning, and does what its input says.

python -m tests.links.faults.pilot KIND WHERE JUMP

Kinds: `link` is what `rovtwin fly --link WHERE` holds the vehicle by; `sdk` is the vendor's blueye.sdk, `take` the same
that sends other clients away, `pymavlink` a ground station. Lines of input: `steer SHARE`, `stop`, `close`, and what a
kind understands. Lines of output: time [s, monotonic], a word, and more. The file JUMP makes the link's clock jump.
"""

import os
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue

import numpy as np
from tests.links.faults.clock import JumpingClock

from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Command
from rovtwin.core.link import Link
from rovtwin.links.remote_link import RemoteLink

PERIOD = 0.02
SHARE = 0.5


def tell(word: str, *more: object) -> None:
    print(time.monotonic(), word, *more, flush=True)


@dataclass(frozen=True)
class Opener:
    """Opens a link in the process that it is called in, as `live.connect` does."""

    where: str
    clock: Callable[[], float]

    def __call__(self) -> Link:
        scheme, _, rest = self.where.partition("://")
        if scheme == "mavlink":
            from rovtwin.links.mavlink.link import MavlinkLink

            return MavlinkLink(rest, np.eye(6), clock=self.clock)
        from rovtwin.links.blueye.double import DoubleBlueyeLink
        from rovtwin.links.blueye.link import BlueyeLink

        hosts = rest.split(",")
        return DoubleBlueyeLink(hosts, clock=self.clock) if len(hosts) == 2 else BlueyeLink(rest, clock=self.clock)


class LinkPilot:
    """The loop of an autopilot: a command every period until the link is lost."""

    def __init__(self, where: str, jump: Path):
        # Surge of the one drone, of both, or of a vehicle of six axes.
        self._ahead = np.eye(6)[0] if where.startswith("mavlink") else np.tile([1.0, 0.0, 0.0], where.count(",") + 1)
        self.link = RemoteLink(Opener(where, JumpingClock(jump)), len(self._ahead))
        tell("host", self.link.pid)
        self.link.arm()
        self.share, self._received, self._reported_at, self._last = SHARE, 0, 0.0, {}
        self._backwards = 0

    def turn(self) -> None:
        for reading in self.link.read():
            self._received += reading.sensor == "pressure"
            last = self._last.get(reading.sensor, -np.inf)
            self._backwards += last >= reading.t_valid > last - 1.0  # further back, a clock has jumped
            self._last[reading.sensor] = reading.t_valid
        self.link.send(Command(self.share * self._ahead))
        if time.monotonic() - self._reported_at > 0.05:
            self._reported_at = time.monotonic()
            tell("heard", self._received, round(self.link.age, 3), self._backwards)
            self._received = 0

    def stop(self) -> None:
        self.link.stop()

    def close(self) -> None:
        self.link.close()


class SdkPilot:
    """A script of a user of blueye.sdk: sets a motion ten times a second."""

    def __init__(self, where: str, take: bool):
        from blueye.sdk import Drone

        tell("takes" if take else "connects")
        self.drone = Drone(where, timeout=3, disconnect_other_clients=take)
        tell("control", self.drone.in_control)
        self.share, self._sent = (0.0 if take else SHARE), 0.0

    def turn(self) -> None:
        if time.monotonic() - self._sent > 0.1:
            self._sent = time.monotonic()
            self.drone.motion.send_thruster_setpoint(self.share, 0, 0, 0)

    def stop(self) -> None:
        self.share = 0.0
        self.drone.motion.send_thruster_setpoint(0, 0, 0, 0)

    def synchronise(self, seconds: str) -> None:
        self.drone.config.set_drone_time(int(time.time() + float(seconds)))

    def close(self) -> None:
        self.drone.disconnect()


class GroundStation:
    """pymavlink as scripts use it: heartbeats and sticks ten times a second."""

    def __init__(self, where: str, arms: bool):
        from pymavlink import mavutil

        self.line = mavutil.mavlink_connection(where, source_system=255)
        self.mavlink = mavutil.mavlink
        self.share, self._sent = SHARE, 0.0
        end = time.monotonic() + 8.0
        while "ATTITUDE" not in self.line.messages and time.monotonic() < end:
            self.turn(sticks=False)
            time.sleep(0.01)
        for _ in range(20 if arms else 0):
            self._command(self.mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
            if self.line.recv_match(type="COMMAND_ACK", blocking=True, timeout=0.3):
                break
        self._sticks = arms

    def _command(self, number: int, *values: float) -> None:
        self.line.mav.command_long_send(1, 1, number, 0, *(*values, *[0.0] * 7)[:7])

    def turn(self, sticks: bool | None = None) -> None:
        if time.monotonic() - self._sent > 0.1:
            self._sent = time.monotonic()
            self.line.mav.heartbeat_send(self.mavlink.MAV_TYPE_GCS, self.mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)
            if self._sticks if sticks is None else sticks:
                self.line.mav.manual_control_send(1, round(1000 * self.share), 0, 500, 0, 0)
        for _ in range(200):
            if self.line.recv_msg() is None:
                break

    def stop(self) -> None:
        """What a ground station does: sticks let go, and disarm until it is so."""
        self.share = 0.0
        self._sent = 0.0
        self.turn()
        for _ in range(20):
            self._command(self.mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
            if self.line.recv_match(
                type="COMMAND_ACK", condition="COMMAND_ACK.command==400", blocking=True, timeout=0.2
            ):
                break

    def disarm(self) -> None:
        self._command(self.mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)

    def mode(self, number: str) -> None:
        self._command(self.mavlink.MAV_CMD_DO_SET_MODE, 1, float(number))

    def synchronise(self, seconds: str) -> None:
        now = time.time() + float(seconds)
        self.line.mav.system_time_send(int(1e6 * now), int(1000 * abs(float(seconds))))
        self.line.mav.timesync_send(0, int(1e9 * now))

    def close(self) -> None:
        if self._sticks:
            self.stop()
        self.line.close()


def opened(kind: str, where: str, jump: Path):
    if kind == "link":
        return LinkPilot(where, jump)
    if kind in ("sdk", "take"):
        return SdkPilot(where, kind == "take")
    return GroundStation(where, kind == "pymavlink")


def main(kind: str, where: str, jump: str) -> int:
    orders: SimpleQueue[str] = SimpleQueue()
    tell("begins", os.getpid())
    try:
        pilot = opened(kind, where, Path(jump))
    except (LinkError, ConnectionError) as error:
        tell("refused", str(error).replace("\n", " "))
        return 3
    tell("open")
    threading.Thread(target=lambda: [orders.put(line) for line in sys.stdin], daemon=True).start()
    try:
        parent = int(os.environ.get("FAULT_BENCH", os.getppid()))
        while os.getppid() == parent:
            pilot.turn()
            try:
                word, *more = orders.get(timeout=PERIOD).split()
            except Empty:
                continue
            tell("obeys", word, *more)
            if word == "steer":
                pilot.share = float(more[0])
            else:
                getattr(pilot, word)(*more)
            if word == "close":
                break
    except LinkError as error:
        tell("lost", str(error))
        pilot.stop()
        pilot.close()
    tell("closed")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
