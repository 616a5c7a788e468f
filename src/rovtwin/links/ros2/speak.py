"""Readings of a station as messages on topics."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Measurement
from rovtwin.core.sensors import IMU
from rovtwin.links.ros2 import convert
from rovtwin.links.ros2 import messages as msg

if TYPE_CHECKING:
    from rovtwin.links.ros2.server import Ros2Server


class Speaker:
    """Publishes batches of readings.

    Args:
        server: Its settings.
        root: Namespace, `/rov`.
        publish: `(topic, message)`.
        say: Told once of a topic that cannot be published.
    """

    def __init__(
        self, server: "Ros2Server", root: str, publish: Callable[[str, Any], None], say: Callable[[str], None]
    ):
        self._server, self._root, self._publish, self._say = server, root, publish, say
        self._silent: set[str] = set()
        prefix = server.frame_prefix
        self._map, self._odom, self._base = (prefix + name for name in (convert.MAP, convert.ODOM, convert.BASE))
        self._made: dict[str, tuple[str, Callable[[float, np.ndarray], Any]]] = {
            "estimate": ("odometry", self._odometry),
            "pressure": ("pressure", self._pressure),
            "mocap": ("mocap", lambda t, x: convert.pose(t, x[:3], x[3:], self._map)),
            "position": ("position", lambda t, x: convert.position(t, x, self._std("position"), self._map)),
            "dvl": ("dvl", lambda t, x: convert.velocity(t, x, self._std("dvl"), self._base)),
            "altimeter": ("altimeter", lambda t, x: convert.floor(t, x[0], self._base)),
            "battery": ("battery", lambda t, x: convert.battery(t, x[0], x[1], server.voltage)),
            "leak": ("leak", lambda t, x: msg.Bool(bool(x[0] > 0.5))),
            "thrusters": ("thrusters", lambda t, x: convert.numbers(x)),
        }

    def speak(self, now: float, speed: float, readings: list[Measurement]) -> None:
        """Publish a batch; `now` is the vehicle's time [s], `speed` its seconds a second."""
        if self._server.sim_time:
            self._send("/clock", msg.Clock(convert.stamp(now)))
        inertial: dict[tuple[str, float], dict[str, np.ndarray]] = {}
        for reading in readings:
            drone, _, sensor = reading.sensor.rpartition("/")
            t = self._stamp(reading.t_valid, now, speed)
            # A sensor that reads no number (an altimeter over the deep) has nothing to say.
            if not (np.isfinite(reading.value).all() and np.isfinite(t)):
                continue
            if sensor in IMU:
                inertial.setdefault((drone, t), {})[sensor] = reading.value
            elif sensor in self._made:
                topic, make = self._made[sensor]
                self._send(self._topic(drone, topic), make(t, reading.value))
        # What was measured at the same instant is one message; nothing is repeated to fill a gap.
        for (drone, t), parts in inertial.items():
            self._send(self._topic(drone, "imu"), convert.imu(t, **parts, std=self._server.std, frame=self._base))

    def _odometry(self, t: float, value: Float[np.ndarray, " k"]) -> msg.Odometry:
        std = self._std("estimate")
        found = convert.odometry(t, value[:6], value[6:12], convert.diagonal(std), self._odom, self._base)
        if self._server.tf:
            self._send("/tf", convert.transforms(found, self._map))
        return found

    def _pressure(self, t: float, value: Float[np.ndarray, " k"]) -> msg.FluidPressure:
        return convert.pressure(t, value[0], self._server.water, self._std("pressure"), self._base)

    def _stamp(self, t_valid: float, now: float, speed: float) -> float:
        return t_valid if self._server.sim_time else time.time() - (now - t_valid) / speed

    def _std(self, sensor: str) -> Any:
        return self._server.std.get(sensor)

    def _topic(self, drone: str, name: str) -> str:
        return f"{self._root}/{drone}/{name}" if drone else f"{self._root}/{name}"

    def _send(self, topic: str, message: Any) -> None:
        if topic in self._silent:
            return
        try:
            self._publish(topic, message)
        except LinkError as error:  # such as tf2_msgs that is not installed: the other topics go on
            self._silent.add(topic)
            self._say(str(error))
