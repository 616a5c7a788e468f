"""Forces of thrusters under test: commands that change between grid points, and that come late."""

import equinox as eqx
import numpy as np
import pytest

from rovtwin.core.numerics import jax, jnp
from rovtwin.identification.joint.loads import thrust_history
from rovtwin.identification.joint.segments import Grid, cut
from rovtwin.identification.logs.record import Record, Signal
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.thrusters import static_force

STEP = 0.02


@pytest.fixture(scope="module")
def thrusters():
    return load_vehicle("bluerov2_heavy").model().thrusters


def instant(thrusters):
    return eqx.tree_at(lambda t: t.time_constant, thrusters, jnp.zeros(thrusters.count))


def test_forces_are_averaged_within_a_step_not_commands(thrusters):
    """Half of a command is a third of the force of a thruster: a mean command bends its curve."""
    full, change = np.full(8, 0.8), 3.25 * STEP  # on from a quarter of the fourth step
    still = Signal(np.array([0.0, 1.0]), np.zeros((2, 1)))
    record = Record("x", np.array([0.0, change]), np.stack([np.zeros(8), full]), {"depth": still}, 1.0)
    arrays = cut([record], Grid(STEP, 10)).arrays
    history = thrust_history(instant(thrusters), *(jnp.asarray(arrays[k]) for k in ("command", "held", "fresh")), STEP)
    settled = np.asarray(thrusters.configuration @ static_force(thrusters, full))
    found = np.asarray(history).reshape(-1, 3, 6)[:, 2]
    assert np.allclose(found[2], 0.0) and np.allclose(found[3], 0.75 * settled) and np.allclose(found[4], settled)


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
    around = (np.asarray(late(0.31 * STEP)) - np.asarray(late(0.29 * STEP))) / (0.02 * STEP)
    np.testing.assert_allclose(slope, around, rtol=1e-6, atol=1e-6)
