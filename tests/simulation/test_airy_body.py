"""What a body does in the airy sea, and the sea in the world."""

import numpy as np
import pytest
from tests.simulation.helper import SHORT_CRESTED, SMALL_SEA, one_wave, state, vehicle

from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Environment
from rovtwin.core.numerics import jax, jnp
from rovtwin.simulation.environment.world import World
from rovtwin.simulation.sensors.sensor import Sensor, SensorInput
from rovtwin.vehicle.physics.dynamics import acceleration, damping_wrench, plant_step
from rovtwin.vehicle.physics.model import GRAVITY
from rovtwin.vehicle.physics.thrusters import thrusters_from

START = Start.at()


def sphere(mass=30.0):
    """Neutral, without drag, and nothing in it that turns."""
    zero = np.zeros((6, 6))
    return vehicle(
        rigid_body_mass=np.diag([mass] * 3 + [1.0] * 3),
        added_mass=np.diag([0.5 * mass] * 3 + [0.0] * 3),
        linear_damping_ahead=zero,
        quadratic_damping_ahead=zero,
        center_of_gravity=(0.0, 0.0, 0.0),
        center_of_buoyancy=(0.0, 0.0, 0.0),
        thrusters=thrusters_from(jnp.zeros((6, 0)), jnp.zeros(0)),
    )


def drifted(sea, model, depth, duration, dt=0.02, moving=True):
    """Paths of a body let go at a depth, and of the water that was there, shape (n, 3) each."""
    world = World(waves=sea)
    memory = world.init(jax.random.key(1), START)
    v0 = sea.at(memory.waves.phase, 0.0, jnp.array([0.0, 0.0, depth])).velocity * moving
    body = state((0.0, 0.0, depth), nu=(*(float(v) for v in v0), 0.0, 0.0, 0.0))

    def particle(t, x):
        return sea.at(memory.waves.phase, t, x).velocity

    def step(carry, k):
        memory, body, x = carry
        memory, environment = world.step(memory, body, dt)
        body = plant_step(model, body, Command(jnp.zeros(0)), environment, dt)
        t = k * dt
        k1 = particle(t, x)
        k2 = particle(t + dt / 2, x + dt / 2 * k1)
        k3 = particle(t + dt / 2, x + dt / 2 * k2)
        x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + particle(t + dt, x + dt * k3))
        return (memory, body, x), (body.position, x)

    run = jax.jit(lambda c: jax.lax.scan(step, c, jnp.arange(round(duration / dt)))[1])
    return jax.tree.map(np.asarray, run((memory, body, body.position)))


@pytest.mark.system
def test_a_neutral_body_without_drag_follows_the_water():
    """To 5 mm after a minute, at ten times the step of the scenarios; the error goes with the step squared."""
    body, water = drifted(SHORT_CRESTED, sphere(), 2.0, 60.0)
    assert np.abs(water - water[0]).max() > 0.5
    np.testing.assert_allclose(body, water, atol=5e-3)


def test_what_is_carried_round_drifts_with_the_waves():
    """Stokes (1847): a^2 omega k exp(-2 k z), over whole turns."""
    omega, a, depth = 1.2, 0.3, 1.5
    sea, k = one_wave(a, omega), omega**2 / GRAVITY
    turns = 20 * 2 * np.pi / omega
    body, _ = drifted(sea, sphere(), depth, turns)
    # About the middle of its orbit: it is let go in one place of it.
    middle = body[:, 2].mean()
    assert (body[-1, 0] - body[0, 0]) / turns == pytest.approx(a**2 * omega * k * np.exp(-2 * k * middle), rel=0.05)


def test_force_on_a_fixed_body_is_morisons():
    """Froude-Krylov, added mass and drag: rho V (1 + Ca) u_dot + D(u) u, in waves long against the body."""
    model, sea = vehicle(), one_wave(0.5, 0.6)
    phase, place = jnp.array([1.0]), jnp.array([0.0, 0.0, 3.0])
    for t in np.linspace(0.0, 10.0, 7):
        flow = sea.at(phase, t, place)
        environment = Environment.calm(velocity=flow.velocity, rate=flow.rate, gradient=flow.gradient, place=place)
        nu_dot = acceleration(model, place, jnp.array([1.0, 0, 0, 0]), jnp.zeros(6), jnp.zeros(6), environment)
        force = (model.inertia @ nu_dot)[:3]
        inertia = model.displaced_mass * flow.rate + model.added_mass[:3, :3] @ flow.rate
        drag = -damping_wrench(model, -jnp.concatenate([flow.velocity, jnp.zeros(3)]))[:3]
        # Convective terms, which Morison leaves out, are k a = 2 % of the largest force.
        np.testing.assert_allclose(force, inertia + drag, atol=0.02 * float(jnp.abs(inertia).max()) + 0.05)


def test_surface_and_pressure_follow_the_waves():
    world = World(waves=SMALL_SEA, surface=jnp.array(0.0))
    memory = world.init(jax.random.key(2), START)
    under = state((1.0, 0.0, 2.0))
    _, environment = world.step(memory, under, 0.002)
    action = SMALL_SEA.at(memory.waves.phase, 0.001, under.position)
    assert float(environment.surface) == pytest.approx(-float(action.elevation))
    assert float(environment.head) == pytest.approx(float(action.head))
    pressure = Sensor("pressure", 500.0)
    seen = SensorInput(under, jnp.zeros(6), jnp.asarray(0), environment)
    _, slot = pressure.step(pressure.init(jax.random.key(0), START), seen, 0.002)
    assert float(slot.value[0, 0]) == pytest.approx(2.0 + float(action.head))
