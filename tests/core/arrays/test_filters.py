"""Filters of a tick: a ramp is followed without lag; an integral rests where it would wind up, and nowhere else."""

import numpy as np
import pytest

from rovtwin.core.arrays.filters import ROUNDING, alpha_beta, integrated
from rovtwin.core.numerics import jnp


@pytest.mark.parametrize(
    ("growth", "cut", "shortfall", "after"),
    [
        (0.5, 0.0, 0.0, 1.5),
        (0.5, 2.0, 0.0, 1.0),  # its own limit cuts it the way it grows
        (0.5, -2.0, 0.0, 1.5),  # it grows back from the limit
        (0.5, 0.0, 1.0, 1.0),  # the allocation gave less
        (0.5, 0.0, -1.0, 1.5),
        (-0.5, -2.0, 0.0, 1.0),
        (0.5, 0.0, 0.5 * ROUNDING, 1.5),  # of an allocation's rounding nobody takes notice
    ],
)
def test_integrates_unless_it_is_cut_that_way(growth, cut, shortfall, after):
    found = integrated(*(jnp.asarray([value]) for value in (1.0, growth, cut, shortfall)))
    np.testing.assert_array_equal(found, [after])


def test_of_an_allocation_that_tells_nothing_the_own_limit_counts():
    growth, cut = jnp.asarray([0.5, 0.5]), jnp.asarray([1.0, 0.0])
    np.testing.assert_array_equal(integrated(jnp.ones(2), growth, cut), [1.0, 1.5])


def test_a_ramp_is_followed_without_lag():
    dt, alpha = 0.1, 0.3
    value, rate = jnp.zeros(2), jnp.zeros(2)
    for k in range(1, 300):
        value = value + dt * rate
        value, rate = alpha_beta(value, rate, jnp.asarray([2.0, -0.5]) * k * dt - value, alpha, 0.05 / dt)
    np.testing.assert_allclose(rate, [2.0, -0.5], rtol=1e-8)
    np.testing.assert_allclose(value, np.array([2.0, -0.5]) * 299 * dt, rtol=1e-8)


def test_a_reading_that_is_expected_changes_nothing():
    np.testing.assert_array_equal(alpha_beta(jnp.ones(1), jnp.full(1, 0.2), jnp.zeros(1), 0.3, 0.5), [[1.0], [0.2]])
