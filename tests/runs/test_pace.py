"""Lateness of a loop's periods."""

import pytest

from rovtwin.runs.pace import Pace


def test_a_loop_that_never_began_was_never_late():
    assert Pace().figures() == {"late_ms_p50": 0.0, "late_ms_p99": 0.0, "late_ms_max": 0.0, "slipped_s": 0.0}


def test_late_periods_are_counted_to_the_end_of_their_step():
    pace, times = Pace(), iter([0.0, 0.0, 0.0, 0.05])
    for _ in range(4):
        pace.wait(0.0, lambda: next(times))
    found = pace.figures()
    assert found["late_ms_p50"] < 1.0 and 50.0 <= found["late_ms_p99"] and found["late_ms_max"] == pytest.approx(50.0)
