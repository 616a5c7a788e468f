"""Forces with their standard deviations, with and without the common scale; whether parts repeat."""

from types import SimpleNamespace

import numpy as np
import pytest

from rovtwin.commission.evidence import repeats as module
from rovtwin.commission.evidence.forces import damping_forces, pushed, thrust_forces, up_to_scale
from rovtwin.commission.evidence.repeats import about, repeats
from rovtwin.core.numerics import jax
from rovtwin.identification.joint.model.catalogue import catalogue, choose
from rovtwin.identification.joint.uncertainty.apart import Apart
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics.dynamics import damping_wrench


@pytest.fixture(scope="module")
def result():
    """Surge and thrust of a Double Blueye, whose scale is known to 10 % and nothing else to more than 1 %."""
    patterns = ["linear_damping.surge", "quadratic_damping.surge", "thrusters.*.force_*"]
    parameters = choose(catalogue(load_vehicle("double_blueye")), patterns)
    n = len(parameters)
    C = 0.1**2 * np.ones((n, n)) + 0.01**2 * np.eye(n)
    theta, tested = np.zeros(n), {"surge": (-0.1, 0.5), "yaw": (-0.4, 0.5)}
    return SimpleNamespace(
        parameters=parameters, theta=theta, covariance=C, tested=tested,
        model=lambda: parameters.model_at(theta)[0], solution=None,
    )  # fmt: skip


def test_damping_is_that_of_the_model_at_the_fastest_tested_speeds(result):
    surge, *yaw = damping_forces(result)
    assert (surge.axis, surge.at) == ("surge", 0.5), "what was hardly tested astern is no speed of its own"
    assert [one.at for one in yaw] == [-0.4, 0.5]
    nu = np.zeros(6)
    nu[0] = 0.5
    assert surge.value == pytest.approx(float(damping_wrench(result.model(), nu)[0]))
    assert surge.unit == "N" and yaw[0].unit == "N m"


@pytest.mark.system
def test_widths_are_those_of_draws(result):
    (surge, *_) = damping_forces(result)
    draws = np.random.default_rng(1).multivariate_normal(result.theta, result.covariance, 4000)
    nu = np.zeros(6)
    nu[0] = 0.5
    values = jax.vmap(lambda theta: damping_wrench(result.parameters.model_at(theta)[0], nu)[0])(draws)
    assert surge.std(result.covariance) == pytest.approx(np.std(np.asarray(values)), rel=0.1)


def test_without_the_scale_what_is_left_is_what_tests_can_tell(result):
    (surge, *_) = damping_forces(result)
    whole, rest = surge.share(result.covariance), surge.share(up_to_scale(result))
    assert whole == pytest.approx(2 * np.hypot(0.1, 0.01 / np.sqrt(2)), rel=0.05)
    assert rest < 0.03 and rest < 0.2 * whole
    assert up_to_scale(result).shape == result.covariance.shape


def test_thrust_of_all_is_what_a_scale_would_read(result):
    found = {one.axis: one for one in thrust_forces(result)}
    thrusters = result.model().thrusters
    assert found["surge"].value == pytest.approx(2 * float(thrusters.force_ahead[0]))
    assert set(found) == {"surge", "sway", "heave", "yaw"} == set(pushed(result.model()))


def apart_by(theta, n, std=0.02):
    covariance = np.tile(2 * std**2 * np.eye(n), (2, 2, 1, 1))
    width = np.tile(np.sqrt(2) * std * np.ones(n), (2, 2, 1))
    return Apart(("part-1", "part-2"), np.array(theta), np.full((2, n), std), width, covariance)


def test_parts_that_agree_repeat_and_others_are_named(result):
    n, forces = len(result.theta), damping_forces(result)
    result.solution = SimpleNamespace(apart=apart_by([np.zeros(n), np.full(n, 0.01)], n), halves=None)
    rows = repeats(result, forces)
    assert len(rows) == len(forces) and all(row["en"] < 1.0 for row in rows)
    assert [check.verdict for check in about(rows)] == ["ok"]
    result.solution = SimpleNamespace(apart=apart_by([np.zeros(n), np.full(n, 0.3)], n), halves=None)
    rows = repeats(result, forces)
    (check,) = about(rows)
    surge = rows[0]
    expected = forces[0].slope @ np.full(n, 0.3)
    assert surge["largest_difference"] == pytest.approx(abs(expected)) and surge["en"] > module.MOST
    assert check.verdict == "warning" and "part-1 against part-2" in check.text and "surge" in check.text


def test_a_single_short_test_says_that_nobody_looked(result):
    result.solution = SimpleNamespace(apart=None, halves=None)
    (check,) = about(repeats(result, damping_forces(result)))
    assert check.verdict == "note" and "not looked at" in check.text
