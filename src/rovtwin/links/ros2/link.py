"""A ROS 2 vehicle behind a Link: readings from its topics, thruster commands or a wrench to it."""

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Command, Measurement
from rovtwin.core.link import Link
from rovtwin.links.ros2 import convert, listen
from rovtwin.links.ros2 import messages as msg
from rovtwin.links.ros2.server import check_namespace
from rovtwin.links.ros2.transport import Middleware, Transport, open_transport

COMMAND_LIFE = 0.3  # a command older than this counts as thrusters off [s]
REPEAT = 0.05  # commands go out again after this [s]
FAREWELL = 0.5  # for so long after stop or an expired command, thrusters off is repeated [s]
BACKLOG = 10_000  # readings that wait for `read`; the oldest are lost beyond
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
# sensor -> topic it is heard on
SOURCES = {
    **{"position": "odometry", "dvl": "odometry", "attitude": "imu", "gyro": "imu", "accelerometer": "imu"},
    **{"pressure": "pressure", "altimeter": "altimeter", "battery": "battery", "leak": "leak"},
}


class Ros2Link(Link):
    """A vehicle that speaks ROS 2.

    What it sends: `arm` (std_msgs/Bool), `cmd_thrusters` (std_msgs/Float64MultiArray: u, -1 to 1) and, with `wrench`,
    `cmd_wrench` (geometry_msgs/WrenchStamped in base_link); at 20 Hz while the last command is younger than 0.3 s. On
    `stop`, `close` and an expired command: `arm: false` and zeros, for half a second. The vehicle must by itself stop
    when it hears nothing any more.

    Args:
        namespace: Of the vehicle's topics, `rov` for `/rov/imu`.
        thrusters: Number of thrusters.
        clock: Times of readings are on it [s]. With `use_sim_time` it may be None: times are simulated time itself
            (`sim_time`), as a host needs it that flies a twin faster than real.
        wrench: tau [N, N m], b, shape (6,), of commands u, shape (n,), for a vehicle that takes forces.
        sources: Topic on which each sensor is heard; an empty name mutes it. By default position and dvl come from
            `odometry`; where the vehicle has them as topics of their own: `{"position": "position", "dvl": "dvl"}`.
        names: Other names for topics, such as `{"imu": "imu/data"}`; with a slash in front from the root.
        use_sim_time: Whether stamps are of `/clock`; otherwise of the host's clock.
        tolerance: By how much a stamp may be off now before the message is refused [s]. Stamps of zero mean now.
        water: How pressure becomes depth.
        domain, expose, middleware: See `open_transport`. A vehicle on another machine needs `expose`.
        transport: To use in place of a new one.
        stamp_clock: The host's clock that stamps are of without `use_sim_time`.

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
        use_sim_time: bool = False,
        tolerance: float = 1.0,
        water: convert.Water = convert.Water(),
        domain: int | None = None,
        expose: bool = False,
        middleware: Middleware = "auto",
        transport: Transport | None = None,
        stamp_clock: Callable[[], float] = time.time,
    ):
        convert.prepare()
        self._root, self._names = check_namespace(namespace), dict(names or {})
        self._sources = _checked({**SOURCES, **(sources or {})})
        if clock is None and not use_sim_time:
            raise LinkError("clock: found None, expected a clock; only with use_sim_time there is another, /clock")
        self._sim_time: float | None = None
        self._clock = clock or self.sim_time
        self._age_clock = clock or time.monotonic  # that commands age by
        self._stamp_clock, self._tolerance, self._water = stamp_clock, tolerance, water
        self._use_sim_time, self._wrench, self._count = use_sim_time, wrench, thrusters
        self._offset = None if clock else 0.0  # from stamps to our clock
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

    def read(self) -> list[Measurement]:
        with self._lock:
            found = [] if self._closed else list(self._readings)
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
                self._quiet_at = time.monotonic() + FAREWELL
                self._wake.notify_all()

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
        if self._use_sim_time:
            self._transport.subscribe(CLOCK, msg.Clock, self._hear_clock)
        for topic in sorted(set(self._sources.values()) - {""}):
            wanted = {sensor for sensor, source in self._sources.items() if source == topic}
            self._transport.subscribe(self._name(topic), TOPICS[topic][0], partial(self._hear, topic, wanted))

    def _name(self, topic: str) -> str:
        name = self._names.get(topic, topic)
        return name if name.startswith("/") else f"{self._root}/{name}"

    def _hear_clock(self, message: msg.Clock) -> None:
        try:
            found = listen.guarded(listen.stamp_of, message.clock)
        except LinkError as error:
            self._refuse("clock", error)
            return
        now = self._sim_time = found or 0.0
        self._align(self._clock() - now)

    def _align(self, offset: float) -> float:
        """The difference of the clocks. It is kept while it holds, so that times come as evenly as stamps do."""
        with self._lock:
            if self._offset is None or abs(offset - self._offset) > (10 * ANCHOR if self._use_sim_time else ANCHOR):
                self._offset = offset
            return self._offset

    def _hear(self, topic: str, wanted: set[str], message: Any) -> None:
        """In a thread of the transport."""
        read = TOPICS[topic][1]
        try:
            t = self._time(message)
            found = listen.guarded(read, message, *([self._water] if topic == "pressure" else []))
        except LinkError as error:
            self._refuse(topic, error)
            return
        with self._lock:
            for sensor in wanted & found.keys():
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
        if not self._use_sim_time:
            self._align(now - self._stamp_clock())
        if self._offset is None or (self._use_sim_time and self._sim_time is None):
            raise LinkError("nothing on /clock yet, and stamps are of simulated time (use_sim_time)")
        t = stamp + self._offset
        if not listen.is_near(t, now, self._tolerance):
            fix = "does it use simulated time?" if not self._use_sim_time else "does it use the host's time?"
            raise LinkError(
                f"a stamp {t - now:+.3f} s from now, expected within {self._tolerance} s: {fix} If not, synchronise "
                "the clocks of both machines (chrony)"
            )
        return t

    def _refuse(self, topic: str, error: LinkError) -> None:
        with self._lock:
            self.refused[topic] = self.refused.get(topic, 0) + 1
            self.problems[topic] = f"{self._name(topic)}: {error}"

    # ------------------------------------------------------------------------------------------------------ sending

    def _work(self) -> None:
        """The thread that publishes: `send` and `stop` only leave a note."""
        armed = closed = spoke = False
        while not closed:
            with self._wake:
                stopped, closed, u = self._stopped, self._closed, self._u
                live = not stopped and self._age_clock() - self._sent <= COMMAND_LIFE
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

    def _command(self, armed: bool, u: np.ndarray) -> None:
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
