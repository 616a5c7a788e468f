"""Damping from steady speeds and forces: the thesis's tables, recovery, honest bands, what cannot be known is said."""

import numpy as np
import pytest

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.steady.damping_fit import fit_damping

SPEED = np.array([-0.4, -0.3, -0.2, -0.1, 0.1, 0.2, 0.3, 0.4])


def force(v: np.ndarray, linear: float, quadratic: float) -> np.ndarray:
    return linear * v + quadratic * np.abs(v) * v


def test_exact_data_give_exact_coefficients_with_the_sign_kept() -> None:
    fit = fit_damping(SPEED, force(SPEED, 6.5, 159.0), nonnegative=False)
    assert fit.coefficients == pytest.approx([6.5, 159.0], rel=1e-9)
    assert fit.force(np.array([-0.25]))[0] == pytest.approx(-fit.force(np.array([0.25]))[0])
    assert fit.rms < 1e-12


def test_ahead_and_astern_apart() -> None:
    F = np.where(SPEED > 0, force(SPEED, 6.5, 159.0), force(SPEED, 0.07, 190.0))
    fit = fit_damping(SPEED, F, astern=True)
    assert fit.linear == pytest.approx([6.5, 0.07], rel=1e-6)
    assert fit.quadratic == pytest.approx([159.0, 190.0], rel=1e-6)
    assert fit_damping(SPEED, F).rms > 0.1, "one pair for both directions cannot meet both"


@pytest.mark.parametrize(
    ("force", "speed", "expected"),
    [  # thesis, tables 3.3, 3.4, 3.5; what they give, errata 20-22
        ([4, 8, 10, 12, 16, 18], [0.048, 0.1415, 0.1745, 0.2124, 0.2685, 0.2872], [54.16, 23.15]),
        ([2, 4, 6, 8], [0.041, 0.065, 0.1314, 0.1575], [49.82, 0.0]),
        ([1.10, 2.20, 3.30, 5.5], [0.028, 0.034, 0.041, 0.0603], [22.11, 1179.4]),
    ],
)
def test_tables_of_the_thesis(force: list[float], speed: list[float], expected: list[float]) -> None:
    fit = fit_damping(np.array(speed), np.array(force, float))
    assert fit.coefficients == pytest.approx(expected, abs=0.05)


@pytest.mark.system
@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("nonnegative", [True, False])
@pytest.mark.parametrize("truth", [(6.5, 159.0), (0.5, 190.0)])
def test_band_and_intervals_hold_the_truth(known: bool, nonnegative: bool, truth: tuple[float, float]) -> None:
    rng = np.random.default_rng(1)
    at = np.array([0.05, 0.2, 0.4])
    held = []
    for _ in range(400):
        F = force(SPEED, *truth) + rng.normal(0, 0.4, SPEED.size)
        fit = fit_damping(SPEED, F, sigma=0.4 if known else None, nonnegative=nonnegative)
        low, high = fit.force_band(at)
        inside = fit.interval()
        held.append(
            np.concatenate(
                [
                    (low < force(at, *truth)) & (force(at, *truth) < high),
                    (inside[:, 0] < truth) & (truth < inside[:, 1]),
                ]
            )
        )
    rate = np.mean(held, axis=0)
    assert np.all(rate > 0.92), rate  # binomial: 95 % of 400 is within 2.2 % two times out of a hundred
    if not nonnegative:
        assert np.all(rate < 0.98), rate


def test_uncertain_speeds_widen_the_band_by_the_slope() -> None:
    rng = np.random.default_rng(2)
    truth, at, held = (6.5, 159.0), np.array([0.3]), []
    for _ in range(400):
        v = SPEED + rng.normal(0, 0.004, SPEED.size)
        fit = fit_damping(v, force(SPEED, *truth), sigma=0.01, sigma_velocity=0.004)
        low, high = fit.force_band(at)
        held.append(low[0] < force(at, *truth)[0] < high[0])
    assert 0.92 < np.mean(held) <= 0.99


def test_terms_that_cannot_be_distinguished_are_reported() -> None:
    v = np.array([0.20, 0.22, 0.24, 0.26])
    fit = fit_damping(v, force(v, 10.0, 50.0), sigma=0.3)
    assert any("cannot be separated" in note and "0.2-0.26" in note for note in fit.notes), fit.notes
    assert fit.correlation[0] < -0.97
    low, high = fit.force_band(np.array([0.23]))
    assert high[0] - low[0] < 0.7, "the sum is known all the same"
    assert fit_damping(SPEED, force(SPEED, 6.5, 159.0), sigma=0.05).notes == ()


def test_says_when_a_coefficient_is_on_its_bound() -> None:
    F = force(SPEED, 50.0, -20.0)
    fit = fit_damping(SPEED, F, sigma=0.1)
    assert fit.quadratic[0] == 0
    assert any("on its bound" in note for note in fit.notes)
    assert any(
        "times the declared noise" in note for note in fit_damping(SPEED, F + 3 * np.cos(40 * SPEED), sigma=0.1).notes
    )
    assert fit_damping(SPEED, F, sigma=0.1, nonnegative=False).quadratic[0] == pytest.approx(-20.0)


def test_two_runs_give_no_uncertainty_and_say_so() -> None:
    fit = fit_damping(np.array([0.1, 0.3]), np.array([2.0, 15.0]))
    assert np.all(np.isinf(fit.force_band(np.array([0.2]))[1]))
    assert any("exact" in note for note in fit.notes)


@pytest.mark.parametrize(
    ("v", "F", "more", "words"),
    [
        ([0.1, 0.2], [1.0], {}, "one each per run"),
        ([0.1, np.nan], [1.0, 2.0], {}, "not finite"),
        ([0.2, 0.2, 0.2], [1.0, 1.1, 0.9], {}, "two speeds"),
        ([0.1, 0.2, -0.1], [1.0, 2.0, -1.0], {"astern": True}, "astern"),
        ([0.1, 0.2, 0.3], [1.0, 2.0, 3.0], {"sigma": 0.0}, "positive"),
        ([0.1, 0.2, 0.3], [1.0, 2.0, 3.0], {"sigma_velocity": 0.1}, "sigma"),
    ],
)
def test_bad_input_is_named(v: list[float], F: list[float], more: dict, words: str) -> None:
    with pytest.raises(IdentificationError, match=words):
        fit_damping(np.array(v), np.array(F), **more)
