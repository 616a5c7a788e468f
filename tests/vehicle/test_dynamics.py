"""The step and the roll-out: against the oracle with thrusters and current, batched, differentiated, refined."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from tests import oracle
from tests.vehicle.random_vehicles import THRUSTERS, build, random_state, rotations, seeds, vehicles, velocities

from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Environment
from rovtwin.core.frames import euler_from_quaternion, quaternion_from_euler, rotation_from_quaternion
from rovtwin.core.numerics import jax, jnp
from rovtwin.vehicle.description.vehicle import load_vehicle
from rovtwin.vehicle.physics.dynamics import (
    State,
    kinetic_energy,
    plant_step,
    potential_energy,
    restoring_wrench,
    rollout,
)
from rovtwin.vehicle.physics.model import GRAVITY, Model, rigid_body_matrix

DT = 0.002


def in_current(velocity) -> Environment:
    return Environment.calm(velocity=jnp.asarray(velocity))


@jax.jit
def fly(model: Model, state: State, u, current) -> State:
    """u of shape (n_steps, THRUSTERS)."""
    return rollout(model, state, Command(u), in_current(current), DT)


def random_commands(seed: int, steps: int, every: int = 50) -> np.ndarray:
    """Steps that change now and then, so that lags never settle."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-1, 1, (steps // every, THRUSTERS)), every, axis=0)


def level_state(seed: int) -> State:
    """Away from theta = 90 degrees, where the oracle's Euler angles end."""
    rng = np.random.default_rng(seed)
    euler = rng.uniform(-0.4, 0.4, 3)
    return dataclasses.replace(random_state(seed), attitude=quaternion_from_euler(jnp.asarray(euler)))


@pytest.mark.system
@settings(max_examples=8)
@given(vehicles(), seeds)
def test_step_is_the_oracles(model, seed):
    """0.4 s with thrusters that lag or jump, dead bands and power laws, in a current: two integrations, 1e-7 apart."""
    state, u = level_state(seed), random_commands(seed, 200)
    v_c = np.random.default_rng(seed).uniform(-0.3, 0.3, 3)
    found = fly(model, state, u, v_c)

    plant = oracle.plant_of(model)
    x = np.concatenate([state.position, euler_from_quaternion(state.attitude), state.nu])
    thrust = np.zeros(THRUSTERS)
    for k in range(len(u)):
        x, thrust = oracle.step(plant, x, thrust, u[k], DT, v_c)
        np.testing.assert_allclose(found.thrust[k], thrust, atol=1e-10)
    np.testing.assert_allclose(found.position[-1], x[:3], atol=1e-7)
    np.testing.assert_allclose(rotation_from_quaternion(found.attitude[-1]), oracle.rotation(*x[3:6]), atol=1e-7)
    np.testing.assert_allclose(found.nu[-1], x[6:], atol=1e-7)


@pytest.mark.system
def test_rollout_is_steps_in_a_row():
    model, state = build(1), random_state(2)
    u = random_commands(3, 50, 5)
    rng = np.random.default_rng(4)
    shapes = {"velocity": (3,), "rate": (3,), "wrench": (6,), "place": (3,), "gradient": (3, 3), "surface": ()}
    fields = {name: jnp.asarray(rng.normal(size=(50, *shape))) for name, shape in shapes.items()}
    environment = Environment.calm(**fields)
    together = jax.jit(lambda *a: rollout(*a, DT))(model, state, Command(jnp.asarray(u)), environment)
    step = jax.jit(lambda *a: plant_step(*a, DT))
    for k in range(50):
        state = step(model, state, Command(u[k]), jax.tree.map(lambda leaf, k=k: leaf[k], environment))
    for a, b in zip(
        jax.tree.leaves(jax.tree.map(lambda leaf: leaf[-1], together)), jax.tree.leaves(state), strict=True
    ):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)


@pytest.mark.system
def test_batch_equals_singles():
    """Different vehicles, starts, commands and currents under vmap, to 1e-12."""
    count, steps = 5, 500
    models, starts = [build(seed) for seed in range(count)], [random_state(10 + seed) for seed in range(count)]
    u = np.stack([random_commands(20 + seed, steps) for seed in range(count)])
    currents = np.random.default_rng(30).uniform(-0.3, 0.3, (count, 3))

    def stack(trees):
        return jax.tree.map(lambda *leaves: jnp.stack(leaves), *trees)

    batch = jax.jit(jax.vmap(fly))(stack(models), stack(starts), u, currents)
    singles = stack([fly(*each) for each in zip(models, starts, u, currents, strict=True)])
    for a, b in zip(jax.tree.leaves(batch), jax.tree.leaves(singles), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12)


def smooth_vehicle() -> Model:
    """Linear damping alike ahead and astern: nothing in the way of the integration's order."""
    model = build(7, astern=False)
    return model.replace(quadratic_damping_ahead=np.zeros((6, 6)), quadratic_damping_astern=np.zeros((6, 6)))


@pytest.mark.system
def test_fourth_order():
    """Half the step, a sixteenth of the error; also with lagging thrusters, because the lag is exact at the stages."""
    model, state = smooth_vehicle(), random_state(8)
    lagging = dataclasses.replace(model.thrusters, time_constant=jnp.full(THRUSTERS, 0.2))
    model = model.replace(thrusters=lagging)
    u = np.random.default_rng(9).uniform(-1, 1, THRUSTERS)
    v_c = jnp.array([0.2, -0.3, 0.1])

    def end(steps: int) -> np.ndarray:
        commands = Command(jnp.broadcast_to(u, (steps, THRUSTERS)))
        run = jax.jit(lambda m, s, c, v: rollout(m, s, c, in_current(v), 2.0 / steps))
        last = jax.tree.map(lambda leaf: leaf[-1], run(model, state, commands, v_c))
        return np.concatenate([last.position, last.attitude, last.nu])

    best = end(1600)
    errors = [np.abs(end(steps) - best).max() for steps in (25, 50, 100)]
    orders = np.log2(errors[:-1] / np.array(errors[1:]))
    assert errors[-1] > 1e-12  # above rounding, or the order says nothing
    assert (np.abs(orders - 4) < 0.4).all(), orders


@pytest.mark.slow
def test_gradient_of_a_rollout_is_that_of_differences():
    """With respect to every number of the vehicle, the start, the commands and the current at once."""
    model, state, v_c = build(11), random_state(12), jnp.array([0.1, -0.2, 0.05])
    u = jnp.asarray(random_commands(13, 100))
    names = [name for name in vars(model) if name not in ("inertia", "inertia_inverse", "damping", "thrusters")]
    parameters = {name: getattr(model, name) for name in names}
    force = model.thrusters.force_ahead, model.thrusters.force_astern, model.thrusters.time_constant
    target = jnp.asarray(np.random.default_rng(14).normal(size=13))

    @jax.jit
    def cost(x):
        parameters, force, state, u, v_c = x
        ahead, astern, constant = force
        thrusters = dataclasses.replace(model.thrusters, force_ahead=ahead, force_astern=astern, time_constant=constant)
        states = fly(Model(**parameters, thrusters=thrusters), state, u, v_c)
        path = jnp.concatenate([states.position, states.attitude, states.nu], axis=1)
        return jnp.mean((path - target) ** 2)

    x = (parameters, force, state, u, v_c)
    gradient = jax.jit(jax.grad(cost))(x)
    leaves, tree = jax.tree.flatten(x)
    slopes = jax.tree.leaves(gradient)
    assert all(np.isfinite(s).all() for s in slopes)
    for i, (leaf, slope) in enumerate(zip(leaves, slopes, strict=True)):
        # Along a random direction of this array, scaled to its size; zeros (no lag, no thruster) stay what they are.
        direction = np.random.default_rng(i).normal(size=leaf.shape) * np.abs(leaf)
        if not direction.any():
            continue
        h = 1e-6

        def at(step, i=i, leaf=leaf, direction=direction):
            return cost(jax.tree.unflatten(tree, leaves[:i] + [leaf + step * direction] + leaves[i + 1 :]))

        difference = (at(h) - at(-h)) / (2 * h)
        assert np.sum(slope * direction) == pytest.approx(float(difference), rel=1e-5, abs=1e-8)


@given(vehicles(), rotations, velocities)
def test_restoring_is_the_slope_of_the_potential(model, q, nu):
    """Power of g is the rate of the potential energy: -dE/dt = -g . nu along any motion."""
    R = rotation_from_quaternion(jnp.asarray(q))
    omega = np.asarray(nu[3:])
    h = 1e-6
    turn = np.concatenate([[1.0], 0.5 * h * omega])  # first order in h
    back = turn * np.array([1, -1, -1, -1])

    def energy(sign, turn):
        w, v = q[0], q[1:]
        after = np.concatenate([[w * turn[0] - v @ turn[1:]], w * turn[1:] + turn[0] * v + np.cross(v, turn[1:])])
        after /= np.linalg.norm(after)
        return potential_energy(model, jnp.asarray(sign * h * (R @ nu[:3])), jnp.asarray(after))

    rate = (energy(1, turn) - energy(-1, back)) / (2 * h)
    power = np.asarray(restoring_wrench(model, R[2])) @ nu
    assert power == pytest.approx(float(rate), abs=1e-5 * float(model.weight))


@given(vehicles(), velocities)
def test_kinetic_energy_is_positive(model, nu):
    assert kinetic_energy(model, nu) > 0


def test_attitude_stays_a_unit_quaternion():
    """Also when it starts as none, after rounding or out of a file."""
    model, state = build(5), random_state(6)
    long = dataclasses.replace(state, attitude=1.001 * state.attitude)
    for start in (state, long):
        attitude = fly(model, start, random_commands(1, 500), jnp.zeros(3)).attitude
        np.testing.assert_allclose(np.linalg.norm(attitude, axis=1), 1.0, atol=1e-14)


def test_heavy_body_sinks_to_terminal_speed():
    """Worked by hand: (W - B) = d1 w + d2 w |w|."""
    d1, d2 = 12.0, 80.0
    W, B = 20 * GRAVITY + 5.0, 20 * GRAVITY
    model = Model(
        rigid_body_mass=rigid_body_matrix(20.0, np.diag([1.0, 1, 1]), [0, 0, 0.02]),
        added_mass=np.diag([10.0, 20, 30, 1, 1, 1]),
        linear_damping_ahead=np.diag([d1] * 6),
        quadratic_damping_ahead=np.diag([d2] * 6),
        weight=W,
        buoyancy=B,
        center_of_gravity=[0, 0, 0.02],
        center_of_buoyancy=[0, 0, 0],
        thrusters=build(1).thrusters,
    )
    states = fly(model, State.at(model, Start.at()), np.zeros((10000, THRUSTERS)), jnp.zeros(3))
    terminal = (-d1 + np.sqrt(d1**2 + 4 * d2 * (W - B))) / (2 * d2)
    np.testing.assert_allclose(states.nu[-1], [0, 0, terminal, 0, 0, 0], atol=1e-9)


def test_start():
    model = build(1)
    state = State.at(model, Start.at((1, 2, 3), heading=np.pi / 2))
    np.testing.assert_allclose(euler_from_quaternion(state.attitude), [0, 0, np.pi / 2], atol=1e-15)
    np.testing.assert_allclose(state.position, [1, 2, 3])
    assert not state.nu.any() and not state.thrust.any() and state.thrust.shape == (THRUSTERS,)


def test_replace_makes_derived_arrays_anew():
    model = build(1)
    heavier = model.replace(added_mass=2 * model.added_mass)
    np.testing.assert_allclose(heavier.inertia, model.rigid_body_mass + 2 * model.added_mass)
    np.testing.assert_allclose(heavier.inertia @ heavier.inertia_inverse, np.eye(6), atol=1e-9)
    with pytest.raises(TypeError, match="no parameter"):
        model.replace(mass=1.0)


@given(seeds)
def test_rigid_body_matrix_is_the_textbooks(seed):
    """Kinetic energy of point masses: 1/2 nu' M_RB nu = sum 1/2 m |v + omega x r|^2."""
    rng = np.random.default_rng(seed)
    m, r, nu = rng.uniform(0.1, 2, 9), rng.normal(size=(9, 3)), rng.normal(size=6)
    cg = m @ r / m.sum()
    arm = r - cg
    inertia = sum(mi * (a @ a * np.eye(3) - np.outer(a, a)) for mi, a in zip(m, arm, strict=True))
    M = rigid_body_matrix(m.sum(), inertia, cg)
    speed2 = np.sum((nu[:3] + np.cross(nu[3:], r)) ** 2, axis=1)
    assert nu @ np.asarray(M) @ nu == pytest.approx(m @ speed2)


@pytest.mark.system
@pytest.mark.parametrize("around", [{}, {"surface": jnp.zeros(())}, {"gradient": jnp.eye(3) * 0.01}])
def test_single_precision_stays_single_where_a_batch_asks_for_it(around):
    """A graphics processor is many times as fast in float32: nothing on the way may fall back to float64."""
    model = load_vehicle("double_blueye").model()
    water = Environment.calm(velocity=jnp.array([0.2, 0.0, 0.0]), **around)
    start = State.at(model, Start.at((0.0, 0.0, 1.0)))
    double = (model, start, Command(jnp.full(model.thrusters.count, 0.3)), water)
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32) if leaf.dtype == float else leaf, double)
    after, expected = plant_step(*single, 0.01), plant_step(*double, 0.01)
    for one, other in zip(jax.tree.leaves(after), jax.tree.leaves(expected), strict=True):
        assert one.dtype == jnp.float32
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-6)
