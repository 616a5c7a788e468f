"""The twin behind a link: what its clock is ahead by while nobody looks is given up, not computed."""

import numpy as np

from rovtwin.core.flow import Slot
from rovtwin.links.twin import TwinLink
from rovtwin.runs.pace import Clock


def counting(clock):
    """A twin that counts its periods of 20 ms, and tells the time of each."""

    def advance(memory, command, k):
        slot = Slot(np.array([[float(k)]]), np.array([True]), np.array([0.02 * (k + 1)]))
        return memory + 1, {"pressure": slot}

    return TwinLink(advance, 0, 2, 0.02, clock)


def test_time_that_passed_while_nobody_looked_is_given_up_and_readings_are_of_now():
    clock = Clock(0.0)
    link = counting(clock)
    clock.slip(-200.0)  # minutes of compilation
    assert link.is_due
    link.go_on_from_here()
    assert not link.is_due and link.memory == 0 and clock() < 0.02
    clock.slip(-0.03)
    (reading,) = link.read()
    assert abs(reading.t_valid - clock()) < 0.02


def test_a_clock_that_cannot_wait_is_caught_up_with():
    link = counting(lambda: 0.1)
    link.go_on_from_here()
    assert sum(len(link.read()) for _ in range(9)) == 5
