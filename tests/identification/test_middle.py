"""From the maximum of the posterior to its mean, on problems whose posterior can be integrated."""

from types import SimpleNamespace

import numpy as np
import pytest

from rovtwin.core.numerics import jax, jnp
from rovtwin.identification.joint.gaussian import Gaussian
from rovtwin.identification.joint.middle import moved_to_the_middle

RIGID, COUNT, PULL = 30.0, 12, 0.02  # [kg]; directions of motion; of the pull on a scale


def problem_of(names, mean, information, scaled, pulled):
    """What the correction asks of a Problem; `pulled` is the information of a pull on the first parameter."""
    static = information + np.diag([pulled] + [0.0] * (len(names) - 1))
    return SimpleNamespace(
        information=information,
        prior=Gaussian(mean, np.linalg.inv(information)),
        static_information=lambda theta: static,
        shooting=SimpleNamespace(
            parameters=SimpleNamespace(free=[SimpleNamespace(name=name) for name in names]),
            scaled=jax.jit(scaled),
            scaled_by_theta=jax.jit(jax.jacfwd(scaled)),
        ),
    )


def test_along_the_scale_of_forces_it_is_the_mean_and_not_the_maximum():
    """Motion gives (rigid + added) / thrust of many directions exactly; a pull gives the thrust to 2 %."""
    ratio = np.full(COUNT, 61.0 / 20.0)  # masses of 61 kg in all, 20 N

    def added(log_thrust):
        return ratio * np.exp(log_thrust)[..., None] - RIGID

    def scaled(theta, s):
        return jnp.concatenate([theta[:1] + s, jnp.log((RIGID + jnp.exp(theta[1:])) * jnp.exp(s) - RIGID)])

    width = 0.5
    information = np.diag([0.15**-2.0] + [width**-2.0] * COUNT)
    mean = np.concatenate([[np.log(20.0)], np.full(COUNT, np.log(31.0))])
    names = ["thrusters.surge.force_ahead"] + ["added_mass.surge_pitch"] * COUNT
    problem = problem_of(names, mean, information, scaled, PULL**-2.0)
    # By the prior and the pull alone the maximum is at 20 N.
    maximum = mean.copy()
    J = np.zeros((COUNT, COUNT + 1))
    J[:, 0], J[range(COUNT), range(1, COUNT + 1)] = -61.0 / 20.0, 31.0 / 20.0
    theta, _ = moved_to_the_middle(problem, maximum, 1e8 * J.T @ J)

    grid = np.log(20.0) + np.linspace(-0.15, 0.15, 3001)
    off = (grid - np.log(20.0)) ** 2 * (0.15**-2.0 + PULL**-2.0)
    off += np.sum(((np.log(added(grid)) - np.log(31.0)) / width) ** 2, axis=1)
    # Room of the added masses that fit the motion: their logarithms' widths.
    log_p = -0.5 * off + np.sum(np.log(np.exp(grid)[:, None] / added(grid)), axis=1)
    p = np.exp(log_p - log_p.max())
    exact = float(p @ grid / p.sum())
    assert exact < np.log(20.0) - 0.1 * PULL
    assert theta[0] == pytest.approx(exact, abs=0.03 * PULL)
    np.testing.assert_allclose(np.exp(theta[1:]), added(theta[0]), rtol=1e-6)  # the same motion


def test_where_the_readings_tell_the_scale_nothing_moves_along_it():
    def scaled(theta, s):
        return theta + s

    problem = problem_of(["thrusters.a.force_ahead", "thrusters.b.force_ahead"], np.zeros(2), np.eye(2), scaled, 1.0)
    theta, covariance = moved_to_the_middle(problem, np.array([0.1, -0.2]), 1e4 * np.eye(2))
    np.testing.assert_allclose(theta, [0.1, -0.2])
    np.testing.assert_allclose(covariance, np.diag([1 / 10002, 1 / 10001]))


@pytest.mark.parametrize("measured", [0.1, 0.5, 1.0, 1.5])
@pytest.mark.parametrize("noise", [0.2, 0.6])
def test_a_damping_that_is_hardly_seen_is_taken_at_its_mean(measured, noise):
    """exp(theta) read once with noise, prior of a factor of 3.3."""
    width = 1.2
    theta = np.linspace(-8, 8, 160_001)
    log_p = -0.5 * ((np.exp(theta) - measured) / noise) ** 2 - 0.5 * (theta / width) ** 2
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    mean = float(p @ theta)
    exact = mean, float(np.sqrt(p @ (theta - mean) ** 2))
    top = theta[np.argmax(log_p)]
    names = ["thrusters.surge.force_ahead", "linear_damping_astern.surge"]
    information = np.diag([1.0, width**-2.0])
    problem = problem_of(names, np.zeros(2), information, lambda theta, s: theta + s, 0.0)
    told = np.diag([1e6, np.exp(2 * top) / noise**2])
    found, covariance = moved_to_the_middle(problem, np.array([0.0, top]), told)
    assert found[1] == pytest.approx(exact[0], abs=1e-3)
    assert np.sqrt(covariance[1, 1]) == pytest.approx(exact[1], rel=1e-3)
