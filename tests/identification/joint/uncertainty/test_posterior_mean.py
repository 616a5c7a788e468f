"""From the maximum of the posterior to its mean, on problems whose posterior can be integrated."""

from types import SimpleNamespace

import numpy as np
import pytest

from rovtwin.core.numerics import jax, jnp
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.uncertainty.posterior_mean import moved_to_the_middle

RIGID, COUNT = 30.0, 12  # [kg]; directions of motion


def problem_of(names, mean, information, scaled, pulled):
    """What the correction asks of a Problem; `pulled` is the information of a pull on the first parameter."""
    static = information + np.diag([pulled] + [0.0] * (len(names) - 1))

    def static_cost(theta):
        return float((theta - mean) @ static @ (theta - mean))

    return SimpleNamespace(
        information=information,
        prior=Gaussian(mean, np.linalg.inv(information)),
        static_information=lambda theta: static,
        static_cost=static_cost,
        shooting=SimpleNamespace(
            parameters=SimpleNamespace(free=[SimpleNamespace(name=name) for name in names]),
            scaled=jax.jit(scaled),
            scaled_by_theta=jax.jit(jax.jacfwd(scaled)),
            scale_tangent=jax.jit(lambda theta: jax.jacfwd(scaled, argnums=1)(theta, 0.0)),
        ),
    )


@pytest.mark.parametrize(
    ("pull", "added", "width"),
    [(0.02, 31.0, 0.5), (None, 31.0, 1.0), (0.05, 10.0, 0.5)],
)
def test_along_the_scale_of_forces_it_is_the_mean_and_not_the_maximum(pull, added, width):
    """Motion gives (rigid + added) / thrust of many directions exactly; a pull, if there is one, gives the thrust."""
    total, thrust, before = RIGID + added, np.log(20.0), 0.15

    def masses(log_thrust):
        return total / 20.0 * np.exp(log_thrust) - RIGID

    def scaled(theta, s):
        return jnp.concatenate([theta[:1] + s, jnp.log((RIGID + jnp.exp(theta[1:])) * jnp.exp(s) - RIGID)])

    information = np.diag([before**-2.0] + [width**-2.0] * COUNT)
    maximum = np.concatenate([[thrust], np.full(COUNT, np.log(added))])  # by prior and pull alone, too
    names = ["thrusters.surge.force_ahead"] + ["added_mass.surge_pitch"] * COUNT
    problem = problem_of(names, maximum, information, scaled, 0.0 if pull is None else pull**-2.0)
    J = np.zeros((COUNT, COUNT + 1))
    J[:, 0], J[range(COUNT), range(1, COUNT + 1)] = -total / 20.0, added / 20.0
    theta, covariance = moved_to_the_middle(problem, maximum, 1e8 * J.T @ J)

    grid = thrust + np.linspace(-0.9, 0.9, 20_001)
    grid = grid[masses(grid) > 0]
    of_masses = np.log(masses(grid))
    off = (grid - thrust) ** 2 * (before**-2.0 + (0.0 if pull is None else pull**-2.0))
    off += COUNT * ((of_masses - np.log(added)) / width) ** 2
    # Room of the added masses that fit the motion: their logarithms' widths.
    log_p = -0.5 * off + COUNT * (grid - of_masses)
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    exact = float(p @ grid)
    std = float(np.sqrt(p @ (grid - exact) ** 2))
    assert exact < thrust - 0.1 * std
    assert theta[0] == pytest.approx(exact, abs=0.1 * std)
    assert np.sqrt(covariance[0, 0]) == pytest.approx(std, rel=0.2)
    np.testing.assert_allclose(np.exp(theta[1:]), masses(theta[0]), rtol=1e-6)  # the same motion


@pytest.mark.parametrize("reported", [1.0, 1e4])
def test_where_the_readings_tell_the_scale_nothing_moves_along_it(reported):
    """The maximum is where the readings hold against the prior, not where the prior would have it."""

    def scaled(theta, s):
        return theta + s

    problem = problem_of(["thrusters.a.force_ahead", "thrusters.b.force_ahead"], np.zeros(2), np.eye(2), scaled, 1.0)
    theta, covariance = moved_to_the_middle(problem, np.array([0.7, 0.4]), reported * np.eye(2))
    np.testing.assert_allclose(theta, [0.7, 0.4], atol=1e-9)
    np.testing.assert_allclose(covariance, np.diag([1 / (reported + 2), 1 / (reported + 1)]))


@pytest.mark.system
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
    reported = np.diag([1e6, np.exp(2 * top) / noise**2])
    found, covariance = moved_to_the_middle(problem, np.array([0.0, top]), reported)
    assert found[1] == pytest.approx(exact[0], abs=1e-3)
    assert np.sqrt(covariance[1, 1]) == pytest.approx(exact[1], rel=1e-3)


def test_two_dampings_of_one_direction_come_nearer_to_their_means():
    """Only their sum is read, at one speed, with noise: exp(a) + exp(b) = 1.5 +- 0.4, prior of a factor of 2.2 each.

    Each is moved by itself, the other giving way, so that not all of the way is made.
    """
    width, read, noise = 0.8, 1.5, 0.4
    x = np.linspace(-5, 3, 801)
    a, b = np.meshgrid(x, x, indexing="ij")
    log_p = -0.5 * ((np.exp(a) + np.exp(b) - read) / noise) ** 2 - 0.5 * (a**2 + b**2) / width**2
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    mean = float(np.sum(p * a))
    std = float(np.sqrt(np.sum(p * (a - mean) ** 2)))
    i, j = np.unravel_index(np.argmax(log_p), log_p.shape)
    names = ["thrusters.surge.force_ahead", "linear_damping.surge", "quadratic_damping.surge"]
    problem = problem_of(names, np.zeros(3), np.diag([1.0] + [width**-2.0] * 2), lambda theta, s: theta + s, 0.0)
    J = np.array([0.0, np.exp(x[i]), np.exp(x[j])]) / noise
    maximum = np.array([0.0, x[i], x[j]])
    found, covariance = moved_to_the_middle(problem, maximum, np.outer(J, J) + np.diag([1e6, 0.0, 0.0]))
    assert x[i] > mean + 0.25 * std
    assert mean < np.mean(found[1:]) < x[i] - 0.05 * std
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)[1:]), std, rtol=0.25)


@pytest.mark.parametrize(("unsure", "reported", "seen"), [(1.0, 40.0, 0.0), (1.0, 0.05, 0.0), (0.8, 400.0, 0.5)])
def test_a_coupling_has_the_interval_of_its_skewed_posterior(unsure, reported, seen):
    """The readings tell D_ji = share sqrt(D_ii), with D_ii unsure: against the posterior on a grid.

    The method does not count that a small damping leaves its couplings more room: a fifth too narrow at most here, less
    than by curvature at the maximum.
    """

    def scaled(theta, s):
        return theta + jnp.array([s, 0.0])

    x, c = np.meshgrid(np.linspace(-5, 5, 801) * unsure, np.linspace(-4, 4, 1601), indexing="ij")
    log_p = -0.5 * (x / unsure) ** 2 - 0.5 * c**2 - 0.5 * reported * (c * np.exp(0.5 * x) - seen) ** 2
    p = np.exp(log_p - log_p.max())
    share = p.sum(axis=0) / p.sum()
    mean, below = float(share @ c[0]), np.cumsum(share)
    low, high = np.interp([0.025, 0.975], below, c[0])

    top = np.unravel_index(np.argmax(log_p), log_p.shape)
    maximum = np.array([x[top], c[top]])
    J = np.exp(0.5 * maximum[0]) * np.array([0.5 * maximum[1], 1.0])
    names = ["linear_damping_astern.surge", "linear_damping_astern.surge_pitch"]
    problem = problem_of(names, np.zeros(2), np.diag([unsure**-2.0, 1.0]), scaled, 0.0)
    readings = reported * np.outer(J, J)
    theta, covariance = moved_to_the_middle(problem, maximum, readings)
    std, by_curvature = np.sqrt(covariance[1, 1]), np.sqrt(np.linalg.inv(readings + problem.information)[1, 1])
    assert 1.96 * std == pytest.approx(max(high - mean, mean - low), rel=0.2)
    assert 1.96 * std > 1.2 * 1.96 * by_curvature or reported < 1.0
    assert theta[1] == pytest.approx(mean, abs=0.3 * std)
    assert np.all(np.linalg.eigvalsh(covariance) > 0.0)
