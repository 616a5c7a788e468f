"""Pulses: whoever is asked may think for long, and no sensor was silent meanwhile."""

import time
from types import SimpleNamespace

import numpy as np

from rovtwin.core.flow import Slot
from rovtwin.links.twin import TwinLink
from rovtwin.live.pulses import Guard, _Run
from rovtwin.live.readiness import SensorMux
from rovtwin.runs.pace import Clock
from rovtwin.scenario.files import load_scenario


def test_a_twin_that_waited_for_an_answer_is_not_taken_for_one_that_fell_silent():
    def advance(memory, command, k):
        time.sleep(0.002)  # what a period takes to compute
        slot = Slot(np.zeros((1, 3)), np.array([True]), np.array([0.02 * (k + 1)]))
        return memory, {"gyro": slot, "attitude": slot}

    clock, written, scenario = Clock(), [], load_scenario("lawnmower_calm")
    link = TwinLink(advance, 0, 2, scenario.control_dt, clock)
    clock.slip(-20.0)  # somebody looks at the vehicle, then says yes
    writer = SimpleNamespace(annotate=written.append, write=lambda *row: written.append(row))
    run = _Run(scenario, link, SensorMux(link, ()), clock, writer, Guard(), 2, {"gyro", "attitude"}, None)
    assert [run._tick(k, np.zeros(2), None) for k in range(3)] == ["", "", ""]
    assert any(row[0] == "sensor/gyro" for row in written if isinstance(row, tuple))
