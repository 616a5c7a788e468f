"""Measurement equations: against cases done by hand, and against differences of a trajectory of the plant."""

import numpy as np
import pytest
from tests.simulation.helper import state, vehicle

from rovtwin.core.flow import Command, Environment
from rovtwin.core.frames import quaternion_from_euler, rotation_from_euler, rotation_from_quaternion
from rovtwin.core.numerics import jax, jnp
from rovtwin.vehicle.physics import measurement
from rovtwin.vehicle.physics.dynamics import State, acceleration, plant_step

HALF = np.sqrt(0.5)
LEVER = jnp.array([0.3, -0.2, 0.15])
TILTED = rotation_from_euler(jnp.array([0.4, -0.7, 1.9]))
ALIGNED = jnp.eye(3)


def test_accelerometer_at_rest_reads_minus_gravity_along_the_axis_that_points_down():
    for attitude, expected in (
        ((1.0, 0.0, 0.0, 0.0), [0, 0, -9.81]),
        ((HALF, HALF, 0.0, 0.0), [0, -9.81, 0]),  # rolled by 90 degrees to starboard: y points down
        ((HALF, 0.0, HALF, 0.0), [9.81, 0, 0]),  # pitched up by 90 degrees: x points up
    ):
        f = measurement.specific_force(state(attitude=attitude), jnp.zeros(6), LEVER, ALIGNED)
        np.testing.assert_allclose(f, expected, atol=1e-14)


def test_accelerometer_on_a_spinning_body_reads_the_centripetal_acceleration():
    spinning = state(nu=(0, 0, 0, 0, 0, 2.0))
    f = measurement.specific_force(spinning, jnp.zeros(6), jnp.array([0.5, 0.0, 0.0]), ALIGNED)
    np.testing.assert_allclose(f, [-0.5 * 4.0, 0, -9.81], atol=1e-14)
    speeding_up = measurement.specific_force(state(), jnp.array([0, 0, 0, 0, 0, 3.0]), jnp.array([0.5, 0, 0]), ALIGNED)
    np.testing.assert_allclose(speeding_up, [0, 1.5, -9.81], atol=1e-14)


def test_accelerometer_in_a_steady_turn():
    """1 m/s ahead and 0.5 rad/s: CO accelerates to starboard though nu stands still."""
    turning = state(nu=(1.0, 0, 0, 0, 0, 0.5))
    f = measurement.specific_force(turning, jnp.zeros(6), jnp.zeros(3), ALIGNED)
    np.testing.assert_allclose(f, [0, 0.5, -9.81], atol=1e-14)


def test_accelerometer_in_free_fall_reads_nothing():
    f = measurement.specific_force(state(), jnp.array([0, 0, 9.81, 0, 0, 0]), jnp.zeros(3), ALIGNED)
    np.testing.assert_allclose(f, 0, atol=1e-14)


def test_mounting_turns_all_vectors_alike():
    somewhere = state((1, 2, 3), (0.8, 0.0, 0.6, 0.0), (0.4, 0.1, -0.2, 0.3, -0.1, 0.6))
    nu_dot = jnp.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    for aligned, turned in (
        (measurement.angular_rate(somewhere, ALIGNED), measurement.angular_rate(somewhere, TILTED)),
        (
            measurement.specific_force(somewhere, nu_dot, LEVER, ALIGNED),
            measurement.specific_force(somewhere, nu_dot, LEVER, TILTED),
        ),
        (
            measurement.velocity_over_ground_at(somewhere, LEVER, ALIGNED),
            measurement.velocity_over_ground_at(somewhere, LEVER, TILTED),
        ),
    ):
        np.testing.assert_allclose(TILTED @ turned, aligned, atol=1e-14)
    # A quarter turn about down: what lies ahead in b lies along -y of the sensor.
    quarter = rotation_from_euler(jnp.array([0.0, 0.0, np.pi / 2]))
    ahead = state(nu=(1.0, 0, 0, 0, 0, 0))
    np.testing.assert_allclose(
        measurement.velocity_over_ground_at(ahead, jnp.zeros(3), quarter), [0, -1.0, 0], atol=1e-15
    )


@pytest.mark.parametrize("euler", [(0.1, -0.2, 2.9), (-3.0, 1.2, -1.0), (0.0, 0.0, 0.0)])
def test_attitude_of_a_mounted_sensor(euler):
    somewhere = state(attitude=quaternion_from_euler(jnp.array(euler)))
    np.testing.assert_allclose(measurement.attitude_euler(somewhere, ALIGNED), euler, atol=1e-12)
    read = measurement.attitude_euler(somewhere, TILTED)
    expected = rotation_from_euler(jnp.array(euler)) @ TILTED
    np.testing.assert_allclose(rotation_from_euler(read), expected, atol=1e-12)


def test_position_and_depth_of_a_point():
    heading_east = state((10.0, 20.0, 3.0), (HALF, 0.0, 0.0, HALF))
    np.testing.assert_allclose(
        measurement.position_at(heading_east, jnp.array([1.0, 0.5, 0.2])), [9.5, 21.0, 3.2], atol=1e-14
    )
    nose_down = state((0, 0, 3.0), (HALF, 0.0, -HALF, 0.0))
    assert float(measurement.depth(nose_down, jnp.array([1.0, 0.0, 0.0]))) == pytest.approx(4.0)


def test_all_readings_are_those_of_a_moving_point_of_the_plant():
    """A vehicle thrown about in its own dynamics: velocity and acceleration of a point by differences of its place."""
    model, dt = vehicle(), 1e-3
    command = Command(jnp.array([0.8, -0.6, 0.7, 0.5, 0.4, -0.9]))
    environment = Environment.calm(velocity=jnp.array([0.2, -0.1, 0.05]), wrench=jnp.ones(6))
    begin = State(
        jnp.zeros(3), jnp.array([0.8, 0.36, -0.48, 0.0]), jnp.array([0.3, -0.2, 0.1, 0.4, -0.5, 0.6]), jnp.zeros(6)
    )

    def one(now, _):
        after = plant_step(model, now, command, environment, dt)
        tau = model.thrusters.configuration @ after.thrust
        return after, (after, acceleration(model, after.position, after.attitude, after.nu, tau, environment))

    _, (states, nu_dot) = jax.jit(lambda: jax.lax.scan(one, begin, None, length=400))()
    place = np.asarray(jax.vmap(lambda s: measurement.position_at(s, LEVER))(states))
    R_ns = np.asarray(jax.vmap(lambda s: rotation_from_quaternion(s.attitude) @ TILTED)(states))
    velocity = (place[2:] - place[:-2]) / (2 * dt)
    twice = (place[2:] - 2 * place[1:-1] + place[:-2]) / dt**2
    dvl = jax.vmap(lambda s: measurement.velocity_over_ground_at(s, LEVER, TILTED))(states)
    force = jax.vmap(lambda s, a: measurement.specific_force(s, a, LEVER, TILTED))(states, nu_dot)
    inner = slice(1, -1)
    np.testing.assert_allclose(np.einsum("kij,kj->ki", R_ns, dvl)[inner], velocity, atol=2e-6)
    np.testing.assert_allclose(np.einsum("kij,kj->ki", R_ns, force)[inner], twice - np.array([0, 0, 9.81]), atol=2e-5)
