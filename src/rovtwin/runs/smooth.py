"""The track of a finished run, smoothed: its log, and the scenario beside it that says what sensors there were."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.block import Start
from rovtwin.core.errors import ConfigError, LogError
from rovtwin.core.flow import Measurements, Slot
from rovtwin.core.frames import quaternion_from_euler
from rovtwin.core.log import Channel, Log
from rovtwin.core.notebook import axes_of
from rovtwin.core.notebook.face import Row
from rovtwin.core.numerics import as_array, jnp
from rovtwin.core.stored import Stored
from rovtwin.gnc.navigation.constants import usual_constants
from rovtwin.gnc.navigation.smoother import Smoothed, smooth
from rovtwin.gnc.navigation.tuning import SENSOR_STD
from rovtwin.runs.compose.autopilot import navigation_filter
from rovtwin.runs.compose.composition import start_of, vehicle_of
from rovtwin.runs.compose.sensors import sensors_of, without_own
from rovtwin.runs.recording.channels import ETA, ETA_UNITS, NU, NU_UNITS
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import ModelBasedSection, Scenario
from rovtwin.vehicle.physics.model import Model

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

COVARIANCE = "smoothed/covariance"
_BETTER = 0.95  # share of the filter's error that counts as better
NEEDED = ("sensor/position", "sensor/attitude")


@dataclass(frozen=True, eq=False, repr=False)
class SmoothedRun(Stored):
    """A smoothed track, the log that holds it, and its errors where the log has the truth.

    Attributes:
        track: See `Smoothed`.
        log: Channels `smoothed/*`.
        errors: rms north and east [m] of filter and smoother; None without the truth.

    Example:
        >>> rovtwin.smooth("runs/survey")  # doctest: +SKIP
        <SmoothedRun: 412.0 s, rms 0.061 m (filter: 0.182 m)>
    """

    track: Smoothed
    log: Log
    errors: Float[np.ndarray, "2 2"] | None

    def __repr__(self) -> str:
        """One line, as a notebook shows it."""
        rms = ""
        if self.errors is not None:
            filtered, smoothed = np.linalg.norm(self.errors, axis=1)
            rms = f", rms {smoothed:.3f} m (filter: {filtered:.3f} m)"
        return f"<SmoothedRun: {self.log.duration:.1f} s{rms}>"

    def figures_table(self) -> list[Row]:
        """Duration, standard deviation, and errors where the truth is known.

        Example:
            >>> rovtwin.smooth("runs/survey").figures_table()[0]  # doctest: +SKIP
            ('duration', 412.0, 's')
        """
        std = np.sqrt(np.mean(self.track.std[:, :3] ** 2, axis=0)).tolist()
        found: list[Row] = [("duration", self.log.duration, "s"), ("sd, north / east / down, rms", std, "m")]
        keys = self.track.keys
        for name, value, sd in zip(
            keys.constants, keys.constants_value, np.sqrt(np.diag(keys.constants_covariance)), strict=True
        ):
            found.append((f"{name}, value / sd", [float(value), float(sd)], "" if name.endswith("scale") else "rad"))
        if self.errors is not None:
            names = ("error of the filter, north / east, rms", "error of the smoother, north / east, rms")
            found += [(name, row.tolist(), "m") for name, row in zip(names, self.errors, strict=True)]
        return found

    def remarks(self) -> list[str]:
        """Whether smoothing made positions no better, where the truth is known.

        Example:
            >>> rovtwin.smooth("runs/survey").remarks()  # doctest: +SKIP
            []
        """
        if self.errors is None:
            return []
        filtered, smoothed = np.linalg.norm(self.errors, axis=1)
        if smoothed < _BETTER * filtered:
            return []
        return [
            f"smoothing made positions no better: {smoothed:.3f} m rms, the filter {filtered:.3f} m. Where a Doppler "
            "log carries the track, what is left is an offset of the whole of it, and what the sensors' constants may "
            "be off by (--heading-std, --dvl-yaw-std, --dvl-scale-std): more or better fixes, or known points, take "
            "that out"
        ]

    def to_xarray(self) -> "xarray.DataTree":
        """A tree of the channels `smoothed/*`, see `Log.to_xarray`.

        Example:
            >>> rovtwin.smooth("runs/survey").to_xarray()["smoothed/eta/x"]  # doctest: +SKIP
        """
        return self.log.to_xarray()

    def to_pandas(self) -> "pandas.DataFrame":
        """Its channels side by side, see `Log.to_pandas`.

        Example:
            >>> rovtwin.smooth("runs/survey").to_pandas()["smoothed/eta", "x"]  # doctest: +SKIP
        """
        return self.log.to_pandas()

    def plot(self) -> "Axes":
        """The path from above, of the filter and smoothed.

        Example:
            >>> rovtwin.smooth("runs/survey").plot().figure.savefig("track.png")  # doctest: +SKIP
        """
        axes = axes_of("East [m]", "North [m]", equal=True)
        axes.plot(self.track.filtered[:, 1], self.track.filtered[:, 0], color="#56B4E9", linewidth=0.9, label="filter")
        axes.plot(self.track.eta[:, 1], self.track.eta[:, 0], color="#0072B2", label="smoothed")
        axes.legend(frameon=False, fontsize=8)
        return axes


def smooth_run(path: Path, constants_std: Mapping[str, float] | None = None) -> SmoothedRun:
    """Smooth the log of a run.

    Args:
        path: The log, or the run's folder; `scenario.yaml` lies beside it.
        constants_std: How well sensors' constants are known before, in place of some of `USUAL_STD`: `heading` of the
            compass [rad], `dvl_yaw` [rad], `dvl_scale`; 0: exactly.

    Raises:
        ConfigError: The scenario is missing.
        LogError: The log lacks what a filter needs.
    """
    path = path / "log.mcap" if path.is_dir() else path
    log, beside = Log.read(path), path.with_name("scenario.yaml")
    if not beside.exists():
        raise ConfigError(f"{beside}: not there; the scenario beside a log says which vehicle and sensors it is of")
    missing = [name for name in NEEDED if name not in log or not len(log[name].t)]
    if missing:
        raise LogError(f"{path}: no {', '.join(missing)}; a run logs its sensors unless log.sensors is false")
    scenario = load_scenario(beside)
    vehicle = vehicle_of(scenario)
    model, dt = vehicle.model(), scenario.control_dt
    section = scenario.autopilot
    if not isinstance(section, ModelBasedSection):
        section = ModelBasedSection(type="model_based")
    filter = navigation_filter(section, model, sensors_of(without_own(scenario), vehicle))
    sensors = [name for name in log if name.startswith("sensor/") and len(log[name].t)]
    last = max(log[name].t[-1] for name in sensors)
    ticks = round(last / dt) + 1
    slots = slots_of(log, ticks, dt)
    constants = usual_constants(filter.tuning, slots, constants_std)
    track = smooth(filter, began(log, scenario, model), slots, commands_of(log, ticks, dt), dt, constants)
    return SmoothedRun(track, _log_of(track, log), _errors(track, log))


def began(log: Log, scenario: Scenario, model: Model) -> Start:
    """Where the flight began: over a link, where the filter found itself at its first tick, and as sure of it."""
    if log.metadata.get("live") != "true" or "autopilot/std" not in log:
        return start_of(scenario, model)
    eta, std = (log[f"autopilot/{name}"].values[0] for name in ("eta", "std"))
    attitude = quaternion_from_euler(jnp.asarray(eta[3:]))
    return Start(as_array(eta[:3]), attitude, jnp.zeros(6), as_array(np.sqrt(np.mean(std[:2] ** 2))))


def slots_of(log: Log, ticks: int, dt: float) -> Measurements:
    """Readings of each sensor in the tick in which they came, leading axis ticks."""
    slots = {}
    for name in SENSOR_STD:
        channel = f"sensor/{name}"
        if channel not in log or not len(log[channel].t):
            continue
        at = np.clip(np.round(log[channel].t / dt).astype(int), 0, ticks - 1)
        row = np.arange(len(at)) - np.searchsorted(at, at)
        values = log[channel].values
        capacity = int(row.max(initial=0)) + 1
        value = np.zeros((ticks, capacity, values.shape[1] - 1))
        valid, t_valid = np.zeros((ticks, capacity), dtype=bool), np.zeros((ticks, capacity))
        value[at, row], valid[at, row], t_valid[at, row] = values[:, :-1], True, values[:, -1]
        slots[name] = Slot(value, valid, t_valid)  # type: ignore[arg-type]  (NumPy: the compiled step takes both)
    return slots


def commands_of(log: Log, ticks: int, dt: float) -> Float[np.ndarray, "ticks thrusters"]:
    """Command that was sent over the tick before each; the last one logged holds."""
    series = log["autopilot/command"]
    at = np.searchsorted(series.t, dt * (np.arange(ticks) - 1) + 1e-9, side="right") - 1
    return np.where((at >= 0)[:, None], series.values[np.maximum(at, 0)], 0.0)


def _log_of(track: Smoothed, source: Log) -> Log:
    std = tuple(f"std_{name}" for name in (*ETA, *NU[:3]))
    rows, columns = np.triu_indices(6)
    pairs = tuple(f"{ETA[i]}_{ETA[j]}" for i, j in zip(rows, columns, strict=True))
    units = tuple("rad2" if i > 2 else "m2" if j < 3 else "m rad" for i, j in zip(rows, columns, strict=True))
    channels = [
        Channel("smoothed/eta", ETA, ETA_UNITS, "n", description="pose of CO, from all readings"),
        Channel("smoothed/nu", NU, NU_UNITS, "b", description="velocity over ground"),
        Channel("smoothed/std", std, ETA_UNITS + NU_UNITS[:3], "", description="standard deviation"),
        Channel(COVARIANCE, pairs, units, "", description="of place in n and small rotation in b, upper triangle"),
    ]
    data: dict[str, Any] = {
        "smoothed/eta": (track.t, track.eta),
        "smoothed/nu": (track.t, track.nu),
        "smoothed/std": (track.t, track.std),
        COVARIANCE: (track.t, track.covariance[:, rows, columns]),
    }
    metadata = {key: value for key, value in source.metadata.items() if key not in ("created", "log_format")}
    return Log.from_arrays(channels, data, metadata)


def _errors(track: Smoothed, log: Log) -> Float[np.ndarray, "2 k"] | None:
    if "truth/eta" not in log:
        return None
    truth = log["truth/eta"]
    at = np.clip(np.searchsorted(track.t, truth.t - 1e-9), 0, len(track.t) - 1)
    both = [eta[at, :2] - truth.values[:, :2] for eta in (track.filtered, track.eta)]
    return np.array([np.sqrt(np.mean(error**2, axis=0)) for error in both])
