"""The controller that a served vehicle brings along: what it holds, and what it lets go."""

import numpy as np
import pytest
from tests.block_examples import START

from rovtwin.core.numerics import jax, jnp
from rovtwin.simulation.vehicle_firmware import FREQUENCY, Onboard, OnboardInput, Order
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics.thrusters import static_force

DT = 0.02
ALL = jnp.ones(6, dtype=bool)


@pytest.fixture(scope="module")
def onboard():
    return Onboard.of(load_vehicle("bluerov2_heavy").model().thrusters, np.full(6, 10.0))


@pytest.fixture(scope="module")
def step(onboard):
    return jax.jit(lambda memory, order, eta, nu, known: onboard.step(memory, OnboardInput(order, eta, nu, known), DT))


def order(motion=(0,) * 6, holds=(False,) * 4, target=None, armed=True) -> Order:
    aimed = target is not None
    goal = jnp.asarray(target if aimed else [0.0] * 4)
    return Order(jnp.asarray(armed), jnp.asarray(motion, dtype=float), jnp.asarray(holds), goal, jnp.asarray(aimed))


def test_the_largest_wrench_along_an_axis_takes_one_thruster_to_its_limit(onboard, step):
    memory = onboard.init(jax.random.key(0), START)
    for axis in np.flatnonzero(onboard.largest > 0):
        motion = np.eye(6)[axis]
        _, out = step(memory, order(motion), jnp.zeros(6), jnp.zeros(6), ALL)
        np.testing.assert_allclose(out.tau[axis], onboard.largest[axis], rtol=1e-6)
        force = static_force(onboard.thrusters, out.command.u)
        np.testing.assert_allclose(onboard.thrusters.configuration @ force, out.tau, atol=1e-6)


def test_a_wrench_beyond_the_limits_keeps_its_direction(onboard, step):
    memory = onboard.init(jax.random.key(0), START)
    both = np.array([1.0, 0, 1.0, 0, 0, 1.0])
    _, out = step(memory, order(both), jnp.zeros(6), jnp.zeros(6), ALL)
    expected = both * np.asarray(onboard.largest)
    np.testing.assert_allclose(
        np.asarray(out.tau) * np.linalg.norm(expected), expected * np.linalg.norm(out.tau), atol=1e-6
    )
    assert np.abs(out.command.u).max() <= 1.0 + 1e-9


def test_a_target_that_is_withdrawn_is_not_flown_on_to(onboard, step):
    memory = onboard.init(jax.random.key(0), START)
    eta, holds = jnp.array([0, 0, 2.0, 0, 0, 0]), (True, True, True, True)
    for _ in range(10):
        memory, _ = step(memory, order(holds=holds, target=[100.0, 0, 5.0, 0]), eta, jnp.zeros(6), ALL)
    for _ in range(3):
        memory, out = step(memory, order(holds=holds), eta, jnp.zeros(6), ALL)
    np.testing.assert_allclose(memory.held, eta, atol=1e-9)


def test_what_is_not_known_is_not_held_and_gives_nothing(onboard, step):
    memory = onboard.init(jax.random.key(0), START)
    deep = jnp.array([0, 0, 5.0, 0, 0, 0])
    blind = ALL & (jnp.arange(6) != 2)
    expected = order((0, 0, 1.0, 0, 0, 0), (True, False, False, False))
    memory, out = step(memory, expected, deep, jnp.zeros(6), blind)
    assert abs(float(out.tau[2])) < 1e-9 and not bool(memory.on[2])
    memory, _ = step(memory, order(holds=(True, False, False, False)), deep, jnp.zeros(6), ALL)
    assert float(memory.held[2]) == pytest.approx(5.0)


def test_disarmed_it_forgets_and_gives_nothing(onboard, step):
    memory = onboard.init(jax.random.key(0), START)
    for _ in range(50):
        near = order(holds=(True,) * 4, target=[0.0, 0.0, 0.001, 0.0])
        memory, _ = step(memory, near, jnp.zeros(6), jnp.zeros(6), ALL)
    assert np.abs(memory.integral).max() > 0
    memory, out = step(memory, order(holds=(True,) * 4, armed=False), jnp.zeros(6), jnp.zeros(6), ALL)
    assert not np.any(out.command.u) and not np.any(memory.integral) and not np.any(memory.on)


def test_holds_are_damped(onboard):
    """w^2 e + 2 w nu: critically damped for a body of the inertia that it counts with."""
    for w in FREQUENCY:
        roots = np.roots([1.0, 2.0 * w, w**2])
        assert np.all(roots.real < 0) and np.allclose(roots.imag, 0, atol=1e-6)


@pytest.mark.parametrize("name", ["bluerov2_heavy", "minerva", "sparus_ii"])
def test_a_hold_is_no_quicker_than_its_thrusters_let_it_be(name):
    thrusters = load_vehicle(name).model().thrusters
    onboard, lag = Onboard.of(thrusters, np.ones(6)), float(thrusters.time_constant.max())
    assert np.all(onboard.frequency * lag <= 0.3 + 1e-9) and np.all(onboard.frequency <= np.asarray(FREQUENCY) + 1e-9)
    assert name != "bluerov2_heavy" or np.array_equal(onboard.frequency, FREQUENCY)
