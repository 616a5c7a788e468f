"""ClockMap and Due."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rovtwin.links.clock import ClockMap, Due


def run(clock: ClockMap, device: np.ndarray, arrival: np.ndarray) -> np.ndarray:
    return np.array([clock(float(d), float(a)) for d, a in zip(device, arrival, strict=True)])


def delayed(rng: np.random.Generator, t: np.ndarray, least: float = 0.004) -> np.ndarray:
    """Arrivals over a network: never faster than `least`, most close to it, some late, none overtaking."""
    return np.maximum.accumulate(t + least + rng.exponential(0.003, t.size))


def test_times_are_those_of_the_fastest_way():
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 60.0, 0.02)
    mapped = run(ClockMap(), t + 1.6e9, delayed(rng, t))
    error = mapped - t
    assert np.abs(error[100:] - 0.004).max() < 5e-4  # the constant of the way is all that is left
    assert error[0] >= 0.004


def test_clocks_that_drift_apart():
    """200 ppm for ten minutes would be 0.12 s; the window forgets."""
    rng = np.random.default_rng(2)
    t = np.arange(0.0, 600.0, 0.1)
    for rate in (1.0 + 2e-4, 1.0 - 2e-4):
        error = run(ClockMap(), rate * t, delayed(rng, t)) - t
        assert np.abs(error[100:] - 0.004).max() < 0.012


@pytest.mark.parametrize("leap", [3600.0, -3600.0, 2.0, -2.0])
def test_a_jump_is_accepted_after_a_second(leap):
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 20.0, 0.05)
    arrival = delayed(rng, t)
    device = t + np.where(t >= 10.0, leap, 0.0)
    clock = ClockMap()
    mapped = run(clock, device, arrival)
    assert (mapped <= arrival).all()
    assert clock.jumps == 1
    settled = (t < 10.0) | (t > 11.2)
    assert np.abs(mapped - t)[settled].max() < 0.05


def test_one_wrong_stamp_changes_nothing():
    t = np.arange(0.0, 10.0, 0.05)
    arrival = t + 0.004
    device = t.copy()
    device[[50, 90, 91]] = [1e12, -1e12, 5e11]
    mapped = run(ClockMap(), device, arrival)
    good = np.ones(t.size, dtype=bool)
    good[[50, 90, 91]] = False
    # What follows a stamp from the far future may not lie before it: it is held at that arrival, for one message.
    assert np.abs(mapped - t - 0.004)[good].max() < 0.05
    assert np.abs(mapped - t - 0.004)[good & (t > 5.0)].max() < 1e-9
    assert (mapped <= arrival).all()


def test_a_stall_keeps_the_times():
    """Two seconds of readings held back come at once: each still has its own time."""
    t = np.arange(0.0, 20.0, 0.05)
    arrival = np.where((t >= 10.0) & (t < 12.0), 12.0, t) + 0.004
    clock = ClockMap()
    mapped = run(clock, t, arrival)
    assert clock.jumps == 0
    np.testing.assert_allclose(mapped, t + 0.004, atol=1e-9)


def test_a_first_message_that_was_late():
    """What waited 5 s in a buffer sets no standard."""
    t = np.arange(0.0, 10.0, 0.05)
    arrival = t + 0.004
    arrival[0] = 5.0
    arrival = np.maximum.accumulate(arrival)
    mapped = run(ClockMap(), t, arrival)
    assert np.abs(mapped - t - 0.004)[t > 6.5].max() < 1e-9


def test_sent_is_not_valid():
    """The time from validity to sending is the instrument's own, and known."""
    clock = ClockMap()
    for k in range(50):
        sent = 100.0 + 0.1 * k
        age = 0.02 + 0.01 * (k % 3)
        assert clock(sent - age, 5.0 + 0.1 * k + 0.001, sent) == pytest.approx(5.0 + 0.1 * k + 0.001 - age, abs=0.031)
    assert clock(200.0, math.nan) is not None


@pytest.mark.parametrize("speed", [0.5, 0.9, 2.0, 10.0])
def test_a_twin_that_is_not_in_real_time(speed):
    """A device's clock at another speed than ours: times stay within seconds of the arrival."""
    t = np.arange(0.0, 120.0, 0.1)
    mapped = run(ClockMap(), speed * t, t)
    assert (t - mapped).max() < 0.25 + 3.2 * max(0.0, 1.0 - speed)


def test_our_own_clock_set_back():
    clock = ClockMap()
    for k in range(20):
        clock(float(k), 1000.0 + k)
    assert clock(20.0, 20.0) == 20.0
    assert clock(21.0, 21.0) == 21.0


@given(st.lists(st.tuples(st.floats(), st.floats(0.0, 1e6)), max_size=60))
def test_never_after_arrival_never_back(stamps):
    """Whatever a device stamps, a time is a number, not in the future, and not before the last."""
    clock, last = ClockMap(), -math.inf
    for arrival, device in zip(sorted(a for _, a in stamps), (d for d, _ in stamps), strict=True):
        mapped = clock(device, arrival)
        assert math.isfinite(mapped) and mapped <= arrival
        if math.isfinite(device):
            assert mapped >= last
            last = mapped


def test_due_keeps_the_rate():
    due = Due(0.2)
    times = [k * 0.02 for k in range(500) if due(k * 0.02)]
    np.testing.assert_allclose(times, np.arange(0.0, 9.9, 0.2), atol=1e-9)


def test_due_after_a_gap_and_from_the_start_again():
    due = Due(0.2)
    assert [due(t) for t in (0.0, 0.1, 0.2, 5.0, 5.1, 5.21, 0.0, 0.1, 0.2)] == [
        *(True, False, True),
        *(True, False, True),
        *(True, False, True),
    ]
