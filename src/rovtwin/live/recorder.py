"""What is kept of a flight over a link: estimates, decisions, readings, and how the loop kept time; no truth."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Real

from rovtwin.core.errors import LogError
from rovtwin.core.flow import AutopilotOutput, Measurements
from rovtwin.core.log import Channel
from rovtwin.core.sensors import SensorKind
from rovtwin.monitoring.flight import FlightMonitor
from rovtwin.runs.loop import Record
from rovtwin.runs.recording.channels import autopilot_samples, log_channels, nis_samples, sensor_samples
from rovtwin.runs.recording.recorder import NOT_IN_TESTS, Write
from rovtwin.runs.scoring.failures import first_failure
from rovtwin.runs.scoring.scores import Failure, Flown, distance_to_leg, score, score_test
from rovtwin.scenario.schema import Scenario

UNKNOWN = (  # without the truth nobody knows
    *("position_error_rms_m", "nees_position_mean", "nees_effective_samples"),
    *("effort_n2s", "energy_wh", "thruster_activity_n_per_s"),
)
# Of the autopilot's channels.
SCORED = ("eta", "nu", "leg", "mode", "health", "reference", "setpoint", "tau", "bias", "progress")
HOST = ("late_ms", "link_age", "thrust_on")


def live_channels(
    scenario: Scenario, thrusters: list[str], sensors: Mapping[str, SensorKind], monitor: FlightMonitor | None = None
) -> list[Channel]:
    """Channels of a flight over a link: those of a simulated one without the truth, the host's and the monitor's."""
    channels = log_channels(thrusters, sensors, scenario.log.rate, scenario.log.sensors)
    unknown = ("score/nees", *_left_out(scenario))
    known = [c for c in channels if not c.name.startswith("truth/") and c.name not in unknown]
    host = Channel("host/timing", HOST, ("ms", "s", "1"), "", description="lateness of each tick, age of the link")
    return [*known, host, *([] if monitor is None else monitor_channels(monitor))]


def monitor_channels(monitor: FlightMonitor) -> list[Channel]:
    """Quantities and their standard deviations, each second."""
    each = monitor.quantities.each
    names, units = tuple(q.name.replace(".", "_") for q in each), tuple(q.unit for q in each)
    about = "of the vehicle against its description; unit 1: logarithm of a factor"
    return [
        Channel("monitor/value", names, units, "", description=f"what has changed {about}"),
        Channel("monitor/std", names, units, "", description=f"standard deviation of what has changed {about}"),
    ]


def _left_out(scenario: Scenario) -> tuple[str, ...]:
    """Channels of a mission that a test has not."""
    return (*NOT_IN_TESTS, "score/cross_track") if scenario.test else ()


class _Spool:
    """Rows of numbers that are needed at the end of a flight only, on the disk until then: it may take a day."""

    def __init__(self, folder: Path):
        """Raises LogError where nothing can be written."""
        try:
            self._file = tempfile.TemporaryFile(dir=folder)  # without a name, and gone with this process
        except OSError as error:
            raise LogError(f"{folder}: cannot be written ({error.strerror})") from None
        self._widths: dict[str, int] = {}

    def add(self, columns: dict[str, Real[np.ndarray, "n ..."]]) -> None:
        """The same names each time, shapes (n, width) or (n,). Raises LogError where the disk is full."""
        blocks = {name: values.reshape(len(values), -1).astype(float) for name, values in columns.items()}
        self._widths = {name: block.shape[1] for name, block in blocks.items()}
        try:
            self._file.write(np.hstack(list(blocks.values())).tobytes())
        except OSError as error:
            raise LogError(f"what the scores are made from cannot be written ({error.strerror})") from None

    def whole(self) -> dict[str, Float[np.ndarray, "_ _"]]:
        """All rows of each name, shapes (n, width)."""
        self._file.seek(0)
        rows = np.frombuffer(self._file.read()).reshape(-1, sum(self._widths.values()))
        ends = np.cumsum(list(self._widths.values()))[:-1]
        return dict(zip(self._widths, np.split(rows, ends, axis=1), strict=True))

    def close(self) -> None:
        self._file.close()


class LiveRecorder:
    """Takes a second of ticks at a time; `flown` is what scores are made of, judged by the estimate."""

    def __init__(self, scenario: Scenario, write: Write, folder: Path, monitor: FlightMonitor | None = None):
        """Samples go to `write`; what the scores are made from waits in the folder. `monitor` is closed with it."""
        self._monitor = monitor
        self._dt = scenario.control_dt
        self._log_every = scenario.rates.control // scenario.log.rate
        self._sensors, self._write = scenario.log.sensors, write
        self._left_out = _left_out(scenario)
        self._tick = 0
        self._spool = _Spool(folder)
        self._failed: Failure | None = None

    def take(self, measurements: Measurements, decided: AutopilotOutput, host: Float[np.ndarray, "ticks _"]) -> None:
        """Ticks in a row, leading axis ticks, NumPy; `host` has columns HOST."""
        record = Record(None, None, None, measurements, decided)  # type: ignore[arg-type]  (nobody knows the truth)
        k = self._tick + np.arange(len(host))
        self._tick += len(host)
        t, samples = k * self._dt, autopilot_samples(record)
        logged = k % self._log_every == 0
        logged[-1] = True
        every = {name: (t[logged], values[logged]) for name, values in samples.items()}
        every |= {name: (t, values) for name, values in nis_samples(record).items()} | {"host/timing": (t, host)}
        if self._sensors:
            every |= sensor_samples(record, t)
        scored = {name: samples[f"autopilot/{name}"][logged] for name in SCORED}
        on_leg = scored["mode"][:, 3] > 0.5
        distance = np.where(on_leg, distance_to_leg(scored["eta"], scored["leg"]), 0.0)
        every["score/cross_track"] = (t[logged], np.stack([distance, on_leg.astype(float)], axis=1))
        for name, (times, values) in every.items():
            if name not in self._left_out:
                self._write(name, times, values)
        self._watch(t, measurements, samples["autopilot/command"])
        self._failed = self._failed or first_failure(decided.failed, t)
        saturated = np.any(np.abs(samples["autopilot/command"][logged]) >= 1.0 - 1e-9, axis=1)
        self._spool.add({"t": t[logged], "saturated": saturated} | scored)

    def _watch(
        self, t: Float[np.ndarray, " ticks"], measurements: Measurements, command: Float[np.ndarray, "ticks n"]
    ) -> None:
        if self._monitor is None or (found := self._monitor.take(t, measurements, command)) is None:
            return
        at = t[-1:]
        self._write("monitor/value", at, np.array([[reading.value for reading in found.readings]]))
        self._write("monitor/std", at, np.array([[reading.std for reading in found.readings]]))

    def close(self) -> None:
        """Forget what the scores are made from."""
        if self._monitor is not None:
            self._monitor.close()
        self._spool.close()

    @property
    def seconds(self) -> float:
        """Time flown so far [s]."""
        return max(self._tick - 1, 0) * self._dt

    def flown(self) -> Flown:
        """All of it; the estimate stands where the truth would."""
        whole = self._spool.whole()
        eta, nu = whole["eta"], whole["nu"]
        return Flown(
            t=whole["t"][:, 0],
            eta=eta,
            nu=nu,
            eta_hat=eta,
            nu_hat=nu,
            covariance=np.broadcast_to(np.eye(12), (len(eta), 12, 12)),
            leg=whole["leg"],
            mode=whole["mode"],
            thrust=np.zeros((2, 1)),
            saturated=whole["saturated"][:, 0] > 0.5,
            control_dt=self._dt,
            duration=self.seconds,
            health=whole["health"],
            reference=whole["reference"],
            setpoint=whole["setpoint"],
            tau=whole["tau"],
            bias=whole["bias"],
            progress=whole["progress"][:, 0].astype(int),
            failed=self._failed,
        )


def live_figures(flown: Flown, test: bool = False) -> dict[str, Any]:
    """Scores as far as the estimate knows them; a test has none that anybody would have to judge."""
    unknown = dict.fromkeys(UNKNOWN)
    if test:
        return score_test(flown) | unknown
    return score(flown) | unknown | {"judged_by": "the autopilot's own estimate"}
