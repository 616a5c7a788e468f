"""What thrusters can make together, against linear programmes."""

import numpy as np
import pytest
from scipy.optimize import linprog

from rovtwin.vehicle.reach import share_of_limits


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
    expected = [by_programme(T, lowest, highest, wanted) for wanted in tau]
    np.testing.assert_allclose(share_of_limits(T, lowest, highest, tau), expected, rtol=1e-6)


def test_no_thrusters_make_nothing():
    nothing = share_of_limits(np.zeros((4, 0)), np.zeros(0), np.zeros(0), np.zeros((2, 4)))
    np.testing.assert_array_equal(nothing, [0.0, 0.0])
