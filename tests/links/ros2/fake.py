"""ROS 2 without a network: a transport within the process, and a vehicle on it for Ros2Link."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from rovtwin.links.ros2 import convert
from rovtwin.links.ros2 import messages as msg
from rovtwin.links.ros2.link import Ros2Link
from rovtwin.links.ros2.transport import Transport


class FakeTransport(Transport):
    """Keeps what is published; `deliver` is what others publish."""

    def __init__(self):
        self.dropped = 0
        self.published: list[tuple[str, Any]] = []
        self.subscribers: dict[str, Callable[[Any], None]] = {}
        self.closed = False

    def publish(self, topic: str, message: Any) -> None:
        if not self.closed:
            self.published.append((topic, message))

    def subscribe(self, topic: str, kind: type, callback: Callable[[Any], None], stream: bool = True) -> None:
        self.subscribers[topic] = callback

    def deliver(self, topic: str, message: Any) -> None:
        if topic in self.subscribers and not self.closed:
            self.subscribers[topic](message)

    def close(self) -> None:
        self.closed = True


class FakeVehicle:
    """A vehicle whose clock stands still until `wait`; it obeys `cmd_thrusters` while `arm` says so."""

    def __init__(self, thrusters: int, period: float):
        self.transport, self.period = FakeTransport(), period
        self.now = 100.0
        self.link = Ros2Link("rov", thrusters, lambda: self.now, transport=self.transport, stamp_clock=lambda: self.now)

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds / self.period)):
            self.now += self.period
            self.transport.deliver("/rov/imu", convert.imu(self.now, gyro=[0.1, 0.2, 0.3]))
            self.transport.deliver("/rov/pressure", convert.pressure(self.now, 2.0, convert.Water()))

    def settle(self) -> None:
        """Until the link's thread has seen all that happened."""
        goal, end = self.link._rounds + 2, time.monotonic() + 10
        while self.link._rounds < goal and self.link._thread.is_alive():
            assert time.monotonic() < end, "the link's thread stands still"
            with self.link._wake:
                self.link._wake.notify_all()
            time.sleep(0.001)

    def applied(self) -> np.ndarray:
        self.settle()
        off = np.zeros(self.link._count)
        text = dict(self.transport.published)  # the newest of each topic
        armed = text.get("/rov/arm", msg.Bool(False)).data
        return np.array(text["/rov/cmd_thrusters"].data) if armed else off
