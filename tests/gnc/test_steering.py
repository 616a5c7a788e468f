"""Line of sight: the laws themselves, and a vehicle without sway thrust that a force pushes off its path."""

import dataclasses

import numpy as np
import pytest
from tests.gnc.flying import DT, Perfect, fly, route, thirty_kg, two_bodies

from rovtwin.core.block import Start
from rovtwin.core.flow import GO, NO_REQUEST
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.allocation import Allocation
from rovtwin.gnc.autopilot import Autopilot
from rovtwin.gnc.path_guidance import PathGuidance
from rovtwin.gnc.steering import Steering, SteeringInput
from rovtwin.gnc.tracking import PathReference, Tracking

KINDS = ("los", "ilos", "alos")
# Without the two sway thrusters; more roll and yaw damping than needed keeps it simple.
MODEL = thirty_kg(T=np.delete(two_bodies(), [1, 4], axis=1))
SPEED = 0.25


def heading(kind, error, direction=0.3):
    block = Steering.of(kind)
    given = SteeringInput(jnp.asarray(error), jnp.asarray(direction), jnp.asarray(True))
    return float(block.step(block.init(jax.random.key(0), Start.at()), given, DT)[1])


@pytest.mark.parametrize("kind", KINDS)
def test_on_the_path_it_heads_along_and_beside_it_back(kind):
    assert heading(kind, 0.0) == pytest.approx(0.3)
    assert heading(kind, 2.0) == pytest.approx(0.3 - np.pi / 4)  # to starboard by the look-ahead
    assert heading(kind, -2.0) == pytest.approx(0.3 + np.pi / 4)
    assert abs(heading(kind, 1e6) - 0.3) < np.pi / 2 + 1e-6


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_learnt_is_bounded_and_waits_while_it_does_not_go(kind):
    block = Steering.of(kind)
    memory = block.init(jax.random.key(0), Start.at())
    for going in (False, True):
        given = SteeringInput(jnp.asarray(5.0), jnp.asarray(0.0), jnp.asarray(going))
        for _ in range(50):
            memory, _ = block.step(memory, given, 20.0)
        assert going or float(memory) == 0.0
    far = SteeringInput(jnp.asarray(0.0), jnp.asarray(0.0), jnp.asarray(False))
    assert abs(float(block.step(memory, far, DT)[1])) <= 1.0 + 1e-9


def test_an_unknown_law_is_named():
    with pytest.raises(ValueError, match="kind is 'vector', expected one of los, ilos, alos"):
        Steering.of("vector")


def pilot(kind):
    made = Autopilot.thesis(MODEL, Perfect(), route([(40, 0)], speed=SPEED), gains="pole_placement")
    return dataclasses.replace(
        made,
        guidance=PathGuidance.of(MODEL, Steering.of(kind)),
        reference=PathReference.of(),
        control=Tracking.of(MODEL),
        allocation=Allocation.of(MODEL),
    )


def last_error(kind, push):
    """Mean cross-track error of the last 20 s of a straight leg with a sideways force in b [m]."""
    truth, output = fly(
        pilot(kind), MODEL, Start.at((0, 0, 3)), np.full(round(140 / DT), NO_REQUEST), [0, push] + [0] * 4
    )
    assert int(output.setpoint.phase[-1]) == GO
    assert float(truth[-1, 0]) > 20.0, "it went on"
    return float(np.mean(np.asarray(truth)[-round(20 / DT) :, 1]))


@pytest.mark.parametrize("push", [1.5, pytest.param(-1.5, marks=pytest.mark.slow)])
def test_only_what_learns_the_crab_angle_comes_back_to_the_path(push):
    off = {kind: last_error(kind, push) for kind in KINDS}
    assert abs(off["los"]) > 0.3 and np.sign(off["los"]) == np.sign(push)
    assert abs(off["ilos"]) < 0.05 and abs(off["alos"]) < 0.05


def test_undisturbed_all_keep_the_path():
    assert all(abs(last_error(kind, 0.0)) < 0.01 for kind in KINDS)
