"""Shares of missions that succeed: what few of them show."""

import numpy as np
import pytest

from rovtwin.campaign.shares import at_least, needed, share_interval


def test_all_of_few_show_what_the_power_law_gives():
    assert at_least(20, 20) == pytest.approx(0.05 ** (1 / 20))
    assert share_interval(20, 20) == pytest.approx((0.025 ** (1 / 20), 1.0))
    assert share_interval(0, 20) == pytest.approx((0.0, 1.0 - 0.025 ** (1 / 20)))
    assert at_least(0, 20) == 0.0


def test_how_many_are_needed_is_the_first_number_that_shows_it():
    for share in (0.9, 0.99, 0.999):
        count = needed(share)
        assert at_least(count, count) >= share > at_least(count - 1, count - 1)
    assert needed(0.99) == 299


@pytest.mark.parametrize("share", [0.5, 0.9, 0.99])
def test_the_bound_is_below_the_truth_in_95_percent_of_campaigns(share):
    hits = np.random.default_rng(1).binomial(20, share, 4000)
    bounds = {k: at_least(k, 20) for k in range(21)}
    assert np.mean([bounds[int(k)] <= share for k in hits]) >= 0.94
