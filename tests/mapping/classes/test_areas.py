"""Errors of areas: what the draws say, on seabeds that are not of the estimator's form."""

import numpy as np
import pytest
from tests.mapping.classes.reef import NAMES, WAVELENGTHS, cube, shares, spectra

from rovtwin.mapping.classes.angle import angle_between
from rovtwin.mapping.classes.areas import Sample, _sizes, _smooth, deviations, interval
from rovtwin.mapping.classes.unmixing import Unmixing

SIDE, ALL = (48, 60), np.ones(len(WAVELENGTHS), bool)
HEIGHT = {"height": 0.02 * (1.0 + 2.0 * ((WAVELENGTHS - 420.0) / 300.0) ** 3)}


def estimate(rng, x, variability, errors=HEIGHT, draws=40):
    """Mean shares of a cube, with their intervals."""
    flat = x.reshape(-1, x.shape[2])
    unmixing = Unmixing(spectra(), np.full(len(WAVELENGTHS), 0.004), np.ones(len(WAVELENGTHS)))
    found = unmixing.shares(flat, np.ones(flat.shape, bool), np.ones(len(flat)))
    some = rng.choice(len(flat), 300, replace=False)
    sample = Sample(found.value[some], found.brightness[some], np.ones(300))
    every = np.full(len(NAMES), np.radians(variability))
    off = deviations(unmixing, sample, WAVELENGTHS, errors, every, draws, rng)
    middle = found.value.mean(axis=0)
    return middle, *interval(middle, off, 1.0), off


def test_differences_turn_a_spectrum_by_the_angle_that_is_asked_for():
    rng, E = np.random.default_rng(1), spectra()
    basis = _smooth(WAVELENGTHS)
    assert np.mean(np.sum(basis**2, axis=0)) == pytest.approx(1.0, abs=0.02)
    q = np.radians(2.0) / _sizes(E, basis, rng)[0] * rng.standard_normal((4000, len(basis))) @ basis
    turned = np.degrees(angle_between(E[:1], E[:1] * (1.0 + q)))
    assert np.sqrt(np.mean(turned**2)) == pytest.approx(2.0, rel=0.08)


def test_without_errors_noise_alone_moves_areas_by_less_than_a_percent():
    rng = np.random.default_rng(2)
    x = cube(rng, shares(rng, SIDE), spectra(), grain=0.1, height=0.0)
    assert np.abs(estimate(rng, x, 0.0, {})[3]).max() < 0.01


@pytest.mark.system
def test_intervals_hold_the_truth_where_the_sites_spectra_are_not_the_librarys():
    inside = 0
    for seed in range(5):
        rng = np.random.default_rng(100 + seed)
        a = shares(rng, SIDE)
        E = spectra(rng, 0.05)
        assert 0.5 < np.degrees(angle_between(E, spectra())).mean() < 3.0
        _, low, high, _ = estimate(rng, cube(rng, a, E), 2.0)
        true = a.mean(axis=(0, 1))
        inside += int(np.sum((low - 1e-3 <= true) & (true <= high + 1e-3)))
        apart = [NAMES.index(name) for name in ("kelp", "maerl")]  # 18 deg and more from all others
        assert np.all((high - low)[apart] < 0.25)
    assert inside >= 18  # of 20: 95 % would be 19


def test_a_larger_variability_makes_wider_intervals_that_hold_the_estimate():
    rng = np.random.default_rng(4)
    x = cube(rng, shares(rng, SIDE), spectra())
    width = []
    for variability in (0.5, 4.0):
        middle, low, high, _ = estimate(np.random.default_rng(5), x, variability)
        assert np.all((low <= middle) & (middle <= high))
        width.append(float(np.sum(high - low)))
    assert width[1] > 2.0 * width[0]
