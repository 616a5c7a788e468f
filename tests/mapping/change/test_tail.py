"""From where on places are named: tails of other distributions than the one that is fitted, and changes among them."""

import numpy as np
import pytest

from rovtwin.mapping.change.tail import FEWEST, places, unchanged
from rovtwin.mapping.change.variance import about


@pytest.mark.parametrize("freedom", [4, 6, 30])
@pytest.mark.parametrize("share", [0.0, 0.07, 0.3])
def test_few_of_the_named_places_are_false_and_most_changes_are_named(freedom, share):
    """Squares of Student's t, whose tail is a Pareto's only far out; the least changes are 6 times their 0.9 quantile.

    With 4 degrees of freedom, a heavier tail than flights have, up to 6.3 % of the named are false.
    """
    rng = np.random.default_rng(freedom)
    named, false, hits, changed = 0, 0, 0, 0
    for _ in range(20):
        same = np.sum(rng.standard_t(freedom, (600, 3)) ** 2, axis=1) / 3.0
        other = np.quantile(same, 0.9) * rng.uniform(6.0, 60.0, round(share * 600))
        limit = unchanged(np.sort(np.concatenate([same, other])), 0.05).limit
        named, false = named + (same >= limit).sum() + (other >= limit).sum(), false + (same >= limit).sum()
        hits, changed = hits + (other >= limit).sum(), changed + len(other)
    assert false <= (0.08 * named if share else 4), (false, named)
    assert hits >= 0.8 * changed, (hits, changed)


def test_too_few_places_name_none():
    assert unchanged(np.arange(FEWEST - 1.0), 0.05).limit == np.inf


def test_a_place_has_the_value_that_a_quarter_of_its_area_reaches():
    T = np.full((60, 60), np.nan)
    T[10:, 10:] = 0.5
    T[20:25, 20:25] = 9.0  # of 10 x 10 cells a quarter
    T[40:44, 40:44] = 50.0  # fewer
    found = places(T, 10, 0.25)
    assert found[-1] == 9.0 and (found[:-1] <= 0.5).all()


def test_differences_that_are_larger_over_half_of_the_floor_have_a_larger_variance_there():
    rng = np.random.default_rng(0)
    squares = rng.chisquare(3, (60, 200)) * np.where(np.arange(200) < 100, 1.0, 6.0)
    squares[28:33, 40:45] = 900.0  # what changed does not count
    g = about(squares, 3, 5)
    assert g[:, 20:70].mean() == pytest.approx(1.0, rel=0.15) and g[:, 130:180].mean() == pytest.approx(6.0, rel=0.2)
