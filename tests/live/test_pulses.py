"""Commands by a time-line beside a twin that waits while somebody thinks."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

from rovtwin.core.flow import Slot
from rovtwin.core.sensors import ESSENTIAL, SENSORS
from rovtwin.links.twin import TwinLink
from rovtwin.live.pulses import Guard, Pulse, _Run, fly_pulses
from rovtwin.live.readiness import SensorMux
from rovtwin.runs.pace import Clock
from rovtwin.scenario.files import load_scenario


@pytest.mark.system
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


def floating(clock, dt, measures_depth=True):
    """A vehicle that dives with 1 m/s times its command and floats up else, from below the surface."""

    def advance(depth, command, k):
        depth = max(depth + dt * (float(command.u[0]) or -0.02), 0.1)
        now = np.array([True]), np.array([dt * (k + 1)])
        found = {name: Slot(np.zeros((1, SENSORS[name].size)), *now) for name in ("gyro", "attitude")}
        return depth, found | ({"pressure": Slot(np.array([[depth]]), *now)} if measures_depth else {})

    return TwinLink(advance, 0.1, 1, dt, clock, prompt=True)


@pytest.mark.parametrize("measures_depth", [True, False])
def test_a_push_down_ends_at_its_depth_and_is_left_out_below(measures_depth):
    clock, scenario = Clock(10.0), load_scenario("lawnmower_calm")
    link = floating(clock, scenario.control_dt, measures_depth)
    written = SimpleNamespace(annotate=lambda what: None, write=lambda *row: None)
    names = {"gyro", "attitude", "pressure"}
    run = _Run(scenario, link, SensorMux(link, ()), clock, written, Guard(), 1, names, None)
    down, rest = Pulse("down", np.array([0.5]), 2.0, down_to=0.5), Pulse("rest", np.zeros(1), 0.2)
    ended, spans, _ = run.through([rest, down, rest, down, rest], lambda t, what: None)
    assert ended == ""
    if not measures_depth:
        assert [what for *_, what in spans] == ["rest"] * 3
        return
    assert [what for *_, what in spans] == ["rest", "down", "rest", "rest"], "deep enough the second time"
    assert 0.4 < spans[1][1] - spans[1][0] < 1.6, "0.8 s, as far as this machine keeps time"
    assert spans[2][0] == spans[1][1]
