"""The position bound: the doubling against plain recursion, against errors of a simulated filter, against the EKF."""

import math

import numpy as np
import pytest
from scipy.linalg import expm
from tests.gnc.observer_cases import DT, Run, double_body, readings, track

from rovtwin.core.block import Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import jnp
from rovtwin.gnc.navigation.accuracy_bound import damping_slopes, discretise, inertial_bound, position_bound
from rovtwin.gnc.thesis.ekf import Ekf, EkfTuning

ACOUSTIC = {"position_sigma": 0.5, "position_rate": 1.0}
WALK = 0.03


def linear_body(damping, mass=45.0):
    """The same damping [N s/m] and mass along surge and sway."""
    D, none = np.diag([damping, damping, 20, 3, 1, 0.2]), np.zeros((6, 6))
    return double_body().replace(
        rigid_body_mass=np.eye(6) * mass,
        added_mass=none,
        linear_damping_ahead=D,
        linear_damping_astern=D,
        quadratic_damping_ahead=none,
        quadratic_damping_astern=none,
    )


def sigma(damping, **others):
    return float(position_bound(linear_body(damping), 0.0, **(ACOUSTIC | {"force_walk": WALK} | others))[0])


def test_figures_for_orientation():
    """0.167 m inertial, 0.103 m with strong damping, 0.028 m with a DVL, 0.155-0.18 m with towing-tank damping."""
    # The accelerometer's bias known; estimated from positions it costs 1.4 % more.
    inertial = inertial_bound(**ACOUSTIC, accelerometer_sigma=0.0308, accelerometer_rate=100, accelerometer_bias_walk=0)
    assert inertial == pytest.approx(0.167, abs=0.001)
    # 55.8 N s/m of the thesis at rest, 66 at the 0.22 m/s it flies at.
    assert sigma(66.0) == pytest.approx(0.103, abs=0.001)
    assert sigma(50.0, dvl_sigma=0.005, dvl_rate=10) == pytest.approx(0.028, abs=0.0005)
    assert sigma(12.5) == pytest.approx(0.155, abs=0.003)
    assert sigma(6.5) == pytest.approx(0.18, abs=0.003)


def test_inertial_bound_in_closed_form():
    """A double integrator in white noise, positions as if continuous: P = sqrt(2) r^(3/4) q^(1/4)."""
    r, q = 0.5**2 / 20.0, 0.0308**2 / 100
    fast = inertial_bound(0.5, 20.0, 0.0308, 100, accelerometer_bias_walk=0)
    assert fast == pytest.approx(math.sqrt(math.sqrt(2) * r**0.75 * q**0.25), rel=0.01)


def recursion(F, noise, readings, step, seconds):
    """Mean position variance over the last ten seconds of a plain covariance recursion from P = 100 I."""
    n = len(F)
    Phi = expm(F * step)
    fine = 200
    inner = [expm(F * step * (k + 0.5) / fine) for k in range(fine)]
    Q = sum(E @ noise @ E.T for E in inner) * step / fine
    P, variance = np.eye(n) * 100.0, []
    for k in range(1, round(seconds / step) + 1):
        P = Phi @ P @ Phi.T + Q
        for row, std, every in readings:
            if k % every == 0:
                K = P @ row / (row @ P @ row + std**2)
                P = P - np.outer(K, row @ P)
        variance.append(P[0, 0])
    return math.sqrt(np.mean(variance[-round(10 / step) :]))


def test_doubling_against_plain_recursion():
    d, m = 20.0, 45.0
    F = np.array([[0, 1, 0, 0], [0, -d / m, 1 / m, 0], [0, 0, 0, 0], [0, 0, 0, 0]])
    noise = np.diag([0, 0.002, WALK, 1e-3]) ** 2.0
    given = [
        (np.array([1.0, 0, 0, 0]), 0.5, 50),
        (np.array([0, 1.0, 0, 0]), 0.05, 5),
        (np.array([0, -d / m, 1 / m, 1]), 0.03, 1),
    ]
    expected = recursion(F, noise, given, 0.02, 400.0)
    found = sigma(
        d,
        velocity_noise=0.002,
        dvl_sigma=0.05,
        dvl_rate=10,
        accelerometer_sigma=0.03,
        accelerometer_rate=50,
        accelerometer_bias_walk=1e-3,
    )
    assert found == pytest.approx(expected, rel=1e-4)


def test_a_filter_errs_as_much():
    """2,000 vehicles under a wandering force, each with its own Kalman filter of fixed gain: their rms error."""
    d, m, rng = 30.0, 45.0, np.random.default_rng(4)
    Phi, Q = discretise(np.array([[0, 1, 0], [0, -d / m, 1 / m], [0, 0, 0]]), np.diag([0, 0, WALK**2]), 1.0)
    P = np.eye(3)
    for _ in range(300):
        P = Phi @ P @ Phi.T + Q
        K = P[:, 0] / (P[0, 0] + 0.25)
        P = P - np.outer(K, P[0])
    x = np.zeros((2000, 3))
    x_hat = x.copy()
    root = np.linalg.cholesky(Q)
    for _ in range(150):
        x = x @ Phi.T + rng.normal(size=x.shape) @ root.T
        x_hat = x_hat @ Phi.T
        x_hat += (x[:, 0] + rng.normal(0, 0.5, len(x)) - x_hat[:, 0])[:, None] * K
    error = np.sqrt(np.mean((x_hat - x)[:, 0] ** 2))
    assert error == pytest.approx(sigma(d, when="after"), rel=0.06)
    assert sigma(d, when="after") < sigma(d) < sigma(d, when="before")


@pytest.mark.system
def test_the_ekf_reaches_it():
    """Steady ahead along north, the full nonlinear filter's own sigma is the bound of the linearised model."""
    model = double_body()
    u = np.tile([0.7, 0.0, 0.0, 0.7, 0.0, 0.0], (round(120 / DT), 1))
    run = Run.of(model, u)
    slots = readings(np.random.default_rng(0), run)
    tuning = EkfTuning.consistent(force_walk=WALK, velocity_noise=1e-3)
    P = np.asarray(track(Ekf(model, tuning), Start.at((0.0, 0.0, 0.5)), slots, jnp.asarray(u))[1])
    own = np.sqrt(np.mean(np.diagonal(P[round(-20 / DT) :, :2, :2], axis1=1, axis2=2), axis=0))
    speed = float(run.x[-1, 6])
    bound = position_bound(model, speed, 0.5, 1.0, WALK, velocity_noise=1e-3)
    assert speed > 0.15
    np.testing.assert_allclose(own, bound, rtol=0.02)


def test_damping_is_linearised_where_the_vehicle_is():
    model = double_body()
    ahead = double_body().replace(linear_damping_astern=model.linear_damping_ahead * 3)
    np.testing.assert_allclose(damping_slopes(model, 0.2), [55.8 + 2 * 23.7 * 0.2, 44.8])
    np.testing.assert_allclose(damping_slopes(ahead, -0.2), [3 * 55.8 + 2 * 23.7 * 0.2, 2 * 44.8])
    np.testing.assert_allclose(damping_slopes(ahead, 0.0), [2 * 55.8, 2 * 44.8])


def test_more_knowledge_is_never_worse():
    base = sigma(8.0)
    assert sigma(8.0, accelerometer_sigma=0.0308, accelerometer_rate=100) < base
    assert sigma(8.0, dvl_sigma=0.005, dvl_rate=10) < 0.2 * base
    assert sigma(8.0, position_rate=2.0) < base
    assert sigma(8.0, force_walk=0.1) > base
    # A useless DVL changes nothing.
    assert sigma(8.0, dvl_sigma=1e6, dvl_rate=10) == pytest.approx(base, rel=1e-6)


def test_without_disturbance_the_place_is_learnt_for_good():
    assert sigma(8.0, force_walk=0.0) < 1e-3


def test_rates_that_do_not_divide_each_other():
    between = sigma(8.0, dvl_sigma=0.05, dvl_rate=3.0)
    assert sigma(8.0, dvl_sigma=0.05, dvl_rate=4.0) < between < sigma(8.0, dvl_sigma=0.05, dvl_rate=2.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"position_sigma": 0.0}, "position_sigma"),
        ({"position_rate": float("nan")}, "position_rate"),
        ({"dvl_sigma": 0.005}, "dvl_rate is missing"),
        ({"dvl_sigma": 0.005, "dvl_rate": 3.14159}, "common period"),
        ({"force_walk": -0.1}, "force_walk"),
    ],
)
def test_nonsense_is_refused(change, message):
    with pytest.raises(ConfigError, match=message):
        sigma(8.0, **change)
