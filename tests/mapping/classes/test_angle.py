"""Spectral angles: against SPy, turned by noise as predicted, blind to brightness."""

import numpy as np
import pytest
import spectral
from tests.mapping.classes.reef import WAVELENGTHS, spectra

from rovtwin.mapping.classes.angle import FACTOR, angle_between, angles, cosines, limits


def test_angles_are_those_of_spy():
    rng = np.random.default_rng(1)
    x = np.abs(rng.normal(0.2, 0.1, (20, 30, len(WAVELENGTHS)))).astype(np.float32)
    theirs = spectral.spectral_angles(x, spectra().astype(np.float32)).reshape(600, -1)
    flat = x.reshape(600, -1)
    found = angles(flat, np.ones(flat.shape, bool), spectra(), np.full((600, 1), 0.01))
    assert found.value == pytest.approx(theirs.min(axis=1), abs=1e-5)
    assert found.nearest.tolist() == theirs.argmin(axis=1).tolist()
    assert found.margin == pytest.approx(np.sort(theirs, axis=1)[:, 1] - theirs.min(axis=1), abs=2e-5)


def test_brightness_does_not_turn_a_spectrum_and_missing_bands_do_not_count():
    E, rng = spectra(), np.random.default_rng(2)
    x = np.linspace(0.01, 3.0, 50)[:, None] * E[1]
    known = rng.random(x.shape) > 0.4
    found = angles(np.where(known, x, 0.0), known, E, np.full((50, 1), 0.01))
    assert (found.nearest == 1).all() and found.value.max() < 1e-3
    one = np.arccos(np.minimum(cosines(np.where(known, x, 0.0), known, E), 1.0))
    for i in (0, 17):
        assert one[i] == pytest.approx(angle_between(x[i, known[i]][None], E[:, known[i]]), abs=2e-4)


def test_noise_turns_spectra_by_what_is_stated_and_few_beyond_the_limit():
    E, rng = spectra(), np.random.default_rng(3)
    sigma = 0.002 * (1.0 + (WAVELENGTHS - 420.0) / 100.0)
    x = E[0] + sigma * rng.standard_normal((5000, len(WAVELENGTHS)))
    found = angles(x, np.ones(x.shape, bool), E, np.tile(sigma, (5000, 1)))
    rms = float(np.sqrt(np.mean(found.value**2)))
    assert rms == pytest.approx(float(np.median(found.noise)), rel=0.03)
    limit = limits(found.noise, np.zeros(4), np.zeros(4))[:, 0]
    assert limit == pytest.approx(FACTOR * found.noise) and (found.value > limit).mean() < 1e-3


def test_a_cell_without_a_number_is_of_no_class():
    E = spectra()
    found = angles(
        np.zeros((2, E.shape[1])), np.array([[True], [False]]) & np.ones(E.shape[1], bool), E, np.ones((2, 1))
    )
    assert (found.nearest == -1).all() and np.isnan(found.value).all() and np.isnan(found.margin).all()
