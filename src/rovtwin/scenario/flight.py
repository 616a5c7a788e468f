"""Flying a scenario: run it, log it while it runs, score it, report it."""

import platform
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin import __version__
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import PHASES
from rovtwin.core.jsontext import to_json
from rovtwin.core.log import Log, LogWriter
from rovtwin.core.numerics import jax
from rovtwin.scenario.altitude import altitude_error
from rovtwin.scenario.belongings import kept_beside, scenes_kept_beside
from rovtwin.scenario.channels import (
    autopilot_samples,
    log_channels,
    nis_samples,
    sensor_samples,
    truth_samples,
)
from rovtwin.scenario.compose_trial import spans_of
from rovtwin.scenario.composition import Composed, compose
from rovtwin.scenario.decisions import decisions
from rovtwin.scenario.files import dump_scenario
from rovtwin.scenario.filming import Filming
from rovtwin.scenario.interrupt import Interrupt
from rovtwin.scenario.loop import Record
from rovtwin.scenario.run import chunks, realtime_chunks, until_the_end
from rovtwin.scenario.schema import Scenario
from rovtwin.scenario.score import Flown, distance_to_leg, nees, nees_interval, score, score_test
from rovtwin.simulation.sensors import Sensor

Progress = Callable[[float, str], None]  # simulated time [s], phase
Write = Callable[[str, np.ndarray, np.ndarray], None]  # channel, times, samples
NOT_IN_TESTS = (  # there is no filter, no path and no wanted force
    *("autopilot/bias", "autopilot/std", "autopilot/nis", "autopilot/nis_dof"),
    *("autopilot/reference", "autopilot/leg", "autopilot/tau", "autopilot/saturated"),
)
SCORE_RATE = 10  # samples that scores are computed from, whatever is logged [1/s]


@dataclass(frozen=True)
class Flight:
    """A run that is over.

    Attributes:
        scenario: What was flown.
        folder: Where everything of it lies, None if nothing was written.
        log: All channels.
        summary: Figures, verdict and reason (see `score`).
    """

    scenario: Scenario
    folder: Path | None
    log: Log
    summary: dict[str, Any]

    @property
    def completed(self) -> bool:
        return bool(self.summary["completed"])


class Recorder:
    """Takes the chunks of a run: writes them to the log as they come, if there is one, and keeps what scores need."""

    def __init__(self, scenario: Scenario, write: Write | None = None):
        self._dt = scenario.control_dt
        self._log_every = scenario.rates.control // scenario.log.rate
        self._score_every = max(1, scenario.rates.control // SCORE_RATE)
        self._sensors = scenario.log.sensors
        self._moving_surface = scenario.world.moving_surface
        self._left_out = NOT_IN_TESTS if scenario.test else ()
        self._write = write
        self._tick = 0
        self._kept: list[dict[str, np.ndarray]] = []
        self._thrust: list[np.ndarray] = []
        self._saturated: list[np.ndarray] = []
        self._energy: list[float] = []

    def take(self, record: Record) -> None:
        """One chunk, leading axis ticks."""
        length = len(record.water_velocity)
        k = self._tick + np.arange(length)
        self._tick += length
        t = k * self._dt
        samples = truth_samples(record, self._moving_surface) | autopilot_samples(record)
        # The last tick of a run is kept whatever its number: it holds the verdict.
        last = (k == k[-1]) & _ends(record)
        if self._write is not None:
            self._log(self._write, record, samples, t, (k % self._log_every == 0) | last)
        scored = (k % self._score_every == 0) | last
        samples |= {"t": t, "covariance": np.asarray(record.autopilot.estimate.covariance)}
        self._kept.append({name: values[scored] for name, values in samples.items()})
        self._thrust.append(np.asarray(record.state.thrust))
        if record.battery is not None:
            used = np.asarray(record.battery.used).sum(axis=1)
            self._energy += [float(used[0]), float(used[-1])]
        self._saturated.append(np.any(np.abs(record.autopilot.command.u) >= 1.0 - 1e-9, axis=1))

    def _log(self, write: Write, record: Record, samples: dict[str, np.ndarray], t: np.ndarray, logged: Any) -> None:
        """Write a chunk: samples of the ticks in `logged`, shape (ticks,), bool; NIS and readings as they came."""
        every = {name: (t[logged], values[logged]) for name, values in samples.items()}
        every |= {name: (t, values) for name, values in nis_samples(record).items()}
        if self._sensors:
            every |= sensor_samples(record, t)
        for name, (times, values) in every.items():
            if name not in self._left_out:
                write(name, times, values)

    @property
    def seconds(self) -> float:
        """Simulated time so far [s]."""
        return max(self._tick - 1, 0) * self._dt

    def flown(self) -> Flown:
        """All of it, for the scores."""
        whole = {name: np.concatenate([chunk[name] for chunk in self._kept]) for name in self._kept[0]}
        return Flown(
            t=whole["t"],
            eta=whole["truth/eta"],
            nu=whole["truth/nu"],
            eta_hat=whole["autopilot/eta"],
            nu_hat=whole["autopilot/nu"],
            covariance=whole["covariance"],
            leg=whole["autopilot/leg"],
            mode=whole["autopilot/mode"],
            thrust=np.concatenate(self._thrust),
            saturated=np.concatenate(self._saturated),
            control_dt=self._dt,
            duration=self.seconds,
            health=whole["autopilot/health"],
            energy=self._energy[-1] - self._energy[0] if self._energy else None,
            reference=whole["autopilot/reference"],
        )


def _ends(record: Record) -> bool:
    """Whether the mission ends within this chunk."""
    return until_the_end(record, len(record.water_velocity) + 1)[1]


def fly(
    scenario: Scenario,
    folder: str | Path | None = None,
    *,
    realtime: bool = False,
    progress: Progress | None = None,
    report: bool = False,
    camera: bool = False,
    film: bool = False,
) -> Flight:
    """Fly a scenario.

    Args:
        scenario: What to fly.
        folder: New folder for log, scenario and report; None keeps all in memory.
        realtime: Tick by tick by the wall clock instead of compiled.
        progress: Called about once a simulated second.
        report: Write the HTML report and the figures (needs a folder).
        camera: Record the scenario's cameras (needs a folder).
        film: Write films of them too.

    Returns:
        The flight. Ctrl-C ends the run, not the program: what was flown is logged, scored and reported.

    Raises:
        ConfigError: The scenario cannot be composed.
        LogError: The folder cannot be written.
    """
    if realtime and (camera or film):
        raise ConfigError(f"{scenario.name}: pictures cannot be rendered by the wall clock; leave out --realtime")
    composed = compose(scenario)
    channels = log_channels(
        composed.thruster_names,
        composed.sensor_names,
        scenario.log.rate,
        scenario.log.sensors,
        scenario.world.moving_surface,
        composed.battery_names,
        {name: tether.segments + 1 for name, tether in composed.loop.twin.tethers.items()},
    )
    metadata = provenance(scenario, composed)
    pieces: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {channel.name: [] for channel in channels}
    if folder is None:
        recorder = Recorder(scenario, lambda name, t, values: pieces[name].append((t, values)))
        interrupted = _run(composed, scenario, [recorder.take], recorder, realtime, progress)
        flown = recorder.flown()
        summary = summarise(flown, composed, interrupted)
        data = {name: _joined(parts) for name, parts in pieces.items() if parts} | _scores(flown, scenario)
        return Flight(scenario, None, Log.from_arrays(channels, data, metadata | _closing(summary)), summary)

    folder = _new_folder(folder)
    metadata["scenario"] = dump_scenario(scenario_to_replay(scenario, composed, folder))
    (folder / "scenario.yaml").write_text(metadata["scenario"], encoding="utf-8")
    with ExitStack() as stack:
        log = stack.enter_context(LogWriter(folder / "log.mcap", channels, metadata))
        recorder = Recorder(scenario, log.write_many)
        takers = [recorder.take]
        if camera or film:
            takers.append(stack.enter_context(Filming(scenario, composed.vehicle, folder, film)).take)
        interrupted = _run(composed, scenario, takers, recorder, realtime, progress)
        flown = recorder.flown()
        summary = summarise(flown, composed, interrupted)
        for name, (t, values) in _scores(flown, scenario).items():
            log.write_many(name, t, values)
        log.annotate(_closing(summary))
    (folder / "summary.json").write_text(to_json(summary) + "\n", encoding="utf-8")
    flight = Flight(scenario, folder, Log.read(folder / "log.mcap"), summary)
    if report:
        from rovtwin.report import write_report

        write_report(flight.log, folder)
    return flight


def _run(
    composed: Composed,
    scenario: Scenario,
    takers: Sequence[Callable[[Record], None]],
    recorder: Recorder,
    realtime: bool,
    progress: Progress | None,
) -> bool:
    """Run to the end or to Ctrl-C; whether it was the latter."""
    source = realtime_chunks if realtime else chunks
    stream: Iterator[Record] = source(
        composed.loop, composed.key, composed.start, scenario.control_dt, scenario.duration
    )
    with Interrupt() as interrupt:
        for record in stream:
            for take in takers:
                take(record)
            if progress:
                progress(recorder.seconds, PHASES[int(record.autopilot.setpoint.phase[-1])])
            if interrupt.asked:
                return True
    return False


def summarise(flown: Flown, composed: Composed, interrupted: bool) -> dict[str, Any]:
    """Scores, the reason where the mission was not completed, NEES interval and the bound of the best filter."""
    judged = not composed.scenario.test
    figures = score(flown) if judged else score_test(flown)
    interrupted = interrupted and not figures["completed"]  # Ctrl-C in the last second of a mission changes nothing
    low, high = nees_interval([figures]) if judged else (None, None)
    if interrupted:
        reason = "interrupted"
    elif figures["completed"]:
        reason = ""
    else:
        reason = figures["reason"] or f"not finished after {flown.duration:.0f} s"
    speed = float(np.sqrt(np.mean(np.sum(flown.nu[:, :2] ** 2, axis=1))))
    return figures | {
        "reason": reason,
        "interrupted": interrupted,
        "altitude_rms_m": altitude_error(flown, composed.scenario),
        "decisions": decisions(flown, composed.thruster_names),
        "nees_position_interval": [low, high] if judged else None,
        "bound_position_m": composed.bound(speed) if judged and np.isfinite(speed) else None,
        "speed_rms_m_s": speed,
    }


def provenance(scenario: Scenario, composed: Composed) -> dict[str, str]:
    """What a log must say to be replayed and judged; wall-clock time is added by the log itself."""
    datum = scenario.origin
    return {
        "version": __version__,
        "scenario": dump_scenario(scenario_to_replay(scenario, composed)),
        "name": scenario.name,
        "seed": str(scenario.seed),
        "platform": platform.platform(),
        "python": platform.python_version(),
        "jax": jax.__version__,
        "command": " ".join(Path(word).name if i == 0 else word for i, word in enumerate(sys.argv)),
        "vehicle_table": to_json(composed.vehicle_table()),
        "sensors": to_json({name: _datasheet(sensor) for name, sensor in composed.loop.twin.sensors.items()}),
        "water_density": str(water.kg_per_m3 if (water := scenario.world.water) else composed.vehicle.assembly.density),
        "waves": scenario.world.waves.model_dump_json() if scenario.world.waves else "",
        "faults": to_json(composed.faults),
        "datum": datum.metadata(),
        "mission": to_json([w.model_dump() | {"position": w.placed(datum)} for w in scenario.waypoints]),
        "test": to_json(spans_of(scenario)) if scenario.test else "",
        "thrusters": to_json(composed.thruster_names),
        "tether_length": str(composed.paid_out),
    }


def _datasheet(sensor: Sensor) -> dict[str, Any]:
    """What a user of the log may know of a sensor: declared noise, place and mounting in b, not its errors."""
    told = {"noise": sensor.noise, "lever": sensor.lever, "rotation": sensor.rotation}
    return {name: np.asarray(value).tolist() for name, value in told.items()}


def scenario_to_replay(scenario: Scenario, composed: Composed, folder: Path | None = None) -> Scenario:
    """The scenario with its vehicle written out, so that it does not depend on files that may change or move.

    Mesh and scene files are copied into `folder`, relative to which they are named; without one they stay where they
    are.
    """
    vehicle = composed.vehicle.to_dict()
    if folder is None:
        return scenario.model_copy(update={"vehicle": vehicle})
    cameras = scenes_kept_beside(scenario.cameras, folder)
    return scenario.model_copy(update={"vehicle": kept_beside(vehicle, folder), "cameras": cameras})


def _scores(flown: Flown, scenario: Scenario) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    if scenario.test:
        return {}
    on_leg = flown.mode[:, 3] > 0.5
    distance = np.where(on_leg, distance_to_leg(flown.eta, flown.leg), 0.0)
    return {
        "score/nees": (flown.t, nees(flown)),
        "score/cross_track": (flown.t, np.stack([distance, on_leg.astype(float)], axis=1)),
    }


def _closing(summary: dict[str, Any]) -> dict[str, str]:
    return {"summary": to_json(summary)}


def _joined(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    times, values = zip(*parts, strict=True)
    return np.concatenate(times), np.concatenate(values)


def run_folder(name: str, root: str | Path = "runs") -> Path:
    """A folder name for a run that starts now: `runs/<time>-<name>`, numbered if taken."""
    stem = f"{datetime.now():%Y%m%d-%H%M%S}-{re.sub(r'[^A-Za-z0-9_.-]', '_', name)}"
    path = Path(root) / stem
    for number in range(2, 1000):
        if not path.exists():
            break
        path = Path(root) / f"{stem}-{number}"
    return path


def _new_folder(folder: str | Path) -> Path:
    folder = Path(folder)
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise ConfigError(f"{folder}: exists already; a run never overwrites another. Choose another folder") from None
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be made ({error.strerror}). Choose a folder you may write to") from None
    return folder
