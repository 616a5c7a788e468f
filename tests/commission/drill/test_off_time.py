"""When thrusters went off, from readings of a push that ended at a known time."""

import numpy as np
import pytest

from rovtwin.commission.drill.exercises import AROUND, CUT, PUSH, SILENT, STOP, push_of
from rovtwin.commission.drill.off_time import off_time
from rovtwin.core.errors import IdentificationError
from rovtwin.identification.logs.record import Record, Signal
from rovtwin.identification.logs.response import commanded_motion
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.constants import AXES

BEGAN, EVENT, END = 2.0, 3.2, 5.7
YAW = AXES.index("yaw")


@pytest.fixture(scope="module")
def model():
    return load_vehicle("double_blueye").model()


def record_of(model, u, ended, noise=2e-3, strength=1.0):
    """Gyro and attitude of a vehicle, pushed from BEGAN until `ended` [s]; `strength` times what its file says."""
    t = np.array([0.0, BEGAN, ended, END])
    moved = commanded_motion(model, t, np.stack([0.0 * u, u, 0.0 * u, 0.0 * u]))["gyro"]
    grid = np.arange(0.0, END, 0.01)
    rate = np.stack([np.interp(grid, moved.t, strength * moved.value[:, i]) for i in range(3)], axis=1)
    gyro = rate + noise * np.random.default_rng(1).normal(size=rate.shape)
    heading = np.cumsum(rate[:, 2]) * 0.01
    attitude = np.stack([0.0 * heading, 0.0 * heading, heading], axis=1)
    signals = {"gyro": Signal(grid, gyro), "attitude": Signal(grid, attitude)}
    return Record("drill", t[:1], np.zeros((1, len(u))), signals, END)


@pytest.mark.system
@pytest.mark.parametrize("late", [0.0, 0.3, 1.1])
@pytest.mark.parametrize("strength", [1.0, 0.5])
def test_it_is_when_the_push_ended_whatever_its_strength(model, late, strength):
    push = push_of(model, STOP)
    record = record_of(model, push.u, EVENT + late, strength=strength)
    found = off_time(model, record, YAW, push.u, BEGAN, EVENT, END)
    assert found.low - 0.05 <= late <= found.high + 0.05 and not found.lasted
    assert found.high - found.low < 0.2 and found.seconds == pytest.approx(late, abs=0.06)


def test_a_push_that_never_ends_lasts(model):
    push = push_of(model, STOP)
    found = off_time(model, record_of(model, push.u, END), YAW, push.u, BEGAN, EVENT, END)
    assert found.lasted and found.low > 1.5, found


def test_what_is_not_felt_has_no_end(model):
    push = push_of(model, STOP)
    record = record_of(model, push.u, EVENT, strength=0.0)
    assert off_time(model, record, YAW, push.u, BEGAN, EVENT, END) is None


def test_missing_readings_are_named(model):
    push = push_of(model, STOP)
    record = record_of(model, push.u, EVENT)
    cut = {name: signal.cut(0.0, EVENT) for name, signal in record.signals.items()}
    with pytest.raises(IdentificationError, match="s of readings, expected"):
        off_time(model, Record("drill", record.t_command, record.command, cut, END), YAW, push.u, BEGAN, EVENT, END)


@pytest.mark.system
@pytest.mark.parametrize("name", ["double_blueye", "bluerov2_heavy", "gladius_mini", "blueye_pioneer", "sparus_ii"])
def test_every_vehicle_has_a_push_for_every_exercise(name):
    model = load_vehicle(name).model()
    found = [push_of(model, exercise) for exercise in (STOP, SILENT, CUT)]
    t = np.array([0.0, PUSH + CUT.watched])
    turned = commanded_motion(model, t, np.stack([found[-1].u] * 2))["gyro"]
    assert np.trapezoid(np.abs(turned.value[:, 2]), turned.t) < 1.05 * AROUND, "one turn, if nothing ends it"
    assert all(push is not None and 0.0 < np.abs(push.u).max() <= 0.8 for push in found)
    assert {push.axis for push in found} <= ({"heave"} if name == "blueye_pioneer" else {"yaw"})
