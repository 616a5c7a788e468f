"""The speed through the water that keeps a vehicle level, against the equations of motion."""

import dataclasses

import numpy as np
import pytest
from tests.gnc.flying import thirty_kg
from tests.gnc.test_speed_limit import pushed

from rovtwin.core.flow import Environment, Reference
from rovtwin.core.frames import quaternion_from_euler
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.control.tracking import Tracking
from rovtwin.gnc.guidance.level_allowance import MOST, QUIET, TILTED, Allowance, LevelAllowance
from rovtwin.gnc.guidance.level_speed import EASY, LevelSpeed
from rovtwin.gnc.guidance.speed_limit import AchievableSpeed
from rovtwin.gnc.interfaces import ControlInput
from rovtwin.gnc.scales import ANY, MARGIN, VehicleScales
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics.dynamics import acceleration
from rovtwin.vehicle.physics.thrusters import thrusters_from

BARE = thirty_kg(
    thrusters=thrusters_from(jnp.zeros((6, 0)), jnp.zeros(0)),
    added_mass=np.diag([15.0, 30.0, 60.0, 2.2, 0.6, 0.9]),
    linear_damping_ahead=np.zeros((6, 6)),
    quadratic_damping_ahead=np.zeros((6, 6)),
)
LEVEL = LevelSpeed(jnp.array([0.4, 1.0]))
NORTH, EAST = jnp.array([1.0, 0.0]), jnp.array([0.0, 1.0])


@pytest.mark.system
@pytest.mark.parametrize("angle", [0.0, 0.4, 1.0, 0.5 * np.pi, 2.5])
def test_on_the_ellipse_nothing_rights_the_vehicle_and_inside_something_does(angle):
    """Static stiffness of roll and pitch by the equations of motion: its determinant is zero where it tips."""
    axes = np.asarray(LevelSpeed.of(BARE).axes) / MARGIN

    def moments(tilt, share):
        speed = share / np.hypot(np.cos(angle) / axes[0], np.sin(angle) / axes[1])
        level = speed * jnp.array([np.cos(angle), np.sin(angle), 0.0])
        phi, theta = tilt
        # The same velocity through the water, seen from the tilted body, to first order.
        body = level + jnp.array([0.0, 0.0, level[0] * theta - level[1] * phi])
        q = quaternion_from_euler(jnp.array([phi, theta, 0.0]))
        nu = jnp.concatenate([body, jnp.zeros(3)])
        nu_dot = acceleration(BARE, jnp.zeros(3), q, nu, jnp.zeros(6), Environment.calm())
        return (BARE.inertia @ nu_dot)[3:5]

    stiffness = jax.jit(jax.jacfwd(moments))
    least = [float(np.linalg.det(stiffness(jnp.zeros(2), share))) for share in (0.0, 0.9, 1.0, 1.1)]
    assert least[1] / least[0] == pytest.approx(1.0 - 0.9**2, rel=1e-3)
    assert least[2] / least[0] == pytest.approx(0.0, abs=1e-3) and least[3] < 0.0


def test_a_velocity_that_keeps_it_level_is_left_alone_and_another_one_reduced():
    inside, outside = jnp.array([0.2, 0.5]), jnp.array([0.8, 1.0])
    assert np.array_equal(LEVEL.nearest(inside), inside)
    kept = np.asarray(LEVEL.nearest(outside))
    assert np.hypot(*(kept / [0.4, 1.0])) == pytest.approx(1.0) and kept[0] / kept[1] == pytest.approx(0.8)


def test_speed_over_ground_along_a_leg_in_a_current():
    assert LEVEL.along(NORTH, jnp.zeros(2)) == pytest.approx(0.4)
    assert LEVEL.along(NORTH, jnp.array([-0.1, 0.0])) == pytest.approx(0.3)
    assert LEVEL.along(NORTH, jnp.array([0.0, 0.6])) == pytest.approx(0.4 * 0.8)
    assert LEVEL.along(NORTH, jnp.array([-0.5, 0.0])) < 0.0
    assert LEVEL.along(NORTH, jnp.array([0.0, 1.1])) < 0.0


def test_a_dive_is_slower_the_faster_the_vehicle_goes_through_the_water():
    still, slow, fast = (float(LEVEL.dive(jnp.array([u, 0.0]))) for u in (0.0, 0.2, 0.4))
    assert still == ANY and 0.0 < fast < slow < 0.35


def heading(level, preferred, way, current, now, aside, astern=2.0):
    return float(level.heading(*(jnp.asarray(v, dtype=float) for v in (preferred, way, current, now, aside, astern))))


def test_a_vehicle_that_is_level_for_longer_sideways_turns_its_side_into_the_current():
    still = (0.0, 0.0)
    assert heading(LEVEL, 0.3, still, (-0.1, 0.0), 0.3, 2.0) == 0.3, "weak: as it was"
    assert heading(LEVEL, 0.0, still, (0.0, 0.7), 0.0, 2.0) == 0.0, "from the side already"
    for now in (0.1, -0.1):  # ahead: to the side to which it looks
        turned = heading(LEVEL, 0.0, still, (-0.6, 0.0), now, 2.0)
        assert np.sign(turned) == np.sign(now)
        w = 0.8 * np.array([np.cos(turned), -np.sin(turned)])
        assert np.hypot(*(w / [0.4, 1.0])) == pytest.approx(1.0, rel=1e-6)


def test_what_thrust_in_sway_lacks_for_speed_to_spare_turns_no_bow():
    """A 42 kg vehicle in 0.5 m/s turned its bow until 0.56 m/s of it would have come from abeam, tipped, gave way."""
    level, current = LevelSpeed(jnp.array([0.35, 0.62])), np.array([0.0, 0.5])
    for preferred, way in ((np.pi / 2, (0.0, -0.1)), (-np.pi / 2, (0.0, -0.1)), (np.pi, (0.0, -0.2))):
        turned = heading(level, preferred, way, current, 3.0, 0.56)
        through = np.array([np.sin(turned), np.cos(turned)]) * 0.5
        assert np.hypot(*(through / [0.35, 0.62])) < 0.95, preferred


LONGER_AHEAD = LevelSpeed(jnp.array([0.5, 0.3]))


def test_a_vehicle_that_is_level_for_longer_ahead_turns_its_bow_into_what_it_goes_through():
    """A current from abeam on a leg north: through the water it goes north-east."""
    way, current = (0.15, 0.0), (0.0, -0.3)
    turned = heading(LONGER_AHEAD, 0.0, way, current, 0.0, 2.0)
    w = np.subtract(way, current)
    off = np.arctan2(w[1], w[0]) - turned
    through = np.hypot(*w) * np.array([np.cos(off), np.sin(off)])
    assert np.hypot(*(through / [0.5, 0.3])) == pytest.approx(EASY, rel=1e-6)
    assert 0.0 < turned < np.arctan2(w[1], w[0]), "no further than it has to"
    assert heading(LONGER_AHEAD, 0.0, way, (0.0, -0.1), 0.0, 2.0) == 0.0, "weak: it crabs"
    assert heading(LONGER_AHEAD, 0.0, (0.0, 0.0), (-0.35, 0.0), 0.0, 2.0) == 0.0, "from ahead already"
    # More than it stands up to anywhere: straight into it, bow or stern, whichever looks there.
    assert heading(LONGER_AHEAD, 0.0, (0.0, 0.0), (0.0, -0.6), 0.1, 2.0) == pytest.approx(np.pi / 2, abs=1e-3)
    assert heading(LONGER_AHEAD, 0.0, (0.0, 0.0), (0.0, -0.6), -0.1, 2.0) == pytest.approx(-np.pi / 2, abs=1e-3)
    weak = heading(LONGER_AHEAD, 0.0, (0.0, 0.0), (0.0, -0.6), -0.1, 2.0, astern=0.5)
    assert weak == pytest.approx(np.pi / 2, abs=1e-3), "the stern looks there, and thrust astern is too weak"


def test_a_current_that_thrust_in_sway_does_not_stem_turns_the_bow():
    """Nothing tips it: what runs across the heading is what sway thrust stems, 0.2 m/s of 0.3."""
    free = LevelSpeed(jnp.array([ANY, ANY]))
    turned = heading(free, 0.0, (0.4, 0.0), (0.0, -0.3), 0.0, 0.2)
    assert np.sin(np.arctan2(0.3, 0.4) - turned) * 0.5 == pytest.approx(0.2, rel=1e-6)
    assert heading(free, 0.0, (0.4, 0.0), (0.0, -0.15), 0.0, 0.2) == 0.0
    assert heading(free, 0.0, (0.4, 0.0), (0.0, -0.3), 0.0, 0.0) == 0.0, "no thrust in sway: who crabs is carried"


def test_control_counts_as_what_tracking_gives():
    """Of a vehicle with thrusters in pitch: it stays level at its top speed (flown at 0.6 m/s: 2 deg)."""
    assert VehicleScales.of(load_vehicle("bluerov2_heavy").model()).level_speed[0] > 0.6


def test_tracking_drifts_where_holding_would_tip_the_vehicle():
    """Pushed by a current: the wrench is that of the largest level speed through the water, not of the current's."""
    model, axes = thirty_kg(), np.array([0.25, 0.25])  # slow enough for the thrust to be more than its drag
    control = Tracking.of(model)
    control = dataclasses.replace(control, sustained=dataclasses.replace(control.sustained, level=LevelSpeed(axes)))
    current = jnp.array([-1.2 * axes[0], 0.0])
    eta = jnp.array([0.0, 0.0, 3.0, 0.0, 0.0, 0.0])
    reference = Reference.from_euler(eta, jnp.zeros(6), jnp.zeros(6))

    def asked(velocity):
        given = ControlInput(pushed(eta, velocity, current), reference, jnp.zeros(6))
        return control.step(control.init(None, None), given, 0.02)[1].tau

    drifting = asked(jnp.array([-0.2 * axes[0], 0.0]))
    drag = AchievableSpeed.of(model)._drag(jnp.array([axes[0], 0.0]))
    assert drifting[0] == pytest.approx(float(drag[0]), rel=0.02)
    unlimited = dataclasses.replace(control.sustained, level=LevelSpeed(jnp.array([ANY, ANY])))
    control = dataclasses.replace(control, sustained=unlimited)
    assert asked(jnp.array([-0.2 * axes[0], 0.0]))[0] > 1.1 * drag[0]


def allowed(allowance, memory, asked, tilt, seconds, dt=0.02):
    def step(memory, t):
        roll = tilt(t) if callable(tilt) else tilt
        return allowance.step(memory, jnp.asarray(asked), jnp.array([roll, 0.0]), dt), None

    return jax.lax.scan(step, memory, dt * jnp.arange(round(seconds / dt)))[0]


def test_a_vehicle_that_stays_level_is_allowed_what_is_asked_for_and_one_that_tilts_is_not():
    """A dead thruster looks like a current that would tip the vehicle; real water tilts it and is given way to."""
    allowance = LevelAllowance.of(thirty_kg())
    w = float(allowance.bandwidth)
    start, level, tilted = Allowance.none(), 0.5 * QUIET, 1.1 * TILTED
    assert allowed(allowance, start, 0.9, level, 30 / w).factor == 1.0, "nothing beyond is asked for"
    assert allowed(allowance, start, 1.4, 1.1 * QUIET, 30 / w).factor == 1.0, "not quite level"
    assert allowed(allowance, start, 1.4, lambda t: 1.1 * QUIET * jnp.cos(1.5 * w * t), 90 / w).factor == 1.0, "waves"
    grown = allowed(allowance, start, 1.4, level, 30 / w)
    assert grown.factor == pytest.approx(1.4, abs=0.01)
    assert allowed(allowance, start, 9.0, level, 90 / w).factor == pytest.approx(MOST, rel=1e-3)
    yielded = allowed(allowance, grown, 1.4, tilted, 0.02)
    assert yielded.factor == 1.0, "at once"
    assert allowed(allowance, yielded, 1.4, level, 10 / w).factor == 1.0, "it waits"
    assert allowed(allowance, yielded, 1.4, level, 40 / w).factor > 1.35
    assert allowed(allowance, grown, 0.5, level, 30 / w).factor < 1.01, "no longer asked for"
    trimmed = dataclasses.replace(allowance, trim=jnp.array([0.2, 0.0]))
    assert allowed(trimmed, start, 1.4, 0.2, 30 / w).factor > 1.35, "a trim is no tilt"


def test_tracking_presses_against_what_does_not_tilt_it():
    """The vehicle of the last test, held off its place for a while and level all the same."""
    model, axes = thirty_kg(), np.array([0.25, 0.25])
    control = Tracking.of(model)
    control = dataclasses.replace(control, sustained=dataclasses.replace(control.sustained, level=LevelSpeed(axes)))
    eta = jnp.array([0.0, 0.0, 3.0, 0.0, 0.0, 0.0])
    reference = Reference.from_euler(eta, jnp.zeros(6), jnp.zeros(6))
    estimate = pushed(eta.at[0].set(-1.0), jnp.zeros(2), jnp.array([-1.2 * axes[0], 0.0]))
    given = ControlInput(estimate, reference, jnp.zeros(6))

    def step(memory, _):
        memory, wrench = control.step(memory, given, 0.02)
        return memory, wrench.tau[0]

    force = np.asarray(jax.lax.scan(step, control.init(None, None), None, 3000)[1])
    assert force[-1] > 1.4 * force[0]
