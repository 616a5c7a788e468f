"""MavlinkLink: a vehicle with ArduSub behind `core.link.Link`, flown by the axes of MANUAL_CONTROL."""

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import LinkError, LinkTimeout
from rovtwin.core.flow import Command, Measurement
from rovtwin.core.link import COMMAND_LIFE, Link
from rovtwin.links.clock import speed_of
from rovtwin.links.mavlink.driver.boot_clock import BootClock, Order
from rovtwin.links.mavlink.driver.line import Line
from rovtwin.links.mavlink.driver.readings import Readings
from rovtwin.links.mavlink.driver.steering import GAIN, THROTTLE, Steering
from rovtwin.links.mavlink.mixing import clean_axes
from rovtwin.links.mavlink.modes import MANUAL
from rovtwin.links.mavlink.wire import dialect, text_of

logger = logging.getLogger(__name__)

SEND_EVERY = 0.04  # MANUAL_CONTROL, as ground stations send it [s]
HEARTBEAT = 1.0  # [s]
BACKLOG = 20_000  # readings that nobody fetches are dropped beyond this, the oldest first
ASK_AGAIN = 10.0  # for the rates [s]
AGAIN = 0.25  # a command that is not acknowledged is sent again [s]
ARMING = 8.0  # longest time for arming in all [s]; the link's host waits 10 s
DISARMING = 10.0  # for so long disarming is repeated while the vehicle does not say that it is disarmed [s]
DISARMING_LEAST = 1.5  # a heartbeat that comes sooner may be of before arming; there is one a second [s]
LOST_AFTER = 3.0  # silence of the autopilot after which the link is lost for good [s]
STALE_MODE = 3.0  # the vehicle's mode is what its last heartbeat said; older than this it is not known [s]
ARMED_FLAG, CUSTOM_MODE = 128, 1
GROUND_STATION, INVALID = 6, 8  # MAV_TYPE_GCS, MAV_AUTOPILOT_INVALID
SET_INTERVAL, ARM_DISARM, SET_MODE = 511, 400, 176
REQUEST_MESSAGE, REQUEST_CAPABILITIES, VERSION_ID = 512, 520, 148
GAIN_COMES = 1.5  # longest wait for the gain in force, said twice a second [s]
# Hertz that the vehicle is asked for.
RATES = {
    **{"ATTITUDE": 50.0, "RAW_IMU": 50.0, "SCALED_PRESSURE2": 20.0, "LOCAL_POSITION_NED": 10.0},
    **{"GLOBAL_POSITION_INT": 10.0, "VFR_HUD": 10.0, "DISTANCE_SENSOR": 10.0, "SYS_STATUS": 2.0},
}
# The gain in force comes among named values, for which ArduSub knows no interval: they come with this stream.
STREAM_OF_NAMED, NAMED_RATE, NAMED_LATE = 2, 2, 3.0  # MAV_DATA_STREAM_EXTENDED_STATUS, [Hz], [s]

Axes = Callable[[np.ndarray], np.ndarray]


class MavlinkLink(Link):
    """An ArduSub vehicle. It must be armed with `arm` before it moves; `stop` and `close` then disarm it.

    Until it is asked to arm, only heartbeats and requests for telemetry are sent. Silence of the autopilot for 3 s is a
    lost connection: `read` raises LinkTimeout from then on, and the thrusters are off for good.

    Commands u become the six axes of MANUAL_CONTROL in mode MANUAL, where ArduSub's mixing makes pulse widths of them.
    Only what six axes can say arrives: with eight thrusters the nearest to u (see `mixing.Mixer.axes`).

    Args:
        url: In pymavlink's form: `udpin:0.0.0.0:14550`, `udpout:HOST:PORT`, `tcp:HOST:PORT`, `/dev/ttyACM0`.
        axes: u, shape (n,), to surge, sway, heave (down), roll, pitch, yaw, shares of full command, shape (6,): a
            function, as `mixing.shares(thrusters)` gives, or a matrix, shape (6, n).
        clock: Of the readings' times [s]; where it runs faster than real it says so by an attribute `speed`.
        readings: What is made of which message.
        rates: Messages that the vehicle is asked to send [Hz], added to RATES; 0 leaves one as it is.
        system: Our MAVLink system id: the vehicle's SYSID_MYGCS.
        target: The vehicle's system id, or None for the first that sends.
        gain: What full stick is of full thrust (JS_GAIN_DEFAULT); None takes what the vehicle reports.
        throttle_gain: The same up and down (JS_THR_GAIN); None takes what the vehicle reports.
        firmware: Major and minor version of its ArduSub; None takes what the vehicle reports.
        time_limit: For the first heartbeat, and for each answer while arming [s], which takes 8 s at most.
        baud: Of a serial port.

    Raises:
        LinkError: pymavlink is missing, or the port cannot be opened.
        LinkTimeout: No vehicle sends.
    """

    def __init__(
        self,
        url: str,
        axes: Axes | np.ndarray,
        *,
        clock: Callable[[], float] = time.monotonic,
        readings: Readings | None = None,
        rates: Mapping[str, float] | None = None,
        system: int = 255,
        target: int | None = None,
        gain: float | None = None,
        throttle_gain: float | None = None,
        firmware: tuple[int, int] | None = None,
        time_limit: float = 5.0,
        baud: int = 115200,
    ):
        matrix = None if callable(axes) else np.asarray(axes, dtype=float)
        self._axes: Axes = axes if callable(axes) else lambda u: matrix @ u
        self._clock, self._readings = clock, readings or Readings()
        self._rates = RATES | dict(rates or {})
        self._dialect = dialect()
        self._time_limit, self._steering = time_limit, Steering(gain, throttle_gain, firmware)
        self._queue: deque[Measurement] = deque(maxlen=BACKLOG)
        self._boot, self._order = BootClock(speed_of(clock)), Order(speed_of(clock))
        self._lock = threading.Lock()
        self._news = threading.Condition()
        self._target = target
        self._mode, self._vehicle_armed, self._mode_at = -1, False, -math.inf
        self._acks: dict[int, int] = {}
        self._texts: deque[str] = deque(maxlen=8)
        self._neutral: np.ndarray = np.zeros(6)
        self._setpoint, self._setpoint_at = self._neutral, -math.inf
        self._stopped = self._closed = False
        self._asked = False  # whether it was asked to arm and not let go since: only then it is ours to steer
        self._received_at = self._named_at = -math.inf
        self._error: LinkError | None = None
        self._disarm_since, self._disarm_until, self._wake = -math.inf, -math.inf, threading.Event()
        self._line = Line(url, baud, system, 190, self._on_message)  # 190: MAV_COMP_ID_MISSIONPLANNER
        self._line.start()
        self._sender = threading.Thread(target=self._send_on, name="mavlink steers", daemon=True)
        self._sender.start()
        try:
            self._await_vehicle(url)
        except BaseException:
            self.close()
            raise

    @property
    def age(self) -> float:
        """Since anything came from the autopilot [real s]; infinite for a link that is lost or closed."""
        lost = self._closed or self._error is not None or bool(self._line.failure)
        return math.inf if lost else max(0.0, time.monotonic() - self._received_at)

    @property
    def armed(self) -> bool:
        """Whether the vehicle says that it is armed."""
        return self._vehicle_armed

    @property
    def gain(self) -> float | None:
        """Share of full thrust that full stick gives, or None while it is not known."""
        return self._steering.gain

    @property
    def firmware(self) -> tuple[int, int] | None:
        """Major and minor version of the vehicle's ArduSub, or None while it is not known."""
        return self._steering.firmware

    def arm(self) -> None:
        """Set mode MANUAL and arm; returns when the vehicle says that it is so, after 8 s at most.

        Whoever calls `stop` meanwhile ends it at once. Where it fails after the vehicle was asked, it disarms.

        Raises:
            LinkError: The vehicle refuses, or the link is stopped.
            LinkTimeout: It does not answer.
        """
        end = time.monotonic() + ARMING
        self._check_usable()
        self._learn_sticks(end)
        self._command(SET_MODE, "mode MANUAL", end, CUSTOM_MODE, MANUAL.number)
        self._until(lambda: self._mode == MANUAL.number, "it is in mode MANUAL", end)
        with self._lock:
            self._asked = not self._stopped
            self._disarm_until = -math.inf  # of an attempt before
        try:
            self._command(ARM_DISARM, "arming", end, 1.0)
            self._until(lambda: self._vehicle_armed, "it is armed", end)
            self._check_usable()
        except BaseException:
            self._let_go()
            raise

    def read(self) -> list[Measurement]:
        """Readings since the last call.

        Raises:
            LinkTimeout: The autopilot has been silent for 3 s.
            LinkError: The line is of no use any more.
        """
        if self._closed:
            return []
        self._check_line()
        if self._error is not None and not (self._line.failure and self._queue):
            raise self._error
        return [self._queue.popleft() for _ in range(len(self._queue))]

    def send(self, command: Command) -> None:
        u = np.array(command.u, dtype=float)
        if not np.all(np.isfinite(u)):
            self.stop()
        with self._lock:
            if self._stopped:
                return
            self._setpoint, self._setpoint_at = clean_axes(self._axes(np.clip(u, -1.0, 1.0))), time.monotonic()
        self._wake.set()

    def stop(self) -> None:
        with self._lock:
            if not self._stopped:
                self._stopped, self._setpoint = True, self._neutral
                if self._asked:
                    self._begin_disarming()
        self._wake.set()
        with self._news:  # whoever is arming gives up
            self._news.notify_all()

    def close(self) -> None:
        self.stop()
        if self._closed:
            return
        if self._asked or time.monotonic() < self._disarm_until:
            # A last word whatever the sender's thread does: neutral and disarm, three times for a line that loses some.
            for _ in range(3):
                self._send_sticks(self._neutral)
                self._send_disarm()
        self._closed = True
        self._wake.set()
        self._sender.join(1.0)
        self._line.close()
        self._queue.clear()

    def _let_go(self) -> None:
        """Arming failed: disarm, for it may yet be obeyed, and leave the vehicle to its pilot."""
        with self._lock:
            if self._asked:
                self._send_sticks(self._neutral)
                self._begin_disarming()
            self._asked = False
        self._wake.set()

    def _begin_disarming(self) -> None:
        self._disarm_since = time.monotonic()
        self._disarm_until = self._disarm_since + DISARMING

    def _check_line(self) -> None:
        """Gives the link up, thrusters off, where the line failed or the autopilot fell silent."""
        if self._error is not None:
            return
        if self._line.failure:
            fix = "Check the tether and open the link anew"
            self._error = LinkError(f"mavlink: {self._line.url}: {self._line.failure}. {fix}")
        # The first heartbeat has a time limit of its own.
        elif math.isfinite(self._received_at) and time.monotonic() - self._received_at > LOST_AFTER:
            self._error = LinkTimeout(
                f"mavlink: {self._line.url}: the autopilot was silent for {LOST_AFTER:g} s, expected a heartbeat a "
                "second. Thrusters are off. Check the tether and open the link anew"
            )
        if self._error is not None:
            self.stop()

    def _check_usable(self) -> None:
        """Raises LinkError where the link is stopped or lost."""
        self._check_line()
        if self._error is not None:
            raise self._error
        if self._stopped:
            raise LinkError(f"mavlink: {self._line.url}: stopped: open the link anew before arming")

    # --- sending

    def _send_on(self) -> None:
        heartbeat_at = disarm_at = -math.inf
        asked_at = time.monotonic()
        while not self._closed:
            now = time.monotonic()
            if now - heartbeat_at >= HEARTBEAT:
                heartbeat_at = now
                self._line.send(self._dialect.MAVLink_heartbeat_message(GROUND_STATION, INVALID, 0, 0, 4, 3))
            self._check_line()
            if self._asked:
                self._send_sticks(self._live(now))
            if now < self._disarm_until and now - disarm_at >= AGAIN:
                disarm_at = now
                self._send_disarm()
            if now - asked_at >= ASK_AGAIN:  # a request may get lost, and a vehicle boots anew
                asked_at = now
                self._ask_for_rates()
            self._wake.wait(SEND_EVERY)
            self._wake.clear()

    def _live(self, now: float) -> Float[np.ndarray, "6"]:
        """Axes of the newest command, neutral where it is too old or would mean something else."""
        with self._lock:
            aged = now - self._setpoint_at > COMMAND_LIFE
            # In other modes sticks are rates: whoever changed the mode has the vehicle now.
            elsewhere = self._mode != MANUAL.number or now - self._mode_at > STALE_MODE
            return self._neutral if self._stopped or aged or elsewhere else self._setpoint

    def _send_sticks(self, axes: Float[np.ndarray, "6"]) -> None:
        if self._target is None:
            return
        s = self._steering.sticks(axes)
        message = self._dialect.MAVLink_manual_control_message
        self._line.send(message(self._target, s.x, s.y, s.z, s.r, 0, 0, s.enabled_extensions, s.s, s.t))

    def _send_disarm(self) -> None:
        self._send_command(ARM_DISARM, 0.0)

    def _send_command(self, command: int, *values: float) -> None:
        if self._target is not None:
            padded = [*values, *[0.0] * (7 - len(values))]
            self._line.send(self._dialect.MAVLink_command_long_message(self._target, 1, command, 0, *padded))

    # --- asking

    def _await_vehicle(self, url: str) -> None:
        if not self._wait(lambda: self._mode_at > 0.0, self._time_limit):
            raise LinkTimeout(
                f"mavlink: {url}: no heartbeat of a vehicle in {self._time_limit:g} s. Expected one a second: is the "
                "vehicle on, and does it (or BlueOS) send to this address and port?"
            )
        self._ask_for_rates()

    def _ask_for_rates(self) -> None:
        # The stream first: it would take the place of intervals. Once the gain comes it is not asked for again.
        if self._target is not None and time.monotonic() - self._named_at > NAMED_LATE:
            stream = self._dialect.MAVLink_request_data_stream_message
            self._line.send(stream(self._target, 1, STREAM_OF_NAMED, NAMED_RATE, 1))
        ids = {found.msgname: identity for identity, found in self._dialect.mavlink_map.items()}
        for name, rate in self._rates.items():
            if rate > 0.0:
                self._send_command(SET_INTERVAL, float(ids[name]), 1e6 / rate)

    def _learn_sticks(self, end: float) -> None:
        """What the vehicle makes of sticks; what they cannot ask of it is logged.

        The gain in force comes by itself; where it does not in time, the one that the vehicle starts with is taken.
        """
        limit = min(end, time.monotonic() + self._time_limit)
        read = self._dialect.MAVLink_param_request_read_message
        while self._steering.unknown and time.monotonic() < limit:
            self._check_usable()
            for name in (THROTTLE, GAIN):
                self._line.send(read(self._target, 1, name.encode(), -1))
            self._send_command(REQUEST_MESSAGE, float(VERSION_ID))
            self._send_command(REQUEST_CAPABILITIES, 1.0)  # how versions before 4 are asked
            self._wait(lambda: not self._steering.unknown, min(AGAIN, max(0.0, limit - time.monotonic())))
        self._wait(lambda: self._steering.in_force, min(GAIN_COMES, max(0.0, end - time.monotonic())))
        self._check_usable()
        if self._steering.unknown:
            raise LinkTimeout(f"mavlink: {self._line.url}: {self._steering.unknown}")
        self.limits, self.reach = tuple(self._steering.limits()), self._steering.reach
        for limit_of_sticks in self.limits:
            logger.warning("mavlink: %s: %s", self._line.url, limit_of_sticks)

    def _command(self, command: int, what: str, end: float, *values: float) -> None:
        self._acks.pop(command, None)
        self._texts.clear()
        began = time.monotonic()
        end = min(end, began + self._time_limit)
        while command not in self._acks and (now := time.monotonic()) < end:
            self._check_usable()
            self._send_command(command, *values)
            self._wait(lambda: command in self._acks, min(AGAIN, end - now))
        self._check_usable()
        result = self._acks.get(command)
        if result is None:
            raise LinkTimeout(f"mavlink: {self._line.url}: {what}: no answer in {time.monotonic() - began:.1f} s")
        if result != 0:
            reasons = "; ".join(self._texts) or "it does not say why"
            raise LinkError(f"mavlink: {self._line.url}: {what}: refused (MAV_RESULT {result}): {reasons}")

    def _until(self, done: Callable[[], bool], what: str, end: float) -> None:
        limit = max(0.0, min(self._time_limit, end - time.monotonic()))
        if not self._wait(done, limit):
            self._check_usable()
            raise LinkTimeout(f"mavlink: {self._line.url}: waited {limit:.1f} s until {what}")

    def _wait(self, done: Callable[[], bool], limit: float) -> bool:
        with self._news:
            over = self._news.wait_for(lambda: done() or self._stopped or bool(self._line.failure), limit)
            return over and done()

    # --- listening

    def _on_message(self, message: Any) -> None:
        arrival = self._clock()
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self._heartbeat(message)
        if message.get_srcSystem() != self._target:
            return
        if message.get_srcComponent() == 1:  # the autopilot's; others of the vehicle may outlive it
            self._received_at = time.monotonic()
        if kind == "COMMAND_ACK":
            self._acks[message.command] = message.result
        elif kind == "STATUSTEXT":
            self._texts.append(text_of(message.text))
        elif message.get_srcComponent() == 1:
            self._named_at = time.monotonic() if kind == "NAMED_VALUE_FLOAT" else self._named_at
            if news := self._steering.take(kind, message):
                logger.warning("mavlink: %s: %s", self._line.url, news)
        for sensor, values, boot in self._readings.of(message, arrival):
            t = arrival if boot is None else self._boot.host_time(boot, arrival)
            if self._order.forward(sensor, t, arrival):
                self._queue.append(Measurement(sensor, np.array(values, dtype=float), t))
        with self._news:
            self._news.notify_all()

    def _heartbeat(self, message: Any) -> None:
        vehicle = message.autopilot != INVALID and message.type != GROUND_STATION and message.get_srcComponent() == 1
        if self._target is None and vehicle:
            self._target = message.get_srcSystem()
        if vehicle and message.get_srcSystem() == self._target:
            self._mode, self._vehicle_armed = message.custom_mode, bool(message.base_mode & ARMED_FLAG)
            self._mode_at = time.monotonic()
            if not self._vehicle_armed and time.monotonic() - self._disarm_since > DISARMING_LEAST:
                self._disarm_until = -math.inf
