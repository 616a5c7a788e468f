"""Vehicles that nobody here flies: axes without thrusters, thrusters that push one way, nothing that rights them."""

import numpy as np
import pytest
from tests.gnc.flying import estimate_of, thirty_kg

from rovtwin.core.flow import Reference
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.contingency import Contingency
from rovtwin.gnc.control import ControlInput
from rovtwin.gnc.navigation.tuning import beliefs
from rovtwin.gnc.path_guidance import PathGuidance
from rovtwin.gnc.scales import VehicleScales
from rovtwin.gnc.sustained import SustainedSpeed
from rovtwin.gnc.tracking import Tracking
from rovtwin.vehicle.thrusters import thrusters_from

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


@pytest.mark.parametrize("name", ODD)
def test_control_asks_for_numbers(name):
    """Without sway and with nothing that rights it in roll, all forces were NaN."""
    tracking = Tracking.of(ODD[name])
    zero = jnp.zeros(6)
    step = jax.jit(lambda at, to: tracking.step(zero[:3], ControlInput(at, to, zero), 0.02)[1])
    ahead = Reference(*(jnp.asarray(v) for v in ([1.0, 0.5, 3.2, 0, 0, 0.3], [0.2, 0.1, 0.1, 0, 0, 0.1], np.zeros(6))))
    for eta in (np.zeros(6), [0, 0, 3, 0.1, -0.1, 2.0]):
        assert np.isfinite(step(estimate_of(eta, nu=np.full(6, 0.1)), ahead).tau).all()


@pytest.mark.parametrize("name", ODD)
def test_every_speed_and_every_belief_is_a_positive_number(name):
    """A dive waits for rest within a speed that was 0 without heave thrust; a way home was flown at 0."""
    model = ODD[name]
    assert float(PathGuidance.of(model).rest) > 0.0
    assert float(Contingency.of(model).speed) > 0.0
    assert np.all(VehicleScales.of(model).level_speed > 0.0)
    assert all(np.isfinite(value) and value > 0.0 for value in beliefs(model).values())


def test_thrust_to_one_side_holds_nothing_from_the_other():
    assert float(SustainedSpeed.of(ONE_WAY).aside_speed()) == 0.0
    assert float(SustainedSpeed.of(thirty_kg()).aside_speed()) > 0.1
