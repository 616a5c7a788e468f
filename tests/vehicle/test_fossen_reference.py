"""Against Fossen's MSS toolbox: accelerations and 40 s trajectories of a fully coupled vehicle in a current.

The oracle of the other tests is held to the same figures here, so that both are tied to something outside this project.
"""

import json

import numpy as np
import pytest
from tests import oracle

from rovtwin.core.arrays.integrate import rk4_step
from rovtwin.core.flow import Command, Environment
from rovtwin.core.frames import euler_from_quaternion, quaternion_from_euler, quaternion_rate, rotation_from_quaternion
from rovtwin.core.numerics import jax, jnp
from rovtwin.vehicle.physics.dynamics import State, acceleration, rollout
from rovtwin.vehicle.physics.model import Model, rigid_body_matrix
from rovtwin.vehicle.physics.thrusters import thrusters_from

CURRENT = np.array([-0.20, 0.35, 0.05])
DT, STEPS = 0.005, 8000
EVERY = 20  # the files hold every 0.1 s


@pytest.fixture(scope="module")
def model(fossen_folder):
    given = json.loads((fossen_folder / "params.json").read_text())["generic30"]
    # Six thrusters that are the six degrees of freedom: a command is tau / 100.
    thrusters = thrusters_from(jnp.eye(6), jnp.full(6, 100.0))
    return Model(
        rigid_body_mass=rigid_body_matrix(given["m"], given["Ig"], given["r_g"]),
        added_mass=given["MA"],
        linear_damping_ahead=np.diag(given["Dlin"]),
        quadratic_damping_ahead=np.diag(given["Dquad"]),
        weight=given["W"],
        buoyancy=given["B"],
        center_of_gravity=given["r_g"],
        center_of_buoyancy=given["r_b"],
        thrusters=thrusters,
    )


def in_current(velocity) -> Environment:
    return Environment.calm(velocity=jnp.asarray(velocity))


@pytest.fixture(scope="module")
def random_states(fossen_folder):
    """200 rows of eta (6), nu (6), tau (6), current (3), and the accelerations (6) that MSS gives."""
    inputs = np.loadtxt(fossen_folder / "rhs_inputs.csv", delimiter=",", skiprows=1)
    expected = np.loadtxt(fossen_folder / "mss_rhs_generic30.csv", delimiter=",")
    assert inputs.shape == (200, 21) and expected.shape == (200, 6)
    return np.split(inputs, [6, 12, 18], axis=1), expected


def test_accelerations(model, random_states):
    (eta, nu, tau, current), expected = random_states

    def one(eta, nu, tau, current):
        return acceleration(model, eta[:3], quaternion_from_euler(eta[3:]), nu, tau, in_current(current))

    np.testing.assert_allclose(jax.jit(jax.vmap(one))(eta, nu, tau, current), expected, atol=1e-10, rtol=0)


def test_accelerations_of_the_oracle(model, random_states):
    (eta, nu, tau, current), expected = random_states
    plant = oracle.plant_of(model)
    found = [oracle.acceleration(plant, *row) for row in zip(eta, nu, tau, current, strict=True)]
    np.testing.assert_allclose(found, expected, atol=1e-10, rtol=0)


def test_current_rate_matters(model, random_states):
    """Without d(nu_c)/dt = -S(omega) nu_c the accelerations are far off: the reference can tell."""
    (eta, nu, tau, current), expected = random_states
    plant = oracle.plant_of(model)
    wrong = []
    for e, n, t, c in zip(eta, nu, tau, current, strict=True):
        nu_c = np.concatenate([oracle.rotation(*e[3:]).T @ c, np.zeros(3)])
        # In nu_r alone, as if the current stood still in the body frame.
        wrong.append(oracle.acceleration(plant, e, n - nu_c, t))
    assert np.abs(np.array(wrong) - expected).max() > 0.1


def trajectory(fossen_folder, case):
    rows = np.loadtxt(fossen_folder / f"mss_traj_generic30_{case}.csv", delimiter=",", skiprows=1)
    assert rows.shape == (STEPS // EVERY + 1, 13)
    return rows[:, 1:7], rows[:, 7:]


def compare(position, attitude, nu, fossen_folder, case):
    """Every 0.1 s, after the start, to 1e-6 m and rad."""
    eta, expected_nu = trajectory(fossen_folder, case)
    found = np.concatenate(
        [position[EVERY - 1 :: EVERY], jax.vmap(euler_from_quaternion)(attitude)[EVERY - 1 :: EVERY]], 1
    )
    error = found - eta[1:]
    error[:, 3:] = (error[:, 3:] + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(error[:, :3]).max() < 1e-6  # m
    assert np.abs(error[:, 3:]).max() < 1e-6  # rad
    np.testing.assert_allclose(nu[EVERY - 1 :: EVERY], expected_nu[1:], atol=1e-6, rtol=0)


def start(model, fossen_folder, case) -> State:
    eta, nu = trajectory(fossen_folder, case)
    zero = jnp.zeros(model.thrusters.count)
    return State(jnp.asarray(eta[0, :3]), quaternion_from_euler(jnp.asarray(eta[0, 3:])), jnp.asarray(nu[0]), zero)


@pytest.fixture(scope="module")
def fly(model):
    @jax.jit
    def run(state, u, environment):
        return rollout(model, state, Command(jnp.broadcast_to(u, (STEPS, 6))), environment, DT)

    return run


@pytest.mark.parametrize(
    "case, tau, current",
    [("free_decay", np.zeros(6), np.zeros(3)), ("drift_yaw_current", np.array([0, 0, 0, 0, 0, 0.8]), CURRENT)],
)
def test_trajectory_by_the_plant(model, fly, fossen_folder, case, tau, current):
    states = fly(start(model, fossen_folder, case), jnp.asarray(tau / 100.0), in_current(current))
    compare(states.position, states.attitude, states.nu, fossen_folder, case)


def test_trajectory_with_a_wrench_that_changes_within_the_step(model, fossen_folder):
    """The toolbox takes tau(t) at each Runge-Kutta stage; the plant holds a command, so this goes below it."""
    environment = in_current(CURRENT)

    def tau(t):
        return jnp.array(
            [
                15 * jnp.sin(0.5 * t),
                10 * jnp.sin(0.35 * t + 1),
                8 * jnp.cos(0.4 * t),
                0.4 * jnp.sin(0.9 * t),
                0.5 * jnp.cos(0.7 * t),
                1.5 * jnp.sin(0.3 * t) + 0.6,
            ]
        )

    def step(x, k):
        def derivative(elapsed, x):
            p, q, nu = x
            nu_dot = acceleration(model, p, q, nu, tau(k * DT + elapsed), environment)
            return rotation_from_quaternion(q) @ nu[:3], quaternion_rate(q, nu[3:]), nu_dot

        x = rk4_step(derivative, x, DT)
        return x, x

    state = start(model, fossen_folder, "coupled_current")
    run = jax.jit(lambda x: jax.lax.scan(step, x, jnp.arange(STEPS))[1])
    compare(*run((state.position, state.attitude, state.nu)), fossen_folder, "coupled_current")
