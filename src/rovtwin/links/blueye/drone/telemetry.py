"""When a drone's telemetry goes out: which message at which simulated time.

What a sensor reads is published once, when it comes, at most at the message's rate; what the drone knows of itself is
published at its rate whether it is new or not.
"""

from collections.abc import Callable, Iterator
from itertools import groupby

from rovtwin.core.datum import Datum
from rovtwin.core.flow import Measurement
from rovtwin.links.blueye.drone.contents import SENSORS, Contents
from rovtwin.links.blueye.drone.drone import Drone
from rovtwin.links.blueye.wire import FASTEST
from rovtwin.links.servers.served_vehicle import ServedVehicle

# Message -> rate [Hz] until a client sets another. The maker does not print its own; these are such that a client
# which sets nothing can steer by them.
SENSED = {
    **{"DepthTel": 10.0, "AttitudeTel": 20.0, "CalibratedImuTel": 20.0, "Imu1Tel": 10.0, "Imu2Tel": 10.0},
    **{"DvlVelocityTel": 10.0, "AltitudeTel": 10.0, "PositionEstimateTel": 10.0, "ControlForceTel": 10.0},
}
KNOWN = {
    **{"ControlModeTel": 2.0, "LightsTel": 2.0, "BatteryTel": 1.0, "BatteryBQ40Z50Tel": 1.0, "DroneInfoTel": 0.2},
    **{"DroneTimeTel": 1.0, "DiveTimeTel": 1.0, "ConnectedClientsTel": 1.0, "ErrorFlagsTel": 1.0, "NStreamersTel": 1.0},
    **{"WaterTemperatureTel": 1.0, "DataStorageSpaceTel": 0.2, "VideoStorageSpaceTel": 0.2, "RecordStateTel": 1.0},
    **{
        "MissionStatusTel": 2.0,
        "TiltAngleTel": 2.0,
        "TiltStabilizationTel": 1.0,
        "ReferenceTel": 5.0,
        "CalibrationStateTel": 0.2,
    },
}
AT_ONCE = {"NotificationTel": FASTEST}  # when it happens
# Message -> sensors whose readings are its occasion: the first of them that the drone has
OCCASIONS = {
    **{"DepthTel": ("pressure",), "AttitudeTel": ("attitude",), "DvlVelocityTel": ("dvl",)},
    **{name: ("gyro", "accelerometer") for name in ("CalibratedImuTel", "Imu1Tel", "Imu2Tel")},
    **{"AltitudeTel": ("altimeter",), "PositionEstimateTel": ("estimate", "position"), "ControlForceTel": ("force",)},
}
EARLY = 0.1  # of a period by which a message may come early: sensors' clocks are not the scheduler's
FOLLOW = 0.1  # of what it came early by, the schedule is moved


class Telemetry:
    """Messages of one drone, as they fall due."""

    def __init__(self, drone: Drone, datum: Datum | None = None, say: Callable[[str], None] = lambda text: None):
        """`say` takes what a user should know."""
        self._drone, self._say = drone, say
        self._failed: set[str] = set()
        self.rates = SENSED | KNOWN | AT_ONCE
        self.contents = Contents(drone, datum)
        self._own = {ServedVehicle.name(drone.name, sensor): sensor for sensor in SENSORS}
        self._seen: set[str] = set()
        self._next: dict[str, float] = {}

    def set_rate(self, name: str, frequency: float) -> bool:
        """Set a message's rate [Hz], 0 is off; whether there is such a message and such a rate."""
        if name not in self.rates or not 0.0 <= frequency <= FASTEST:
            return False
        self.rates[name] = frequency
        self._next.pop(name, None)
        return True

    def take(self, now: float, batch: list[Measurement]) -> Iterator[tuple[str, bytes]]:
        """Names and bytes of the messages that are due with new readings; `now` is the vehicle's time [s]."""
        self.contents.pass_time(now)
        ours = sorted(self._ours(batch), key=lambda reading: reading.t_valid)
        for _, group in groupby(ours, key=lambda reading: round(reading.t_valid, 6)):
            new = {reading.sensor: reading for reading in group}
            self.contents.latest.update(new)
            t = next(iter(new.values())).t_valid
            for name, occasions in OCCASIONS.items():
                occasion = next((sensor for sensor in occasions if sensor in self.contents.latest), "")
                if occasion in new and self._due(name, t):
                    yield from self._built(name)
        for name in KNOWN:
            if self._due(name, now):
                yield from self._built(name)

    def _ours(self, batch: list[Measurement]) -> Iterator[Measurement]:
        """What concerns this drone, by the sensor's name alone: what it measures itself before what all share."""
        for reading in batch:
            if reading.sensor in self._own:
                sensor = self._own[reading.sensor]
                self._seen.add(sensor)
                yield Measurement(sensor, reading.value, reading.t_valid)
            elif reading.sensor in SENSORS and reading.sensor not in self._seen:
                yield reading

    def _due(self, name: str, t: float) -> bool:
        rate = self.rates[name]
        if rate <= 0.0:
            return False
        period, due = 1.0 / rate, self._next.get(name, t)
        if due - t >= 2 * period:
            due = t  # a clock that was set back must not silence the drone
        if t < due - EARLY * period:
            return False
        # A sensor as fast as the rate may have a clock that is fast: the schedule follows it, no reading is left out.
        due = max(due, t - period)
        self._next[name] = due + period + FOLLOW * min(0.0, t - due)
        return True

    def _built(self, name: str) -> Iterator[tuple[str, bytes]]:
        payload = self.build(name)
        if payload is not None:
            yield name, payload

    def build(self, name: str) -> bytes | None:
        """The newest message of a name; None where there is nothing to tell, no such message, or it cannot be built."""
        try:
            built = self.contents.message(name) if name in self.rates else None
            return None if built is None else built.SerializeToString()
        except Exception as error:  # whatever it is: one message less is better than no drone any more
            if name not in self._failed:
                self._failed.add(name)
                reason = f"{type(error).__name__}: {error}"
                self._say(
                    f"blueye {self._drone.name}: {name} cannot be built ({reason}); it is left out".replace(" :", ":")
                )
            return None
