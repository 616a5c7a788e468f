"""Commands by a time-line, without an autopilot: a few seconds of thrust at a time, watched, and logged.

For what comes before an autopilot can be trusted: whether thrusters and sensors are what the file says.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import rotation_from_euler
from rovtwin.core.datum import utc_now
from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Command, Measurement
from rovtwin.core.link import Link, Source
from rovtwin.core.log import LogWriter
from rovtwin.core.sensors import kind_of
from rovtwin.core.types import Matrix3
from rovtwin.core.user_files.jsontext import to_json
from rovtwin.live.flight import metadata_of
from rovtwin.live.readiness import SensorMux, listen
from rovtwin.live.recorder import live_channels
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.compose.sensors import rotated
from rovtwin.runs.interrupt import Interrupt
from rovtwin.runs.pace import Clock, Pace
from rovtwin.runs.recording.provenance import beginning
from rovtwin.scenario.schema import Scenario

NEEDED = {"gyro": "", "attitude": ""}  # without these nobody would see it tip over
SILENT = 0.5  # since anything came from the vehicle, from which on thrusters stop [s, real time]
COMMAND = "autopilot/command"


@dataclass(frozen=True, eq=False)
class Pulse:
    """A command that holds for a while.

    Attributes:
        what: In words.
        command: From -1 to 1; None: nothing is sent, as by a program that hangs.
        seconds: How long.
        event: Done once as it begins, in place of its first command, as a STOP; None: nothing.
    """

    what: str
    command: Float[np.ndarray, " n"] | None
    seconds: float
    event: Callable[[], None] | None = None


@dataclass(frozen=True)
class Guard:
    """What ends pulses before their time.

    Attributes:
        tilt: Largest angle of the vehicle's z axis to the vertical [rad].
        deepest: Largest depth that is measured [m].
    """

    tilt: float = np.radians(40.0)
    deepest: float = np.inf


@dataclass(frozen=True)
class Pulsed:
    """What came of it.

    Attributes:
        log: The log: readings and commands.
        ended: Why it ended before its time, "" if it did not.
        spans: Start [s], end [s] and words of each pulse that was begun.
        readings: Number by sensor.
        rates: Readings a second of each sensor before it [Hz].
    """

    log: Path
    ended: str
    spans: tuple[tuple[float, float, str], ...]
    readings: dict[str, int]
    rates: dict[str, float]


def fly_pulses(
    scenario: Scenario,
    link: Link,
    sources: Sequence[Source],
    clock: Clock,
    folder: Path,
    pulses: Sequence[Pulse],
    guard: Guard,
    confirm: Callable[[], bool],
    progress: Callable[[float, str], None] = lambda t, what: None,
) -> Pulsed:
    """Listen, ask, arm, send each command for its time, and stop; thrusters are off at the end, however it comes.

    Args:
        scenario: With the vehicle and its sensors, as the link reads them.
        link: To the vehicle, open.
        sources: Instruments beside it, open.
        clock: That link and sources stamp readings with.
        folder: For `log.mcap`.
        pulses: One after the other; none: readings are logged for no time at all.
        guard: Limits.
        confirm: Asked before arming; without a yes nothing is sent.
        progress: Called about twice a second.

    Raises:
        ConfigError: The scenario cannot be composed.
        LinkError: The vehicle is not there, is silent, or refuses to arm. One that is lost on the way ends it.
        LogError: The folder cannot be written.
    """
    simulation = compose(scenario)
    mux = SensorMux(link, sources)
    rotation = rotated(simulation.loop.twin.sensors).get("attitude")
    ready = listen(
        mux, simulation.sensor_names, lambda line: progress(0.0, line), clock.speed, needed=NEEDED, rotation=rotation
    )
    names = set(simulation.sensor_names)
    channels = [
        channel
        for channel in live_channels(scenario, simulation.thruster_names, simulation.sensor_kinds)
        if channel.name == COMMAND or channel.name.startswith("sensor/")
    ]
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "log.mcap"
    with LogWriter(log, channels, metadata_of(scenario, simulation, folder)) as writer:
        if not confirm():
            return Pulsed(log, "it was not confirmed", (), {}, ready.rates)
        link.arm()
        try:
            thrusters = len(simulation.thruster_names)
            run = _Run(scenario, link, mux, clock, writer, guard, thrusters, names, rotation)
            return Pulsed(log, *run.through(pulses, progress), ready.rates)
        finally:
            link.stop()


class _Run:
    """The loop."""

    def __init__(
        self,
        scenario: Scenario,
        link: Link,
        mux: SensorMux,
        clock: Clock,
        writer: LogWriter,
        guard: Guard,
        thrusters: int,
        names: set[str],
        rotation: Matrix3 | None,
    ):
        self._link, self._mux, self._clock, self._writer, self._guard = link, mux, clock, writer, guard
        self._dt, self._names = scenario.control_dt, names
        self._to_body = np.eye(3) if rotation is None else np.asarray(rotation).T
        self._off = np.zeros(thrusters)
        self._counts: dict[str, int] = {}
        self._pace = Pace()
        self._last = dict.fromkeys(NEEDED, clock())  # when each came [s]
        mux.drain()
        mux.zero = self._began = clock.next(self._dt)
        writer.annotate(beginning(scenario, utc_now()))

    def through(
        self, pulses: Sequence[Pulse], progress: Callable[[float, str], None]
    ) -> tuple[str, tuple[tuple[float, float, str], ...], dict[str, int]]:
        """Why it ended early, spans, readings."""
        spans: list[tuple[float, float, str]] = []
        k, ended = 0, ""
        with Interrupt() as interrupt:
            for pulse in pulses:
                start, last = k, k + round(pulse.seconds / self._dt)
                spans.append((start * self._dt, last * self._dt, pulse.what))
                while k < last and not ended:
                    event = pulse.event if k == start else None
                    ended = self._tick(k, pulse.command, event) or ("interrupted" if interrupt.asked else "")
                    if k % max(1, round(0.5 / self._dt)) == 0:
                        progress(k * self._dt, pulse.what)
                    k += 1
                if ended:
                    break
        if not ended.startswith("link lost"):
            self._send(self._off)
            self._writer.write(COMMAND, k * self._dt, self._off)
        self._writer.annotate({"spans": to_json(spans)})
        return ended, tuple(spans), self._counts

    def _tick(self, k: int, command: Float[np.ndarray, " n"] | None, event: Callable[[], None] | None) -> str:
        """Wait, read, look, send, log; why it ends, "" while it goes on."""
        self._pace.wait(self._began + k * self._dt, self._clock, self._clock.speed)
        try:
            ended = self._watched(self._mux.read())
            if ended:
                return ended
            if event is not None:
                event()
            elif command is not None:
                self._send(command)
        except LinkError as error:
            return f"link lost: {error}"
        if command is not None:  # what is not sent is not logged
            self._writer.write(COMMAND, k * self._dt, command)
        return ""

    def _send(self, command: Float[np.ndarray, " n"]) -> None:
        self._link.send(Command(command))  # type: ignore[arg-type]  (NumPy: it goes to a link)

    def _watched(self, readings: Sequence[Measurement]) -> str:
        if self._link.age > SILENT:
            return f"link lost: nothing came from the vehicle for {self._link.age:.1f} s"
        now = self._clock()
        if quiet := [name for name in NEEDED if now - self._last[name] > SILENT * max(1.0, self._clock.speed)]:
            return f"{quiet[0]} fell silent, and nobody would see it tip over"
        for reading in readings:
            value = np.asarray(reading.value, dtype=float)
            if kind_of(reading.sensor) == "leak" and np.any(value > 0.5):  # whether the file has such a sensor or not
                return "the leak sensor reports water"
            if reading.sensor not in self._names:
                continue
            if reading.sensor in self._last:
                self._last[reading.sensor] = self._clock()
            t = max(0.0, self._clock() - self._began)
            self._writer.write(f"sensor/{reading.sensor}", t, np.append(value, reading.t_valid))
            self._counts[reading.sensor] = self._counts.get(reading.sensor, 0) + 1
            if reading.sensor == "attitude":
                R_nb = rotation_from_euler(value[None])[0] @ self._to_body
                tilt = float(np.arccos(np.clip(R_nb[2, 2], -1.0, 1.0)))
                if not np.isfinite(tilt):
                    return "its attitude is no number"
                if tilt > self._guard.tilt:
                    most = np.degrees(self._guard.tilt)
                    return f"it tilted by {np.degrees(tilt):.0f} deg, at most {most:.0f} are allowed"
            if reading.sensor == "pressure" and value[0] > self._guard.deepest:
                return f"it was {value[0]:.2f} m deep, at most {self._guard.deepest:.2f} m are allowed"
        return ""
