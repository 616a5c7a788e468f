"""The speed that thrusters keep up, and guidance that asks for no more."""

import dataclasses

import equinox as eqx
import numpy as np
import pytest
from tests.gnc.flying import DT, route, thirty_kg, two_bodies

from rovtwin.core.block import Start
from rovtwin.core.flow import Estimate
from rovtwin.core.frames import quaternion_from_euler, rotation_from_euler, yaw_rotation
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.guidance.path_following import SLOWEST, PathGuidance
from rovtwin.gnc.guidance.speed_limit import FREE, AchievableSpeed
from rovtwin.gnc.interfaces import MODE_RUNNING, GuidanceInput, Mode
from rovtwin.gnc.scales import ANY
from rovtwin.vehicle.analysis.stability import steady_speed
from rovtwin.vehicle.physics.dynamics import damping_wrench

# With ballast far below: what is tested here is thrust, and nothing tips this vehicle over.
UPRIGHT = {"center_of_gravity": np.array([0.0, 0.0, 0.3])}
MODEL = thirty_kg(linear_damping_astern=np.diag([9.0, 8.0, 10.0, 1.0, 1.0, 0.2]), **UPRIGHT)
SUSTAINED = AchievableSpeed.of(MODEL, share=1.0)
AHEAD, ASIDE = (steady_speed(MODEL, axis, force) for axis, force in ((0, 20.0), (1, 10.0)))


def pushed(eta, velocity, current):
    """An estimate, in the plane, of a vehicle at a velocity and in a current, both in n, shape (2,)."""
    R = rotation_from_euler(jnp.array([0.0, 0.0, 1.0]) * eta[5])
    nu, nu_r = (jnp.concatenate([R.T @ jnp.append(v, 0.0), jnp.zeros(3)]) for v in (velocity, velocity - current))
    force = R @ (damping_wrench(MODEL, nu) - damping_wrench(MODEL, nu_r))[:3]
    bias = jnp.concatenate([force, jnp.zeros(3)])
    return Estimate.from_euler(eta, nu, bias, jnp.eye(12), jnp.zeros(1), jnp.zeros(1))


@pytest.mark.parametrize("heading", [0.0, 0.7, -2.5])
@pytest.mark.parametrize("current", [(0.0, 0.0), (0.2, -0.1), (-0.3, 0.25)])
def test_the_current_is_read_from_the_force_that_it_makes(heading, current):
    estimate = pushed(jnp.array([0, 0, 3, 0, 0, heading]), jnp.array([0.15, -0.05]), jnp.array(current))
    np.testing.assert_allclose(SUSTAINED.current(estimate), current, atol=1e-9)


def test_a_horizontal_current_runs_along_the_heave_axis_of_a_vehicle_that_rolls():
    """The monitor of thrusters took what Munk's moment made of that for a lost heave thruster."""
    roll, flow = 0.35, 0.1
    level = pushed(jnp.array([0, 0, 3, 0, 0, 0.0]), jnp.zeros(2), jnp.array([0.0, flow]))
    rolled = dataclasses.replace(level, attitude=quaternion_from_euler(jnp.array([roll, 0.0, 0.0])))
    np.testing.assert_allclose(SUSTAINED.through_water(level)[:3], [0.0, -flow, 0.0], atol=1e-9)
    expected = [0.0, -flow * np.cos(roll), flow * np.sin(roll)]
    np.testing.assert_allclose(SUSTAINED.through_water(rolled)[:3], expected, atol=1e-9)


@pytest.mark.parametrize(
    ("direction", "heading", "current", "expected"),
    [
        (0.0, 0.0, (0.0, 0.0), AHEAD),
        (0.0, 0.0, (-0.1, 0.2), AHEAD - 0.1),
        (0.5 * np.pi, 0.5 * np.pi, (0.3, 0.1), AHEAD + 0.1),
        (0.5 * np.pi, 0.0, (0.0, -0.1), ASIDE - 0.1),
        (0.25 * np.pi, 0.0, (0.0, 0.0), ASIDE * np.sqrt(2)),
        (0.0, 0.0, (-0.5, 0.0), AHEAD - 0.5),
    ],
)
def test_the_speed_over_ground_is_that_through_the_water_and_the_current(direction, heading, current, expected):
    speed = SUSTAINED.along(jnp.asarray(direction), jnp.asarray(heading), jnp.array(current))
    assert speed == pytest.approx(expected, abs=1e-6)


def test_astern_has_its_own_drag_and_an_axis_without_thrusters_does_not_count():
    astern = SUSTAINED.along(jnp.asarray(np.pi), jnp.asarray(0.0), jnp.zeros(2))
    assert astern < AHEAD - 1e-3
    T = two_bodies()[:, [0, 2, 3, 5]]
    none_aside = eqx.tree_at(lambda s: s.level.axes, AchievableSpeed.of(thirty_kg(T=T)), jnp.array([ANY, ANY]))
    assert none_aside.along(jnp.asarray(0.5 * np.pi), jnp.asarray(0.0), jnp.array([0.0, -0.4])) > 0.9 * FREE


def speeds(guidance, current, corners=((6, 0), (6, 6)), seconds=100, leg=0.25):
    """Speed of the point, way-point and whether it is on an arc, for a vehicle that is where it should be."""
    plan, current = route(corners, speed=leg), jnp.asarray(current)

    def tick(carry, _):
        memory, nu = carry
        eta = jnp.concatenate([memory.position, jnp.zeros(2), memory.heading[None]])
        estimate = pushed(eta, (yaw_rotation(memory.heading) @ nu[:3])[:2], current)
        memory, asked = guidance.step(
            memory, GuidanceInput(estimate, plan, Mode(jnp.asarray(MODE_RUNNING), jnp.asarray(0))), DT
        )
        return (memory, asked.nu), (memory.speed, memory.waypoint, memory.on_arc)

    begin = guidance.init(jax.random.key(0), Start.at((0.0, 0.0, 3.0))), jnp.zeros(6)
    flown = jax.jit(lambda b: jax.lax.scan(tick, b, None, length=round(seconds / DT))[1])(begin)
    return [np.asarray(x) for x in flown]


@pytest.mark.system
def test_the_point_goes_as_fast_against_the_current_as_thrusters_do_and_brakes_before_the_corner():
    guidance, current = PathGuidance.of(MODEL), (0.0, -0.2)
    expected = float(
        AchievableSpeed.of(MODEL).along(jnp.asarray(0.5 * np.pi), jnp.asarray(0.5 * np.pi), jnp.array(current))
    )
    assert 0.05 < expected < 0.15  # or the test would be of something else
    # The bow is turned into the current with something to spare, which leaves 0.249 m/s across it.
    speed, waypoint, on_arc = speeds(guidance, current, leg=0.24)
    against = (waypoint == 1) & ~on_arc
    assert speed[~on_arc & (waypoint == 0)].max() == pytest.approx(0.24, abs=1e-3)
    assert speed[on_arc].max() < expected + 0.03  # the lag of the speed
    assert np.median(speed[against]) == pytest.approx(expected, abs=1e-3)
    unaware, waypoint, on_arc = speeds(eqx.tree_at(lambda g: g.sustained, guidance, None), current, leg=0.24)
    assert unaware[(waypoint == 1) & ~on_arc].max() == pytest.approx(0.24, abs=1e-3)
    assert unaware[on_arc].max() > expected + 0.06


def test_a_current_that_seems_too_strong_slows_the_point_but_does_not_strand_it():
    speed, *_ = speeds(PathGuidance.of(MODEL), (-0.6, 0.0))
    assert speed[-1] == pytest.approx(SLOWEST * 0.25, abs=1e-4)


def test_what_is_left_for_a_corner_is_the_thrust_less_what_holds_against_the_current():
    flow, heading = 0.2, 0.3
    current = flow * jnp.array([-np.sin(heading), np.cos(heading)])  # to starboard
    drag = float(damping_wrench(MODEL, jnp.zeros(6).at[1].set(flow))[1])
    mass = float(MODEL.inertia[1, 1])
    for side, expected in ((1.0, (10.0 + drag) / mass), (-1.0, (10.0 - drag) / mass)):
        assert SUSTAINED.aside(jnp.asarray(heading), jnp.asarray(side), current) == pytest.approx(expected, rel=1e-6)


@pytest.mark.system
def test_corners_are_slower_in_a_current_from_the_side():
    guidance = PathGuidance.of(MODEL)
    calm, strong = (speeds(guidance, current) for current in ((0.0, 0.0), (0.0, -0.17)))
    left = float(AchievableSpeed.of(MODEL).aside(jnp.asarray(0.0), jnp.asarray(1.0), jnp.array([0.0, -0.17])))
    radius = 0.2 / (np.sqrt(2.0) - 1.0)
    expected = np.sqrt(left * radius)
    assert expected < 0.7 * calm[0][calm[2]].min()  # or the test would be of something else
    assert strong[0][strong[2]].min() == pytest.approx(expected, abs=1e-3)
