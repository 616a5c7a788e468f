"""What is kept of a run while it goes on: the log's samples as they come, and what scores need."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import pose_covariance
from rovtwin.runs.loop import Record
from rovtwin.runs.recording.channels import autopilot_samples, nis_samples, sensor_samples, truth_samples
from rovtwin.runs.run import until_the_end
from rovtwin.runs.scoring.failures import first_failure
from rovtwin.runs.scoring.scores import Failure, Flown
from rovtwin.scenario.schema import Scenario

Write = Callable[[str, np.ndarray, np.ndarray], None]  # channel, times, samples
NOT_IN_TESTS = (  # there is no filter, no path and no desired force
    *("autopilot/bias", "autopilot/std", "autopilot/nis", "autopilot/nis_dof"),
    *("autopilot/reference", "autopilot/leg", "autopilot/tau", "autopilot/saturated"),
)
SCORE_RATE = 10  # samples that scores are computed from, whatever is logged [1/s]


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
        self._pose: list[np.ndarray] = []
        self._saturated: list[np.ndarray] = []
        self._energy: list[float] = []
        self._failed: Failure | None = None
        self._broken: Failure | None = None

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
        samples["t"] = t
        kept = {name: values[scored] for name, values in samples.items()}
        estimate = record.autopilot.estimate
        kept["covariance"] = pose_covariance(estimate.covariance[scored], estimate.attitude[scored])
        self._kept.append(kept)
        self._thrust.append(np.asarray(record.state.thrust))
        self._pose.append(samples["truth/eta"])
        if record.battery is not None:
            used = np.asarray(record.battery.used).sum(axis=1)
            self._energy += [float(used[0]), float(used[-1])]
        self._failed = self._failed or first_failure(record.autopilot.failed, t)
        self._broken = self._broken or first_failure(record.broken_force, t)
        self._saturated.append(np.any(np.abs(record.autopilot.command.u) >= 1.0 - 1e-9, axis=1))

    def _log(
        self, write: Write, record: Record, samples: dict[str, np.ndarray], t: Float[np.ndarray, " ticks"], logged: Any
    ) -> None:
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
            setpoint=whole["autopilot/setpoint"],
            tau=whole["autopilot/tau"],
            bias=whole["autopilot/bias"],
            water=whole["truth/water_velocity"],
            outside=whole["truth/external_wrench"],
            progress=whole["autopilot/progress"][:, 0].astype(int),
            pose=np.concatenate(self._pose),
            failed=self._failed,
            broken_force=self._broken,
        )


def _ends(record: Record) -> bool:
    """Whether the mission ends within this chunk."""
    return until_the_end(record, len(record.water_velocity) + 1)[1]
