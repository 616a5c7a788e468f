"""At the surface and at walls: draught, stability afloat, energy, and that nothing gets through."""

import dataclasses

import numpy as np
import pytest

from rovtwin.core.arrays.integrate import rk4_step
from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Environment, Walls
from rovtwin.core.frames import euler_from_quaternion, quaternion_from_euler, quaternion_rate, rotation_from_quaternion
from rovtwin.core.numerics import jax, jnp
from rovtwin.vehicle import Model, load_vehicle, vehicle_from_dict
from rovtwin.vehicle.analysis.stability import afloat
from rovtwin.vehicle.physics.boundaries import CONTACT_RATE, dryness, surface_energy
from rovtwin.vehicle.physics.dynamics import (
    State,
    acceleration,
    damping_wrench,
    kinetic_energy,
    potential_energy,
    rollout,
)

RHO, START = 1000.0, Start.at()
SURFACE = jnp.zeros(())
TANK = Walls(
    jnp.array([[-1.0, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, 1]]), jnp.array([2.0, 2.0, 1.0, 1.0, 1.5])
)


def box(length=0.8, width=0.5, height=0.4, share=0.6, bg=0.05) -> Model:
    """A box of which `share` floats under water, with its weight low."""
    mass = share * RHO * length * width * height
    data = {"name": "box", "mass": mass, "center_of_gravity": [0, 0, bg], "shape": {"box": [length, width, height]}}
    return vehicle_from_dict(data | {"hydrodynamics": {"linear_damping": [20, 20, 400, 5, 5, 5]}}).model()


@jax.jit
def left_alone(model: Model, start: State, environment: Environment) -> State:
    """60 s without thrust, every step of 2 ms."""
    idle = Command(jnp.zeros((30_000, model.thrusters.count)))
    return rollout(model, start, idle, environment, 0.002)


def at(model: Model, position, euler=(0.0, 0.0, 0.0), nu=np.zeros(6)) -> State:
    start = State.at(model, Start.at(position))
    attitude = quaternion_from_euler(jnp.asarray(euler, dtype=float))
    return dataclasses.replace(start, attitude=attitude, nu=jnp.asarray(nu, dtype=float))


def test_a_box_floats_at_its_draught():
    """From under water and from above: draught = share x height, as Archimedes says."""
    model = box()
    for depth in (1.0, -0.3):
        end = left_alone(model, at(model, (0.0, 0.0, depth)), Environment.calm(surface=SURFACE))
        draught = 0.6 * 0.4
        assert float(end.position[-1, 2]) + 0.2 == pytest.approx(draught, abs=1e-6)


def test_a_floating_box_has_its_metacentre():
    """Righting moment about level: W GM with GM = KB + I/V - KG, from naval architecture."""
    model = box(share=0.5)
    draught, V = 0.2, 0.2 * 0.8 * 0.5
    KG, KB = 0.2 - 0.05, draught / 2
    z = draught - 0.2
    angle = 1e-4
    for axis, (side, other) in enumerate(((0.5, 0.8), (0.8, 0.5))):
        GM = KB + other * side**3 / 12 / V - KG
        euler = np.zeros(3)
        euler[axis] = angle
        q = quaternion_from_euler(jnp.asarray(euler))
        # Floating freely it turns about the waterplane; CO is at the centre of the box, off it by its height there.
        state = jnp.array([0.0, 0.0, z])
        nu_dot = acceleration(model, state, q, jnp.zeros(6), jnp.zeros(6), Environment.calm(surface=SURFACE))
        moment = (model.inertia @ nu_dot)[3 + axis]
        assert float(moment) == pytest.approx(-float(model.weight) * GM * angle, rel=1e-3)


@pytest.mark.system
def test_the_double_blueye_rises_and_floats_level():
    """With 10 N of net buoyancy it comes up and settles where the rest of its volume stays dry."""
    vehicle = load_vehicle("double_blueye")
    model = vehicle.model(net_buoyancy=10.0)
    end = left_alone(model, at(model, (0.0, 0.0, 2.0), (0.1, -0.1, 0.5)), Environment.calm(surface=SURFACE))
    angles = np.asarray(euler_from_quaternion(end.attitude[-1]))
    assert np.abs(angles[:2]).max() < 0.02 and np.abs(end.nu[-1]).max() < 1e-3
    assert float(end.position[-1, 2]) == pytest.approx(afloat(model), abs=1e-3)
    # What is dry displaces 10 N: two Pioneers of 9 dm3, 0.319 m high, and an imager of 2.5 dm3.
    dry = 0.1595 - afloat(model)
    assert dry * 20.5e-3 / 0.319 * RHO * 9.81 == pytest.approx(10.0, rel=0.5)


def test_a_half_floating_box_goes_with_the_current():
    """Drag ends at the water's own speed, however little of the hull is wet."""
    current = jnp.array([0.5, -0.2, 0.0])
    model = box(share=0.5)
    end = left_alone(model, at(model, (0.0, 0.0, 0.0)), Environment.calm(surface=SURFACE, velocity=current))
    R = np.asarray(rotation_from_quaternion(end.attitude[-1]))
    np.testing.assert_allclose(
        R @ end.nu[-1, :3], current, atol=0.01
    )  # quadratic drag: what is left goes as 1 over time


def test_waves_push_what_is_wet():
    """A fixed box in accelerating water: Morison's inertia force, halved when it is half in the water."""
    model, rate = box(share=0.5), jnp.array([0.4, 0.0, 0.0])
    push = []
    for z in (5.0, 0.0):
        environment = Environment.calm(surface=SURFACE, rate=rate)
        nu_dot = acceleration(model, jnp.array([0.0, 0.0, z]), START.attitude, jnp.zeros(6), jnp.zeros(6), environment)
        push.append(float((model.inertia @ nu_dot)[0]))
    assert push[0] == pytest.approx(0.4 * float(model.displaced_mass + model.added_mass[0, 0]), rel=1e-9)
    assert push[1] == pytest.approx(0.5 * push[0], rel=1e-9)


@pytest.mark.system
def test_deep_water_has_no_surface():
    """Far below it the surface changes nothing, to the bit."""
    model = load_vehicle("double_blueye").model(net_buoyancy=1.0)
    start = at(model, (0.0, 0.0, 30.0), (0.3, 0.2, 0.1), [0.3, -0.1, 0.1, 0.2, 0.1, -0.2])
    u = Command(0.4 * jnp.ones((500, 6)))
    a, b = (
        jax.jit(rollout, static_argnums=4)(model, start, u, environment, 0.002)
        for environment in (Environment.calm(), Environment.calm(surface=SURFACE))
    )
    np.testing.assert_allclose(a.nu, b.nu, atol=1e-13)


def energies(model: Model, start: State, environment: Environment, dt: float, steps: int):
    """Kinetic, potential and lost to damping along a free run, RK4 in all of them."""

    def derivative(_, x):
        p, q, nu, lost = x
        R = rotation_from_quaternion(q)
        wet = 1.0
        if environment.surface is not None:
            wet = 1.0 - dryness(model, p[2], R[2], environment.surface) @ model.hull.shares
        nu_dot = acceleration(model, p, q, nu, jnp.zeros(6), environment)
        return R @ nu[:3], quaternion_rate(q, nu[3:]), nu_dot, wet * nu @ damping_wrench(model, nu)

    def step(x, _):
        p, q, nu, lost = rk4_step(derivative, x, dt)
        q = q / jnp.sqrt(q @ q)
        potential = potential_energy(model, p, q) + surface_energy(
            model, p[2], rotation_from_quaternion(q)[2], jnp.zeros(())
        )
        return (p, q, nu, lost), (kinetic_energy(model, nu), potential, lost)

    begin = (start.position, start.attitude, start.nu, jnp.zeros(()))
    return jax.lax.scan(step, begin, None, length=steps)[1]


def test_energy_at_the_surface():
    """Bobbing and rolling through the surface: kinetic + potential + lost is kept to 1e-6 of what moves about."""
    model = box()
    start = at(model, (0.0, 0.0, 0.5), (0.4, -0.3, 0.2), [0.3, 0.2, -0.5, 0.5, -0.4, 0.2])
    run = jax.jit(lambda: energies(model, start, Environment.calm(surface=SURFACE), 0.002, 10_000))
    kinetic, potential, lost = map(np.asarray, run())
    total = kinetic + potential + lost
    moved = kinetic.max() + np.ptp(potential) + lost[-1]
    assert np.ptp(potential) > 5.0 and lost[-1] > 5.0
    assert np.abs(total - total[0]).max() < 1e-6 * moved


def depths(model: Model, states: State) -> np.ndarray:
    """How far each corner is beyond each wall at all times [m], shape (t, m, k)."""
    R = jax.vmap(rotation_from_quaternion)(states.attitude)
    corners = np.asarray(states.position[:, None] + jnp.einsum("mi,tji->tmj", model.hull.corners, R))
    return corners @ np.asarray(TANK.normals).T - np.asarray(TANK.offsets)


PUSHES = {"ahead": (1, 0, 0), "astern": (-1, 0, 0), "starboard": (0, 1, 0), "down": (0, 0, 1), "askew": (1, 1, 1)}


@pytest.mark.system
@pytest.mark.parametrize("way", PUSHES)
def test_full_thrust_against_a_wall_for_a_minute(way):
    """It stays in the tank, comes to rest, and is never thrown back faster than it came."""
    model = load_vehicle("double_blueye").model()
    sign = jnp.asarray(PUSHES[way], dtype=float)
    wrench = jnp.concatenate([sign * jnp.array([20.0, 10.0, 22.0]), jnp.zeros(3)])
    start = at(model, (0.0, 0.0, 0.75), nu=np.concatenate([0.3 * sign, np.zeros(3)]))
    states = left_alone(model, start, Environment.calm(wrench=wrench, walls=TANK, surface=SURFACE))
    assert 0.0 < depths(model, states).max() < 0.02
    assert np.all(np.isfinite(states.nu)) and np.abs(states.nu[-1]).max() < 0.05
    assert np.abs(states.nu[:, :3]).max() < 0.8


@pytest.mark.system
def test_a_wall_gives_no_energy():
    """Thrown at floor and walls without drag: kinetic + potential never rises."""
    model = load_vehicle("double_blueye").model(net_buoyancy=-3.0)
    none = jnp.zeros((6, 6))
    model = model.replace(
        linear_damping_ahead=none,
        quadratic_damping_ahead=none,
        linear_damping_astern=none,
        quadratic_damping_astern=none,
    )
    start = at(model, (0.0, 0.0, 0.7), (0.2, 0.1, 0.5), [0.5, 0.3, 0.2, 0.1, 0.2, 0.4])
    states = left_alone(model, start, Environment.calm(walls=TANK))
    kinetic = jax.vmap(kinetic_energy, (None, 0))(model, states.nu)
    potential = jax.vmap(potential_energy, (None, 0, 0))(model, states.position, states.attitude)
    deep = np.maximum(depths(model, states), 0.0)
    stored = 0.5 * 30.0 * CONTACT_RATE**2 * np.sum(deep**2, axis=(1, 2))  # in the springs, to be given back or not
    total = np.asarray(kinetic + potential) + stored
    assert np.any(stored > 0.01) and total[-1] < total[0] - 1.0
    assert np.diff(total).max() < 1e-6 * np.ptp(total)
