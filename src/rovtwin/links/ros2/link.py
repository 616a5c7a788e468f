"""A ROS 2 vehicle behind a Link: readings from its topics, thruster commands or a wrench to it."""

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import LinkError, LinkTimeout
from rovtwin.core.flow import Command, Measurement
from rovtwin.core.link import COMMAND_LIFE, Link
from rovtwin.links.clock import ClockMap, speed_of
from rovtwin.links.ros2 import convert, listen
from rovtwin.links.ros2 import messages as msg
from rovtwin.links.ros2.middleware import Middleware, open_transport
from rovtwin.links.ros2.server import check_namespace
from rovtwin.links.ros2.transport import Transport

REPEAT = 0.05  # commands go out again after this [s]
FAREWELL = 0.5  # for so long after stop or an expired command, thrusters off is repeated [s]
BACKLOG = 10_000  # readings that wait for `read`; the oldest are lost beyond
LOST_AFTER, FIRST = 3.0, 10.0  # silence after which the link is lost for good, and that before the first message [s]
WINDOW = 10.0  # the shortest delay of /clock of so many seconds counts [s]
ANCHOR = 0.005  # by so much two clocks may drift before their difference is taken anew [s]
ARM, WRENCH, THRUSTERS, CLOCK = "arm", "cmd_wrench", "cmd_thrusters", "/clock"

# topic -> (type, what its messages say)
TOPICS: dict[str, tuple[type, Callable[..., listen.Readings]]] = {
    "imu": (msg.Imu, listen.imu),
    "pressure": (msg.FluidPressure, listen.pressure),
    "odometry": (msg.Odometry, listen.odometry),
    "mocap": (msg.PoseStamped, listen.mocap),
    "position": (msg.PoseWithCovarianceStamped, listen.position),
    "dvl": (msg.TwistWithCovarianceStamped, listen.velocity),
    "altimeter": (msg.PointStamped, listen.altimeter),
    "battery": (msg.BatteryState, listen.battery),
    "leak": (msg.Bool, listen.leak),
}
# sensor -> topic that it comes on
SOURCES = {
    **{"position": "odometry", "dvl": "odometry", "attitude": "imu", "gyro": "imu", "accelerometer": "imu"},
    **{"pressure": "pressure", "altimeter": "altimeter", "battery": "battery", "leak": "leak"},
}


class Ros2Link(Link):
    """A vehicle that speaks ROS 2.

    It sends nothing until `arm`. From then on it sends `arm` (std_msgs/Bool), `cmd_thrusters`
    (std_msgs/Float64MultiArray: u, -1 to 1) and, with `wrench`, `cmd_wrench` (geometry_msgs/WrenchStamped in
    base_link), at 20 Hz while the last command is younger than 0.3 s. On `stop`, `close` and an expired command:
    `arm: false` and zeros, for half a second. The vehicle must by itself stop when it hears nothing any more.

    Silence of the vehicle for 3 s (10 s before its first message) is a lost connection: `read` raises LinkTimeout from
    then on, and the thrusters are off for good.

    Args:
        namespace: Of the vehicle's topics, `rov` for `/rov/imu`.
        thrusters: Number of thrusters.
        clock: Times of readings are on it [s]. Where it runs faster than real it says so by an attribute `speed`. With
            `use_sim_time=True` it may be None: times are then simulated time itself (`sim_time`).
        wrench: tau [N, N m], b, shape (6,), of commands u, shape (n,), for a vehicle that takes forces.
        sources: Topic on which each sensor comes; an empty name mutes it. By default position and dvl come from
            `odometry`; where the vehicle has them as topics of their own: `{"position": "position", "dvl": "dvl"}`.
        names: Other names for topics, such as `{"imu": "imu/data"}`; with a slash in front from the root.
        use_sim_time: Whether stamps are of `/clock`, which is mapped to `clock` by its shortest delay of late; False:
            of the host's clock; None: of whichever of the two they are near, `/clock` first where it is received.
        tolerance: By how much a stamp may be off now before the message is refused [real s]. Stamps of zero mean now.
        water: How pressure becomes depth.
        domain, expose, middleware: See `open_transport`. A vehicle on another machine needs `expose`.
        transport: To use in place of a new one.
        stamp_clock: The host's clock that stamps are of where there is no simulated time.
        timer: Real time, for silence [s].

    Raises:
        LinkError: The namespace or a source is none, or ROS 2 cannot be joined.
    """

    def __init__(
        self,
        namespace: str,
        thrusters: int,
        clock: Callable[[], float] | None = time.monotonic,
        *,
        wrench: Callable[[np.ndarray], np.ndarray] | None = None,
        sources: Mapping[str, str] | None = None,
        names: Mapping[str, str] | None = None,
        use_sim_time: bool | None = None,
        tolerance: float = 1.0,
        water: convert.Water = convert.Water(),
        domain: int | None = None,
        expose: bool = False,
        middleware: Middleware = "auto",
        transport: Transport | None = None,
        stamp_clock: Callable[[], float] = time.time,
        timer: Callable[[], float] = time.monotonic,
    ):
        convert.prepare()
        self._root, self._names = check_namespace(namespace), dict(names or {})
        self._sources = _checked({**SOURCES, **(sources or {})})
        if clock is None and not use_sim_time:
            raise LinkError("clock: found None, expected a clock; only with use_sim_time=True there is another, /clock")
        self._sim_time: float | None = None
        self._clock = clock or self.sim_time
        self._age_clock = clock or time.monotonic  # that commands age by
        self._speed = speed_of(clock) if clock else 1.0
        self._stamp_clock, self._tolerance, self._water = stamp_clock, tolerance * max(1.0, self._speed), water
        self._use_sim_time, self._wrench, self._count = use_sim_time, wrench, thrusters
        self._own_time = clock is None  # simulated time is our clock
        self._map = ClockMap(WINDOW * self._speed, 0.25 * self._speed, self._speed)
        self._anchor = (0.0, math.inf)  # the same instant on the stamps' clock and on ours
        self._timer = timer
        self._error: LinkError | None = None
        self._received_at, self._received_any, self._asked = timer(), False, False
        self._lock = threading.Lock()
        self._wake = threading.Condition(self._lock)
        self._readings: deque[Measurement] = deque(maxlen=BACKLOG)
        self._last: dict[str, float] = {}
        self._u = np.zeros(thrusters)
        self._sent = -np.inf  # when the last command was given, our clock
        self._quiet_at = -np.inf  # until when thrusters off is repeated, steady clock
        self._stopped = self._closed = False
        self._rounds = 0
        self.refused: dict[str, int] = {}
        self.problems: dict[str, str] = {}
        own = transport is None
        self._transport = open_transport("rovtwin_link", domain, expose, middleware) if transport is None else transport
        try:
            self._listen()
        except BaseException:
            if own:
                self._transport.close()
            raise
        self._thread = threading.Thread(target=self._work, name="ros2 link", daemon=True)
        self._thread.start()

    @property
    def age(self) -> float:
        """Since anything came from the vehicle, or the link opened [real s]; infinite if lost or closed."""
        return math.inf if self._closed or self._error else max(0.0, self._timer() - self._received_at)

    def arm(self) -> None:
        """From now on it says `arm: true` with each command.

        Raises:
            LinkError: The link is stopped or lost.
        """
        self._check_alive()
        with self._lock:
            if self._error is not None:
                raise self._error
            if self._stopped:
                raise LinkError(f"ros2: {self._root}: stopped: open the link anew before arming")
            self._asked = True

    def read(self) -> list[Measurement]:
        """Readings since the last call.

        Raises:
            LinkTimeout: The vehicle has been silent for 3 s, or sent nothing within 10 s.
        """
        if self._closed:
            return []
        self._check_alive()
        if self._error is not None:
            raise self._error
        with self._lock:
            found = list(self._readings)
            self._readings.clear()
        return found

    def send(self, command: Command) -> None:
        u = np.array(command.u, dtype=float)
        if u.shape != (self._count,) or not np.isfinite(u).all():
            self.stop()
            return
        with self._wake:
            if not self._stopped:
                self._u, self._sent = np.clip(u, -1.0, 1.0), self._age_clock()
                self._wake.notify_all()

    def stop(self) -> None:
        with self._wake:
            if not self._stopped:
                self._stopped = True
                if self._asked:
                    self._quiet_at = time.monotonic() + FAREWELL
                self._wake.notify_all()

    def _check_alive(self) -> None:
        """Gives the link up, thrusters off, where the vehicle fell silent."""
        limit = LOST_AFTER if self._received_any else FIRST
        if self._error is not None or self._closed or self._timer() - self._received_at <= limit:
            return
        with self._lock:
            problems = "; ".join(self.problems.values())
        why = problems or "Does it publish, is ROS_DOMAIN_ID the same, and does `ros2 topic list` show it?"
        self._error = LinkTimeout(
            f"ros2: {self._root}: nothing usable on its topics for {limit:g} s. Thrusters are off. {why}"
        )
        self.stop()

    def sim_time(self) -> float:
        """The newest time on `/clock` [s]; 0 before the first."""
        return self._sim_time or 0.0

    def close(self) -> None:
        """Stop and leave the network; takes about 0.1 s if it ever sent anything, so that the last words get out."""
        self.stop()
        with self._wake:
            if self._closed:
                return
            self._closed = True
            self._wake.notify_all()
        self._thread.join(2.0)
        self._transport.close()

    # ------------------------------------------------------------------------------------------------------ hearing

    def _listen(self) -> None:
        if self._use_sim_time is not False:
            self._transport.subscribe(CLOCK, msg.Clock, self._receive_clock)
        for topic in sorted(set(self._sources.values()) - {""}):
            sensors = {sensor for sensor, source in self._sources.items() if source == topic}
            self._transport.subscribe(self._name(topic), TOPICS[topic][0], partial(self._receive, topic, sensors))

    def _name(self, topic: str) -> str:
        name = self._names.get(topic, topic)
        return name if name.startswith("/") else f"{self._root}/{name}"

    def _receive_clock(self, message: msg.Clock) -> None:
        try:
            found = listen.guarded(listen.stamp_of, message.clock)
        except LinkError as error:
            self._refuse("clock", error)
            return
        with self._lock:
            now = self._sim_time = found or 0.0
            if not self._own_time:
                self._map(now, self._clock())

    def _receive(self, topic: str, sensors: set[str], message: Any) -> None:
        """In a thread of the transport."""
        read = TOPICS[topic][1]
        try:
            t = self._time(message)
            found = listen.guarded(read, message, *([self._water] if topic == "pressure" else []))
        except LinkError as error:
            self._refuse(topic, error)
            return
        with self._lock:
            self._received_at, self._received_any = self._timer(), True
            for sensor in sensors & found.keys():
                last = self._last.get(sensor, -np.inf)
                # A repeat, or one that was overtaken. Much older: the vehicle began anew, and so do we.
                if last - self._tolerance < t <= last:
                    continue
                self._last[sensor] = t
                self._readings.append(Measurement(sensor, found[sensor], t))

    def _time(self, message: Any) -> float:
        """When a message was valid, on our clock [s].

        Raises:
            LinkError: Its stamp is far from now, or there is no `/clock` yet.
        """
        now = self._clock()
        stamp = listen.guarded(listen.stamp_of, message.header.stamp) if hasattr(message, "header") else None
        if stamp is None:
            return now
        if self._use_sim_time and self._sim_time is None:
            raise LinkError("nothing on /clock yet, and stamps are of simulated time (use_sim_time)")
        found = []
        if self._sim_time is not None:
            with self._lock:
                found.append(stamp + (0.0 if self._own_time else self._map.offset))
            if listen.is_near(found[0], now, self._tolerance):
                return found[0] if self._own_time else min(found[0], now)
        if not self._use_sim_time:
            found.append(self._of_host(stamp, now))
            if listen.is_near(found[-1], now, self._tolerance):
                return min(found[-1], now)
        if self._sim_time is None:
            fix = "does it use simulated time, and publishes no /clock?"
        else:
            fix = "does it use the host's time?" if self._use_sim_time else "of neither /clock nor the host's clock?"
        raise LinkError(
            f"a stamp {found[0] - now:+.3f} s from now, expected within {self._tolerance} s: {fix} If not, synchronise "
            "the clocks of both machines (chrony)"
        )

    def _of_host(self, stamp: float, now: float) -> float:
        """Our time of a stamp of the host's clock [s]. Both are anchored anew only when they drift apart.

        So times come as evenly as stamps do.
        """
        host = self._stamp_clock()
        with self._lock:
            then, ours = self._anchor
            if not abs(ours + (host - then) * self._speed - now) <= ANCHOR * self._speed:
                then, ours = self._anchor = host, now
        return ours + (stamp - then) * self._speed

    def _refuse(self, topic: str, error: LinkError) -> None:
        with self._lock:
            self.refused[topic] = self.refused.get(topic, 0) + 1
            self.problems[topic] = f"{self._name(topic)}: {error}"

    # ------------------------------------------------------------------------------------------------------ sending

    def _work(self) -> None:
        """The thread that publishes: `send` and `stop` only leave a note."""
        armed = closed = spoke = False
        while not closed:
            self._check_alive()
            with self._wake:
                stopped, closed, u = self._stopped, self._closed, self._u
                young = self._age_clock() - self._sent <= COMMAND_LIFE * self._speed
                live = self._asked and young and not stopped
                if armed and not live:
                    self._quiet_at = time.monotonic() + FAREWELL
            try:
                if live:
                    self._command(True, u)
                elif armed or time.monotonic() < self._quiet_at:
                    self._command(False, np.zeros(self._count))
            except LinkError as error:
                self._refuse("commands", error)
            armed, spoke = live, spoke or live
            with self._wake:
                self._rounds += 1
                self._wake.notify_all()
                if not self._closed and (self._stopped, self._u is u) == (stopped, True):
                    self._wake.wait(REPEAT)
        if spoke:
            # Reliable delivery needs a moment in which this end still answers.
            time.sleep(0.1)

    def _command(self, armed: bool, u: Float[np.ndarray, " n"]) -> None:
        self._transport.publish(self._name(ARM), msg.Bool(armed))
        self._transport.publish(self._name(THRUSTERS), convert.numbers(u))
        if self._wrench is not None:
            tau = np.asarray(self._wrench(u), dtype=float) if armed else np.zeros(6)
            force, torque = convert.flu(tau[:3]), convert.flu(tau[3:])
            wrench = msg.Wrench(convert.vector3(force), convert.vector3(torque))
            self._transport.publish(self._name(WRENCH), msg.WrenchStamped(msg.Header(frame_id=convert.BASE), wrench))


def _checked(sources: Mapping[str, str]) -> dict[str, str]:
    """Raises LinkError where a sensor or its topic is unknown."""
    for sensor, topic in sources.items():
        if sensor not in SOURCES or topic not in (*TOPICS, ""):
            raise LinkError(
                f"sources: found {sensor!r}: {topic!r}, expected one of {', '.join(SOURCES)} from one of "
                f"{', '.join(TOPICS)}, or from '' to mute it. Other names of topics go into `names`"
            )
    return dict(sources)
