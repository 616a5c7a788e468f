"""The control plant model of the observer: the plant itself, its exact slope, C and b in their places."""

import equinox as eqx
import numpy as np
import pytest
from tests.gnc.observer_cases import DT, Run, at, double_body

from rovtwin.core.arrays.small_matrices import product
from rovtwin.core.flow import Command, Environment
from rovtwin.core.frames import quaternion_from_euler, rotation_from_euler
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.thesis import ekf_model
from rovtwin.gnc.thesis.ekf_model import discrete_step, state_jacobian, state_rate
from rovtwin.vehicle.physics.dynamics import acceleration, plant_step
from rovtwin.vehicle.physics.model import Model

DECAY = jnp.array([0.0, 0.01, 0.02, 0.03, 0.04, 0.05])


@pytest.fixture(scope="module")
def coupled() -> Model:
    """Full matrices everywhere, other damping astern than ahead, heavy and lop-sided: nothing cancels."""
    rng = np.random.default_rng(7)
    body = double_body()

    def full(scale):
        A = rng.normal(size=(6, 6)) * scale
        return A @ A.T + np.eye(6) * scale

    return body.replace(
        added_mass=full(2.0),
        linear_damping_ahead=full(2.0),
        linear_damping_astern=full(3.0),
        quadratic_damping_ahead=full(4.0),
        quadratic_damping_astern=full(5.0),
        buoyancy=290.0,
        center_of_gravity=[0.02, -0.01, 0.03],
        center_of_buoyancy=[-0.01, 0.02, -0.04],
    )


def states(n=20):
    rng = np.random.default_rng(3)
    scale = np.r_[5, 5, 5, 1.0, 0.6, 3.0, np.full(3, 0.5), np.full(3, 0.8), np.full(6, 3.0)]
    return jnp.asarray(rng.uniform(-1, 1, (n, 18)) * scale), jnp.asarray(rng.normal(size=(n, 6)) * 5)


def test_it_is_the_plant(coupled):
    """C, D, g and the disturbance, all against the equations of motion that the twin obeys."""
    x, tau = states()

    def nu_dot(x, tau):
        force_b = rotation_from_euler(x[3:6]).T @ x[12:15]
        disturbed = eqx.tree_at(lambda e: e.wrench, Environment.calm(), jnp.concatenate([force_b, x[15:]]))
        return acceleration(coupled, x[:3], quaternion_from_euler(x[3:6]), x[6:12], tau, disturbed)

    rates = jax.jit(jax.vmap(lambda x, tau: state_rate(coupled, x, tau, DECAY)))(x, tau)
    np.testing.assert_allclose(rates[:, 6:12], jax.jit(jax.vmap(nu_dot))(x, tau), rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(rates[:, 12:], -DECAY * x[:, 12:], rtol=1e-12)


def test_slope_is_the_derivative(coupled):
    x, tau = states()
    by_hand = jax.jit(jax.vmap(lambda x: state_jacobian(coupled, x, DECAY)))(x)
    automatic = jax.jit(jax.vmap(jax.jacfwd(lambda x, tau: state_rate(coupled, x, tau, DECAY))))(x, tau)
    np.testing.assert_allclose(by_hand, automatic, rtol=1e-9, atol=1e-9)


def test_transition_matrix_against_finite_differences():
    """Phi = df_k/dx; I + T df_k/dx with the discrete f_k, as (2.42) prints it, would be off by T I."""
    model = double_body("towing")
    x, tau = states(6)
    step = jax.jit(jax.vmap(lambda x, tau: discrete_step(model, x, tau, tau, DECAY, DT)))
    half = np.asarray(step(x, tau)[1])
    Phi = half @ half
    h = 1e-6
    for j in range(18):
        ahead, astern = step(x.at[:, j].add(h), tau)[0], step(x.at[:, j].add(-h), tau)[0]
        np.testing.assert_allclose(Phi[:, :, j], (ahead - astern) / (2 * h), atol=1e-3)


def test_one_step_is_that_of_the_plant():
    model = double_body()
    state = at(model, euler=(0.2, -0.3, 2.0), nu=[0.3, -0.2, 0.1, 0.2, -0.1, 0.4])
    x = jnp.concatenate([state.position, jnp.array([0.2, -0.3, 2.0]), state.nu, jnp.zeros(6)])
    tau = jnp.zeros(6)
    after = jax.jit(lambda s: plant_step(model, s, Command(tau), Environment.calm(), DT))(state)
    stepped, _ = jax.jit(lambda x: discrete_step(model, x, tau, tau, jnp.zeros(6), DT))(x)
    # Midpoint against RK4: what is left is the third power of the step.
    np.testing.assert_allclose(stepped[:3], after.position, atol=2e-6)
    np.testing.assert_allclose(stepped[6:12], after.nu, atol=1e-4)


def dead_reckoned(model, run):
    """Position error at the end of a run that is only predicted, forces through the lag as the plant has them."""

    def tick(carry, u):
        x, thrust = carry
        target = model.thrusters.force_ahead * u
        decay = jnp.exp(-DT / model.thrusters.time_constant)
        halfway = target + jnp.sqrt(decay) * (thrust - target)
        T = model.thrusters.configuration
        x, _ = discrete_step(model, x, T @ thrust, T @ halfway, jnp.zeros(6), DT)
        return (x, target + decay * (thrust - target)), x

    start = (jnp.zeros(18).at[2].set(0.5), jnp.zeros(6))
    _, x = jax.jit(lambda start, u: jax.lax.scan(tick, start, u))(start, jnp.asarray(run.u))
    return float(np.linalg.norm(x[-1, :3] - run.x[-1, :3]))


@pytest.mark.system
def test_coriolis_matters(monkeypatch):
    """Ahead while turning: with C the prediction stays on the plant for half a minute, without it is metres away."""
    model = double_body("towing")
    u = np.tile([0.8, 0.0, 0.0, 0.3, 0.0, 0.0], (1500, 1))
    run = Run.of(model, u)
    assert dead_reckoned(model, run) < 0.01
    monkeypatch.setattr(ekf_model, "coriolis_wrench", lambda mass, nu: jnp.zeros(6))
    assert dead_reckoned(model, run) > 0.5


def test_disturbance_force_stays_in_the_world_and_moment_in_the_body():
    model = double_body()
    b = jnp.array([2.0, 0, 0, 0.5, 0, 0])
    heading_east = jnp.zeros(18).at[5].set(jnp.pi / 2).at[12:].set(b)
    rate = state_rate(model, heading_east, jnp.zeros(6), jnp.zeros(6))
    wrench = model.inertia @ rate[6:12]
    np.testing.assert_allclose(wrench, [0, -2.0, 0, 0.5, 0, 0], atol=1e-12)


@pytest.mark.parametrize("shapes", [((18, 18), (18, 18)), ((6, 4), (4, 6)), ((3, 3), (3, 6))])
def test_product(shapes):
    rng = np.random.default_rng(0)
    A, B = (rng.normal(size=shape) for shape in shapes)
    np.testing.assert_allclose(product(jnp.asarray(A), jnp.asarray(B)), A @ B, rtol=1e-12, atol=1e-12)
