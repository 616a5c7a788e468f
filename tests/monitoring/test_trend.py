"""Runs beside each other: scatter, changes that chance does not explain, drifts."""

import numpy as np

from rovtwin.monitoring.quantities import Quantity, Reading
from rovtwin.monitoring.trend import Run, baseline, changed_since, drifts

STD = np.array([0.02, 0.05, 0.03, 0.1, 0.01])


def run(values, name="run"):
    return Run(name, [Reading(Quantity(f"drag.{i}", f"drag {i}", "1"), v, STD[i], 1.0) for i, v in enumerate(values)])


def drawn(rng, n, scatter=0.0, mean=0.0):
    return [run(mean + np.hypot(STD, scatter) * rng.standard_normal(5)) for _ in range(n)]


def test_the_baseline_is_the_weighted_mean():
    runs = drawn(np.random.default_rng(0), 2)
    before = baseline(runs)
    np.testing.assert_allclose(before.value, np.mean([r.value for r in runs], axis=0))
    np.testing.assert_allclose(before.std, STD / np.sqrt(2))


def test_scatter_between_runs_is_found():
    rng = np.random.default_rng(1)
    found = np.mean([baseline(drawn(rng, 8, scatter=0.1)).scatter for _ in range(300)], axis=0)
    np.testing.assert_allclose(found, 0.1, rtol=0.15)
    assert np.mean([baseline(drawn(rng, 8)).scatter for _ in range(300)]) < 0.02


def test_an_unchanged_vehicle_is_left_in_peace():
    rng, told = np.random.default_rng(2), 0
    for _ in range(500):
        told += bool(changed_since(drawn(rng, 1)[0], baseline(drawn(rng, 3))))
    assert told <= 12  # 1 % is what is allowed for; 12 of 500 by chance once in a hundred


def test_a_change_is_told_with_its_size():
    rng = np.random.default_rng(3)
    values = np.zeros(5)
    values[2] = 0.3
    (change,) = changed_since(run(values), baseline(drawn(rng, 4, mean=0.0)))
    assert change.reading.quantity.name == "drag.2"
    assert abs(change.difference.value - 0.3) < 0.1 and str(change.difference).startswith("drag 2 +3")


def test_a_drift_is_told_and_noise_is_not():
    rng, told = np.random.default_rng(4), 0
    for _ in range(300):
        told += bool(drifts(drawn(rng, 6)))
    assert told <= 9
    slow = [run(np.array([0.03 * k, 0.0, 0.0, 0.0, 0.0]) + 0.3 * STD * rng.standard_normal(5)) for k in range(8)]
    (drift,) = drifts(slow)
    assert drift.reading.quantity.name == "drag.0" and abs(drift.slope - 0.03) < 0.01
    assert drifts(slow[:3]) == []
