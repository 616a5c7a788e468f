"""Expected information against finite differences of the plant, and the choice of tests against all choices."""

from dataclasses import replace
from functools import partial
from itertools import combinations_with_replacement

import numpy as np
import pytest

from rovtwin.core.errors import IdentificationError
from rovtwin.core.flow import Command, Environment
from rovtwin.core.frames import euler_from_quaternion, quaternion_from_euler
from rovtwin.core.numerics import jax, jnp
from rovtwin.identification.experiment.choice import choose_tests, expected, spread, variance_ratio
from rovtwin.identification.experiment.information import Information, Path, information, with_anchors
from rovtwin.identification.joint.model.catalogue import catalogue, choose
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.prior import default_prior
from rovtwin.identification.joint.solver.segments import Grid
from rovtwin.identification.logs.record import Record, Signal
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics.dynamics import State, rollout

STEP, STEPS = 0.05, 60
GRID = Grid(step=STEP, steps=STEPS, rate=20.0)
SIGMA = {"horizontal": 0.03, "depth": 0.01, "attitude": 0.01, "gyro": 0.01}


@pytest.fixture(scope="module")
def vehicle():
    return load_vehicle("double_blueye")


def chosen(vehicle, *patterns):
    return choose(catalogue(vehicle), patterns)


def path(model, start, command):
    """What the sensors see at the grid points, by signal, and states; `start` is position, Euler angles and nu."""
    state = State(start[:3], quaternion_from_euler(start[3:6]), start[6:], jnp.zeros(model.thrusters.count))
    steps = rollout(model, state, jax.vmap(Command)(command), Environment.calm(), STEP)
    whole = jax.tree.map(lambda first, rest: jnp.concatenate([first[None], rest]), state, steps)
    euler = jax.vmap(euler_from_quaternion)(whole.attitude)
    seen = {
        "horizontal": whole.position[:, :2],
        "depth": whole.position[:, 2:],
        "attitude": euler,
        "gyro": whole.nu[:, 3:],
    }
    return seen, whole


def surge(model, steps):
    t = np.arange(steps)[:, None] * STEP
    command = np.zeros((steps, model.thrusters.count))
    command[:, [0, 3]] = 0.8 * np.sin(2.0 * t) * (t > 0)
    return command


@pytest.fixture(scope="module")
def parameters(vehicle):
    return chosen(vehicle, "added_mass.surge", "added_mass.sway", "quadratic_damping.surge", "quadratic_damping.sway")


@pytest.fixture(scope="module")
def sensed(parameters):
    """Three tests, noise-free: a pull in surge of one segment, one of two, and nothing at all."""
    model = parameters.model
    tests, paths = [], []
    for command in (surge(model, STEPS), surge(model, 2 * STEPS), 0 * surge(model, STEPS)):
        seen, states = path(model, jnp.zeros(12), jnp.asarray(command))
        t = STEP * np.arange(len(command) + 1)
        signals = {name: Signal(t, np.asarray(v), np.full(v.shape[1], SIGMA[name])) for name, v in seen.items()}
        tests.append([Record("test", t[:-1], command, signals, end=float(t[-1]))])
        paths.append(Path(t, *(np.asarray(x) for x in (states.position, states.attitude, states.nu))))
    return partial(information, parameters, tests, paths, [3.0, 6.0, 3.0], grid=GRID)


@pytest.mark.slow
def test_information_is_that_of_finite_differences_of_the_plant(parameters, sensed):
    n, command = len(parameters), jnp.asarray(surge(parameters.model, STEPS))
    found = sensed(misfit={}).matrices[0][:n, :n]

    @jax.jit
    def readings(x):
        seen, _ = path(parameters.model_at(x[:n])[0], x[n:], command)
        return jnp.concatenate([seen[name].ravel() / SIGMA[name] for name in SIGMA])

    h = 1e-5
    J = np.stack([(readings(h * e) - readings(-h * e)) / (2 * h) for e in np.eye(n + 12)], axis=1)
    theta, states = J[:, :n], J[:, n:]
    expected = theta.T @ (theta - states @ np.linalg.lstsq(states, theta, rcond=None)[0])
    assert found == pytest.approx(expected, rel=2e-3, abs=2e-3 * np.abs(expected).max())


@pytest.mark.slow
def test_what_is_not_excited_stays_as_unknown_as_before(vehicle, parameters, sensed):
    prior = default_prior(parameters, vehicle)
    reported = sensed()
    after = np.sqrt(np.diag(reported.covariance(prior, np.array([100.0, 0, 0]))) / np.diag(prior.covariance))
    by_name = dict(zip(parameters.names, after, strict=True))
    assert by_name["added_mass.surge"] < 0.5
    # Sway did not move: all that is learnt of it is what errors of one kind have in common.
    assert by_name["added_mass.sway"] > 0.8 and by_name["quadratic_damping.sway"] > 0.8
    nothing = reported.covariance(prior, np.array([0, 0, 1.0]))
    assert np.diag(nothing) == pytest.approx(np.diag(prior.covariance), rel=1e-3)


@pytest.mark.slow
def test_a_disturbance_between_segments_costs_information(sensed):
    quiet, windy = (sensed(defect=np.array([1e-4] * 6 + [d] * 6 + [1e-4] * 6)).matrices[1][:4, :4] for d in (1e-5, 1.0))
    assert np.linalg.eigvalsh(quiet - windy).min() > -1e-6 * np.trace(quiet)
    assert np.trace(quiet) > 1.2 * np.trace(windy)


@pytest.mark.slow
def test_what_a_model_misses_costs_information(sensed):
    exact, honest = (sensed(misfit=m).matrices[0][:4, :4] for m in ({}, {"horizontal": 0.1}))
    assert np.trace(honest) < 0.5 * np.trace(exact)


@pytest.mark.system
def test_pulls_on_a_scale_narrow_the_prior_of_thrust(vehicle):
    parameters = chosen(vehicle, "thrusters.surge.force_ahead", "thrusters.sway.force_ahead")
    before = default_prior(parameters, vehicle)
    pull = {"bollard": {"direction": "surge", "force": 20.0, "sd": 0.4}}
    after = with_anchors(parameters, before, [pull])
    assert np.sqrt(after.covariance[0, 0]) == pytest.approx(0.02, rel=0.02)
    assert after.covariance[1, 1] < before.covariance[1, 1], "what thrusters have in common is known then, too"
    assert with_anchors(parameters, before, []) is before


# -- the choice


def drawn(count=6, n=3, seed=0):
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(count, 2, n + 1)) * rng.uniform(0.1, 3.0, (count, 1, 1))
    matrices = np.einsum("cki,ckj->cij", rows, rows)
    return Gaussian(np.zeros(n), np.eye(n)), Information(matrices, np.array([1e6]), rng.choice([20.0, 30.0], count))


@pytest.mark.parametrize("seed", range(5))
def test_the_choice_is_nearly_the_best_of_all(seed):
    prior, reported = drawn(seed=seed)
    order = choose_tests(prior, reported, 120.0)
    assert reported.seconds[order].sum() <= 120.0

    def value(some):
        return spread(prior, reported, np.bincount(some, minlength=6).astype(float))

    everything = [
        some for k in range(1, 7) for some in combinations_with_replacement(range(6), k)
        if reported.seconds[list(some)].sum() <= 120.0
    ]  # fmt: skip
    best = min(value(np.array(some)) for some in everything)
    assert value(np.array(order)) <= best + 0.05, "5 % of a variance"


def test_each_further_manoeuvre_makes_no_parameter_less_known(vehicle):
    parameters = chosen(vehicle, "added_mass.surge", "added_mass.sway", "added_mass.heave")
    prior, reported = drawn()
    seen = expected(parameters, prior, reported, choose_tests(prior, reported, 200.0))
    assert np.all(np.diff(seen.path, axis=0) <= 1e-12)
    left = [share for _, share in seen.each_minute()]
    assert len(left) == 3 and left == sorted(left, reverse=True) and left[0] < 1.0
    assert variance_ratio(seen.plan, 2.0 * seen.plan, seen.prior) == pytest.approx(0.25)


@pytest.mark.system
def test_mistakes_are_reported(sensed):
    prior, reported = drawn()
    with pytest.raises(IdentificationError, match=r"found 0.167 minutes, expected at least 0.3"):
        choose_tests(prior, reported, 10.0)
    parameters, tests, paths, seconds = sensed.args
    silent = {name: replace(signal, sigma=None) for name, signal in tests[0][0].signals.items()}
    with pytest.raises(IdentificationError, match="noise of every sensor"):
        information(parameters, [[replace(tests[0][0], signals=silent)]], paths[:1], seconds[:1])
