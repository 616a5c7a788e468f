"""What figures and tables read from a log, whichever channels it has."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import wrapped
from rovtwin.core.datum import Datum, coordinates_text, datum_of
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import PHASES
from rovtwin.core.log import Log, Series
from rovtwin.core.log.missions import FlownMission, missions_of, point_name
from rovtwin.core.user_files.quantity import is_finite
from rovtwin.core.user_files.yamlfile import parse_yaml
from rovtwin.report.series import at, sensor_values

POSES = ("x", "y", "z", "phi", "theta", "psi")
VELOCITIES = ("u", "v", "w", "p", "q", "r")

_FIX_NAMES = ("acoustic", "position", "usbl", "fix", "gnss")


@dataclass(frozen=True)
class Interval:
    """A stretch of time in one phase [s], and the way-point aimed at, counted from 0."""

    start: float
    end: float
    phase: str
    waypoint: int


@dataclass(frozen=True)
class FaultSpan:
    """A fault: its number in the report, from 1, what it is, from when to when [s], and the thrusters it is of."""

    number: int
    what: str
    start: float
    end: float
    thrusters: tuple[str, ...]


class Flight:
    """A log as a report sees it: series that may be missing, phases, and metadata that may be missing too.

    A channel without samples, or without any finite value, counts as missing.
    """

    def __init__(self, log: Log) -> None:
        self.log = log

    def get(self, name: str) -> Series | None:
        """The series, or None when it is missing."""
        if name not in self.log:
            return None
        series = self.log[name]
        return series if len(series) and np.isfinite(series.values).any() else None

    def has(self, *names: str) -> bool:
        """Whether none of the channels is missing; a name that ends in / stands for any below it."""
        return all(self.below(name) if name.endswith("/") else self.get(name) is not None for name in names)

    def below(self, prefix: str) -> dict[str, Series]:
        """Series of the channels `prefix...` that are not missing, by the rest of their names, in order."""
        names = sorted(name for name in self.log.channels if name.startswith(prefix) and self.has(name))
        return {name.removeprefix(prefix): self[name] for name in names}

    def __getitem__(self, name: str) -> Series:
        series = self.get(name)
        if series is None:
            raise KeyError(name)
        return series

    @cached_property
    def sensors(self) -> dict[str, Series]:
        """Series of `sensor/...` that have samples, by the name of the sensor."""
        return self.below("sensor/")

    @cached_property
    def tethers(self) -> dict[str, Series]:
        """Series of `truth/tether/...` that have a tension, by the name of the tether."""
        return {
            name: series for name, series in self.below("truth/tether/").items() if "tension" in series.channel.fields
        }

    @cached_property
    def anchors(self) -> dict[str, Float[np.ndarray, "3"]]:
        """Upper ends of the tethers, north, east, down [m], by name: their first node."""
        places = {name: series.values[:, :3] for name, series in self.below("truth/tether_shape/").items()}
        known = {name: place[np.isfinite(place).all(axis=1)] for name, place in places.items()}
        return {name: place[0] for name, place in known.items() if len(place)}

    @cached_property
    def charges(self) -> dict[str, tuple[Float[np.ndarray, " N"], Float[np.ndarray, " N"]]]:
        """Time [s] and share of the charge that is left, by the name of the battery."""
        series = self.get("truth/battery")
        if series is None:
            return {}
        fields = [field for field in series.channel.fields if field.endswith("_charge")]
        return {field.removesuffix("_charge"): (series.t, series[field]) for field in fields}

    @cached_property
    def emptied(self) -> dict[str, float]:
        """When a battery had nothing left [s], by its name, in order of time; those that last are not in it."""
        found = {name: t[charge <= 0] for name, (t, charge) in self.charges.items()}
        return dict(sorted(((name, float(t[0])) for name, t in found.items() if len(t)), key=lambda one: one[1]))

    @cached_property
    def fixes(self) -> Float[np.ndarray, "N 2"] | None:
        """Positions as a sensor measured them: north, east [m]; None when there is no such sensor."""
        for name, series in self.sensors.items():
            if any(word in name.lower() for word in _FIX_NAMES) and sensor_values(series).shape[1] >= 2:
                return sensor_values(series)[:, :2]
        return None

    @cached_property
    def phases(self) -> list[Interval]:
        """Phases in order of time; empty without `autopilot/mode`."""
        mode = self.get("autopilot/mode")
        if mode is None or "phase" not in mode.channel.fields:
            return []
        waypoints = mode["waypoint"] if "waypoint" in mode.channel.fields else np.zeros(len(mode))
        state = np.nan_to_num(np.column_stack([mode["phase"], waypoints])).astype(int)
        starts = np.flatnonzero(np.r_[True, (np.diff(state, axis=0) != 0).any(axis=1)])
        times = np.r_[mode.t[starts], mode.t[-1]]
        return [
            Interval(float(times[k]), float(times[k + 1]), phase_name(state[i, 0]), int(state[i, 1]))
            for k, i in enumerate(starts)
            if times[k + 1] > times[k] or k == 0
        ]

    @cached_property
    def first_dive_end(self) -> float:
        """When the first dive ended [s]; the start of the log when there was none."""
        dives = [p.end for p in self.phases if p.phase == "dive"]
        return dives[0] if dives else self.span[0]

    @cached_property
    def span(self) -> tuple[float, float]:
        """First and last time of what is drawn [s]."""
        names = ("truth/eta", "autopilot/eta", "autopilot/mode", "autopilot/reference")
        series = [self[name] for name in names if self.has(name)]
        start = min((float(s.t[0]) for s in series), default=self.log.start)
        end = max((float(s.t[-1]) for s in series), default=self.log.end)
        return start, max(end, start + 1e-3)

    def json(self, key: str) -> Any:
        """A metadata entry that holds JSON; None when it is missing or cannot be read."""
        try:
            return json.loads(self.log.metadata.get(key, "null"))
        except ValueError:
            return None

    @cached_property
    def world(self) -> Mapping[str, Any]:
        """Section `world` of the scenario that was flown; empty when unknown."""
        try:
            found = parse_yaml(self.log.metadata.get("scenario", ""), "scenario").get("world")
        except ConfigError:
            return {}
        return found if isinstance(found, Mapping) else {}

    @cached_property
    def tank(self) -> tuple[tuple[float, float], tuple[float, float]] | None:
        """South-western and north-eastern corner of the tank: north, east [m]; None without one."""
        tank = self.world.get("tank")
        spans: list[Any] = [tank.get(axis) for axis in ("north", "east")] if isinstance(tank, Mapping) else []
        if not spans or not all(isinstance(s, list) and len(s) == 2 and all(map(is_finite, s)) for s in spans):
            return None
        (south, north), (west, east) = spans
        return (float(south), float(west)), (float(north), float(east))

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Figures of the run, as whoever flew it computed them; empty when there are none."""
        found = self.json("summary")
        return found if isinstance(found, dict) else {}

    @cached_property
    def faults(self) -> list[FaultSpan]:
        """Faults that came during the run, in order of time, empty batteries too; those for good end with it."""
        start, end = self.span
        given = self.json("faults")
        listed = [one for one in given if isinstance(one, Mapping)] if isinstance(given, list) else []
        listed += [
            {"what": f"battery {name} empty", "start": t, "thrusters": self._fed_by(name)}
            for name, t in self.emptied.items()
        ]
        came = [one for one in listed if is_finite(one.get("start")) and one["start"] <= end]
        return [
            FaultSpan(
                k,
                str(one.get("what", "fault")),
                max(float(one["start"]), start),
                min(float(one["end"]), end) if is_finite(one.get("end")) else end,
                tuple(str(name) for name in one.get("thrusters") or ()),
            )
            for k, one in enumerate(sorted(came, key=lambda one: one["start"]), start=1)
        ]

    def _fed_by(self, battery: str) -> list[str]:
        """Thrusters that hang on a battery, as the vehicle's table names them."""
        table = self.json("vehicle_table")
        listed = table.get("batteries") if isinstance(table, Mapping) else None
        for one in listed if isinstance(listed, list) else []:
            # The log's fields have no dots: port of rov is rov_port there.
            if isinstance(one, Mapping) and str(one.get("name")).replace(".", "_") == battery:
                return list(one.get("thrusters") or [])
        return []

    @cached_property
    def waypoints(self) -> list[dict[str, Any]]:
        """Way-points of all missions that were flown: position as x, y and (if given) z, `name`, number of mission."""
        points = [
            _waypoint(one) | {"name": point_name(self.missions, i, k), "mission": i}
            for i, mission in enumerate(self.missions)
            for k, one in enumerate(mission.waypoints)
        ]
        return [point for point in points if is_finite(point.get("x")) and is_finite(point.get("y"))]

    @cached_property
    def missions(self) -> list[FlownMission]:
        """Missions that were flown, in order of time."""
        return missions_of(self.log.metadata)

    @cached_property
    def datum(self) -> Datum | None:
        """Where on Earth n lies; None when the log does not say."""
        return datum_of(self.log.metadata)

    @cached_property
    def start_on_map(self) -> str:
        """Map coordinates of where the vehicle began, in words; empty when unknown."""
        pose = self.get("truth/eta") or self.get("autopilot/eta")
        known = [] if pose is None else pose.values[np.isfinite(pose.values[:, :3]).all(axis=1), :3]
        if self.datum is None or not len(known):
            return ""
        latitude, longitude, _ = self.datum.geodetic(known[0])
        return coordinates_text(float(latitude), float(longitude))

    @cached_property
    def current(self) -> Float[np.ndarray, "2"] | None:
        """Mean horizontal water velocity, north and east [m/s].

        None when unknown, nearly still, or lost in what goes to and fro with waves.
        """
        water = self.get("truth/water_velocity")
        if water is None:
            return None
        mean, spread = np.nanmean(water.values[:, :2], axis=0), np.nanstd(water.values[:, :2], axis=0)
        return mean if np.hypot(*mean) > max(5e-3, 0.15 * np.hypot(*spread)) else None

    @cached_property
    def wave_direction(self) -> float | None:
        """Where the waves run to, clockwise from north [rad]; None without waves."""
        waves = self.json("waves")
        if not isinstance(waves, Mapping):
            return None
        for key, factor in (("direction_rad", 1.0), ("direction_deg", np.pi / 180)):
            if is_finite(waves.get(key)):
                return factor * float(waves[key])
        return None

    @cached_property
    def cross_track(self) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, " N"]] | None:
        """Time and distance to the commanded path [m], NaN where it does not count."""
        series = self.get("score/cross_track")
        if series is None or "distance" not in series.channel.fields:
            return None
        counts = series["valid"] > 0.5 if "valid" in series.channel.fields else np.ones(len(series), bool)
        return series.t, np.where(counts, series["distance"], np.nan)

    @cached_property
    def station(self) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, " N"]] | None:
        """Time and true horizontal distance to the way-point aimed at [m]."""
        pose, leg = self.get("truth/eta") or self.get("autopilot/eta"), self.get("autopilot/leg")
        if pose is None or leg is None:
            return None
        return pose.t, np.linalg.norm(pose.values[:, :2] - at(leg, pose.t)[:, 3:5], axis=1)

    @cached_property
    def depth_error(self) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, " N"]] | None:
        """Time and true (without truth: estimated) minus commanded depth [m]."""
        pose, setpoint = self.get("truth/eta") or self.get("autopilot/eta"), self.get("autopilot/setpoint")
        if pose is None or setpoint is None:
            return None
        return pose.t, pose["z"] - at(setpoint, pose.t)[:, 2]

    @cached_property
    def error(self) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, "N 12"]] | None:
        """Estimate minus truth at the times of the estimate: t, then pose and velocity."""
        parts = [(self.get(f"autopilot/{name}"), self.get(f"truth/{name}")) for name in ("eta", "nu")]
        if any(one is None for pair in parts for one in pair):
            return None
        (eta, true_eta), (nu, true_nu) = parts
        assert eta and true_eta and nu and true_nu
        pose = eta.values - at(true_eta, eta.t, angles=slice(3, 6))
        pose[:, 3:] = wrapped(pose[:, 3:])
        velocity = at(nu, eta.t) - at(true_nu, eta.t)
        return eta.t, np.hstack([pose, velocity])


def phase_name(number: int) -> str:
    """The phase as a word, also of a number nobody knows."""
    return PHASES[number] if 0 <= number < len(PHASES) else f"phase {number}"


def _waypoint(one: Mapping[str, Any]) -> dict[str, Any]:
    position = one.get("position")
    if not isinstance(position, list):
        return dict(one)
    rest = {key: value for key, value in one.items() if key != "position"}
    return dict(zip("xyz", position, strict=False)) | rest
