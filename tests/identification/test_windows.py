"""Steady windows: every plateau found, ramps and tails kept out, nothing across gaps."""

import numpy as np
import pytest

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.steady.windows import steady_windows

T = np.arange(0, 60, 0.02)
ENDS, LEVELS = (5.0, 15.0, 20.0, 30.0, 35.0, 45.0), (0.0, 0.1, 0.0, 0.25, 0.0, -0.3, 0.0)


def tow(rate: float = 0.2) -> np.ndarray:
    """A carriage that ramps between the levels."""
    goal = np.array(LEVELS)[np.searchsorted(ENDS, T, side="right")]
    v = np.zeros_like(T)
    for k in range(1, len(T)):
        v[k] = v[k - 1] + np.clip(goal[k] - v[k - 1], -rate * 0.02, rate * 0.02)
    return v


@pytest.mark.parametrize("noise", [0.0, 0.002, 0.01])
@pytest.mark.parametrize("seed", range(5))
def test_every_plateau_is_found_and_no_ramp(noise: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    v = tow()
    windows = steady_windows(T, v + rng.normal(0, noise, T.size))
    assert [w.rest for w in windows] == [True, False, True, False, True, False, True]
    assert np.allclose([w.mean for w in windows], LEVELS, atol=1e-3 + 0.3 * noise)
    for window, level in zip(windows, LEVELS, strict=True):
        inside = (window.start + 0.1 <= T) & (window.end - 0.1 >= T)
        assert np.all(np.abs(v[inside] - level) < 0.01 + 3 * noise), (window, level)
        assert abs(window.mean - level) < 0.005 * abs(level) + 4 * window.std + 1e-9


def test_means_are_as_uncertain_as_they_say() -> None:
    rng = np.random.default_rng(3)
    t, missed = np.arange(0, 20, 0.05), []
    for _ in range(200):
        (window,) = steady_windows(t, 0.2 + rng.normal(0, 0.01, t.size))
        missed.append((window.mean - 0.2) / window.std)
    assert 0.85 < np.std(missed) < 1.2


def test_the_end_of_a_transient_is_neither_in_the_window_nor_a_window() -> None:
    rng = np.random.default_rng(0)
    v = 0.2 * (1 - np.exp(-T / 3)) + rng.normal(0, 0.002, T.size)
    (window,) = [w for w in steady_windows(T, v) if not w.rest]
    assert window.mean == pytest.approx(0.2, rel=0.005)
    assert window.start > 8


def test_slow_drift_is_not_steady() -> None:
    assert not [w for w in steady_windows(T, 0.1 + 0.01 * T, shortest=20.0)]


def test_the_force_must_be_steady_too() -> None:
    v = np.full_like(T, 0.2)
    force = np.where(T < 30, 5 + 0.3 * T, 14.0)
    (window,) = [w for w in steady_windows(T, v, force, shortest=5.0) if w.start > 15]
    assert window.start > 25
    assert window.force == pytest.approx(14.0, rel=0.02)


def test_no_window_crosses_a_gap() -> None:
    v = np.full_like(T, 0.2)
    v[(T > 20) & (T < 24)] = np.nan
    windows = steady_windows(T, v)
    assert [w.start < 20 and w.end > 24 for w in windows] == [False, False]
    assert windows[0].end == pytest.approx(20, abs=0.5)


@pytest.mark.parametrize(
    ("t", "v", "words"),
    [
        (T[:10], T[:10], "at least"),
        (T[:50], T[:50], "shorter than"),
        (T[::-1], T, "increasing"),
        (T, T[:-1], "as many"),
    ],
)
def test_bad_input_is_named(t: np.ndarray, v: np.ndarray, words: str) -> None:
    with pytest.raises(IdentificationError, match=words):
        steady_windows(t, v)
