"""The twin as a ROS 2 vehicle: readings as standard messages, wrench and way-points from any node."""

import asyncio
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from rovtwin.core.errors import LinkError
from rovtwin.links.ros2 import convert, listen
from rovtwin.links.ros2 import messages as msg
from rovtwin.links.ros2.middleware import Middleware, open_transport
from rovtwin.links.ros2.pilot import Pilot
from rovtwin.links.ros2.speak import Speaker
from rovtwin.links.ros2.transport import Transport
from rovtwin.links.servers.served_vehicle import ServedVehicle
from rovtwin.links.servers.server import Server

COMMAND_RATE = 20.0  # repeated a second (real time)
# `arm` is received first: a client that sends everything at once means it so.
TOPICS_IN: dict[str, type] = {"arm": msg.Bool, "cmd_wrench": msg.WrenchStamped, "cmd_pose": msg.PoseStamped}
# Cyclone, kept on this machine, is not found by nodes of Fast DDS that look for others on the network.
_WHERE = {
    True: "on the network: who reaches it can steer",
    False: "on this machine only. In your terminals: export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST "
    "(Humble: ROS_LOCALHOST_ONLY=1)",
}


@dataclass
class Ros2Server(Server):
    """The vehicle of a station as a node of ROS 2. Topics are below `namespace`, and `<drone>/` where it has several.

    Out: `odometry`, `imu`, `pressure`, `battery`, `mocap`, `position`, `dvl`, `altimeter`, `leak`, `thrusters`, and
    `/tf`, `/clock`. In: `arm` (std_msgs/Bool), `cmd_wrench` (geometry_msgs/WrenchStamped, base_link), `cmd_pose`
    (geometry_msgs/PoseStamped, map or odom). There is no camera: a station has none.

    Attributes:
        namespace: Of the topics.
        largest: Force or moment that counts as 1 in a command: surge, sway, heave [N], roll, pitch, yaw [N m]; 0
            where the vehicle can do nothing.
        domain: Of ROS 2, 0 to 232; by default `ROS_DOMAIN_ID`, else 0.
        expose: Whether other machines take part.
        sim_time: Whether stamps are the vehicle's time and `/clock` tells it; otherwise they are of the host's clock.
        life: How long a wrench, a way-point or `arm` counts (real time) [s].
        water: How depth becomes pressure.
        std: Standard deviations of sensors by name, for covariances; those left out are unknown (zeros).
        voltage: Of the battery [V]; without it no current is reported.
        frame_prefix: Before `map`, `odom` and `base_link`, where several vehicles share `/tf`.
        tf: Whether `/tf` is published.
        middleware: See `open_transport`.
    """

    namespace: str = "rov"
    largest: tuple[float, ...] = (100.0, 100.0, 100.0, 20.0, 20.0, 20.0)
    domain: int | None = None
    expose: bool = False
    sim_time: bool = True
    life: float = 0.5
    water: convert.Water = convert.Water()
    std: dict[str, Sequence[float]] = field(default_factory=dict)
    voltage: float | None = None
    frame_prefix: str = ""
    tf: bool = True
    middleware: Middleware = "auto"

    def __post_init__(self) -> None:
        check_namespace(self.namespace)
        if len(self.largest) != 6 or not all(0 <= x < 1e9 for x in self.largest):
            raise LinkError(f"largest: found {self.largest}, expected six forces and moments of at least 0 [N, N m]")

    @property
    def addresses(self) -> list[str]:
        """All, if exposed: ROS 2 chooses ports by domain and finds others by multicast."""
        return ["0.0.0.0" if self.expose else "127.0.0.1"]

    async def run(self, station: ServedVehicle) -> None:
        convert.prepare()
        name = "_".join(["rovtwin", *self.namespace.strip("/").split("/")])
        transport = open_transport(name, self.domain, self.expose, self.middleware)
        try:
            await _Serving(self, station, transport).run()
        finally:
            # Leaving the network takes some 10 ms, and waits for threads: not in the loop of the other servers.
            closing = threading.Thread(target=transport.close, name="ros2 close", daemon=True)
            closing.start()
            with suppress(asyncio.CancelledError):
                while closing.is_alive():
                    await asyncio.sleep(0.01)


def check_namespace(namespace: str) -> str:
    """The namespace with one slash before it, `/rov`.

    Raises:
        LinkError: It is none in ROS 2.
    """
    words = namespace.strip("/").split("/")
    if not all(word.isascii() and word.isidentifier() for word in words):
        raise LinkError(
            f"namespace {namespace!r}: expected letters, digits and _ between slashes, each part starting with a "
            "letter, such as 'rov' or 'fleet/rov_1'"
        )
    return "/" + "/".join(words)


class _Serving:
    """A server that runs: from the station's readings to topics, and from topics to commands."""

    def __init__(self, server: Ros2Server, station: ServedVehicle, transport: Transport):
        self.server, self.station, self.transport = server, station, transport
        self.root = check_namespace(server.namespace)
        self.pilots = {drone: Pilot(drone, server.life) for drone in station.drones}
        self._lock = threading.Lock()
        self._received: dict[tuple[str, str], tuple[Any, float]] = {}  # the newest by drone and topic
        self._disarmed: set[str] = set()  # drones whose client sent so since the last command
        self.refused = 0
        self.speaker = Speaker(server, self.root, transport.publish, station.say)
        self._reported: set[str] = set()

    async def run(self) -> None:
        for drone in self.station.drones:
            base = f"{self.root}/{drone}" if drone else self.root
            for topic, kind in TOPICS_IN.items():
                # A wrench is a stream; `arm` and a way-point may be said once, so they must not be lost.
                stream = topic == "cmd_wrench"
                self.transport.subscribe(f"{base}/{topic}", kind, partial(self._receive, drone, topic), stream)
        self.station.say(f"ROS 2: topics below {self.root}, {_WHERE[self.server.expose]}")
        tasks = [asyncio.create_task(task) for task in (self._publish(), self._steer())]
        try:
            await asyncio.gather(*tasks)
        finally:
            for task in tasks:
                task.cancel()
            for pilot in self.pilots.values():
                if (last := pilot.end()) is not None:
                    self.station.command(last)

    def _receive(self, drone: str, topic: str, message: Any) -> None:
        """In a thread of the transport: only keep it. However many come, one a topic waits; no `false` gets lost."""
        with self._lock:
            self._received[drone, topic] = message, time.monotonic()
            if topic == "arm" and not message.data:
                self._disarmed.add(drone)

    def _take(self) -> list[tuple[str, str, Any, float]]:
        with self._lock:
            received, disarmed = self._received, self._disarmed
            self._received, self._disarmed = {}, set()
        found = [(drone, "arm", msg.Bool(False), time.monotonic()) for drone in disarmed]
        return found + [
            (drone, t, *received[drone, t]) for t in TOPICS_IN for drone in self.pilots if (drone, t) in received
        ]

    async def _publish(self) -> None:
        async for readings in self.station.readings():
            self.speaker.speak(self.station.now, self.station.speed, readings)

    async def _steer(self) -> None:
        while True:
            armed = self._armed()
            for received in self._take():
                self._obey(*received)
            asked = self._armed()
            for pilot in self.pilots.values():
                if (command := pilot.command(time.monotonic())) is not None:
                    self.station.command(command)
            self._tell(asked - armed, "armed")
            self._tell(armed - asked, "disarmed")
            self._tell(asked - self._armed(), "its client is silent: disarmed")
            await asyncio.sleep(1.0 / COMMAND_RATE)

    def _armed(self) -> set[str]:
        """Names of the drones that are armed."""
        return {drone for drone, pilot in self.pilots.items() if pilot.armed}

    def _tell(self, drones: set[str], what: str) -> None:
        for drone in sorted(drones):
            self.station.say(f"ROS 2 {drone}: {what}".replace(" :", ":"))

    def _obey(self, drone: str, topic: str, message: Any, at: float) -> None:
        pilot = self.pilots[drone]
        try:
            if topic == "arm":
                pilot.receive_arm(at, bool(message.data))
                return
            self._check_stamp(message.header.stamp)
            frames = [self.server.frame_prefix + name for name in (convert.MAP, convert.ODOM, convert.BASE)]
            if topic == "cmd_wrench":
                motion = listen.guarded(listen.wrench, message, frames[2], self.server.largest)
                counts = pilot.receive_motion(at, motion)
            else:
                counts = pilot.receive_target(at, listen.guarded(listen.target, message, frames[:2]))
            if not counts:
                self._say_once(topic, "ignored: say `true` on `arm` first, and give no wrench beside way-points")
        except LinkError as error:
            self.refused += 1
            self._say_once(topic, f"refused: {error}")

    def _check_stamp(self, stamp: msg.Time) -> None:
        """What was sent long ago, or by another clock, moves nothing; a stamp of zero means now."""
        found = listen.guarded(listen.stamp_of, stamp)
        now = self.station.now if self.server.sim_time else time.time()
        tolerance = self.server.life * (max(1.0, self.station.speed) if self.server.sim_time else 1.0)
        if found is not None and not listen.is_near(found, now, tolerance):
            fix = "set use_sim_time on your node" if self.server.sim_time else "synchronise the clocks"
            raise LinkError(f"stamp {found:.3f} s, now is {now:.3f} s: {fix}, or leave the stamp at zero")

    def _say_once(self, topic: str, what: str) -> None:
        # Once a topic and kind: a client that repeats a mistake must not fill the screen.
        if (key := f"{topic} {what[:20]}") not in self._reported:
            self._reported.add(key)
            self.station.say(f"ROS 2: {topic} {what}")
