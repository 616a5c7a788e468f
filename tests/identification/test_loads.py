"""Forces of thrusters under test: commands that change between grid points, and that come late."""

import equinox as eqx
import numpy as np
import pytest

from rovtwin.core.numerics import jax, jnp
from rovtwin.identification.joint.model.loads import thrust_history
from rovtwin.identification.joint.solver.segments import Grid, cut
from rovtwin.identification.logs.record import Record, Signal
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics.thrusters import static_force

STEP = 0.02
KEYS = ("command", "held", "fresh")


@pytest.fixture(scope="module")
def thrusters():
    return load_vehicle("bluerov2_heavy").model().thrusters


def instant(thrusters):
    return eqx.tree_at(lambda t: t.time_constant, thrusters, jnp.zeros(thrusters.count))


@pytest.mark.system
def test_forces_are_averaged_within_a_step_not_commands(thrusters):
    """Half of a command is a third of the force of a thruster: a mean command bends its curve."""
    full, change = np.full(8, 0.8), 3.25 * STEP  # on from a quarter of the fourth step
    still = Signal(np.array([0.0, 1.0]), np.zeros((2, 1)))
    record = Record("x", np.array([0.0, change]), np.stack([np.zeros(8), full]), {"depth": still}, 1.0)
    arrays = cut([record], Grid(STEP, 10)).arrays
    history = thrust_history(instant(thrusters), *(jnp.asarray(arrays[k]) for k in KEYS), STEP)
    settled = np.asarray(thrusters.configuration @ static_force(thrusters, full))
    found = np.asarray(history).reshape(-1, 3, 6)
    impulse = (found[:, 0] + 4.0 * found[:, 1] + found[:, 2]) / 6.0  # Simpson's rule, as of RK4
    assert np.allclose(impulse[2], 0.0) and np.allclose(impulse[3], 0.75 * settled) and np.allclose(impulse[4], settled)


@pytest.mark.system
def test_a_command_in_the_middle_of_a_step_is_as_late_as_it_is(thrusters):
    """Against steps so short that every change is at the end of one: the lag of a mean command was 0.3 ms too late."""
    rng, fine = np.random.default_rng(1), 20
    u = rng.uniform(-1, 1, (6, 8))
    t = STEP * (np.arange(6) + 0.35)
    still = Signal(np.array([0.0, 8 * STEP]), np.zeros((2, 1)))
    record = Record("x", t, u, {"depth": still}, 8 * STEP)
    coarse, exact = (
        np.asarray(thrust_history(thrusters, *(jnp.asarray(cut([record], grid).arrays[k]) for k in KEYS), grid.step))
        for grid in (Grid(STEP, 8), Grid(STEP / fine, 8 * fine))
    )
    coarse, exact = (x.reshape(-1, 3, 6) for x in (coarse, exact))
    np.testing.assert_allclose(coarse[:, 2], exact[fine - 1 : 8 * fine : fine, 2], atol=1e-9)
    impulse, small = ((x[:, 0] + 4.0 * x[:, 1] + x[:, 2]) / 6.0 for x in (coarse, exact))
    np.testing.assert_allclose(impulse, small[: 8 * fine].reshape(8, fine, 6).mean(axis=1), atol=1e-4)


@pytest.mark.system
@pytest.mark.parametrize("lagging", [True, False])
def test_commands_that_come_late_give_the_same_forces_later(thrusters, lagging):
    """By whole steps exactly, at the ends of each of two records their first and last force; none late: unchanged."""
    rng = np.random.default_rng(0)
    command = jnp.asarray(np.repeat(rng.uniform(-1, 1, (2, 3, 1, 8)), 4, axis=1))
    held, fresh = jnp.ones((2, 12, 1)), jnp.zeros((2, 12)).at[:, 0].set(1.0)
    some = thrusters if lagging else instant(thrusters)

    @jax.jit
    def late(delay):
        return thrust_history(some, command, held, fresh, STEP, delay)

    now = np.asarray(thrust_history(some, command, held, fresh, STEP))
    np.testing.assert_allclose(late(0.0), now, atol=1e-11)
    by_two = np.asarray(late(2 * STEP))
    np.testing.assert_allclose(by_two[:, 2:], now[:, :-2], atol=1e-12)
    np.testing.assert_allclose(by_two[:, :2], np.broadcast_to(now[:, :1, :1], (2, 2, 3, 6)), atol=1e-12)
    np.testing.assert_allclose(np.asarray(late(-STEP))[:, :-1], now[:, 1:], atol=1e-12)
    slope = np.asarray(jax.jacfwd(late)(0.3 * STEP))
    around = (np.asarray(late(0.301 * STEP)) - np.asarray(late(0.299 * STEP))) / (0.002 * STEP)
    np.testing.assert_allclose(slope, around, rtol=1e-6, atol=1e-6)


@pytest.mark.system
@pytest.mark.parametrize("constant", [0.0, 0.05, 0.3])
@pytest.mark.parametrize("phase", [0.1, 0.35, 0.75])
def test_a_delay_is_as_long_as_it_says_wherever_commands_begin(thrusters, constant, phase):
    """The impulse so far comes late by half a step: as area, for a thruster without a lag has no slope."""
    some = eqx.tree_at(lambda t: t.time_constant, thrusters, jnp.full(thrusters.count, constant))
    t = np.array([0.0, (5.0 + phase) * STEP])
    still = Signal(np.array([0.0, 200 * STEP]), np.zeros((2, 1)))
    record = Record("x", t, np.stack([np.zeros(8), np.full(8, 0.8)]), {"depth": still}, 200 * STEP)
    arrays = [jnp.asarray(cut([record], Grid(STEP, 200)).arrays[k]) for k in KEYS]

    def area(delay):
        forces = np.asarray(thrust_history(some, *arrays, STEP, delay))[0, :, :, 2]
        return STEP * (forces[:, 0] + 4.0 * forces[:, 1] + forces[:, 2]).sum() / 6.0

    settled = float((thrusters.configuration @ static_force(thrusters, np.full(8, 0.8)))[2])
    for delay in (0.5 * STEP, -0.3 * STEP, 1.7 * STEP):
        assert (area(0.0) - area(delay)) / settled == pytest.approx(delay, abs=1e-5)
