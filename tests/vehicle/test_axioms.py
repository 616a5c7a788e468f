"""What mechanics demands of any vehicle: no energy from nowhere, no preferred place, heading, side or moving frame."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from tests import oracle
from tests.vehicle.random_vehicles import (
    THRUSTERS,
    random_thrusters,
    rotations,
    seeds,
    states,
    vectors,
    vehicles,
    velocities,
)

from rovtwin.core.arrays.integrate import rk4_step
from rovtwin.core.flow import Command, Environment
from rovtwin.core.frames import (
    quaternion_from_euler,
    quaternion_multiply,
    quaternion_rate,
    rotation_from_quaternion,
)
from rovtwin.core.numerics import jax, jnp
from rovtwin.vehicle.physics import dynamics
from rovtwin.vehicle.physics.dynamics import State, acceleration, coriolis_wrench, damping_wrench, rollout
from rovtwin.vehicle.physics.model import Model

DT = 0.002
STEPS = 500

MIRROR = np.array([1.0, -1.0, 1.0])  # of positions, forces and directions; moments and rates turn the other way
MIRROR_NU = np.concatenate([MIRROR, -MIRROR])

coriolis = jax.jit(coriolis_wrench)
damp = jax.jit(damping_wrench)
accelerate = jax.jit(acceleration)
rotate = jax.jit(rotation_from_quaternion)
multiply = jax.jit(quaternion_multiply)


@jax.jit
def fly(model: Model, state: State, u, environment: Environment) -> State:
    """One second; u of shape (THRUSTERS,) is held, the environment has a leading axis STEPS."""
    return rollout(model, state, Command(jnp.broadcast_to(u, (STEPS, THRUSTERS))), environment, DT)


def water(velocity, rate=np.zeros(3), gradient=np.zeros((3, 3))) -> Environment:
    """A field of water, velocity + t rate + gradient x, step by step."""
    at = np.asarray(velocity) + DT * np.arange(STEPS)[:, None] * np.asarray(rate)
    return Environment.calm(velocity=jnp.asarray(at), rate=jnp.asarray(rate), gradient=jnp.asarray(gradient))


STILL = water(np.zeros(3))


def commands(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, THRUSTERS)


def same_motion(a: State, b: State, atol: float) -> None:
    """The same body motion: nu and thrust."""
    np.testing.assert_allclose(a.nu, b.nu, atol=atol, rtol=0)
    np.testing.assert_allclose(a.thrust, b.thrust, atol=atol, rtol=0)


def same_attitude(a, b, atol: float) -> None:
    """As rotations: q and -q are the same."""
    np.testing.assert_allclose(np.abs(np.sum(np.asarray(a) * np.asarray(b), axis=-1)), 1.0, atol=atol, rtol=0)


# -- matrices


@given(vehicles(), seeds, velocities)
def test_coriolis_does_no_work(model, seed, nu):
    """nu . C(nu) nu = 0 for the vehicle and for any symmetric matrix."""
    a = np.random.default_rng(seed).normal(size=(6, 6))
    for M in (model.rigid_body_mass, model.added_mass, model.inertia, jnp.asarray(a @ a.T)):
        force = np.asarray(coriolis(M, nu))
        assert abs(nu @ force) <= 1e-13 * (1 + np.abs(nu) @ np.abs(force))


@given(vehicles(), velocities)
def test_coriolis_is_the_textbooks(model, nu):
    """Momentum and cross products give C(nu) nu of the explicit matrices; those are skew-symmetric."""
    plant = oracle.plant_of(model)
    C_RB = oracle.rigid_body_coriolis(plant.m, plant.I_b, plant.r_g, nu)
    C_A = oracle.added_mass_coriolis(plant.M_A, nu)
    scale = np.abs(np.asarray(model.inertia)).max()
    for C, M in ((C_RB, model.rigid_body_mass), (C_A, model.added_mass)):
        np.testing.assert_allclose(C, -C.T, atol=1e-12 * scale)
        np.testing.assert_allclose(coriolis(M, nu), C @ nu, atol=1e-12 * scale)


@given(vehicles())
def test_inertia_is_positive_definite(model):
    for M in (model.rigid_body_mass, model.added_mass, model.inertia):
        np.testing.assert_allclose(M, np.asarray(M).T, atol=1e-12 * float(jnp.abs(M).max()))
        assert np.linalg.eigvalsh(M).min() > 0
    np.testing.assert_allclose(model.inertia @ model.inertia_inverse, np.eye(6), atol=1e-9)


@given(vehicles(), velocities)
def test_damping_never_adds_energy(model, nu_r):
    assert nu_r @ np.asarray(damp(model, nu_r)) >= 0
    for one in np.eye(6):  # the smallest motion in one direction
        assert 1e-6 * one @ np.asarray(damp(model, -1e-6 * one)) < 0


@given(vehicles(), velocities)
def test_damping_is_the_textbooks(model, nu_r):
    np.testing.assert_allclose(damp(model, nu_r), oracle.damping(oracle.plant_of(model), nu_r), rtol=1e-12, atol=1e-12)


# -- one instant against the oracle


@given(vehicles(), velocities, seeds, vectors, vectors)
def test_acceleration_is_the_oracles(model, nu, seed, v_c, a_f):
    """Rigid body in the velocity over ground (oracle) and in nu_r (plant) agree, also in unsteady water."""
    rng = np.random.default_rng(seed)
    euler = rng.uniform(-1, 1, 3) * np.array([3.0, 1.3, 3.0])
    tau, gradient = rng.uniform(-20, 20, 6), rng.uniform(-1, 1, (3, 3))
    place, position, elapsed = rng.normal(size=3), rng.normal(size=3), 0.001
    rate = a_f - gradient @ v_c  # a particle that passes here speeds up by a_f
    there = v_c - elapsed * rate - gradient @ (position - place)
    fields = {"velocity": there, "rate": rate, "wrench": 0.5 * tau, "place": place, "gradient": gradient}
    environment = Environment.calm(**{name: jnp.asarray(value) for name, value in fields.items()})
    attitude = quaternion_from_euler(jnp.asarray(euler))
    found = accelerate(model, position, attitude, nu, 0.5 * tau, environment, elapsed)
    expected = oracle.acceleration(
        oracle.plant_of(model), np.concatenate([position, euler]), nu, tau, v_c, a_f, gradient
    )
    np.testing.assert_allclose(found, expected, atol=1e-9 * (1 + np.abs(expected).max()), rtol=0)


# -- energy


@jax.jit
def free_run(model: Model, state: State):
    """Energy kinetic, potential and lost to damping along a run without thrust in still water, RK4 in all of them."""
    dt = 0.0005

    def derivative(_, x):
        position, q, nu, lost = x
        nu_dot = acceleration(model, position, q, nu, jnp.zeros(6), Environment.calm())
        power = nu @ damping_wrench(model, nu)
        return rotation_from_quaternion(q) @ nu[:3], quaternion_rate(q, nu[3:]), nu_dot, power

    def step(x, _):
        x = rk4_step(derivative, x, dt)
        position, q, nu, lost = x
        q = q / jnp.sqrt(q @ q)
        return (position, q, nu, lost), (
            dynamics.kinetic_energy(model, nu),
            dynamics.potential_energy(model, position, q),
            lost,
        )

    begin = (state.position, state.attitude, state.nu, jnp.zeros(()))
    return jax.lax.scan(step, begin, None, length=4000)[1]


@pytest.mark.system
@given(vehicles(), states)
def test_energy_balance_of_a_free_run(model, state):
    """Kinetic + potential + lost energy stays what it was, to 1e-8 of the energy that moves about, over 2 s."""
    kinetic, potential, lost = map(np.asarray, free_run(model, state))
    total = kinetic + potential + lost
    moved = kinetic.max() + np.ptp(potential) + lost[-1]
    assert lost[-1] > 0.01 * kinetic[0]  # the balance is not empty
    assert np.abs(total - total[0]).max() < 1e-8 * moved


@pytest.mark.system
@given(vehicles(drag=False, neutral=True, centred=True), states)
def test_free_body_keeps_its_momentum(model, state):
    """Without drag and restoring the momentum of body and water, seen in n, stays; so does the energy."""
    states = fly(model, state, np.zeros(THRUSTERS), STILL)
    before, after = (
        (model.inertia @ nu, rotate(q)) for q, nu in ((state.attitude, state.nu), (states.attitude[-1], states.nu[-1]))
    )
    np.testing.assert_allclose(after[1] @ after[0][:3], before[1] @ before[0][:3], rtol=1e-8, atol=1e-8)
    energy = 0.5 * np.einsum("ti,ij,tj->t", states.nu, model.inertia, states.nu)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-8)


# -- symmetries


@given(vehicles(), states, vectors, vectors, st.floats(-3.1, 3.1), seeds)
def test_heading_of_the_world_does_not_matter(model, state, v_c, a_f, angle, seed):
    """Turn the world about the vertical, water and all: the body moves the same, the path turns with it."""
    turn = quaternion_from_euler(jnp.array([0.0, 0.0, angle]))
    R = np.asarray(rotate(turn))
    turned = State(R @ state.position, multiply(turn, state.attitude), state.nu, state.thrust)
    u = commands(seed)
    G = np.random.default_rng(seed).uniform(-0.2, 0.2, (3, 3))
    a = fly(model, state, u, water(v_c, a_f, G))
    b = fly(model, turned, u, water(R @ v_c, R @ a_f, R @ G @ R.T))
    same_motion(a, b, 1e-9)
    np.testing.assert_allclose(b.position, np.asarray(a.position) @ R.T, atol=1e-9)
    same_attitude(b.attitude, jax.vmap(multiply, (None, 0))(turn, a.attitude), 1e-9)


@given(vehicles(neutral=True, centred=True), states, vectors, vectors, rotations, seeds)
def test_up_does_not_matter_to_a_neutral_body(model, state, v_c, a_f, turn, seed):
    """W = B and CG = CB: gravity is not felt, any rotation of the world leaves the motion."""
    R = np.asarray(rotate(turn))
    turned = State(R @ state.position, multiply(turn, state.attitude), state.nu, state.thrust)
    u = commands(seed)
    a, b = fly(model, state, u, water(v_c, a_f)), fly(model, turned, u, water(R @ v_c, R @ a_f))
    same_motion(a, b, 1e-9)
    np.testing.assert_allclose(b.position, np.asarray(a.position) @ R.T, atol=1e-9)


@given(vehicles(), states, vectors, vectors, seeds)
def test_place_does_not_matter(model, state, v_c, offset, seed):
    moved = State(state.position + 100 * offset, state.attitude, state.nu, state.thrust)
    a, b = (fly(model, x, commands(seed), water(v_c)) for x in (state, moved))
    same_motion(a, b, 1e-12)
    np.testing.assert_allclose(b.position - a.position, np.broadcast_to(100 * offset, (STEPS, 3)), atol=1e-11)


@given(vehicles(), states, vectors, seeds)
def test_steady_current_only_carries(model, state, v_c, seed):
    """Galileo: seen from water in steady motion all is as in still water, for any vehicle, thrusters running."""
    u = commands(seed)
    R = np.asarray(rotate(state.attitude))
    carried = State(state.position, state.attitude, state.nu.at[:3].add(R.T @ v_c), state.thrust)
    still, moving = fly(model, state, u, STILL), fly(model, carried, u, water(v_c))
    t = DT * np.arange(1, STEPS + 1)[:, None]
    # The two integrate different quantities (nu_r, nu), so they agree as well as RK4 does.
    np.testing.assert_allclose(moving.position, still.position + t * v_c, atol=1e-7)
    same_attitude(moving.attitude, still.attitude, 1e-9)
    np.testing.assert_allclose(moving.nu[:, 3:], still.nu[:, 3:], atol=1e-7)


@given(vehicles(drag=False, neutral=True, centred=True), rotations, vectors, vectors, seeds)
def test_accelerating_water_carries_a_neutral_body(model, attitude, v_c, a_f, seed):
    """A body that displaces its own mass is fluid to the fluid: starting with the water it stays with it exactly."""
    position = np.random.default_rng(seed).uniform(-5, 5, 3)
    R = np.asarray(rotate(attitude))
    nu = np.concatenate([R.T @ v_c, np.zeros(3)])
    state = State(jnp.asarray(position), jnp.asarray(attitude), jnp.asarray(nu), jnp.zeros(THRUSTERS))
    states = fly(model, state, np.zeros(THRUSTERS), water(v_c, a_f))
    t = DT * np.arange(1, STEPS + 1)[:, None]
    np.testing.assert_allclose(states.position, position + t * v_c + t**2 / 2 * a_f, atol=1e-10)
    np.testing.assert_allclose(states.nu[:, :3], (v_c + t * a_f) @ R, atol=1e-10)
    np.testing.assert_allclose(states.nu[:, 3:], 0, atol=1e-10)


@given(vehicles(drag=False, neutral=True, centred=True), rotations, vectors, seeds)
def test_strained_water_carries_a_neutral_body(model, attitude, v_c, seed):
    """The same where the water's velocity differs from place to place: x_dot = v_c + G x, in closed form."""
    rng = np.random.default_rng(seed)
    position, G = rng.uniform(-1, 1, 3), rng.uniform(-0.5, 0.5, (3, 3))
    R = np.asarray(rotate(attitude))
    nu = np.concatenate([R.T @ (v_c + G @ position), np.zeros(3)])
    state = State(jnp.asarray(position), jnp.asarray(attitude), jnp.asarray(nu), jnp.zeros(THRUSTERS))
    states = fly(model, state, np.zeros(THRUSTERS), water(v_c, gradient=G))
    field = np.block([[G, v_c[:, None]], [np.zeros((1, 4))]])
    expected = (expm(DT * STEPS * field) @ np.append(position, 1.0))[:3]
    np.testing.assert_allclose(states.position[-1], expected, atol=1e-9)


@given(vehicles(neutral=True, centred=True), rotations, vectors, seeds)
def test_drag_does_not_stop_a_body_that_moves_with_the_water(model, attitude, v_c, seed):
    R = np.asarray(rotate(attitude))
    nu = np.concatenate([R.T @ v_c, np.zeros(3)])
    state = State(jnp.zeros(3), jnp.asarray(attitude), jnp.asarray(nu), jnp.zeros(THRUSTERS))
    states = fly(model, state, np.zeros(THRUSTERS), water(v_c))
    np.testing.assert_allclose(states.nu, np.broadcast_to(nu, (STEPS, 6)), atol=1e-10)


def test_yawing_body_is_carried_straight():
    """Spinning in a current a sphere is carried straight; without d(nu_c)/dt = -S(omega) nu_c it would spiral."""
    m, I, m_a = 10.0, 0.2, 5.0
    model = Model(
        rigid_body_mass=np.diag([m, m, m, I, I, I]),
        added_mass=np.diag([m_a, m_a, m_a, 0.1, 0.1, 0.1]),
        linear_damping_ahead=np.zeros((6, 6)),
        quadratic_damping_ahead=np.zeros((6, 6)),
        weight=m * 9.81,
        buoyancy=m * 9.81,
        center_of_gravity=np.zeros(3),
        center_of_buoyancy=np.zeros(3),
        thrusters=random_thrusters(np.random.default_rng(1), 6, 5.0),
    )
    v_c = np.array([0.3, -0.2, 0.1])
    nu = jnp.asarray([*v_c, 0.0, 0.0, 2.0])
    state = State(jnp.zeros(3), jnp.array([1.0, 0, 0, 0]), nu, jnp.zeros(THRUSTERS))
    states = fly(model, state, np.zeros(THRUSTERS), water(v_c))
    t = DT * np.arange(1, STEPS + 1)[:, None]
    np.testing.assert_allclose(states.position, t * v_c, atol=1e-10)


# -- port and starboard


def mirrored(model: Model) -> Model:
    """The vehicle seen in a mirror at the xz plane: forces and motions along y, about x and about z change sign."""
    P = np.diag(MIRROR_NU)
    flips = MIRROR_NU < 0  # ahead becomes astern in these columns

    def swap(a, b):
        return P @ np.where(flips, np.asarray(b), np.asarray(a)) @ P

    linear = model.linear_damping_ahead, model.linear_damping_astern
    quadratic = model.quadratic_damping_ahead, model.quadratic_damping_astern
    thrusters = model.thrusters
    return model.replace(
        rigid_body_mass=P @ model.rigid_body_mass @ P,
        added_mass=P @ model.added_mass @ P,
        linear_damping_ahead=swap(*linear),
        linear_damping_astern=swap(*linear[::-1]),
        # |nu| nu turns with nu, so a quadratic matrix transforms like a linear one.
        quadratic_damping_ahead=swap(*quadratic),
        quadratic_damping_astern=swap(*quadratic[::-1]),
        center_of_gravity=MIRROR * model.center_of_gravity,
        center_of_buoyancy=MIRROR * model.center_of_buoyancy,
        thrusters=type(thrusters)(
            **{**vars(thrusters), "configuration": P @ thrusters.configuration},
        ),
    )


def mirror_state(state: State) -> State:
    # R -> diag(MIRROR) R diag(MIRROR): of the rotation's axis the y part stays.
    q = state.attitude * np.array([1.0, -1.0, 1.0, -1.0])
    return State(MIRROR * state.position, q, MIRROR_NU * state.nu, state.thrust)


@given(vehicles(), states, vectors, vectors, seeds)
def test_mirrored_vehicle_moves_mirrored(model, state, v_c, a_f, seed):
    u = commands(seed)
    a = fly(model, state, u, water(v_c, a_f))
    b = fly(mirrored(model), mirror_state(state), u, water(MIRROR * v_c, MIRROR * a_f))
    np.testing.assert_allclose(b.nu, a.nu * MIRROR_NU, atol=1e-9)
    np.testing.assert_allclose(b.position, a.position * MIRROR, atol=1e-9)


@pytest.mark.system
@given(vehicles(), st.floats(-1.2, 1.2), seeds)
def test_symmetric_vehicle_keeps_to_its_plane(model, pitch, seed):
    """Alike to port and starboard, pushed in its plane of symmetry, a vehicle neither sways, rolls nor yaws."""
    other = mirrored(model)
    model = jax.tree.map(lambda a, b: (a + b) / 2 if a.dtype == float else a, model, other)
    model = model.replace()  # derived arrays from the averaged ones
    rng = np.random.default_rng(seed)
    nu = rng.uniform(-1, 1, 6) * (MIRROR_NU > 0)
    q = quaternion_from_euler(jnp.array([0.0, pitch, 0.0]))
    state = State(jnp.zeros(3), q, jnp.asarray(nu), jnp.zeros(THRUSTERS))
    states = fly(model, state, commands(seed), water(np.array([0.3, 0.0, -0.1])))
    assert np.abs(states.nu[:, MIRROR_NU < 0]).max() < 1e-10
    assert np.abs(states.position[:, 1]).max() < 1e-10
    assert np.ptp(np.asarray(states.nu[:, 4])) > 1e-6  # while it does pitch
