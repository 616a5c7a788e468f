"""A log as a vehicle to be served: what it measured comes again, commands move nothing."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rovtwin.core.errors import LogError
from rovtwin.core.flow import Measurement
from rovtwin.core.frames import readings_in_body
from rovtwin.core.log import Log
from rovtwin.core.numerics import as_array
from rovtwin.core.sensors import kind_of
from rovtwin.core.types import Matrix3
from rovtwin.core.user_files.yamlfile import parse_yaml
from rovtwin.links.replay import readings_of
from rovtwin.links.servers.pilot_command import PilotCommand
from rovtwin.live.serving.vehicle import OF_A_DRONE, drones_of
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.runs.compose.sensors import rotated, sensors_of
from rovtwin.scenario.files import scenario_of
from rovtwin.scenario.schema import Scenario

EARLY = 1e-3  # of a period: readings at its edge belong to one period, however times were rounded


class ReplayedVehicle:
    """Readings of a run's log, period by period; each drone of a vehicle of several measures what the whole did.

    Attributes:
        scenario: Of the run.
        dt: Control period [s].
        drones: Names of its drones.
        largest: Wrench of a drone along each axis, zeros: nothing moves it.
        duration: Of the log [s]; infinite when it begins again at the end.
    """

    def __init__(self, log: Log, loop: bool = False):
        """Raises LogError where the log is not that of a run, or has no readings."""
        text = log.metadata.get("scenario")
        if not text:
            raise LogError(f"{log.source}: found no scenario in it, expected the log of a run, runs/<run>/log.mcap")
        self.scenario: Scenario = scenario_of(parse_yaml(text, log.source), log.source)
        self.dt = self.scenario.control_dt
        vehicle = vehicle_of(self.scenario)
        self.drones = tuple(drones_of(vehicle))
        self.largest = {drone: np.zeros(6) for drone in self.drones}
        self._arrivals, self._readings = readings_of(log)
        if not self._readings:
            raise LogError(f"{log.source}: found no sensor channels, expected those of a run with log.sensors on")
        for name, rotation in rotated(sensors_of(self.scenario, vehicle)).items():
            self._turn(name, rotation)
        self._ticks, self._loop = int(np.floor(self._arrivals[-1] / self.dt + EARLY)) + 1, loop
        self._tick = 0

    def _turn(self, name: str, rotation: Matrix3) -> None:
        """A sensor's readings along the axes of b, as a vehicle tells them."""
        its = [i for i, reading in enumerate(self._readings) if reading.sensor == name]
        if its:
            values = readings_in_body(as_array([self._readings[i].value for i in its]), kind_of(name), rotation)
            for i, value in zip(its, np.asarray(values), strict=True):
                self._readings[i] = replace(self._readings[i], value=value)

    @property
    def duration(self) -> float:
        return np.inf if self._loop else self._ticks * self.dt

    @property
    def now(self) -> float:
        """Time since the beginning [s]; it goes on when the log begins again."""
        return self._tick * self.dt

    def advance(self, commands: Mapping[str, PilotCommand]) -> list[Measurement]:
        """What was measured in the next period."""
        k = self._tick % self._ticks if self._loop else self._tick
        begin, end = np.searchsorted(self._arrivals, [(k - EARLY) * self.dt, (k + 1 - EARLY) * self.dt])
        later = (self._tick - k) * self.dt
        self._tick += 1
        found = [Measurement(r.sensor, r.value, r.t_valid + later) for r in self._readings[begin:end]]
        if self.drones == ("",):
            return found
        whole = [r for r in found if r.sensor not in OF_A_DRONE]
        own = [r for r in found if r.sensor in OF_A_DRONE]
        return whole + [Measurement(f"{d}/{r.sensor}", r.value, r.t_valid) for d in self.drones for r in own]
