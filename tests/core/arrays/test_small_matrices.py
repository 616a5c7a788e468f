"""Small matrices written out give what the library gives."""

import numpy as np
import pytest

from rovtwin.core.arrays.small_matrices import eliminated, product, solution, squared_norm, summed_product
from rovtwin.core.numerics import jnp

RNG = np.random.default_rng(5)


def definite(n: int) -> np.ndarray:
    A = RNG.normal(size=(n, n + 2))
    return A @ A.T


@pytest.mark.parametrize(("m", "n", "p"), [(3, 3, 3), (6, 8, 6), (8, 1, 5), (1, 4, 2)])
def test_a_product_of_matrices(m, n, p):
    A, B = RNG.normal(size=(m, n)), RNG.normal(size=(n, p))
    for form in (product, summed_product):
        np.testing.assert_allclose(form(jnp.asarray(A), jnp.asarray(B)), A @ B, atol=1e-14)


@pytest.mark.system
@pytest.mark.parametrize("n", [1, 2, 3, 8])
def test_what_elimination_gives_is_what_the_library_gives(n):
    S, e, rows = definite(n), RNG.normal(size=n), RNG.normal(size=(n, 5))
    pivots, found = eliminated(jnp.asarray(S), jnp.asarray(rows))
    L = np.linalg.cholesky(S)
    np.testing.assert_allclose(pivots, np.diag(L) ** 2, rtol=1e-12)
    np.testing.assert_allclose(found, np.linalg.solve(L / np.diag(L), rows), rtol=1e-10, atol=1e-12)
    assert float(squared_norm(jnp.asarray(e), jnp.asarray(S))) == pytest.approx(e @ np.linalg.solve(S, e), rel=1e-10)
    np.testing.assert_allclose(solution(jnp.asarray(S), jnp.asarray(e)), np.linalg.solve(S, e), rtol=1e-9)
