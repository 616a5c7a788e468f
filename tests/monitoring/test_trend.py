"""Runs beside each other: scatter, changes that chance does not explain, drifts."""

import numpy as np
import pytest

from rovtwin.monitoring.change import changes
from rovtwin.monitoring.quantities import Quantity, Reading
from rovtwin.monitoring.trend import Run, baseline, changed_since, drifts, first_learnt

STD = np.array([0.02, 0.05, 0.03, 0.1, 0.01])


def run(values, name="run"):
    return Run(name, [Reading(Quantity(f"drag.{i}", f"drag {i}", "1"), v, STD[i], 1.0) for i, v in enumerate(values)])


def drawn(rng, n, scatter=0.0, mean=0.0):
    return [run(mean + np.hypot(STD, scatter) * rng.standard_normal(5)) for _ in range(n)]


def test_the_baseline_is_the_weighted_mean():
    runs = drawn(np.random.default_rng(0), 2)
    before = baseline(runs)
    np.testing.assert_allclose(before.value, np.mean([r.value for r in runs], axis=0))
    # A run more lies about the mean with the mean's own error and the scatter; two runs alone still suppose some.
    np.testing.assert_allclose(before.std**2, (STD**2 + before.scatter**2) / 2 + before.scatter**2)
    assert (before.scatter > 0.0).all()


def test_scatter_between_runs_is_found():
    rng = np.random.default_rng(1)
    found = np.mean([baseline(drawn(rng, 8, scatter=0.1)).scatter ** 2 for _ in range(300)], axis=0)
    np.testing.assert_allclose(found, (7 * 0.1**2 + 2 * 0.01**2) / 9, rtol=0.15)
    assert np.mean([baseline(drawn(rng, 8)).scatter for _ in range(300)]) < 0.025


def test_an_unchanged_vehicle_is_left_in_peace():
    rng, reported = np.random.default_rng(2), 0
    for _ in range(500):
        reported += bool(changed_since(drawn(rng, 1)[0], baseline(drawn(rng, 3))))
    assert reported <= 12  # 1 % is what is allowed for; 12 of 500 by chance once in a hundred


@pytest.mark.parametrize(("runs", "allowed"), [(1, 0.05), (3, 0.05), (5, 0.04)])
def test_nor_one_whose_runs_differ_by_more_than_they_say(runs, allowed):
    """Scatter as large as the surest quantity's own deviation."""
    rng = np.random.default_rng(5)
    reports = [bool(changed_since(drawn(rng, 1, 0.01)[0], baseline(drawn(rng, runs, 0.01)))) for _ in range(400)]
    assert np.mean(reports) <= allowed


def test_what_the_baseline_has_not_learnt_is_no_change():
    wide = [Run("run", [Reading(Quantity("drag.0", "drag 0", "1"), 0.0, 0.45, 0.5)]) for _ in range(10)]
    sure = Run("run", [Reading(Quantity("drag.0", "drag 0", "1"), 0.5, 0.03, 0.5)])
    assert changed_since(sure, baseline(wide)) == []
    (new,) = first_learnt(sure, baseline(wide))  # but neither is it in order: it is not as described
    assert str(new.reading) == "drag 0 +65 ± 5 %"
    near = Run("run", [Reading(Quantity("drag.0", "drag 0", "1"), 0.05, 0.03, 0.5)])
    assert first_learnt(near, baseline(wide)) == []
    reported = Run("run", [Reading(Quantity("drag.0", "drag 0", "1"), 0.5, 0.03, 0.5)])
    assert first_learnt(sure, baseline([reported, wide[0]])) == [], "one of the runs before says the same"


def thrusters(**values):
    return [Reading(Quantity(f"thruster.{n}", n, "1", (0, 1)), v, 0.02, 0.3) for n, v in values.items()]


def reported_of(**values):
    none = np.zeros(len(values))
    return {c.reading.quantity.words for c in changes(thrusters(**values), none, none)}


def test_the_thruster_that_differs_is_reported_and_not_the_others():
    assert reported_of(a=-0.3, b=0.1, c=0.1, d=0.1) == {"a"}  # weaker than the others
    assert reported_of(a=0.48, b=-0.16, c=-0.16, d=-0.16) == {"a"}  # repaired
    assert reported_of(a=-0.3, b=0.3) == {"a"}  # of two, the weaker one


def test_a_change_is_reported_with_its_size():
    rng = np.random.default_rng(3)
    values = np.zeros(5)
    values[2] = 0.3
    (change,) = changed_since(run(values), baseline(drawn(rng, 4, mean=0.0)))
    assert change.reading.quantity.name == "drag.2"
    assert abs(change.difference.value - 0.3) < 0.1 and str(change.difference).startswith("drag 2 +3")


def test_a_drift_is_reported_and_noise_is_not():
    rng, reported = np.random.default_rng(4), 0
    for _ in range(300):
        reported += bool(drifts(drawn(rng, 6)))
    assert reported <= 9
    slow = [run(np.array([0.03 * k, 0.0, 0.0, 0.0, 0.0]) + 0.3 * STD * rng.standard_normal(5)) for k in range(8)]
    (drift,) = drifts(slow)
    assert drift.reading.quantity.name == "drag.0" and abs(drift.slope - 0.03) < 0.01
    assert drifts(slow[:3]) == []
