"""Thrust that is left and energy that is used, against what the twin's own battery counts."""

from types import SimpleNamespace

import numpy as np
import pytest

from rovtwin.runs.ensemble.exertion import WINDOW, Supply, margins
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.description.power import PowerSource
from rovtwin.vehicle.physics.thrusters import force_limits

DT = 0.02
WHOLE = np.array([[0.0, 0.0, 20.0, 20.0]])


@pytest.fixture(scope="module")
def model():
    return load_vehicle("double_blueye").model()


def thrust_of(model, share, seconds=20.0):
    """All thrusters at a share of their force ahead [N]."""
    high = np.asarray(force_limits(model.thrusters)[1])
    return np.repeat(share * high[None], round(seconds / DT) + 1, axis=0)


def test_the_most_loaded_thruster_counts(model):
    thrust = thrust_of(model, 0.25)
    thrust[:, 1] *= 3.0
    assert margins(thrust, DT, model, WHOLE) == pytest.approx([0.25])


def test_astern_is_a_share_of_what_it_gives_astern(model):
    low = np.asarray(force_limits(model.thrusters)[0])
    thrust = np.repeat(0.6 * low[None], 1001, axis=0)
    assert margins(thrust, DT, model, WHOLE) == pytest.approx([0.4])


def test_a_peak_that_is_shorter_than_the_window_counts_by_its_share_of_it(model):
    thrust = thrust_of(model, 0.0)
    peak = round(0.1 * WINDOW / DT)
    thrust[300 : 300 + peak] = thrust_of(model, 1.0)[0]
    assert margins(thrust, DT, model, WHOLE) == pytest.approx([0.9])


def test_legs_have_margins_of_their_own_and_those_that_were_not_flown_none(model):
    thrust = thrust_of(model, 0.2)
    thrust[600:] *= 2.0
    times = np.array([[0.0, 0.0, 12.0, 12.0], [12.0, 12.0, 20.0, 20.0], [np.nan] * 4])
    least = margins(thrust, DT, model, times)
    assert least[:2] == pytest.approx([0.8, 0.6], abs=1e-6) and np.isnan(least[2])


def test_energy_is_what_thrusters_and_loads_take():
    thrust = np.tile([4.0, -9.0], (101, 1))
    supply = Supply(np.array([[1.0, 1.5], [1.0, 2.0]]), (PowerSource("vehicle", 10.0, 5.0, (0, 1)),))
    used = supply.used(thrust, 0.1)
    assert used[-1] == pytest.approx([10.0 * (1.0 * 4.0**1.5 + 2.0 * 9.0**1.5 + 5.0)])
    assert supply.left(used[-1], 0.5) == pytest.approx(0.5 - used[-1, 0] / 36_000.0)


def test_without_a_battery_the_thrusters_alone_count():
    supply = Supply.of(SimpleNamespace(specific_power=lambda: np.ones((1, 2)), power_sources=[]))
    used = supply.used(np.full((11, 1), 4.0), 1.0)
    assert used[-1] == pytest.approx([80.0]) and supply.left(used[-1], 1.0) is None
