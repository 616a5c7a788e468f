"""Thrust curves: recovery, measured tables, thrust and damping together, bad input."""

from pathlib import Path

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError, IdentificationError
from rovtwin.identification.known import Known
from rovtwin.identification.steady.thrust import fit_bollard, read_thrust, shape
from rovtwin.identification.steady.thrust_damping import ThrustPrior, fit_thrust_and_damping

DATA = Path(__file__).parents[2].parent / "shared" / "data"
T200, LIU = DATA / "t200", DATA / "bluerov_liu" / "measured_thrust.txt"
needs_data = pytest.mark.skipif(not T200.exists(), reason=f"measured data are not at {DATA}")

# Thesis table 3.3, and its towing of surge ahead, (4.3).
COMMAND = np.array([0.2, 0.4, 0.5, 0.6, 0.8, 0.9])
SPEED = np.array([0.048, 0.1415, 0.1745, 0.2124, 0.2685, 0.2872])
TOWED = 6.48 * SPEED + 158.86 * SPEED**2


def bollard(seed, noise=0.3, ahead=50.0, astern=40.0, dead_band=0.06, exponent=1.6):
    u = np.linspace(-1, 1, 41)
    force = np.sign(u) * np.where(u < 0, astern, ahead) * shape(u, dead_band, exponent)
    return np.stack([u, force + noise * np.random.default_rng(seed).standard_normal(len(u))], axis=1)


def test_recovery_and_intervals_over_100_seeds():
    truth = np.array([50.0, 0.06, 1.6])
    fits = [fit_bollard(bollard(seed)).both for seed in range(100)]
    z = np.array([(fit.values - truth) / fit.sd for fit in fits])
    assert (np.mean(np.abs(z) < 1.96, axis=0) > 0.87).all()
    astern = [fit.astern for fit in fits]
    assert np.mean([a for a in astern if a is not None]) == pytest.approx(40.0, rel=0.01)


def test_the_curve_gives_the_force_of_the_vehicle():
    fit = fit_bollard(bollard(0, noise=0.0)).both
    assert fit.force(np.array([1.0, -1.0, 0.0, 0.05])) == pytest.approx([50.0, -40.0, 0.0, 0.0], abs=1e-6)


@needs_data
@pytest.mark.parametrize(
    ("volts", "ahead", "astern", "share"),
    [(10, 29.4, 23.2, 0.005), (12, 37.2, 29.3, 0.005), (14, 45.4, 35.6, 0.006),
     (16, 52.7, 41.3, 0.006), (18, 59.8, 47.0, 0.009), (20, 66.3, 51.2, 0.010)],
)  # fmt: skip
def test_t200_at_every_voltage(volts, ahead, astern, share):
    """Full force as the tables' ends have it (within 4 %), and residuals below 1 % of it."""
    voltage, points = read_thrust(T200 / f"{volts}V.csv")
    fit = fit_bollard(points, voltage=voltage)
    assert voltage == pytest.approx(volts, rel=0.01)
    assert (fit.both.values[0], fit.both.astern) == pytest.approx((ahead, astern), abs=0.1)
    assert fit.both.values[0] == pytest.approx(points[-1, 1], rel=0.04)
    assert fit.both.rms < share * fit.both.values[0]
    assert 1.38 < fit.both.values[2] < 1.8


@needs_data
def test_the_curve_of_the_library_vehicle():
    """Full force held as measured: dead band 0.07 and exponent 1.33, as blueye_pioneer.yaml has them."""
    fit = fit_bollard(read_thrust(T200 / "16V.csv")[1], hold_full=True).both
    assert fit.values[1:] == pytest.approx([0.07, 1.33], abs=0.01)
    assert fit.rms < 0.0115 * fit.values[0]


@needs_data
def test_two_columns_with_a_header():
    voltage, points = read_thrust(LIU)
    assert voltage is None
    assert points[0] == pytest.approx([-1.0, -40.0788]) and points[-1] == pytest.approx([1.0, 49.9531])
    assert fit_bollard(points).both.rms < 0.01 * 50


def test_columns_in_any_order_and_kgf(tmp_path):
    table = bollard(1)
    one, two = tmp_path / "one.csv", tmp_path / "two.txt"
    one.write_text("command,force_kgf\n" + "\n".join(f"{u},{f / 9.80665}" for u, f in table))
    two.write_text("\n".join(f"{f}\t{u}" for u, f in table))
    for path in (one, two):
        assert read_thrust(path)[1] == pytest.approx(table, abs=1e-9)


# Together with damping.


def rms(error):
    return float(np.sqrt(np.mean(error**2)))


def test_the_thesis_surge_runs_meet_its_towing_once_the_thrust_curve_may_bend():
    """3.45 N apart when thrust is linear in command, 0.74 N with 20 a^1.75; here found from a prior of 1.5 to 2."""
    assert rms(20 * COMMAND - TOWED) == pytest.approx(3.45, abs=0.01)
    assert rms(20 * COMMAND**1.75 - TOWED) == pytest.approx(0.74, abs=0.01)
    fit = fit_thrust_and_damping(COMMAND, SPEED, ThrustPrior(Known(20.0, 0.4)))
    assert rms(fit.force(COMMAND) - TOWED) < 0.8
    assert rms(fit.drag(SPEED) - TOWED) < 0.5
    assert fit.as_linear == pytest.approx([54.16, 23.15], abs=0.01)  # the thesis's way
    towing = np.array([6.48, 158.86])
    assert (np.abs(fit.damping - towing) < 2 * fit.sd[:2]).all()


def test_a_thrust_held_linear_gives_the_thesis_answer():
    fit = fit_thrust_and_damping(COMMAND, SPEED, ThrustPrior(Known(20.0, 0.4), exponent=Known(1.0)))
    assert rms(fit.drag(SPEED) - TOWED) == pytest.approx(3.45, abs=0.05)


def test_truth_within_the_band_of_the_drag_over_100_seeds():
    """Synthetic runs, noise of 3 mm/s, thrust drawn from the prior each time: the band holds the drag."""
    damping, u = np.array([6.48, 158.86]), np.linspace(0.2, 1.0, 9)
    prior = ThrustPrior(Known(20.0, 0.4), Known(1.75, 0.125))
    inside = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        force = rng.normal(20.0, 0.4) * u ** rng.normal(1.75, 0.125)
        v = 2 * force / (damping[0] + np.sqrt(damping[0] ** 2 + 4 * damping[1] * force)) + rng.normal(0, 0.003, len(u))
        fit = fit_thrust_and_damping(u, v, prior, sigma_velocity=0.003)
        at = np.array([0.1, 0.2, 0.3])
        true = damping[0] * at + damping[1] * at**2
        inside.append(np.abs(fit.drag(at) - true) < 1.96 * fit.drag_sd(at))
    assert (np.mean(inside, axis=0) > 0.87).all(), np.mean(inside, axis=0)


def test_a_prior_against_the_data_is_reported():
    u = COMMAND[COMMAND > 0.3]
    v = 2 * 20 * u**3 / (60 + np.sqrt(60**2 + 4 * 5 * 20 * u**3))
    fit = fit_thrust_and_damping(u, v, ThrustPrior(Known(20.0, 0.4)), sigma_velocity=0.001)
    assert any("exponent" in note and "standard deviations" in note for note in fit.notes)


@needs_data
def test_a_prior_from_bollard_tests():
    curves = [fit_bollard(read_thrust(T200 / f"{v}V.csv")[1]) for v in (10, 12, 14, 16, 18, 20)]
    prior = ThrustPrior.of(curves, Known(20.0, 0.4))
    assert 1.4 < prior.exponent.value < 1.7 and prior.exponent.sd > 0.05
    fit = fit_thrust_and_damping(COMMAND, SPEED, prior)
    assert rms(fit.drag(SPEED) - TOWED) < 1.0  # of 3.45 N as printed


# Bad input.


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda p: p * [1, -1], "against the command"),
        (lambda p: p[:, ::-1], "swap the columns"),
        (lambda p: p * [1500, 1], "PWM"),
        (lambda p: p[:3], "expected 5 or more"),
        (lambda p: p * [1, 0], "no curve"),
    ],
)
def test_bad_points_are_named(spoil, message):
    with pytest.raises(IdentificationError, match=message):
        fit_bollard(spoil(bollard(0)))


@pytest.mark.parametrize(
    ("text", "message"),
    [("a,b\n1,x\n", "expected a command and a force"), ("0.1 0.2\n" * 6, "which column"), ("1 2\n", "5 or more")],
)
def test_bad_files_are_named(tmp_path, text, message):
    path = tmp_path / "thrust.txt"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        read_thrust(path)


def test_bad_runs_are_named():
    prior = ThrustPrior(Known(20.0, 0.4))
    with pytest.raises(IdentificationError, match="axis turned round"):
        fit_thrust_and_damping(COMMAND, -SPEED, prior)
    with pytest.raises(IdentificationError, match="3 or more"):
        fit_thrust_and_damping(COMMAND[:2], SPEED[:2], prior)
    with pytest.raises(IdentificationError, match="expected -1 to 1"):
        fit_thrust_and_damping(100 * COMMAND, SPEED, prior)
