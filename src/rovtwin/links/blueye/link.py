"""One Blueye drone behind the Link interface, through the vendor's unmodified SDK."""

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from rovtwin.core.errors import LinkError, LinkTimeout
from rovtwin.core.flow import Command, Measurement
from rovtwin.core.link import COMMAND_LIFE, Link
from rovtwin.links.blueye.driver.connect import connect, release, set_rates
from rovtwin.links.blueye.driver.thrust import Curve, linear
from rovtwin.links.blueye.protobuf import parse
from rovtwin.links.blueye.readings import parse_power, parse_telemetry

logger = logging.getLogger(__name__)

AXES = 3  # surge, sway, heave: the pseudo-thrusters of the part blueye_pioneer
REPEAT = 0.05  # motion input is repeated so often: a message may get lost [s]
SDK_WATCHDOG = 1.0  # from then on the SDK feeds the watchdog by itself [s]
LOST_AFTER = 3.0  # silence after which the link is lost for good [s]
PARTING = 0.1  # time that the last zero motion gets to leave [s]
MOST_READINGS = 8192  # kept for one who does not read; about 20 s
ARMING = 5.0  # longest wait for control when arming [s]; what follows takes up to another 2
POSITION = "PositionEstimateTel"
# What an autopilot needs, as fast as the protocol allows where it helps [Hz]; who is in control, within 0.2 s.
# Nothing is switched off: an app beside us may live by it.
RATES = {
    **{"CalibratedImuTel": 100.0, "AttitudeTel": 50.0, "DepthTel": 50.0, "DvlVelocityTel": 20.0, "AltitudeTel": 20.0},
    **{"BatteryTel": 1.0, "BatteryBQ40Z50Tel": 1.0, "ErrorFlagsTel": 2.0},
    **{"ConnectedClientsTel": 5.0, "ControlModeTel": 5.0},
}


class BlueyeLink(Link):
    """A drone of protocol v3, its telemetry as Measurements and its motion input as thrusters surge, sway, heave.

    Readings are `pressure, attitude, gyro, accelerometer, battery, leak, dvl, altimeter`, as far as the drone sends
    them, SI, radians, NED and FRD. The protocol has no time stamps: `t_valid` is when a message arrived.

    Until `arm` it is connected as an observer, whom the drone never lets control, and sends nothing but requests for
    rates of telemetry, which hold for all who listen. `arm` connects as a pilot beside that, and the observer leaves.

    A drone publishes all the time, so silence means a lost connection: `read` returns an empty list for 3 s of it
    (`age` grows), then raises LinkTimeout, for good. Armed, it raises LinkError as soon as another client has taken
    control.
    Either way the thrusters are off from then on.

    Args:
        ip: The drone's address; its ports are fixed.
        drone: What it is called in messages, such as its place in a vehicle of two.
        curve: Thruster commands to shares of the largest forces, see `thrust.force_shares`.
        clock: Time for `t_valid` [s].
        rates: Telemetry by message [Hz], beside or in place of RATES.
        take_control: Send other clients away if one of them is in control when arming.
        observer: Only look: it cannot be armed.
        position: Whether the drone's own estimate of its position becomes readings `position`, 20 Hz. It is dead
            reckoning from the same DVL, which drifts: an autopilot that takes it for measured counts the DVL twice.
        accelerometer_sign: -1 for a drone that reads +1 g along z when level and at rest.
        timeout: Time for connecting [s].
        timer: Time for the life of commands and for silence [s].

    Raises:
        LinkTimeout: There was no answer in time.
        LinkError: blueye.sdk is missing, or no drone answers as agreed.
    """

    def __init__(
        self,
        ip: str,
        *,
        drone: str = "",
        curve: Curve = linear,
        clock: Callable[[], float] = time.monotonic,
        rates: Mapping[str, float] | None = None,
        take_control: bool = False,
        observer: bool = False,
        position: bool = False,
        accelerometer_sign: float = 1.0,
        timeout: float = 10.0,
        timer: Callable[[], float] = time.monotonic,
    ):
        self.name = f"blueye://{ip}" + (f" ({drone})" if drone else "")
        self.dropped = 0  # messages that could not be parsed
        self.permit: Callable[[], bool] = lambda: True  # whether thrusters may turn; asked at every motion input
        self._curve, self._clock, self._timer = curve, clock, timer
        self._sign, self._observer, self._position = accelerometer_sign, observer, position
        self._ip, self._take_control = ip, take_control
        self._rates = RATES | ({POSITION: 20.0} if position else {}) | dict(rates or {})
        self._readings: deque[Measurement] = deque(maxlen=MOST_READINGS)
        self._power = 0.0
        self._error: LinkError | None = None
        self._share, self._sent_at = np.zeros(AXES), -math.inf
        self._armed = self._stopped = self._closed = False
        self._arming, self._taking = threading.Lock(), threading.Lock()
        self._wake = threading.Event()
        self._sender = threading.Thread(target=self._keep_sending, daemon=True, name=f"motion of {self.name}")
        self._drone = connect(ip, timeout, take_control=False, observer=True, dropped=self._drop)
        self._last_at = timer()
        self._callback = self._drone.telemetry.add_msg_callback([], self._listen, raw=True)
        refused = set_rates(self._drone, self._rates)
        if refused:
            logger.warning("%s: would not set the rate of %s", self.name, ", ".join(refused))

    def arm(self) -> None:
        """Become the client in control, switch the drone's own modes off and begin to send; within 8 s.

        Raises:
            LinkTimeout: There was no answer in time.
            LinkError: The link is an observer's, stopped, lost or closed, or another client is in control.
        """
        if self._observer:
            raise LinkError(f"{self.name}: opened to look only, found arm(), expected a link without observer=True")
        with self._arming:
            if self._error is not None:
                raise self._error
            if self._closed or self._stopped:
                raise LinkError(f"{self.name}: stopped or closed before it was armed. Open a new link")
            if self._armed:
                return
            pilot = connect(self._ip, ARMING, self._take_control, observer=False, dropped=self._drop)
            # A drone may keep rates for the client that asked for them.
            set_rates(pilot, self._rates, tries=2)
            if not self._take_over(pilot):
                release(pilot)
                raise LinkError(f"{self.name}: closed while it was being armed")
            self._sender.start()

    def _take_over(self, pilot: Any) -> bool:
        """Hear and command through the pilot's connection; False when the link was closed meanwhile."""
        with self._taking:  # what the observer received last says that we are not in control
            if self._closed:
                return False
            observer, callback = self._drone, self._callback
            observer.telemetry.remove_msg_callback(callback)
            self._drone, self._armed = pilot, True
            self._callback = pilot.telemetry.add_msg_callback([], self._listen, raw=True)
        threading.Thread(target=release, args=(observer,), name=f"leave {self.name}").start()
        return True

    @property
    def age(self) -> float:
        """Time since anything came from the drone [s]; infinite for a link that is lost or closed."""
        return math.inf if self._closed or self._error else max(0.0, self._timer() - self._last_at)

    def read(self) -> list[Measurement]:
        """Readings since the last call.

        Raises:
            LinkTimeout: The drone has been silent for 3 s.
            LinkError: Another client has taken control since it was armed.
        """
        if self._closed:
            return []
        if self._error is None and self.age > LOST_AFTER:
            self._fail(LinkTimeout(f"{self.name}: silent for {LOST_AFTER:g} s, expected telemetry. Thrusters are off"))
        if self._error is not None:
            raise self._error
        found: list[Measurement] = []
        while self._readings:
            found.append(self._readings.popleft())
        return found

    def send(self, command: Command) -> None:
        u = np.array(command.u, dtype=float)
        if u.shape != (AXES,):
            self.stop()
            raise ValueError(f"{self.name}: command of shape {u.shape}, expected ({AXES},): surge, sway, heave")
        if not np.isfinite(u).all():
            self.stop()
        if self._armed and not self._stopped:
            self._share, self._sent_at = np.clip(self._curve(np.clip(u, -1.0, 1.0)), -1.0, 1.0), self._timer()
            self._wake.set()

    def stop(self) -> None:
        self._stopped = True
        self._wake.set()

    def close(self) -> None:
        if self._closed:
            return
        self.stop()
        with self._taking:
            self._closed = True
        self._wake.set()
        # No daemon: a process that ends waits until the last zero motion has left.
        threading.Thread(target=self._leave, name=f"leave {self.name}").start()

    def _leave(self) -> None:
        # Disconnecting may wait for a reply: nobody shall wait for that here.
        if self._sender.is_alive():
            self._sender.join(PARTING)
        time.sleep(PARTING if self._armed else 0.0)
        release(self._drone)

    def _fail(self, error: LinkError) -> None:
        self._error = error
        self.stop()

    # In the SDK's thread of telemetry

    def _drop(self) -> None:
        self.dropped += 1

    def _listen(self, name: str, payload: bytes) -> None:
        with self._taking:
            self._take(name, payload)

    def _take(self, name: str, payload: bytes) -> None:
        t = self._clock()
        self._last_at = self._timer()
        try:
            if name == "ConnectedClientsTel":
                self._check_pilot(payload)
            elif name == "ControlModeTel":
                self._check_modes(payload)
            elif name == "BatteryBQ40Z50Tel":
                self._power = parse_power(payload)
            if name == POSITION and not self._position:
                return
            for sensor, value in parse_telemetry(name, payload, self._sign):
                if sensor == "battery":
                    value[1] = self._power
                self._readings.append(Measurement(sensor, value, t))
        except LinkError:
            self.dropped += 1

    def _check_pilot(self, payload: bytes) -> None:
        pilot = parse("ConnectedClientsTel", payload).client_id_in_control
        if self._armed and pilot != self._drone.client_id and self._error is None:
            self._fail(
                LinkError(f"{self.name}: another client has taken control (client {pilot}). Thrusters of ours are off")
            )

    def _check_modes(self, payload: bytes) -> None:
        """The drone's own controllers stay off while we control: their messages may get lost, so they are repeated."""
        state = parse("ControlModeTel", payload).state
        if not self._armed or self._closed or self._error:
            return
        motion = self._drone.motion
        for on, switch in (
            (state.auto_depth, motion.enable_auto_depth),
            (state.auto_heading, motion.enable_auto_heading),
            (state.auto_altitude, motion.enable_auto_altitude),
            (state.station_keeping, motion.enable_station_keeping),
            (state.weather_vaning, motion.enable_weather_vaning),
        ):
            if on:
                switch(False)

    # In the sender's thread

    def _keep_sending(self) -> None:
        """The newest command as motion input, at once and repeatedly; nothing but the SDK's queue can hold it up."""
        armed_by_sdk = time.monotonic() + SDK_WATCHDOG
        while not self._closed and self._error is None:
            if time.monotonic() < armed_by_sdk:
                self._feed_watchdog()
            self._send_motion()
            self._wake.wait(REPEAT)
            self._wake.clear()
        self._send_motion()

    def _send_motion(self) -> None:
        share = np.zeros(AXES)
        # A timer that was set back makes no command young again.
        if not self._stopped and 0.0 <= self._timer() - self._sent_at <= COMMAND_LIFE and self.permit():
            share = self._share
        try:
            self._drone.motion.send_thruster_setpoint(*map(float, share), 0.0)
        except Exception as error:  # the SDK has given up its connection
            self._fail(LinkError(f"{self.name}: cannot be commanded ({error})"))

    def _feed_watchdog(self) -> None:
        """Thrusters on at once: the SDK feeds the watchdog from one second after connecting.

        More than once, for what is published before the drone has subscribed is lost.
        """
        import blueye.protocol

        alive: Any = blueye.protocol.WatchdogCtrl(connection_duration={"value": 0}, client_id=self._drone.client_id)
        # The queue of the SDK's thread for control: its sockets are no other thread's to use.
        self._drone._ctrl_client._messages_to_send.put(alive)
