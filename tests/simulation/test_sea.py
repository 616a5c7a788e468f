"""Spectra, dispersion, and the components that stand for a sea."""

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import jnp
from rovtwin.simulation.environment import waves
from rovtwin.simulation.environment.sea import SeaState, components, period_ratio, wavenumber

SMALL = SeaState.of(0.27, zero_crossing_period=3.0, gamma=3.3)
STORM = SeaState.of(4.1, zero_crossing_period=8.7)


@pytest.mark.parametrize("sea, period", [(SMALL, 3.0), (STORM, 8.7)])
def test_a_sea_has_the_height_and_period_it_is_made_from(sea, period):
    w = np.geomspace(0.3, 300.0, 400_001) * 2 * np.pi / sea.peak_period
    S = sea.spectrum(w)
    m0, m2 = np.trapezoid(S, w), np.trapezoid(S * w**2, w)
    assert 4 * np.sqrt(m0) == pytest.approx(sea.height, rel=1e-5)
    assert 2 * np.pi * np.sqrt(m0 / m2) == pytest.approx(period, rel=1e-5)
    assert sea.zero_crossing_period == pytest.approx(period)
    assert w[S.argmax()] == pytest.approx(2 * np.pi / sea.peak_period, rel=1e-4)


def test_gamma_of_one_is_the_spectrum_of_the_thesis():
    w = np.linspace(0.3, 4.0, 50)
    same = np.asarray(waves.spectrum(jnp.asarray(w), jnp.array(4.1), jnp.array(8.7)))
    np.testing.assert_allclose(STORM.spectrum(w), same, rtol=1e-4)


@pytest.mark.parametrize("gamma", [1.0, 2.0, 3.3, 5.0])
def test_ratio_of_periods_is_that_of_the_standard(gamma):
    """DNV-RP-C205 (2021), sec. 3.5.5.5."""
    fit = 0.6673 + 0.05037 * gamma - 0.006230 * gamma**2 + 0.0003341 * gamma**3
    assert period_ratio(gamma) == pytest.approx(fit, rel=3e-3)


@pytest.mark.parametrize("depth", [0.5, 20.0, 3000.0])
def test_dispersion(depth):
    omega = np.geomspace(0.01, 30.0, 500)
    k = wavenumber(omega, depth)
    np.testing.assert_allclose(9.81 * k * np.tanh(k * depth), omega**2, rtol=1e-12)
    np.testing.assert_allclose(wavenumber(omega, None), omega**2 / 9.81)


@pytest.mark.parametrize("count", [32, 64, 128])
@pytest.mark.parametrize("sea", [SMALL, STORM])
def test_components_carry_the_energy(sea, count):
    parts = components(sea, count)
    energy = 0.5 * parts.amplitude**2
    assert 4 * np.sqrt(energy.sum()) == pytest.approx(sea.height, rel=1e-12)
    period = 2 * np.pi * np.sqrt(energy.sum() / (energy * parts.omega**2).sum())
    assert period == pytest.approx(sea.zero_crossing_period, rel=0.025)
    assert np.all(np.diff(parts.omega) > 0)


def test_the_record_does_not_repeat_within_half_an_hour():
    parts = components(SMALL, 64)
    lag = np.arange(20.0, 1800.0, 0.1)
    likeness = (0.5 * parts.amplitude**2 * np.cos(np.outer(lag, parts.omega))).sum(1) / (SMALL.height**2 / 16)
    assert np.abs(likeness).max() < 0.5


def test_spreading_is_about_the_direction_and_as_wide_as_asked_for():
    """The variance of the angle under cos^2s: for s = 1, pi^2/12 - 1/2."""
    angles = components(SMALL, 128, 0.7, spreading=1.0).direction - 0.7
    assert angles.mean() == pytest.approx(0.0, abs=1e-3)
    assert angles.var() == pytest.approx(np.pi**2 / 12 - 0.5, rel=0.02)
    assert not np.ptp(components(SMALL, 8, 0.7).direction)


@pytest.mark.parametrize(
    "given, words",
    [
        ({"height": 1.0}, "either"),
        ({"height": 1.0, "zero_crossing_period": 5.0, "peak_period": 6.0}, "not both"),
        ({"height": -1.0, "peak_period": 6.0}, "Hs -1 m, expected 0.001 to 30 m"),
        ({"height": 1e-300, "zero_crossing_period": 1e-3}, "Hs 1e-300 m, expected 0.001 to 30 m"),
        ({"height": 40.0, "peak_period": 20.0}, "expected 0.001 to 30 m"),
        ({"height": 0.001, "zero_crossing_period": 1e-3}, "Tz 0.001 s, expected 0.5 to 30 s"),
        ({"height": 1.0, "peak_period": 60.0}, "Tz 42.6 s, expected 0.5 to 30 s"),
        ({"height": 1.0, "peak_period": 0.0}, "above 0"),
        ({"height": np.nan, "peak_period": 6.0}, "Hs nan m"),
        ({"height": 1.0, "peak_period": 6.0, "gamma": 30.0}, "gamma 30"),
        ({"height": 3.0, "peak_period": 3.0}, "steep.*Lower the height"),
    ],
)
def test_seas_that_cannot_be(given, words):
    with pytest.raises(ConfigError, match=words):
        SeaState.of(**given)
