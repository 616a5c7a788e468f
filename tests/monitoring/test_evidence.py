"""Estimate and width from blocks of normal equations."""

import numpy as np
import pytest

from rovtwin.monitoring.evidence import Block, estimated


def blocks(rng, truths, rows=40):
    """Of linear equations y = H theta + noise, one block for each truth."""
    out = []
    for k, truth in enumerate(truths):
        H = rng.standard_normal((rows, len(truth)))
        y = H @ truth + rng.standard_normal(rows)
        out.append(Block(10.0 * (k + 1), H.T @ H, H.T @ y))
    return out


def test_without_evidence_it_is_the_prior():
    found = estimated([], np.diag([1.0, 4.0]))
    assert found.theta.tolist() == [0.0, 0.0] and found.std.tolist() == [1.0, 2.0] and found.blocks == 0


def test_it_is_the_weighted_least_squares_of_all():
    rng = np.random.default_rng(0)
    given, prior = blocks(rng, [np.array([0.5, -0.2])] * 4), np.diag([0.3, 0.7])
    A, s = sum(b.A for b in given), sum(b.s for b in given)
    found = estimated(given, prior)
    np.testing.assert_allclose(found.theta, np.linalg.solve(A + np.linalg.inv(prior), s), rtol=1e-12)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(A + np.linalg.inv(prior)), rtol=1e-12)


def test_intervals_hold_where_the_model_is_right():
    rng, prior, z = np.random.default_rng(1), np.eye(3), []
    for _ in range(400):
        truth = rng.standard_normal(3)
        found = estimated(blocks(rng, [truth] * 12), prior)
        z.append((found.theta - truth) / found.std)
    assert 0.94 < np.mean(np.abs(z) < 1.96) <= 1.0  # the jackknife may only widen


def test_blocks_that_disagree_widen_the_interval_until_it_holds():
    rng, prior, z, widened = np.random.default_rng(2), 25.0 * np.eye(2), [], []
    for _ in range(400):
        truth = rng.standard_normal(2)
        # Each block has a truth of its own, twelve times as far away as its noise says.
        found = estimated(blocks(rng, truth + 2.0 * rng.standard_normal((12, 2))), prior)
        z.append((found.theta - truth) / found.std)
        widened.append(found.widened)
    assert np.mean(widened) > 5.0
    assert 0.90 < np.mean(np.abs(z) < 1.96) < 0.97


def test_a_difference_is_widened_where_each_of_two_is_not():
    """Blocks tell the difference of two well, and disagree about it; each of the two is as wide as before them."""
    rng, z = np.random.default_rng(4), []
    g = np.array([0.5, -0.5])
    for _ in range(200):
        given = []
        for k in range(30):
            y = 0.06 * rng.standard_normal()
            given.append(Block(10.0 * k, np.outer(g, g) / 0.01**2, g * y / 0.01**2))
        found = estimated(given, np.eye(2))
        z.append(g @ found.theta / np.sqrt(g @ found.covariance @ g))
    assert 0.85 < np.sqrt(np.mean(np.square(z))) < 1.2


def test_what_is_old_fades():
    rng = np.random.default_rng(3)
    given = blocks(rng, [np.array([0.0])] * 30 + [np.array([1.0])] * 6, rows=200)
    whole, now = estimated(given, np.eye(1)), estimated(given, np.eye(1), fading=20.0)
    assert whole.theta[0] == pytest.approx(6 / 36, abs=0.05)
    assert now.theta[0] > 0.75 and now.std[0] > whole.std[0]
