"""Before anything moves: which sensors speak, and where the vehicle is."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.core.block import Start
from rovtwin.core.errors import LinkTimeout
from rovtwin.core.flow import Measurement
from rovtwin.core.frames import quaternion_from_euler, readings_in_body
from rovtwin.core.link import Link, Source
from rovtwin.core.numerics import as_array, jnp
from rovtwin.core.sensors import SENSORS
from rovtwin.core.types import Matrix3
from rovtwin.links.registry import built_in

_SOURCES = " or ".join(f"{one.scheme}://.." for one in built_in() if one.source and one.gives_position)
POSITIONS = f"--sensor {_SOURCES}, or a vehicle that knows its position"
# Of a mission: what the filter cannot do without; and where a reading can come from, for messages.
NEEDED = {"position": POSITIONS, "pressure": "", "attitude": "", "gyro": "", "accelerometer": ""}
# Of a test: it reads these directly. What it wants positions for can be left out of it.
NEEDED_IN_TESTS = {"pressure": "", "attitude": "", "gyro": ""}
TO_COME_HOME = {"position": f"{POSITIONS}; a test without home, between, and keep in surge and sway needs none"}
ENOUGH = 3  # positions that the start is the mean of
SETTLING = 0.2  # a host that held readings back has handed them on by then [s]
PATIENCE = 20.0  # longest wait for all sensors [s]


@dataclass(frozen=True)
class Readiness:
    """What was received before arming.

    Attributes:
        start: Pose of the vehicle at rest.
        rates: Readings a second of each sensor [Hz].
        missing: Sensors of the scenario without readings; the flight does without.
    """

    start: Start
    rates: dict[str, float]
    missing: tuple[str, ...]


class SensorMux:
    """Link and sources as one: all readings in order of arrival, times since `zero` [s].

    What an instrument beside the vehicle measures is not taken from the vehicle, too: it may well hand on the same.

    Attributes:
        zero: Time from which readings count [s].
        instruments: Sensors that instruments provide, or have spoken for.
    """

    def __init__(self, link: Link, sources: Sequence[Source]):
        self._link, self._sources = link, sources
        self.instruments = {name for source in sources for name in source.provides}
        self.zero = 0.0

    def read(self) -> list[Measurement]:
        """What came since the last call."""
        beside = [reading for source in self._sources for reading in source.read()]
        self.instruments.update(reading.sensor for reading in beside)
        found = [r for r in self._link.read() if r.sensor not in self.instruments] + beside
        return [Measurement(r.sensor, r.value, r.t_valid - self.zero) for r in found]

    def drain(self) -> None:
        """Let go of what came while nobody listened, as during a compilation; a twin then is where its clock is."""
        began = time.monotonic()
        while self.read() or time.monotonic() - began < SETTLING:
            if time.monotonic() - began > PATIENCE:
                return


def listen(
    mux: SensorMux,
    sensors: Sequence[str],
    say: Callable[[str], None] = lambda text: None,
    speed: float = 1.0,
    patience: float = PATIENCE,
    needed: Mapping[str, str] = NEEDED,
    rotation: Matrix3 | None = None,
    position_noise: float = SENSORS["position"].std,
) -> Readiness:
    """Listen until every sensor that the autopilot cannot do without has spoken, and all others had their time.

    Args:
        mux: Where readings come from.
        sensors: Those of the scenario.
        say: Told once a second what is waited for.
        speed: Of the clock of readings.
        patience: Longest wait [real s].
        needed: Those that the autopilot cannot do without, and where each can come from.
        rotation: R_bs of the sensor that tells the attitude; None where it tells that of b.
        position_noise: Standard deviation of one position, each axis [m].

    Raises:
        LinkTimeout: One of `needed` is not received.
    """
    received: dict[str, list[np.ndarray]] = {}
    mux.drain()
    began = reported_at = time.monotonic()
    while True:
        before = set(mux.instruments)
        news = mux.read()
        for name in mux.instruments - before:
            received.pop(name, None)  # what the vehicle said of it was in a frame of its own
        for reading in news:
            received.setdefault(reading.sensor, []).append(reading.value)
        waited = time.monotonic() - began
        waiting = [name for name in needed if len(received.get(name, ())) < (ENOUGH if name == "position" else 1)]
        others = [name for name in sensors if name not in received and name not in needed]
        if not waiting and (not others or waited > patience / 4) and waited > 1.0 / speed:
            break
        if waited > patience:
            raise LinkTimeout(_missing({name: needed[name] for name in waiting}, sorted(received), patience))
        if time.monotonic() - reported_at > 1.0:
            reported_at = time.monotonic()
            say(f"waiting for {', '.join(waiting or others)}")
        time.sleep(0.01)
    start = _start(received, rotation, position_noise)
    return Readiness(start, {n: len(v) / (waited * speed) for n, v in received.items()}, tuple(others))


def _missing(waiting: Mapping[str, str], received: list[str], patience: float) -> str:
    found = ", ".join(received) if received else "nothing at all"
    fixes = [f"{name}: {origin}" for name, origin in waiting.items() if origin]
    return (
        f"the vehicle's sensors: found {found} within {patience:g} s, expected {', '.join(waiting)} too. "
        f"{'; '.join(fixes) or 'Is the vehicle switched on, and are its telemetry rates above zero?'}"
    )


def _start(
    received: dict[str, list[Float[np.ndarray, " _"]]], rotation: Matrix3 | None, position_noise: float
) -> Start:
    """Mean of the received positions and depths, and the last attitude, at rest; n begins here where nobody knows."""
    places = received.get("position", [])[-20:]
    north, east = np.mean(places or [np.zeros(2)], axis=0)
    std = position_noise / np.sqrt(len(places)) if places else 0.0
    depth = float(np.mean(received.get("pressure", [0.0])[-20:]))  # of what needs no depth: one that it begins at
    euler = as_array(received["attitude"][-1:])
    euler = euler if rotation is None else readings_in_body(euler, "attitude", rotation)
    return Start(as_array([north, east, depth]), quaternion_from_euler(euler[0]), jnp.zeros(6), as_array(std))
