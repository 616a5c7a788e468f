"""The twin's books: work of the thrusters, kinetic, potential and lost energy, and what the batteries gave for it."""

import numpy as np
import pytest

from rovtwin.core.arrays.integrate import rk4_step
from rovtwin.core.flow import Command
from rovtwin.core.frames import quaternion_normalise, quaternion_rate, rotation_from_quaternion
from rovtwin.core.numerics import jax, jnp
from rovtwin.runs.compose.composition import compose
from rovtwin.scenario.files import load_scenario
from rovtwin.simulation.twin import TwinInput
from rovtwin.vehicle.physics.boundaries import surface_energy, surroundings_wrench
from rovtwin.vehicle.physics.dynamics import acceleration, damping_wrench, kinetic_energy, potential_energy
from rovtwin.vehicle.physics.thrusters import lag, static_force

DT, STEPS, TICKS = 0.02, 10, 2000
H = DT / STEPS
EVERYTHING = [
    "world.surface=true",
    "world.floor=12",
    "world.tank={north: [-20, 20], east: [-20, 20]}",
    "battery=true",
    *(f"sensors.{name}=true" for name in ("dvl", "altimeter", "battery", "leak")),
]


def command(k):
    """Up through the surface and down again, turning, ahead and astern; never the same."""
    t = k * DT
    rate, phase = jnp.array([0.9, 0.7, 0.3, 1.1, 0.8, 0.31]), jnp.array([0.0, 0.4, -1.6, 0.2, 0.9, -1.5])
    return Command(jnp.array([0.5, 0.4, 0.7, 0.6, 0.4, 0.75]) * jnp.sin(rate * t + phase))


def books(model, twin, environment):
    """The twin's flight, and beside it the same motion with its work and losses, all by RK4."""

    def derivative(wrench):
        def at(elapsed, x):
            p, q, nu, _, _ = x
            R, tau = rotation_from_quaternion(q), wrench[elapsed]
            nu_dot = acceleration(model, p, q, nu, tau, environment, elapsed)
            wet = surroundings_wrench(model, p, R, nu, environment)[1]
            return R @ nu[:3], quaternion_rate(q, nu[3:]), nu_dot, tau @ nu, wet * nu @ damping_wrench(model, nu)

        return at

    def step(carry, _):
        x, thrust, target = carry
        T, middle = model.thrusters.configuration, lag(model.thrusters, thrust, target, 0.5 * H)
        end = lag(model.thrusters, middle, target, 0.5 * H)
        wrench = {0.0: T @ thrust, 0.5 * H: T @ middle, H: T @ end}
        p, q, nu, work, lost = rk4_step(derivative(wrench), x, H)
        return ((p, quaternion_normalise(q), nu, work, lost), end, target), None

    def tick(carry, k):
        memory, x, thrust = carry
        memory, out = twin.step(memory, TwinInput(command(k), k), DT)
        begin = (x, thrust, static_force(model.thrusters, command(k).u))
        (x, thrust, _), _ = jax.lax.scan(step, begin, None, length=STEPS)
        p, q, nu, work, lost = x
        potential = potential_energy(model, p, q)
        afloat = surface_energy(model, p[2], rotation_from_quaternion(q)[2], jnp.zeros(()))
        energy = jnp.stack([kinetic_energy(model, nu), potential + afloat, work, lost])
        return (memory, x, thrust), (out.state, memory.battery.used, x[:3], energy)

    return tick


@pytest.fixture(scope="module")
def flight():
    simulation = compose(load_scenario("lawnmower_calm", EVERYTHING))
    twin, start = simulation.loop.twin, simulation.start
    assert len(twin.sensors) == 9 and twin.battery is not None

    def fly(twin):
        memory = twin.init(jax.random.key(0), start)
        environment = twin.world.step(memory.world, memory.state, H)[1]
        state = memory.state
        x = (state.position, state.attitude, state.nu, jnp.zeros(()), jnp.zeros(()))
        return jax.lax.scan(books(twin.model, twin, environment), (memory, x, state.thrust), jnp.arange(TICKS))[1]

    return twin, jax.device_get(jax.jit(fly)(twin))


@pytest.mark.system
def test_work_is_kinetic_and_potential_energy_and_what_is_lost(flight):
    """Calm water, surface broken, floor and walls not touched, battery and all sensors on: closed to 1e-6."""
    _, (state, _, (position, attitude, nu), energy) = flight
    np.testing.assert_allclose(position, state.position, atol=1e-9)  # the books are of the twin's own motion
    np.testing.assert_allclose(attitude, state.attitude, atol=1e-9)
    np.testing.assert_allclose(nu, state.nu, atol=1e-9)
    # The hull is 0.16 m high above CO: it came out of the water, and dived again.
    assert state.position[:, 2].min() < 0.12 and state.position[:, 2].max() > 1.0
    kinetic, potential, work, lost = energy.T
    balance = kinetic + potential - work + lost
    moved = np.abs(np.diff(work)).sum()
    print(f"moved {moved:.1f} J, lost {lost[-1]:.1f} J, error {np.ptp(balance):.2e} J, {np.ptp(balance) / moved:.1e}")
    assert moved > 20.0 and np.ptp(potential) > 1.0
    assert np.ptp(balance) < 1e-6 * moved


@pytest.mark.system
def test_the_batteries_give_the_integral_of_the_electrical_power(flight):
    """From the forces in the log alone: between ticks each goes to its target with its lag, exactly."""
    twin, (state, used, _, energy) = flight
    model, thrust = twin.model, np.vstack([np.zeros(6), state.thrust])
    target = np.asarray(jax.vmap(lambda k: static_force(model.thrusters, command(k).u))(jnp.arange(TICKS)))
    e = np.linspace(0.0, DT, 201)
    decay = np.exp(-e[:, None] / np.asarray(model.thrusters.time_constant))
    weights = np.r_[1.0, np.tile([4.0, 2.0], 99), 4.0, 1.0] * (DT / 200) / 3
    force = target[:, None] + (thrust[:-1, None] - target[:, None]) * decay
    np.testing.assert_allclose(force[:, -1], thrust[1:], atol=1e-9)
    power = np.where(force > 0, 1.0, 1.45) * np.abs(force) ** 1.5
    electrical = np.einsum("e,ken->", weights, power)
    hotel = 2 * 20.0 * TICKS * DT
    drawn, work = used[-1].sum() - hotel, energy[-1, 2]
    print(f"thrusters drew {drawn:.1f} J for {work:.2f} J of work: efficiency {100 * work / drawn:.1f} %")
    assert drawn == pytest.approx(electrical, rel=1e-6)
    assert 0.0 < work < drawn
