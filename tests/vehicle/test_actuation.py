"""What thrusters can make together, against linear programmes."""

import numpy as np
import pytest
from scipy.optimize import linprog

from rovtwin.core.numerics import as_array
from rovtwin.vehicle.physics.actuation import pure_force_limits, share_of_limits, wrench_limits
from rovtwin.vehicle.physics.thrusters import thrusters_from


def by_programme(T, lowest, highest, tau):
    """Least s with T f = tau and s lowest <= f <= s highest."""
    m, n = T.shape
    limits = np.block([[np.eye(n), -highest[:, None]], [-np.eye(n), lowest[:, None]]])
    free = [(None, None)] * n + [(0.0, None)]
    found = linprog(
        np.eye(n + 1)[n], A_ub=limits, b_ub=np.zeros(2 * n), A_eq=np.c_[T, np.zeros(m)], b_eq=tau, bounds=free
    )
    return found.fun if found.success else np.inf


@pytest.mark.parametrize("seed", range(40))
def test_share_of_limits_is_that_of_a_linear_programme(seed):
    """Thrusters that are more or fewer than axes, alike, or push one way only."""
    rng = np.random.default_rng(seed)
    m, n = rng.integers(1, 5), rng.integers(1, 9)
    T = rng.normal(size=(m, n))
    if seed % 3 == 0:
        T = T[:, rng.integers(0, max(1, n // 2), n)]
    lowest, highest = -rng.uniform(0, 2, n) * (rng.random(n) > 0.2), rng.uniform(0.1, 2, n)
    tau = (T @ rng.normal(size=(n, 4))).T
    expected = [by_programme(T, lowest, highest, desired) for desired in tau]
    np.testing.assert_allclose(share_of_limits(T, lowest, highest, tau), expected, rtol=1e-6)


def test_no_thrusters_make_nothing():
    nothing = share_of_limits(np.zeros((4, 0)), np.zeros(0), np.zeros(0), np.zeros((2, 4)))
    np.testing.assert_array_equal(nothing, [0.0, 0.0])


def test_a_force_that_does_not_turn_the_vehicle_is_less_than_all_of_it():
    """Three thrusters in a Y: all of them along the first make 2 N and turn it, 1.5 N do not."""
    angle, lever = np.radians([0.0, 120.0, 240.0]), 0.2
    T = np.stack([np.cos(angle), np.sin(angle), *np.zeros((3, 3)), lever * np.ones(3)])
    thrusters = thrusters_from(as_array(T), as_array(np.ones(3)))
    assert float(wrench_limits(thrusters)[1][0]) == pytest.approx(2.0)
    assert pure_force_limits(thrusters, 0) == pytest.approx((-1.5, 1.5))
    assert pure_force_limits(thrusters, 1) == pytest.approx((-np.sqrt(3.0), np.sqrt(3.0)))
