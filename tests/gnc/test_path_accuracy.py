"""Accuracy along a planned path: against conditioning of all states at once, and against its known limits."""

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.gnc.navigation.accuracy_bound import position_bound
from rovtwin.gnc.navigation.path_accuracy import STATES, Aids, _Linearised, _start, path_accuracy
from rovtwin.gnc.navigation.tuning import Tuning
from rovtwin.vehicle import load_vehicle

AIDS = Aids((0.5, 1.0), (0.0308, 100.0), (0.005, 10.0))


@pytest.fixture(scope="module")
def model():
    return load_vehicle("double_blueye").model()


@pytest.fixture(scope="module")
def tuning(model):
    return Tuning.of(model)


def conditioned(model, tuning, aids, step, heading, speed, start_std):
    """Covariance of all places and their answer to the constants, by one Gaussian over all states at once."""
    local, n = _Linearised(model, tuning, aids, step, float(np.max(speed))), len(heading)
    mean, cov = [np.zeros((STATES, 3))], [[_start(tuning, start_std)]]
    H, h, R = [], [], []
    for i in range(n):
        Phi, Q, rows, noise = local.matrices(float(heading[i]), bool(speed[i] > 0))
        drift, bias = local.constants(float(heading[i]), float(speed[i]), len(noise))
        mean.append(Phi @ mean[-1] + drift)
        cov.append([Phi @ block for block in cov[-1]] + [Phi @ cov[-1][-1] @ Phi.T + Q])
        H.append(rows), h.append(bias), R.append(noise)
    whole = np.zeros((STATES * (n + 1),) * 2)
    for i, row in enumerate(cov):
        for j, block in enumerate(row):
            a, b = (slice(STATES * k, STATES * (k + 1)) for k in (i, j))
            whole[a, b], whole[b, a] = block, block.T
    whole, V, count = whole[STATES:, STATES:], np.concatenate(mean[1:]), len(R[0])
    big = np.zeros((n * count, n * STATES))
    for i, rows in enumerate(H):
        big[count * i : count * (i + 1), STATES * i : STATES * (i + 1)] = rows
    S = big @ whole @ big.T + np.diag(np.concatenate(R))
    gain = np.linalg.solve(S, big @ whole).T
    place = np.ravel(STATES * np.arange(n)[:, None] + [0, 1])
    # The filter's mean moves by the gain times what it reads; the truth's by V.
    return (whole - gain @ big @ whole)[np.ix_(place, place)], (V - gain @ (big @ V + np.concatenate(h)))[place]


def test_the_recursion_is_the_whole_gaussian_conditioned(model, tuning):
    n = 24
    heading = np.repeat([0.3, 0.3 + np.pi / 2, 2.0], n // 3)
    speed = np.where(np.arange(n) % 8 < 2, 0.0, 0.2)
    covariance, response = conditioned(model, tuning, AIDS, 0.5, heading, speed, 0.5)
    key = np.array([0, 3, 10, 11, 23])
    found = path_accuracy(model, tuning, AIDS, 0.5, heading, speed, key, 0.5)
    pick = np.ravel(2 * key[:, None] + [0, 1])
    assert np.allclose(found.covariance, covariance[np.ix_(pick, pick)], rtol=1e-6, atol=1e-10)
    assert np.allclose(found.response, response[pick], rtol=1e-6, atol=1e-8)
    assert np.linalg.eigvalsh(found.covariance).min() > 0


def test_the_last_instant_is_the_filter_s_and_comes_near_its_bound(model, tuning):
    """Steady on one course; the bound knows fewer disturbances, so that it is lower, but not by much."""
    n, ahead = 1600, 0.2
    found = path_accuracy(model, tuning, Aids((0.5, 1.0), (0.0308, 100.0)), 0.25, np.zeros(n), np.full(n, ahead),
                          np.array([n // 2, n - 1]), 0.5)  # fmt: skip
    walk = float(tuning.walk[21])
    bound = position_bound(model, ahead, 0.5, 1.0, walk, accelerometer_sigma=0.0308, accelerometer_rate=100.0)
    last, middle = found.std[1], found.std[0]
    assert (bound < last).all() and (last < 1.5 * bound).all()
    assert (middle < 0.75 * last).all()  # what comes later tells, too


def test_a_step_twice_as_long_gives_the_same(model, tuning):
    found = []
    for step in (0.25, 0.5):
        n = round(200 / step)
        heading = np.where(np.arange(n) * step < 100, 0.0, np.pi)
        key = (np.arange(1, 9) * 24 / step).astype(int)
        found.append(path_accuracy(model, tuning, AIDS, step, heading, np.full(n, 0.2), key, 0.5))
    assert np.allclose(found[0].std, found[1].std, rtol=0.02)
    assert np.allclose(found[0].response, found[1].response, atol=0.06)  # a step of the way is 0.05 m


def test_a_compass_that_is_off_turns_the_path_and_a_log_that_reads_too_much_stretches_it(model, tuning):
    """On a line there and back, places known well at the start: the error is across and along, as far as it is long."""
    n, step = 400, 0.25
    heading = np.where(np.arange(n) < n // 2, 0.0, np.pi)
    aids = Aids((50.0, 1.0), AIDS.accelerometer, AIDS.dvl)
    key = np.array([n // 2 - 1, n - 1])
    far, back = path_accuracy(model, tuning, aids, step, heading, np.full(n, 0.2), key, 1e-3).response.reshape(2, 2, 3)
    length = 0.2 * step * n / 2
    assert far[1, 0] == pytest.approx(length, rel=0.01) and abs(far[0, 0]) < 0.01 * length
    assert far[1, 1] == pytest.approx(length, rel=0.05)  # the log turned on the vehicle: as the compass
    assert far[0, 2] == pytest.approx(-length, rel=0.05)  # the truth lies behind what is read
    assert np.abs(back).max() < 0.1 * length


def test_bad_input_is_named(model, tuning):
    with pytest.raises(ConfigError, match="key frames must grow"):
        path_accuracy(model, tuning, AIDS, 0.5, np.zeros(5), np.zeros(5), np.array([5]), 0.5)
    with pytest.raises(ConfigError, match="dvl: found noise and rate"):
        Aids((0.5, 1.0), (0.03, 100.0), (0.0, 10.0))
