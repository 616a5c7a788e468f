"""NSGA-II of one direction: recovery, the bound, the seed, bad input."""

import numpy as np
import pytest

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.steady.nsga import OneDirection, fit_nsga, simulate

T = np.arange(0.0, 10.0, 0.1)


def record(quantity, added_mass=21.2, thrust=8.0, noise=0.0):
    blank = OneDirection(T, np.zeros_like(T), quantity, 30.0, 6.48, 158.86)
    y = simulate(blank, np.array([added_mass]), np.array([thrust]))[0]
    y = y + noise * np.random.default_rng(0).standard_normal(len(y))
    return OneDirection(T, y, quantity, 30.0, 6.48, 158.86)


def test_speed_is_that_of_the_exact_solution():
    """Quadratic damping alone: v = V tanh(F t / (m V)), V = sqrt(F / D)."""
    one = OneDirection(T, np.zeros_like(T), "velocity", 30.0, 0.0, 158.86)
    terminal = np.sqrt(8.0 / 158.86)
    exact = terminal * np.tanh(8.0 * T / (51.2 * terminal))
    assert simulate(one, np.array([21.2]), np.array([8.0]))[0] == pytest.approx(exact, abs=1e-5)


@pytest.mark.system
@pytest.mark.parametrize("quantity", ["position", "velocity"])
def test_recovery(quantity):
    fit = fit_nsga(record(quantity, noise=0.002), (0.0, 200.0), (5.0, 12.0))
    assert fit.added_mass == pytest.approx(21.2, rel=0.06) and fit.thrust == pytest.approx(8.0, rel=0.01)
    assert fit.on_bound == ()


def test_a_thrust_on_its_bound_is_reported():
    fit = fit_nsga(record("velocity", thrust=5.0), (0.0, 200.0), (5.2, 5.8), generations=30)
    assert fit.thrust == pytest.approx(5.2, abs=0.003) and fit.on_bound == ("thrust",)
    assert "5.2 to 5.8" in fit.notes[0]


def test_a_seed_gives_the_same_result_and_progress_is_reported():
    reports = []
    one, two = (
        fit_nsga(record("position"), (0, 200), (8, 8), generations=8, seed=3, progress=lambda *a: reports.append(a))
        for _ in range(2)
    )
    assert one.added_mass == two.added_mass and reports == [(i, 8) for i in range(1, 9)] * 2


@pytest.mark.parametrize(
    ("bounds", "message"), [(((5.0, 1.0), (8, 8)), "lowest first"), (((-40.0, 1.0), (8, 8)), "not positive")]
)
def test_bad_bounds_are_named(bounds, message):
    with pytest.raises(IdentificationError, match=message):
        fit_nsga(record("position"), *bounds)
