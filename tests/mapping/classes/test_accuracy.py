"""Confusion matrices and areas by check points, against published examples."""

import numpy as np
import pytest

from rovtwin.mapping.classes.accuracy import Confusion, adjusted, counted


def test_areas_are_those_of_olofssons_example():
    """Olofsson et al. (2014), tables 8 and 9: four strata, 30 m pixels, 10 million of them."""
    names = ("deforestation", "gain", "forest", "other land")
    count = np.array([[66, 0, 5, 4], [0, 55, 8, 12], [1, 0, 153, 11], [2, 1, 9, 313]])
    weight = np.array([200_000, 150_000, 3_200_000, 6_450_000]) / 1e7
    found = adjusted(Confusion(names, names, count), weight)
    hectares = 0.09 * 1e7
    assert found.share[0] * hectares == pytest.approx(21_158, abs=1)
    low, high = found.interval()
    assert (high - low)[0] / 2 * hectares == pytest.approx(6_158, abs=3)
    assert found.overall_sd is not None
    assert found.overall == pytest.approx(0.947, abs=5e-4) and 1.96 * found.overall_sd == pytest.approx(0.018, abs=1e-3)
    assert found.few == () and found.share.sum() == pytest.approx(1.0)


def test_a_class_with_too_few_points_widens_each_interval_by_its_area():
    count = np.array([[10, 0], [0, 1]])
    found = adjusted(Confusion(("a", "b"), ("a", "b"), count), np.array([0.8, 0.2]))
    assert found.few == ("b",) and found.unknown == pytest.approx(0.2)
    low, high = found.interval()
    assert high[0] == 1.0 and low[1] == 0.0 and high[1] > 0.2
    assert found.overall == 1.0 and found.rough == ("a",)  # of the area that has points, not of all


def test_accuracy_is_that_of_the_area_with_points_and_mixtures_count_as_wrong():
    names = ("a", "b", "mixed")
    count = np.array([[30, 10], [5, 45], [0, 0]])
    found = adjusted(Confusion(names, ("a", "b"), count), np.array([0.4, 0.4, 0.2]), ("mixed",))
    assert found.overall == pytest.approx(0.5 * 0.75 + 0.5 * 0.9) and found.unknown == pytest.approx(0.2)
    sd = 0.5 * np.sqrt(0.75 * 0.25 / 39 + 0.9 * 0.1 / 49)
    assert found.overall_sd == pytest.approx(sd) and found.rough == ()
    count[2] = 12, 12
    found = adjusted(Confusion(names, ("a", "b"), count), np.array([0.4, 0.4, 0.2]), ("mixed",))
    assert found.overall == pytest.approx(0.4 * 0.75 + 0.4 * 0.9) and found.overall_sd == pytest.approx(0.8 * sd)
    nothing = adjusted(Confusion(names, ("a",), np.array([[1], [0], [0]])), np.array([0.4, 0.4, 0.2]))
    assert nothing.overall is None and nothing.overall_sd is None and nothing.unknown == pytest.approx(1.0)


@pytest.mark.parametrize("n", [5, 20, 100])
def test_points_that_all_agree_leave_an_interval_about_as_wide_as_the_exact_one(n):
    """Clopper and Pearson's ends at (alpha / 2)^(1 / n), Wilson's at n / (n + z^2), where all of n points agree."""
    found = adjusted(Confusion(("a",), ("a",), np.array([[n]])), np.array([1.0]))
    low = found.interval()[0][0]
    exact = 0.025 ** (1.0 / n)
    assert low < n / (n + 1.96**2) and 0.95 < (1.0 - low) / (1.0 - exact) < 1.35
    assert found.most_absent() == pytest.approx(1.0 - low)


def test_kappa_users_and_producers_accuracy():
    found = Confusion(("yes", "no"), ("yes", "no"), np.array([[20, 5], [10, 15]]))
    assert found.overall == pytest.approx(0.7) and found.kappa == pytest.approx(0.4)
    assert found.users("yes") == pytest.approx(0.8) and found.producers("yes") == pytest.approx(2.0 / 3.0)


def test_what_the_map_does_not_have_is_a_column_of_its_own():
    found = counted(["a", "a", "b", "mixed"], ["a", "star", "b", "a"], ("none", "a", "b", "mixed"))
    assert found.true == ("a", "b", "star") and found.count.sum() == 4
    assert found.overall == pytest.approx(0.5) and found.producers("star") == 0.0 and found.users("none") is None
    assert found.producers("c") is None
