"""The start of the joint estimate: smoothed states, and parameters at which forces balance along them."""

import numpy as np
import pytest
from tests.identification.synthetic import record, steps_command

from rovtwin.identification.identify import default_free
from rovtwin.identification.joint.model.catalogue import catalogue, choose
from rovtwin.identification.joint.model.prior import default_prior
from rovtwin.identification.joint.solver.anchors import static_evidence
from rovtwin.identification.joint.solver.equation_error import Balance, balanced
from rovtwin.identification.joint.solver.path import smoothed_path
from rovtwin.identification.joint.solver.segments import Grid, cut
from rovtwin.vehicle import load_vehicle

GRID, DURATION = Grid(0.02, 250, 20.0), 60.0
COARSE = Grid(0.1, 50)


@pytest.fixture(scope="module")
def blueye():
    vehicle = load_vehicle("double_blueye")
    everything = catalogue(vehicle)
    parameters = choose(everything, default_free(everything, []))
    return vehicle, parameters, default_prior(parameters, vehicle), Balance(parameters, GRID)


def flown(blueye, seed, signals=("horizontal", "depth", "attitude", "gyro"), **moved):
    """A test of a vehicle drawn from the prior, and its theta."""
    vehicle, parameters, prior, _ = blueye
    truth = np.linalg.cholesky(prior.covariance) @ np.random.default_rng(seed).standard_normal(len(parameters))
    for name, widths in moved.items():
        i = parameters.names.index(f"thrusters.surge.{name}")
        truth[i] = widths * np.sqrt(prior.covariance[i, i])
    model, _ = parameters.model_at(truth)
    t, u = steps_command(vehicle, seed, DURATION)
    return truth, model, record(model, t, u, DURATION, seed, signals)


@pytest.mark.slow  # compiles a record of its own shape
@pytest.mark.parametrize("seed", [1, 2])
def test_the_start_is_nearer_to_the_truth_than_the_prior(blueye, seed):
    _, parameters, prior, balance = blueye
    truth, model, log = flown(blueye, seed)
    full = 2 * float(model.thrusters.force_ahead[0])
    static = static_evidence(parameters, [{"bollard": {"direction": "surge", "force": full, "sd": 0.02 * full}}])
    found = balanced(balance, cut([log], GRID), prior, linear(static))
    width = np.sqrt(np.diag(prior.covariance))
    off, before = (np.sqrt(np.mean(((x - truth) / width) ** 2)) for x in (found, prior.mean))
    assert off < 0.7 * before
    translation = [parameters.names.index(f"added_mass.{d}") for d in ("surge", "sway", "heave")]
    np.testing.assert_allclose(found[translation], truth[translation], atol=0.2)


def linear(static):
    import jax

    return jax.jit(lambda theta: (static(theta), jax.jacfwd(static)(theta)))


@pytest.mark.slow
def test_a_large_dead_band_is_found(blueye):
    # From a small one no slope leads there: the start ends in a valley with an absurd exponent, if it is not tried.
    _, parameters, prior, balance = blueye
    truth, _, log = flown(blueye, 3, dead_band=2.4, exponent=0.5)
    found = balanced(balance, cut([log], GRID), prior)
    i = parameters.names.index("thrusters.surge.dead_band")
    assert found[i] == pytest.approx(truth[i], abs=0.5)  # without that, 5 away


@pytest.mark.system
def test_without_velocities_or_rates_the_prior_is_the_start(blueye):
    _, _, prior, balance = blueye
    _, _, log = flown(blueye, 4, signals=("depth",))
    np.testing.assert_array_equal(balanced(balance, cut([log], GRID), prior), prior.mean)


def test_windows_do_not_run_into_the_next_record(blueye):
    *_, balance = blueye
    log = flown(blueye, 5)[2]
    one, two = (balance.arrays_of(cut(logs, GRID)) for logs in ([log], [log, log]))
    assert two["used"].sum() == pytest.approx(2 * one["used"].sum(), abs=6)
    largest = [np.abs(x["change"][x["used"] > 0]).max() for x in (one, two)]
    assert largest[1] == pytest.approx(largest[0])


@pytest.mark.parametrize(
    ("signals", "moves", "turns"),
    [
        (("horizontal", "depth", "attitude", "gyro"), 0.03, 0.02),
        (("horizontal", "depth", "attitude"), 0.03, 0.02),
        (("velocity", "gyro"), 0.01, 0.02),
    ],
)
def test_smoothed_states_are_those_of_the_vehicle(blueye, signals, moves, turns):
    # A quiet vehicle: what the kernel takes off quick motion is no error of the method, thrust goes through it too.
    vehicle, parameters, _, _ = blueye
    model, _ = parameters.model_at(np.zeros(len(parameters)))
    t, u = steps_command(vehicle, 6, DURATION, hold=10.0)
    log = record(model, t, 0.3 * u, DURATION, 6, signals)
    exact = record(model, t, 0.3 * u, DURATION, 6, ("velocity", "gyro"))
    path, seen = smoothed_path(cut([log], GRID), COARSE)
    grid = 0.1 * np.arange(len(path.nu))
    inside = seen.all(axis=1) & (np.abs(grid[:, None] - t).min(axis=1) > 2.0)
    assert inside.sum() > 200
    for name, columns, limit in (("velocity", slice(0, 3), moves), ("gyro", slice(3, 6), turns)):
        signal = exact.signals[name]
        truth = np.stack([np.interp(grid, signal.t, c) for c in signal.value.T], axis=1)
        assert np.sqrt(np.mean((path.nu[inside, columns] - truth[inside]) ** 2)) < limit
