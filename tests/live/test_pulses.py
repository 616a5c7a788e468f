"""Commands by a time-line beside a twin that waits while somebody thinks."""

import time

import numpy as np
import pytest

from rovtwin.core.flow import Slot
from rovtwin.core.sensors import ESSENTIAL, SENSORS
from rovtwin.links.twin import TwinLink
from rovtwin.live.pulses import Guard, Pulse, fly_pulses
from rovtwin.runs.pace import Clock
from rovtwin.scenario.files import load_scenario

pytestmark = pytest.mark.system


def test_who_thinks_for_minutes_before_a_yes_finds_a_twin_that_speaks(tmp_path):
    """It caught up with the time that had passed, was silent meanwhile, and the pushes ended: "gyro fell silent"."""
    scenario, clock = load_scenario("lawnmower_calm"), Clock()
    dt = scenario.control_dt

    def advance(memory, command, k):
        time.sleep(0.001)  # of computing
        now = np.array([True]), np.array([dt * (k + 1)])
        return memory, {name: Slot(np.zeros((1, SENSORS[name].size)), *now) for name in ESSENTIAL}

    def thinks():
        clock.slip(-600.0)
        return True

    link = TwinLink(advance, 0, 6, dt, clock, prompt=True)
    pulse = Pulse("ahead", np.full(6, 0.1), 0.4)
    flown = fly_pulses(scenario, link, (), clock, tmp_path / "dip", [pulse], Guard(), thinks)
    assert flown.ended == "" and flown.readings["gyro"] > 0.2 / dt
