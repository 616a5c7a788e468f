"""Velocity from positions: recovery, honest uncertainty, gaps, outliers, wrapped angles."""

import numpy as np
import pytest

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.steady.smoother import smooth


def start_up(t: np.ndarray, tau: float = 2.0, speed: float = 0.2) -> tuple[np.ndarray, np.ndarray]:
    """Distance and velocity of a vehicle that speeds up."""
    return speed * (t - tau * (1 - np.exp(-t / tau))), speed * (1 - np.exp(-t / tau))


def test_without_noise_the_velocity_is_exact() -> None:
    t = np.arange(0, 60, 0.02)
    x, v = start_up(t)
    track = smooth(t, x + 500.0)
    assert np.abs(track.velocity(t) - v).max() < 1e-5
    assert np.abs(track.position(t) - x - 500.0).max() < 1e-6


@pytest.mark.system
def test_noise_and_velocity_are_as_uncertain_as_they_say() -> None:
    """100 records of ArUco-like positions, 3 cm at 15 Hz, with a gap."""
    rng = np.random.default_rng(0)
    t = np.arange(0, 25, 1 / 15)
    t = t[(t < 8) | (t > 10.5)]
    at = np.linspace(11, 24.5, 40)
    inside, means, noise = [], [], []
    for _ in range(100):
        x, _ = start_up(t)
        _, v = start_up(at)
        track = smooth(t, x + rng.normal(0, 0.03, t.size))
        inside.append(np.abs(track.velocity(at) - v) < 1.96 * track.velocity_std(at))
        mean, variance = track.weighted_velocity(at, np.full(at.size, 1 / at.size))
        means.append((mean - v.mean()) / np.sqrt(variance))
        noise.append(track.sigma)
    assert np.mean(noise) == pytest.approx(0.03, rel=0.02)
    assert 0.93 < np.mean(inside) <= 1
    assert np.mean(np.abs(means) < 1.96) > 0.9
    assert 0.6 < np.std(means) < 1.2


def test_far_better_than_a_plain_difference() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(0, 30, 1 / 15)
    x, v = start_up(t)
    y = x + rng.normal(0, 0.03, t.size)
    error = np.std(smooth(t, y).velocity(t) - v)
    assert error < 0.02
    assert np.std(np.gradient(y, t) - v) > 15 * error


def test_there_is_no_estimate_inside_a_long_gap() -> None:
    rng = np.random.default_rng(2)
    t = np.arange(0, 30, 0.1)
    t = t[(t < 10) | (t > 13)]
    track = smooth(t, 0.2 * t + rng.normal(0, 0.01, t.size))
    inside = np.array([10.5, 12.0, 12.9])
    assert not track.trusted(inside).any()
    assert np.isnan(track.velocity(inside)).all() and np.isnan(track.velocity_std(inside)).all()
    assert len(track.spans) == 2
    assert track.spans[0][1] < 10 < 13 < track.spans[1][0]
    assert len(smooth(t, 0.2 * t, gap=5.0).spans) == 1


def test_uncertainty_is_larger_at_the_ends_and_where_readings_are_missing() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(0, 30, 0.1)
    t = t[(t < 15) | (t > 16.5)]
    x, _ = start_up(t)
    track = smooth(t, x + 0.1 * np.sin(t) + rng.normal(0, 0.01, t.size), gap=5.0)
    end, gap, middle = track.velocity_std(np.array([29.85, 15.75, 22.0]))
    assert end > 1.5 * middle
    assert gap > 1.2 * middle


def test_outliers_are_left_out() -> None:
    rng = np.random.default_rng(4)
    t = np.arange(0, 25, 1 / 15)
    x, v = start_up(t)
    y = x + rng.normal(0, 0.03, t.size)
    y[7::40] += 1.0
    track = smooth(t, y)
    assert track.left_out == len(y[7::40])
    assert np.abs(track.velocity(t) - v)[20:-5].max() < 0.03


def test_angles_are_unwrapped() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(0, 40, 0.05)
    t = t[(t < 18) | (t > 29)]
    psi = np.mod(0.5 * t + 3 + np.pi + rng.normal(0, 0.01, t.size), 2 * np.pi) - np.pi
    assert np.nanmax(np.abs(smooth(t, psi, angle=True).velocity(t) - 0.5)) < 0.02


@pytest.mark.parametrize(
    ("t", "value", "words"),
    [
        (np.arange(5.0), np.arange(5.0), "at least"),
        (np.arange(20.0), np.arange(19.0), "one value"),
        (np.arange(20.0)[::-1], np.arange(20.0), "increase"),
        (np.arange(20.0), np.full(20, np.nan), "finite"),
        (np.repeat([0.0, 100.0, 200.0], 5) + np.tile(np.arange(5) * 0.1, 3), np.arange(15.0), "in a row"),
    ],
)
def test_bad_input_is_named(t: np.ndarray, value: np.ndarray, words: str) -> None:
    with pytest.raises(IdentificationError, match=words):
        smooth(t, value)
