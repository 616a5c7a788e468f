"""Shares of spectra in cells: against scipy's solver, with bands missing, and as sure as stated."""

import numpy as np
import pytest
from scipy.optimize import nnls
from tests.mapping.classes.reef import WAVELENGTHS, spectra

from rovtwin.mapping.classes.unmixing import Unmixing, nonnegative

NAMES = ("sand", "mud", "rock", "kelp", "maerl", "coral", "rust")
BANDS = len(WAVELENGTHS)


def mixtures(rng, n, noise=0.003):
    E = spectra(names=NAMES)
    a = rng.dirichlet(np.full(len(E), 0.3), n)
    s = np.exp(0.2 * rng.standard_normal(n))
    return E, a, s, s[:, None] * (a @ E) + rng.normal(0.0, noise, (n, BANDS))


def unmixing(E, free=True, noise=0.003):
    return Unmixing(E, np.full(BANDS, noise), np.linspace(1.0, 2.0, BANDS), free)


@pytest.mark.parametrize("free", [True, False])
def test_shares_are_those_of_scipy_with_all_bands_and_with_some(free):
    rng = np.random.default_rng(1)
    E, _, _, x = mixtures(rng, 300)
    known = rng.random(x.shape) > 0.3
    known[:150] = True
    one = unmixing(E, free)
    found = one.shares(np.where(known, x, 0.0), known, np.ones(len(x)))
    for i in range(0, 300, 7):
        A, y = (E * one.weight).T[known[i]], (x[i] * one.weight)[known[i]]
        if not free:
            A, y = np.vstack([A, np.full(len(E), 1e4)]), np.append(y, 1e4)
        c, _ = nnls(A, y)
        assert found.value[i] == pytest.approx(c / c.sum(), abs=2e-5)
        assert found.brightness[i] == pytest.approx(c.sum(), rel=1e-5)
        left = x[i, known[i]] - (c @ E)[known[i]]
        assert found.residual[i] == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-3, abs=1e-6)


def test_without_noise_shares_and_brightness_are_exact_and_sum_to_one():
    E, a, s, x = mixtures(np.random.default_rng(2), 200, noise=0.0)
    found = unmixing(E).shares(x, np.ones(x.shape, bool), np.ones(200))
    assert found.value == pytest.approx(a, abs=1e-5) and found.brightness == pytest.approx(s, rel=1e-6)
    assert found.residual.max() < 1e-7 and found.value.sum(axis=1) == pytest.approx(1.0, abs=1e-6)


def test_shares_scatter_as_stated_where_none_is_near_zero():
    rng = np.random.default_rng(3)
    E = spectra()
    a = np.full((4000, len(E)), 1.0 / len(E))
    x = 1.3 * (a @ E) + 2.0 * rng.normal(0.0, 0.001, (4000, BANDS))
    found = unmixing(E, noise=0.001).shares(x, np.ones(x.shape, bool), np.full(4000, 2.0))
    assert found.value.min() > 0.0
    assert (found.value - a).std(axis=0) == pytest.approx(np.median(found.sd, axis=0), rel=0.06)


def test_the_solution_satisfies_the_conditions_of_an_optimum_however_alike_spectra_are():
    rng = np.random.default_rng(4)
    E = np.abs(rng.normal(1.0, 0.02, (10, 60)))  # some degrees apart
    b = rng.normal(0.1, 1.0, (500, 60)) @ E.T
    G = (E @ E.T)[None]
    for total in (None, 1.0):
        c = nonnegative(G, b, total)
        slope = c @ G[0] - b
        force = 0.0 if total is None else np.array([np.mean(row[one > 0]) for row, one in zip(slope, c, strict=True)])
        slope = slope - np.reshape(force, (-1, 1))
        assert c.min() >= 0.0 and (total is None or c.sum(axis=1) == pytest.approx(1.0, abs=1e-9))
        assert slope.min() > -1e-6 and np.abs(slope[c > 0.0]).max() < 1e-6


def test_black_cells_and_cells_with_fewer_bands_than_classes_have_no_number():
    E = spectra()
    known = np.ones((3, BANDS), bool)
    known[1, 3:] = False
    x = np.where(known, E[:3] * np.array([[0.0], [1.0], [1.0]]), 0.0)
    found = unmixing(E).shares(x, known, np.ones(3))
    assert np.isnan(found.value[:2]).all() and found.value[2, 2] == pytest.approx(1.0, abs=1e-5)
