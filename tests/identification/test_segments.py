"""Records cut into segments: commands keep their time, whatever the phase of the grid."""

import numpy as np
import pytest

from rovtwin.identification.joint.solver.segments import Grid, cut, nodes_from_data
from rovtwin.identification.logs.record import Record, Signal

STEP = 0.02


def driven(start=0.0, period=STEP, seconds=1.0):
    t = np.arange(0.0, seconds, period)
    u = np.sin(3 * t)[:, None] * np.array([1.0, -0.5])
    read = np.arange(start, seconds, 0.05)
    whole = Record("x", t, u, {"depth": Signal(read, np.ones((len(read), 1)))}, seconds)
    return whole.cut(start, seconds) if start else whole


def commands(record, steps=10):
    segments = cut([record], Grid(STEP, steps))
    held, command = segments.arrays["held"], segments.arrays["command"]
    assert np.allclose(held.sum(axis=-1), 1.0)
    return np.einsum("skm,skmn->skn", held, command).reshape(-1, 2)


def test_commands_on_the_grid_are_taken_as_they_are():
    record = driven()
    assert np.allclose(commands(record)[: len(record.t_command)], record.command, atol=1e-12)


@pytest.mark.parametrize("start", [0.01, 0.004, 0.013])
def test_commands_off_the_grid_come_neither_early_nor_late(start):
    """Taken in the middle of a step, all commands of a record that starts half a step off came half a step early."""
    found = commands(driven(start))[:40]
    share = (STEP - start % STEP) / STEP
    u = np.sin(3 * STEP * np.arange(42))[:, None] * np.array([1.0, -0.5])
    assert np.allclose(found, share * u[:40] + (1 - share) * u[1:41], atol=1e-12)
    middle = start + STEP * (np.arange(40) + 0.5)
    late = np.sin(3 * (middle - STEP / 2))  # a held command is half a period behind what it holds
    assert np.abs(found[:, 0] - late).max() < 1e-3


def test_commands_slower_and_faster_than_the_grid():
    slow = driven(period=0.5)
    assert np.allclose(commands(slow)[:25], slow.command[0]) and np.allclose(commands(slow)[25:50], slow.command[1])
    fast = driven(period=0.005)
    assert np.allclose(commands(fast)[0], fast.command[:4].mean(axis=0))
    faster = driven(period=0.001)
    assert np.allclose(commands(faster)[0], faster.command[:20].mean(axis=0), atol=2e-3)


@pytest.mark.parametrize("first", [0.005, 0.012])
def test_of_many_readings_those_nearest_to_the_grid_are_used(first):
    """The grid begins with the record, not with the signal: half a step off it a reading is interpolated the most."""
    t = np.arange(first, 1.0, 0.01)
    record = Record("x", np.array([0.0]), np.zeros((1, 2)), {"gyro": Signal(t, np.zeros((len(t), 3)))}, 1.0)
    rows = cut([record], Grid(STEP, 50, 20.0)).arrays["gyro"]
    share = rows["share"][rows["used"] > 0.0]
    assert len(share) > 15 and np.minimum(share, 1.0 - share).max() < 0.26


@pytest.mark.parametrize("exact", [False, True])
def test_nodes_are_states_of_co_not_of_the_sensors(exact):
    """A vehicle that turns on the spot: a DVL ahead of CO reads a speed, a positioning mark goes in circles."""
    r, t = 0.5, np.arange(0.0, 10.0, 0.02)
    heading, zero = r * t, np.zeros_like(t)
    ahead = np.array([0.4, 0.0, 0.0])
    attitude = Signal(t, np.stack([zero, zero, heading], axis=1))
    gyro = Signal(t, np.stack([zero, zero, zero + r], axis=1))
    speed = Signal(t, np.stack([zero, zero + r * ahead[0], zero], axis=1), lever=ahead)
    circle = ahead[0] * np.stack([np.cos(heading), np.sin(heading), zero], axis=1)
    for name, signal in (("velocity", speed), ("position", Signal(t, circle, lever=ahead))):
        signals = {"attitude": attitude, "gyro": gyro, name: signal}
        log = Record("turning", np.array([0.0]), np.zeros((1, 6)), signals, 10.0)
        nodes = nodes_from_data(cut([log], Grid(0.02, 100)), exact=exact)
        np.testing.assert_allclose(nodes["nu"][1:-1, :3], 0.0, atol=5e-3)
        if name == "position":
            np.testing.assert_allclose(nodes["position"][1:-1], 0.0, atol=5e-3)


@pytest.mark.parametrize(("first", "begins"), [(0.0, 0.0), (0.3, 1.0)])
def test_readings_count_once_thrusters_have_settled_from_what_nobody_knows(first, begins):
    read = np.arange(0.05, 8.0, 0.05)
    record = Record("x", np.array([0.0, 0.5]), np.array([[first], [0.7]]), {"depth": Signal(read, read[:, None])}, 8.0)
    rows = cut([record], Grid(STEP, 50, settling=1.0)).arrays["depth"]
    assert rows["value"][rows["used"] > 0.0].min() == pytest.approx(max(begins, 0.05))


def test_of_a_short_record_no_more_than_a_quarter_is_left_out():
    read = np.arange(0.05, 2.0, 0.05)
    record = Record("x", np.array([0.0]), np.array([[0.5]]), {"depth": Signal(read, read[:, None])}, 2.0)
    rows = cut([record], Grid(STEP, 50, settling=1.0)).arrays["depth"]
    assert rows["value"][rows["used"] > 0.0].min() == pytest.approx(0.5)
