"""Holding, coming home and coming up: where the set-point goes, how fast, and when it is there."""

import dataclasses

import numpy as np
import pytest
from tests.gnc.flying import estimate_of

from rovtwin.core.block import Start
from rovtwin.core.flow import GO, HELD, LEAK, PILOTED, RETURNED, RETURNING, SURFACED, SURFACING, Setpoint
from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.gnc.interfaces import (
    MODE_ABORTED,
    MODE_HOLDING,
    MODE_PAUSED,
    MODE_PILOTED,
    MODE_RETURNING,
    MODE_RUNNING,
    MODE_SURFACING,
    Mode,
)
from rovtwin.gnc.safety.contingency import Contingency, ContingencyInput

DT = 0.1
BLOCK = Contingency(
    speed=0.3,
    acceleration=0.1,
    settling=0.5,
    surface=0.2,
    near=0.5,
    afloat=0.15,
    fastest=(0.5, 0.5, 0.2, 0.5),
    leash=0.7,
)
START = Start.at([1.0, -1.0, 0.5], 0.0)
AT = [6.0, 3.0, 4.0, 0.0, 0.0, np.pi / 2]
ON_LEG = Setpoint.level(
    as_array(AT[:3]),
    as_array(AT[5]),
    as_array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0]),
    jnp.zeros(3),
    jnp.ones(3),
    jnp.asarray(True),
    jnp.asarray(2),
    jnp.asarray(GO),
    jnp.asarray(0),
)

# Where guidance wants it in the end; a contingency begins where the vehicle is.
FAR_AHEAD = dataclasses.replace(ON_LEG, position=as_array([6.0, 9.0, 8.0]))


@jax.jit
def follow(memory, modes, command):
    """Memory and set-points; the vehicle stays until a contingency begins, then it is where asked, a tick late."""

    def one(carry, mode):
        memory, at = carry
        here = estimate_of(at, ON_LEG.nu)
        given = ContingencyInput(FAR_AHEAD, here, Mode(mode, jnp.where(mode > MODE_PAUSED, LEAK, 0)), command)
        memory, asked = BLOCK.step(memory, given, DT)
        return (memory, jnp.where(mode > MODE_RUNNING, asked.eta, at)), asked

    (memory, _), asked = jax.lax.scan(one, (memory, as_array(AT)), modes)
    return memory, asked


def flown(*spans, command=(0.0, 0.0, 0.0, 0.0)):
    """Set-points of (mode, seconds) one after the other; the pilot wishes the same all the time."""
    modes = np.concatenate([np.full(round(seconds / DT), mode) for mode, seconds in spans])
    return follow(BLOCK.init(jax.random.key(0), START), jnp.asarray(modes), as_array(command))[1]


def test_the_mission_passes_through():
    asked = flown((MODE_RUNNING, 1.0))
    assert np.all(np.asarray(asked.eta) == np.asarray(FAR_AHEAD.eta)) and np.all(np.asarray(asked.phase) == GO)
    assert np.all(np.asarray(asked.on_leg))


@pytest.mark.parametrize("mode", [MODE_HOLDING, MODE_RETURNING, MODE_SURFACING])
def test_it_moves_without_a_jump_and_no_faster_than_allowed(mode):
    place = np.asarray(flown((MODE_RUNNING, 1.0), (mode, 60.0)).eta)[10:, :3]
    speed = np.diff(np.vstack([AT[:3], place]), axis=0) / DT
    assert np.linalg.norm(speed[0] - [0.0, 0.3, 0.0]) < 0.02, "it begins as fast as guidance moved"
    assert np.linalg.norm(speed, axis=1).max() <= 0.3 + 1e-9
    assert np.linalg.norm(np.diff(speed, axis=0), axis=1).max() <= 0.1 * DT + 1e-9


def test_holding_comes_to_rest_within_its_stopping_distance():
    asked = flown((MODE_RUNNING, 1.0), (MODE_HOLDING, 30.0))
    place = np.asarray(asked.eta)[-1]
    assert np.allclose(place[[0, 2, 5]], np.array(AT)[[0, 2, 5]]) and 0.0 < place[1] - AT[1] < 0.6
    assert np.allclose(np.asarray(asked.nu)[-1], 0.0) and int(asked.phase[-1]) == HELD
    assert int(asked.reason[-1]) == LEAK and not bool(asked.on_leg[-1])


def test_returning_goes_home_level_and_bow_first():
    asked = flown((MODE_RUNNING, 1.0), (MODE_RETURNING, 60.0))
    eta, phase = np.asarray(asked.eta), np.asarray(asked.phase)
    assert np.allclose(eta[-1, :2], [1.0, -1.0], atol=1e-3) and np.all(eta[10:, 2] == 4.0)
    ahead = np.asarray(asked.nu)[150]
    assert ahead[0] > 0.25 and abs(ahead[1]) < 0.02, "sailing ahead on its way"
    there = np.argmax(phase == RETURNED)
    assert np.all(phase[10:there] == RETURNING) and np.all(phase[there:] == RETURNED)
    assert np.hypot(*(eta[there - 1, :2] - [1.0, -1.0])) < 0.5


def test_surfacing_goes_straight_up_and_stays():
    asked = flown((MODE_RUNNING, 1.0), (MODE_SURFACING, 60.0))
    eta, phase = np.asarray(asked.eta), np.asarray(asked.phase)
    assert eta[-1, 2] == pytest.approx(0.2, abs=1e-3) and abs(eta[-1, 1] - AT[1]) < 0.7
    assert {int(p) for p in phase[10:]} == {SURFACING, SURFACED} and phase[-1] == SURFACED


@pytest.mark.system
def test_a_vehicle_already_at_the_surface_is_not_sent_down():
    memory = BLOCK.init(jax.random.key(0), START)
    given = ContingencyInput(
        FAR_AHEAD, estimate_of(ON_LEG.eta.at[2].set(0.05)), Mode(jnp.asarray(MODE_SURFACING), jnp.asarray(LEAK))
    )
    for _ in range(100):
        memory, asked = BLOCK.step(memory, given, DT)
        assert float(asked.eta[2]) <= 0.06 and int(asked.phase) == SURFACED


@pytest.mark.system
def test_after_an_abort_it_stays_where_it_has_drifted_to():
    """Not drawn back to the path, nor down again, by arming alone."""
    memory = BLOCK.init(jax.random.key(0), START)
    drifted = estimate_of([9.0, -4.0, 0.3, 0.0, 0.0, 1.0])
    for mode in [MODE_RUNNING] * 5 + [MODE_ABORTED] * 5 + [MODE_PAUSED] * 50:
        given = ContingencyInput(FAR_AHEAD, drifted, Mode(jnp.asarray(mode), jnp.asarray(0)))
        memory, asked = BLOCK.step(memory, given, DT)
    assert np.allclose(asked.eta, drifted.eta)


def test_paused_after_a_fail_safe_it_stays_and_running_it_goes_back_to_guidance():
    asked = flown((MODE_RUNNING, 1.0), (MODE_RETURNING, 10.0), (MODE_PAUSED, 20.0), (MODE_RUNNING, 1.0))
    eta = np.asarray(asked.eta)
    assert np.linalg.norm(eta[-12, :2] - eta[-15, :2]) < 1e-3, "at rest while paused"
    assert np.linalg.norm(eta[-12, :2] - np.array(AT)[:2]) > 0.5, "not back where guidance waits"
    assert np.all(eta[-1] == np.asarray(FAR_AHEAD.eta))


def test_a_pilot_gets_the_velocity_along_the_heading_and_what_he_does_not_want_is_held():
    asked = flown((MODE_RUNNING, 1.0), (MODE_PILOTED, 20.0), command=(0.2, 0.0, -0.1, 0.0))
    eta, nu = np.asarray(asked.eta), np.asarray(asked.nu)
    assert np.allclose(nu[-1], [0.2, 0.0, -0.1, 0.0, 0.0, 0.0], atol=1e-6) and int(asked.phase[-1]) == PILOTED
    # It looks east: surge is east, and up is up.
    assert np.allclose((eta[-1] - eta[-51]) / (50 * DT), [0.0, 0.2, -0.1, 0.0, 0.0, 0.0], atol=1e-6)


def test_a_pilot_who_turns_moves_along_the_new_heading():
    asked = flown((MODE_RUNNING, 1.0), (MODE_PILOTED, 20.0), command=(0.2, 0.0, 0.0, 0.1))
    eta = np.asarray(asked.eta)
    along = np.diff(eta[-60:, :2], axis=0) / DT
    psi = eta[-60:-1, 5]
    assert np.allclose(np.diff(np.unwrap(eta[20:, 5])), 0.1 * DT, atol=1e-9)
    assert np.allclose(along, 0.2 * np.stack([np.cos(psi), np.sin(psi)], axis=1), atol=0.05)


def test_without_a_command_the_pilot_keeps_the_station():
    eta = np.asarray(flown((MODE_RUNNING, 1.0), (MODE_PILOTED, 30.0)).eta)
    assert np.allclose(eta[-1], eta[-100]) and np.linalg.norm(eta[-1, :3] - AT[:3]) < 0.6


@pytest.mark.system
def test_a_pilot_gets_no_more_than_the_vehicle_may_and_does_not_leave_it_behind():
    nu = np.asarray(flown((MODE_RUNNING, 1.0), (MODE_PILOTED, 30.0), command=(9.0, 0.0, 0.0, 9.0)).nu)
    assert np.abs(nu[:, :2]).max() <= 0.5 + 1e-9 and nu[-1, 5] == 0.5
    still = flown((MODE_RUNNING, 1.0), (MODE_PILOTED, 5.0), command=(np.nan, 0.0, 0.0, np.nan))
    assert np.isfinite(np.asarray(still.eta)).all(), "what is not a number is no wish"
    memory, here = BLOCK.init(jax.random.key(0), START), estimate_of(AT)
    for _ in range(200):  # a vehicle that is stuck
        given = ContingencyInput(
            ON_LEG, here, Mode(jnp.asarray(MODE_PILOTED), jnp.asarray(0)), as_array([0.4, 0, 0, 0.4])
        )
        memory, asked = BLOCK.step(memory, given, DT)
    assert np.isclose(np.linalg.norm(np.asarray(asked.eta)[:3] - AT[:3]), 0.7, atol=1e-6)
    assert np.isclose(asked.eta[5] - AT[5], 0.8, atol=1e-6)


def test_paused_after_piloting_it_stays_where_the_pilot_left_it_and_resumed_the_mission_goes_on():
    asked = flown(
        (MODE_RUNNING, 1.0), (MODE_PILOTED, 10.0), (MODE_PAUSED, 5.0), (MODE_RUNNING, 1.0), command=(0.2, 0, 0, 0)
    )
    eta = np.asarray(asked.eta)
    assert np.linalg.norm(eta[155, :2] - AT[:2]) > 1.0 and np.linalg.norm(eta[155, :2] - FAR_AHEAD.eta[:2]) > 1.0
    assert np.all(eta[-1] == np.asarray(FAR_AHEAD.eta)) and int(asked.phase[-1]) == GO
