"""The twin's link in the console's host: orders, arming after a stop, and the leash where time runs fast."""

import time

import numpy as np
import pytest

from rovtwin.console.engine.world import LEASH, TRUTH, WorldLink
from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Command, Slot
from rovtwin.links.twin import TwinLink
from rovtwin.runs.pace import Clock

DT = 0.02


class SmallWorld(WorldLink):
    """Without a vehicle: it tells its depth each period, and `u` is what its thrusters were sent."""

    def __init__(self, clock):
        self._clock_, self._silent, self._truth, self.u = clock, set(), np.zeros(10), []
        TwinLink.__init__(self, self._moved, None, 2, DT, clock)
        self._reached, self._leash = np.inf, LEASH

    def _moved(self, memory, command, k):
        self.u.append(np.asarray(command.u).tolist())
        self._truth = np.full(10, float(k))
        return memory, {"pressure": Slot(np.full((1, 1), 2.0), np.array([True]), np.array([k * DT]))}


def world(t, speed=1.0):
    """A world whose clock says t [s] and runs from there."""
    clock = Clock()
    clock.follow((time.monotonic(), t, speed))
    return SmallWorld(clock)


def read_all(link, most=1000):
    """What it tells until it has caught up with its clock, and how many ticks that took."""
    before, found = link.tick, []
    for _ in range(most):
        news = link.read()
        if not news:
            break
        found += news
    return found, link.tick - before


def test_a_fast_world_waits_for_the_autopilot():
    link = world(10.0, speed=20.0)
    link.tell(("reached", 0.0))
    read_all(link)
    assert LEASH < (link.tick + 0.5) * DT < LEASH + 2 * DT
    assert read_all(link)[1] == 0  # a hung autopilot keeps it here for ever
    link.tell(("reached", 1.0))
    read_all(link)
    assert 1.0 + LEASH < (link.tick + 0.5) * DT < 1.0 + LEASH + 2 * DT


def test_in_real_time_it_waits_for_nobody():
    link = world(1.0)
    link.tell(("reached", 0.0))
    assert read_all(link)[1] >= 50


def test_a_command_counts_from_when_it_comes():
    """In the period under way, not in those that have passed and were not computed yet."""
    link = world(0.0)
    link.arm()
    link.tell(("pace", time.monotonic(), 2.5 * DT, 0.0))
    link.send(Command(np.full(2, 0.5)))
    found, _ = read_all(link)
    assert link.u == [[0.0, 0.0]] * 2 and [reading.sensor for reading in found] == ["pressure", TRUTH] * 2
    link.tell(("pace", time.monotonic(), 3.5 * DT, 0.0))
    read_all(link)
    assert link.u[2:] == [[0.5, 0.5]]


def test_a_test_flown_fast_is_in_step_to_the_tick():
    link = world(10.0, speed=20.0)
    link._leash = 0.0
    for k in range(3):
        link.tell(("reached", k * DT))  # the command of this tick is here
        read_all(link)
        assert link.tick == k + 1


def test_stopped_time_stands_and_goes_on_from_there():
    link = world(0.1)
    read_all(link)
    link.tell(("pace", time.monotonic(), 0.1, 0.0))
    time.sleep(2 * DT)
    assert read_all(link) == ([], 0)
    link.tell(("pace", time.monotonic(), 0.1 + 2.5 * DT, 0.0))
    assert read_all(link)[1] == 2


def test_the_truth_ends_each_tick_and_a_silenced_sensor_is_left_out():
    link = world(2.5 * DT)
    link.tell(("pace", time.monotonic(), 2.5 * DT, 0.0))
    assert [reading.sensor for reading in read_all(link)[0]] == ["pressure", TRUTH] * 2
    link.tell(("sensor", "pressure", False))
    link.tell(("pace", time.monotonic(), 3.5 * DT, 0.0))
    (truth,), _ = read_all(link)
    assert truth.sensor == TRUTH and truth.t_valid == pytest.approx(3 * DT)
    link.tell(("sensor", "pressure", True))
    link.tell(("pace", time.monotonic(), 4.5 * DT, 0.0))
    assert len(read_all(link)[0]) == 2


def test_stop_holds_until_it_is_armed_anew():
    link = world(0.0)
    for do, reported in ((lambda: None, 0.5), (link.stop, 0.0), (link.arm, 0.5)):
        do()
        link.send(Command(np.full(2, 0.5)))
        link.tell(("pace", time.monotonic(), (link.tick + 1.5) * DT, 0.0))
        read_all(link)
        assert link.u[-1] == [reported, reported]
    link.close()
    with pytest.raises(LinkError, match="closed"):
        link.arm()


def test_an_order_that_there_is_not_is_a_mistake():
    with pytest.raises(ValueError, match="no such"):
        world(0.0).tell(("no such", 1))
