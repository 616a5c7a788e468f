"""Missions with an Underwater GPS that errs like the real one, and what the filter is given of it."""

import json

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Slot
from rovtwin.core.numerics import jax
from rovtwin.core.user_files.config import parse
from rovtwin.planning.experiments import _scenario
from rovtwin.planning.records import _signal
from rovtwin.planning.rehearsal import _exact
from rovtwin.planning.tank import MOTION_CAPTURE, Tank
from rovtwin.runs.batch import score_together
from rovtwin.runs.compose.acoustic import equivalent_white
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.compose.sensors import sensors_of
from rovtwin.runs.recording.provenance import provenance
from rovtwin.scenario.files import load_scenario
from rovtwin.vehicle import vehicle_from_dict
from rovtwin.vehicle.description.schema import Sensor


def test_every_scenario_comes_with_an_underwater_gps():
    for name in ("lawnmower_calm_ugps", "lawnmower_hard_dvl_ugps"):
        position = compose(load_scenario(name)).loop.twin.sensors["position"]
        assert position.errors is not None and position.rate == 2000
    assert compose(load_scenario("lawnmower_calm")).loop.twin.sensors["position"].errors is None


def test_an_underwater_gps_bolted_on_errs_too():
    parts = [{"name": "rov", "part": "double_blueye"}, {"name": "ugps", "part": "ugps_u1"}]
    vehicle = vehicle_from_dict({"name": "v", "parts": parts})
    simulation = compose(load_scenario("lawnmower_calm", ["autopilot=model_based"]), vehicle=vehicle)
    assert simulation.loop.twin.sensors["position"].errors is not None
    along, across, growth = simulation.loop.autopilot.observer.tuning.mounts["position"].sight
    assert 0.11 < along < 0.45 < across and growth > 0.041
    # It tells less than 2 Hz of white noise of 35 mm, and more than its slow error alone would.
    assert 0.03 < simulation.bound(0.2)[0] < 0.45


@pytest.mark.system
def test_identification_is_given_the_errors_of_an_underwater_gps():
    """Logs and records declared its white part, 35 mm of half a metre: the model was said to miss the position."""
    parts = [{"name": "rov", "part": "double_blueye"}, {"name": "ugps", "part": "ugps_u1"}]
    vehicle = vehicle_from_dict({"name": "v", "parts": parts})
    run = compose(load_scenario("lawnmower_calm"), vehicle=vehicle)
    sensor = run.loop.twin.sensors["position"]
    declared = json.loads(provenance(run.scenario, run)["sensors"])["position"]["noise"]
    fix = Slot(np.zeros((1, 1, 2)), np.ones((1, 1), bool), np.zeros((1, 1)))
    np.testing.assert_allclose(_signal(run, "position", fix).sigma, declared)

    def step(state, key):
        state, error, _ = sensor.errors.step(state, np.array([2.0, 4.0]), key, 0.5)
        return state, error

    states = sensor.errors.init(jax.random.key(0))
    _, errors = jax.lax.scan(step, states, jax.random.split(jax.random.key(1), 20_000))
    rms = np.sqrt(np.mean(np.asarray(errors) ** 2))  # of an axis, on average: 0.34 m
    assert 0.5 < rms / declared[0] < 1.0 and rms > 5 * np.asarray(sensor.noise).max()
    assert _exact(run.loop.twin.sensors)["position"].errors is None  # a rehearsal is without noise


@pytest.mark.parametrize("name", ["test_mixed", "test_steps_thesis", "test_decay", "plan"])
def test_tests_with_motion_capture_fly_none_of_it(name):
    """A locator on board stays silent: the position of a test is that of CO to 3 cm."""
    parts = [{"name": "rov", "part": "double_blueye"}, {"name": "ugps", "part": "ugps_u1"}]
    vehicle = vehicle_from_dict({"name": "v", "parts": parts})
    rest = [{"manoeuvre": "rest", "duration": 5}]
    scenario = (
        _scenario("double_blueye", Tank(6.0, 3.0, 1.5), MOTION_CAPTURE, rest) if name == "plan" else load_scenario(name)
    )
    position = sensors_of(scenario, vehicle)["position"]
    assert position.errors is None and float(position.dropout) == 0.0 and not np.any(position.lever)
    assert position.rate == 15_000 and np.all(position.noise == 0.03)


def test_only_positions_may_say_so():
    with pytest.raises(ConfigError, match="expected it of a position"):
        parse(Sensor, {"name": "d", "kind": "dvl", "errors": "acoustic"}, "v.yaml")


def test_white_noise_that_says_as_little_as_an_error_that_lasts():
    assert equivalent_white(0.5, 0.01, 2.0, 1e-3) == pytest.approx(0.5)  # fades within a reading: white as it is
    longer = [equivalent_white(0.5, memory, 2.0, 1e-3) for memory in (1.0, 5.0, 30.0, 300.0)]
    assert np.all(np.diff(longer) > 0)
    # However long it lasts, a filter that forgets sooner is misled by no more than what lies in its memory.
    assert longer[-1] < 0.5 * np.sqrt(2.0 * 2.0 * 300.0)


@pytest.mark.system
@pytest.mark.parametrize("memory", [3.0, 30.0])
def test_a_filter_with_that_noise_is_consistent(memory):
    """One axis, no drag: a walk of the acceleration, positions with a first-order error, 20,000 s.

    The rule is an approximation, right to a factor of two of the variance, and never on the side of too much belief.
    """
    rng, dt, jerk, std = np.random.default_rng(0), 0.5, 1e-3, 0.5
    F = np.array([[1, dt, dt * dt / 2], [0, 1, dt], [0, 0, 1.0]])
    Q = jerk**2 * np.array(
        [[dt**5 / 20, dt**4 / 8, dt**3 / 6], [dt**4 / 8, dt**3 / 3, dt**2 / 2], [dt**3 / 6, dt**2 / 2, dt]]
    )
    L = np.linalg.cholesky(Q)
    R = equivalent_white(std, memory, 1 / dt, jerk) ** 2
    kept = np.exp(-dt / memory)
    x, guess, P, error, squares = np.zeros(3), np.zeros(3), np.eye(3), 0.0, []
    for k in range(40_000):
        x = F @ x + L @ rng.normal(size=3)
        guess, P = F @ guess, F @ P @ F.T + Q
        error = kept * error + np.sqrt(1 - kept**2) * std * rng.normal()
        gain = P[:, 0] / (P[0, 0] + R)
        guess = guess + gain * (x[0] + error - guess[0])
        P = P - np.outer(gain, P[0])
        x, guess = x - [x[0], x[1], 0], guess - [x[0], x[1], 0]  # the same differences, small numbers
        if k > 2000:
            squares.append((x[0] - guess[0]) ** 2 / P[0, 0])
    assert 0.5 < np.mean(squares) < 1.2


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lawnmower_calm_ugps", "lawnmower_hard_ugps"])
def test_the_filter_stays_consistent(name):
    """NEES of north and east over 5 seeds: chi-square of 2, 95 % for the number of samples that are independent."""
    runs = [load_scenario(name, ["autopilot=model_based"], seed=seed) for seed in range(1, 6)]
    nees = np.mean([run["nees_position_mean"] for run in score_together([compose(run) for run in runs])])
    assert 1.4 < nees < 2.7
