"""A twin is recorded as fast as its clock runs, whichever that is."""

import numpy as np

from rovtwin.core.flow import Slot
from rovtwin.core.log import Log
from rovtwin.links.twin import TwinLink
from rovtwin.live import readiness
from rovtwin.live import record as recording
from rovtwin.runs.pace import Clock
from rovtwin.scenario.files import load_scenario

PERIOD = 0.02


class Slept(Clock):
    """Time that passes by sleeping alone."""

    def __init__(self, speed):
        super().__init__(0.0)
        self.speed, self.now = speed, 0.0

    def __call__(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds * self.speed


def test_readings_of_a_fast_twin_are_not_late(tmp_path, monkeypatch):
    """At four times real time it fell behind by more than half: one period was computed, then it rested for 10 ms."""
    clock = Slept(4.0)

    def advance(memory, command, k):
        return memory, {"pressure": Slot(np.array([[1.0]]), np.array([True]), np.array([PERIOD * (k + 1)]))}

    monkeypatch.setattr(recording.time, "sleep", clock.sleep)
    monkeypatch.setattr(readiness, "SETTLING", 0.0)
    path = tmp_path / "rest.mcap"
    counts = recording.record(
        load_scenario("lawnmower_calm"), TwinLink(advance, 0, 6, PERIOD, clock), (), clock, path, 2.0
    )
    assert counts["pressure"] >= 2.0 / PERIOD - 2
    readings = Log.read(path)["sensor/pressure"]
    assert np.max(readings.t - readings["t_valid"]) < 2 * PERIOD
