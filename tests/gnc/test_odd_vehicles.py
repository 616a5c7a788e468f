"""Vehicles that nobody here flies: axes without thrusters, thrusters that push one way, nothing that rights them."""

import dataclasses

import numpy as np
import pytest
from tests.gnc.flying import estimate_of, thirty_kg

from rovtwin.core.flow import Reference
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.allocation.prioritised import PriorityAllocation
from rovtwin.gnc.control.tracking import Tracking
from rovtwin.gnc.guidance.path_following import PathGuidance
from rovtwin.gnc.guidance.speed_limit import AchievableSpeed, significant
from rovtwin.gnc.interfaces import AllocationInput, ControlInput
from rovtwin.gnc.navigation.tuning import disturbance_levels
from rovtwin.gnc.safety.contingency import Contingency
from rovtwin.gnc.scales import VehicleScales
from rovtwin.vehicle.physics.actuation import axis_limits
from rovtwin.vehicle.physics.thrusters import thrusters_from

AXES = np.eye(6)
SURGE_PAIR = AXES[:, [0, 0]] + 0.2 * AXES[:, [5, 5]] * [1.0, -1.0]
NO_HEAVE = thirty_kg(T=SURGE_PAIR)
HEAVE_ONLY = thirty_kg(T=AXES[:, [2]])
UNRIGHTED = thirty_kg(T=np.c_[SURGE_PAIR, AXES[:, 2]], center_of_gravity=[0.0, 0.0, 0.0])
ONE_WAY = thirty_kg(
    thrusters=thrusters_from(
        jnp.asarray(np.c_[SURGE_PAIR, AXES[:, [1, 2]]]),
        jnp.full(4, 20.0),
        force_astern=jnp.array([20.0, 20.0, 0.0, 20.0]),
    )
)
ODD = {"no heave": NO_HEAVE, "heave only": HEAVE_ONLY, "unrighted": UNRIGHTED, "sway one way": ONE_WAY}


@pytest.mark.system
@pytest.mark.parametrize("name", ODD)
def test_control_asks_for_numbers(name):
    """Without sway and with nothing that rights it in roll, all forces were NaN."""
    tracking = Tracking.of(ODD[name])
    zero = jnp.zeros(6)
    memory = tracking.init(None, None)
    step = jax.jit(lambda at, to: tracking.step(memory, ControlInput(at, to, zero), 0.02)[1])
    ahead = Reference.from_euler(
        *(jnp.asarray(v) for v in ([1.0, 0.5, 3.2, 0, 0, 0.3], [0.2, 0.1, 0.1, 0, 0, 0.1], np.zeros(6)))
    )
    for eta in (np.zeros(6), [0, 0, 3, 0.1, -0.1, 2.0]):
        assert np.isfinite(step(estimate_of(eta, nu=np.full(6, 0.1)), ahead).tau).all()


@pytest.mark.parametrize("name", ODD)
def test_every_speed_and_every_belief_is_a_positive_number(name):
    """A dive waits for rest within a speed that was 0 without heave thrust; a way home was flown at 0."""
    model = ODD[name]
    assert float(PathGuidance.of(model).rest) > 0.0
    assert float(Contingency.of(model).speed) > 0.0
    assert np.all(VehicleScales.of(model).level_speed > 0.0)
    assert all(np.isfinite(value) and value > 0.0 for value in disturbance_levels(model).values())


def test_thrust_to_one_side_holds_nothing_from_the_other():
    assert float(AchievableSpeed.of(ONE_WAY).aside_speed()) == 0.0
    assert float(AchievableSpeed.of(thirty_kg()).aside_speed()) > 0.1


def test_turning_does_not_drive_a_vehicle_ahead():
    """25 N ahead and 18 N astern: the whole moment in yaw came with 7 N ahead, and yaw goes first."""
    T = np.c_[AXES[:, 0] + 0.12 * AXES[:, 5], AXES[:, 0] - 0.12 * AXES[:, 5], AXES[:, 2]]
    astern = jnp.array([18.0, 18.0, 25.0])
    model = thirty_kg(thrusters=thrusters_from(jnp.asarray(T), jnp.full(3, 25.0), force_astern=astern))
    lower, upper = axis_limits(model)
    np.testing.assert_allclose([lower[5], upper[5]], [-0.24 * 18.0, 0.24 * 18.0])
    np.testing.assert_allclose(Tracking.of(model).limits.upper[5], upper[5])
    allocation = PriorityAllocation.of(model, slew=np.inf)
    tau = jnp.array([-36.0, 0, 0, 0, 0, float(upper[5])])
    _, got = allocation.step(allocation.init(None, None), AllocationInput(tau, jnp.ones(3)), 0.02)
    np.testing.assert_allclose(got.made[jnp.array([0, 5])], [0.0, upper[5]], atol=0.15)


def test_what_nobody_knows_of_a_force_is_no_current():
    """A slender vehicle took 0.3 N of filter noise for a current of 0.3 m/s and turned its bow into it, to and fro."""
    estimate = dataclasses.replace(estimate_of(np.zeros(6)), bias=jnp.array([0.3, 0.0, 0, 0, 0, 0]))
    for std, share in ((0.0, 1.0), (0.15, 0.75), (0.31, 0.0)):
        kept = significant(dataclasses.replace(estimate, bias_std=jnp.asarray(std))).bias
        np.testing.assert_allclose(kept, [0.3 * share, 0, 0, 0, 0, 0], atol=1e-9)
