"""How many correlated samples count as one, where the answer is known."""

import numpy as np
import pytest
from scipy.signal import lfilter

from rovtwin.core.arrays.correlation import effective_samples, inflation, neighbours

WHITE = np.random.default_rng(1).standard_normal(20_000)


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9])
def test_of_a_first_order_process(phi):
    series = lfilter([1.0], [1.0, -phi], WHITE)
    exact = (1.0 + phi) / (1.0 - phi)
    assert neighbours(series) == pytest.approx(exact, rel=0.25)
    assert effective_samples(series) == pytest.approx(20_000 / exact, rel=0.25)


def test_the_mean_does_not_count_nor_does_the_scale():
    series = lfilter([1.0], [1.0, -0.8], WHITE[:500])
    assert neighbours(1e-9 * series + 3e-9) == pytest.approx(neighbours(series))


def test_of_an_autocorrelation_the_sum_is_exact():
    lags = np.arange(200)
    assert inflation(0.9**lags) == pytest.approx(19.0, rel=1e-6)
    # The third pair sums to less than nothing: what follows is noise.
    assert inflation(np.array([1.0, 0.5, 0.2, 0.1, -0.1, 0.05, 0.9, 0.9])) == pytest.approx(2.0 * 1.8 - 1.0)
    assert inflation(np.array([1.0, -0.9, 0.5, 0.4])) == 1.0  # samples that alternate tell no less than they are
    assert inflation(np.array([])) == 1.0


@pytest.mark.parametrize("series", [np.full(50, 0.1), np.arange(5.0), np.array([np.nan] * 20)])
def test_of_what_tells_nothing_each_counts(series):
    assert neighbours(series) == 1.0
    assert effective_samples(series) == len(series)
