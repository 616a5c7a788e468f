"""The chain with a border against a dense solution."""

import numpy as np
import pytest

from rovtwin.identification.joint.solver.arrow import Arrow


def dense(arrow):
    S, d = arrow.b.shape
    n = len(arrow.b_corner)
    H, b = np.zeros((S * d + n,) * 2), np.zeros(S * d + n)
    for s in range(S):
        here = slice(s * d, (s + 1) * d)
        H[here, here] = arrow.own[s]
        b[here] = arrow.b[s]
        H[here, S * d :] = arrow.border[s]
        H[S * d :, here] = arrow.border[s].T
        if s + 1 < S:
            there = slice((s + 1) * d, (s + 2) * d)
            H[here, there], H[there, here] = arrow.next[s], arrow.next[s].T
    H[S * d :, S * d :], b[S * d :] = arrow.corner, arrow.b_corner
    return H, b


def random_arrow(seed, S=5, d=4, n=3):
    """Normal equations of random least squares: each row touches a node, the next one and the border."""
    rng = np.random.default_rng(seed)
    own, following = np.zeros((S, d, d)), np.zeros((S, d, d))
    border, corner = np.zeros((S, d, n)), 0.1 * np.eye(n)
    b, b_corner = rng.standard_normal((S, d)), rng.standard_normal(n)
    for s in range(S):
        rows = 3 * d
        J, K = rng.standard_normal((rows, d)), rng.standard_normal((rows, n))
        L = rng.standard_normal((rows, d)) if s + 1 < S else np.zeros((rows, d))
        own[s] += J.T @ J
        border[s] += J.T @ K
        corner += K.T @ K
        if s + 1 < S:
            own[s + 1] += L.T @ L
            border[s + 1] += L.T @ K
            following[s] = J.T @ L
    return Arrow(own, following, border, corner, b, b_corner)


@pytest.mark.parametrize("seed", range(5))
def test_solution_and_covariance_are_those_of_the_dense_matrix(seed):
    arrow = random_arrow(seed)
    H, b = dense(arrow)
    S, d = arrow.b.shape
    factored = arrow.factor()
    theta = factored.border()
    x = factored.nodes(theta)
    np.testing.assert_allclose(np.concatenate([x.ravel(), theta]), np.linalg.solve(H, b), rtol=1e-9)
    C = np.linalg.inv(H)
    own, following, border, corner = arrow.factor().covariance()
    np.testing.assert_allclose(corner, C[S * d :, S * d :], rtol=1e-8)
    for s in range(S):
        here = slice(s * d, (s + 1) * d)
        np.testing.assert_allclose(own[s], C[here, here], rtol=1e-7, atol=1e-12)
        np.testing.assert_allclose(border[s], C[here, S * d :], rtol=1e-7, atol=1e-12)
        if s + 1 < S:
            np.testing.assert_allclose(following[s], C[here, slice((s + 1) * d, (s + 2) * d)], rtol=1e-7, atol=1e-12)


def test_damping_raises_the_diagonal_of_the_border_only():
    arrow = random_arrow(0)
    H, b = dense(arrow)
    n, more = len(arrow.b_corner), np.linspace(1.0, 3.0, len(arrow.b_corner))
    H[-n:, -n:] += np.diag(more)
    factored = arrow.factor()
    theta = factored.border(more)
    found = np.concatenate([factored.nodes(theta).ravel(), theta])
    np.testing.assert_allclose(found, np.linalg.solve(H, b), rtol=1e-9)


def test_the_gain_is_what_a_quadratic_sum_of_squares_loses():
    arrow = random_arrow(1)
    H, b = dense(arrow)
    assert arrow.gain() == pytest.approx(b @ np.linalg.solve(H, b), rel=1e-9)


def test_a_singular_matrix_is_reported_to_be_one():
    arrow = random_arrow(0)
    arrow.own[2] = 0.0
    with pytest.raises(np.linalg.LinAlgError):
        arrow.factor()
