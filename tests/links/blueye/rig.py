"""A Blueye link for the contract test: its clock and timer are the test's, the wire and the SDK are real."""

import os
from contextlib import ExitStack
from unittest.mock import patch

import blueye.protocol as bp
import numpy as np
from tests.links.blueye.vehicle import wait_for_farewells
from tests.links.serving import serving, wait_for

from rovtwin.core.flow import Measurement
from rovtwin.links.blueye.double import DoubleBlueyeLink
from rovtwin.links.blueye.link import BlueyeLink
from rovtwin.links.blueye.server import BlueyeServer

HOSTS, HTTP = ("127.0.0.16", "127.0.0.17"), 8780
SLOW = 5  # every so many periods there is an altitude


class BlueyeRig:
    def __init__(self, double: bool, period: float):
        self.now, self._period, self._k, self._mark = 0.0, period, 0, 0.0
        self._drones = ("port", "starboard") if double else ("",)
        self._end = ExitStack()
        hosts = HOSTS[: len(self._drones)]
        # The watchdog is real time's, and so long that a slow machine does not meet it.
        server = BlueyeServer(hosts=hosts, http_port=HTTP, watchdog_s=30.0)
        self._end.enter_context(patch.dict(os.environ, {"http_proxy": f"http://{hosts[0]}:{HTTP}"}))
        self._served = self._end.enter_context(serving(server, drones=self._drones))
        self._end.callback(wait_for_farewells)
        try:
            self._connect(double, hosts)
        except BaseException:
            self._end.close()  # or the next rig finds its ports taken
            raise

    def _connect(self, double: bool, hosts: tuple[str, ...]) -> None:
        assert wait_for(lambda: self._served.messages, 20.0)
        # Messages of states would come once within the test, which looks for gaps.
        rates = {"ErrorFlagsTel": 0.0, "AltitudeTel": 100.0}
        options = {"clock": lambda: self.now, "timer": lambda: self.now, "rates": rates, "timeout": 20.0}
        self.link = DoubleBlueyeLink(hosts, **options) if double else BlueyeLink(hosts[0], **options)
        self.link.arm()
        self._links = self.link._links if isinstance(self.link, DoubleBlueyeLink) else (self.link,)
        self._received, self._sent = [0] * len(self._links), [0] * len(self._links)
        for i in range(len(self._links)):
            self._watch(i)

    def _watch(self, i: int) -> None:
        drone = self._links[i]._drone

        def on_message(name: str, payload: bytes) -> None:
            self._received[i] += 1

        drone.telemetry.add_msg_callback([bp.DepthTel, bp.AltitudeTel], on_message, raw=True)
        send = drone.motion.send_thruster_setpoint

        def sent(*share: float) -> None:
            send(*share)
            self._sent[i] += 1

        drone.motion.send_thruster_setpoint = sent

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds / self._period)):
            self._k += 1
            self.now = self._k * self._period
            batch = [Measurement(self._name(d, "pressure"), np.array([2.0 + self.now]), self.now) for d in self._drones]
            if self._k % SLOW == 0:
                batch.append(Measurement("altimeter", np.array([1.0 + self.now]), self.now))
            self._served.feed(self.now, batch)
            expected = self._k + self._k // SLOW
            closed = all(link._closed for link in self._links)
            assert closed or wait_for(lambda count=expected: min(self._received) >= count)

    @staticmethod
    def _name(drone: str, sensor: str) -> str:
        return f"{drone}/{sensor}" if drone else sensor

    def listen(self) -> list[Measurement]:
        return self.link.read()

    def applied(self) -> np.ndarray:
        """What the server wishes once all that was commanded before has come there."""
        before = list(self._sent)
        assert wait_for(lambda: all(now >= then + 2 for now, then in zip(self._sent, before, strict=True)))
        self._mark += 1 / 64  # lights come after the motion on the same line, and tell when it has arrived
        for link in self._links:
            link._drone.set_lights(self._mark)
        found = [self._marked(drone) for drone in self._drones]
        assert all((share == found[0]).all() for share in found), "both drones do the same here"
        return found[0]

    def _marked(self, drone: str) -> np.ndarray:
        def command():
            return next(
                (w for w in reversed(self._served.commands) if w.drone == drone and w.lights == self._mark), None
            )

        assert wait_for(command)
        return np.array(command().motion[:3])

    def close(self) -> None:
        self._end.close()
