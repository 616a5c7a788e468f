"""The allocator with priorities against proxsuite, its limits, lost thrusters, and what is attainable."""

import equinox as eqx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from tests.gnc.flying import ARM, thirty_kg, two_bodies
from tests.gnc.test_allocation import VECTORED, any_thrusters, made

from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.allocation.attainable_wrench import attainable, lost_axes, remaining
from rovtwin.gnc.allocation.box_least_squares import MOST_STEPS, box_least_squares, unbounded
from rovtwin.gnc.allocation.prioritised import DAMPING, AllocationMemory, PriorityAllocation
from rovtwin.gnc.interfaces import AllocationInput
from rovtwin.gnc.scales import VehicleScales
from rovtwin.vehicle import list_library, load_vehicle
from rovtwin.vehicle.constants import AXES
from rovtwin.vehicle.physics.actuation import pushed_axes
from rovtwin.vehicle.physics.thrusters import force_limits, thrusters_from

proxsuite = pytest.importorskip("proxsuite")

DT = 0.02
SOUND = jnp.ones(6)
seeds = st.integers(0, 2**32 - 1)
solve = jax.jit(lambda *problem: (box_least_squares(*problem), unbounded(*problem)[1]))
step = jax.jit(lambda block, memory, input: block.step(memory, input, DT))
largest_factor = jax.jit(attainable)


def oracle(A, b, lower, upper, preferred, damping):
    n = A.shape[1]
    problem = proxsuite.proxqp.dense.QP(n, 0, 0, True)
    problem.settings.eps_abs, problem.settings.eps_rel, problem.settings.max_iter = 1e-11, 0.0, 10_000
    H, g = A.T @ A + damping * np.eye(n), -A.T @ b - damping * preferred
    problem.init(H, g, None, None, None, None, None, lower, upper)
    problem.solve()
    return problem.results.x.copy()


def step_from_rest(block, tau, health=None):
    n = block.thrusters.count
    health = jnp.ones(n) if health is None else jnp.asarray(health, dtype=float)
    return step(block, AllocationMemory(jnp.zeros(n), jnp.zeros(n)), AllocationInput(jnp.asarray(tau), health))[1]


def crippled(rng, T, lost=0.25):
    """T with one row or some columns lost, or columns that do the same: what makes it rank-deficient."""
    T = T.copy()
    T[rng.choice(6, rng.integers(0, 4), replace=False)] = 0.0
    if rng.random() < 0.5:
        T[:, 1] = T[:, 0]
    return T, np.where(rng.random(T.shape[1]) < lost, 0.0, rng.choice([0.5, 1.0], T.shape[1]))


@pytest.mark.system
@given(seeds, st.sampled_from([3, 8, 12]), st.sampled_from([1e-1, 1e-3]))
def test_minimum_within_bounds_is_the_oracles(seed, n, damping):
    rng = np.random.default_rng(seed)
    T, health = crippled(rng, rng.normal(size=(6, n)))
    A = T * health * np.array([1.0, 1, 10, 3, 3, 3])[:, None]
    lower, upper = -rng.uniform(0, 1, n), rng.uniform(0, 1, n)
    upper = np.where(rng.random(n) < 0.2, lower, upper)  # fixed
    b = A @ rng.normal(size=n) * rng.choice([0.1, 1.0, 10.0]) + rng.normal(size=6)
    problem = A, b, lower, upper, rng.normal(size=n), damping
    x, steps = solve(*map(jnp.asarray, problem))
    assert steps < MOST_STEPS
    assert np.all(x >= lower) and np.all(x <= upper)
    np.testing.assert_allclose(x, oracle(*problem), atol=1e-6)


@given(seeds)
def test_allocation_is_the_oracles(seed):
    """Random vehicles, wrenches far beyond and well within, thrusters lost and weak, T of any rank, some slow."""
    rng = np.random.default_rng(seed)
    T, thrusters = any_thrusters(seed, 8)
    T, health = crippled(rng, T)
    thrusters = eqx.tree_at(lambda t: t.configuration, thrusters, jnp.asarray(T))
    block = PriorityAllocation.of(thirty_kg(thrusters=thrusters), slew=rng.choice([np.inf, 50.0]), start=0, stop=0)
    low, high = (np.asarray(limit) for limit in force_limits(thrusters))
    last = rng.uniform(low, high)
    tau = T @ rng.uniform(low, high) * rng.choice([0.2, 1.0, 5.0]) + rng.choice([0.0, 10.0]) * rng.normal(size=6)
    memory = AllocationMemory(jnp.asarray(last), jnp.asarray(last))
    after, allocated = step(block, memory, AllocationInput(jnp.asarray(tau), jnp.asarray(health)))

    scale, weight = np.maximum(high, -low), np.asarray(block.weight)
    lower = np.where(health > 0, np.maximum(low, last - np.asarray(block.slew) * DT), 0.0) / scale
    upper = np.where(health > 0, np.minimum(high, last + np.asarray(block.slew) * DT), 0.0) / scale
    b = weight * np.clip(tau, block.least_wrench, block.greatest_wrench)
    problem = weight[:, None] * T * health * scale, b, lower, upper
    first = oracle(*problem, np.zeros(8), DAMPING)
    want = oracle(*problem, first, DAMPING) * scale
    np.testing.assert_allclose(T * health @ after.solved, T * health @ want, atol=1e-6 * scale.max())
    np.testing.assert_allclose(allocated.made, T * health @ after.sent, atol=1e-9)
    np.testing.assert_allclose(allocated.residual, tau - allocated.made, atol=1e-9)
    assert np.all(np.abs(allocated.command.u) <= 1 + 1e-12)


@given(seeds, st.sampled_from([VECTORED, two_bodies()]))
def test_reachable_wrench_is_made(seed, T):
    thrusters = thrusters_from(jnp.asarray(T), jnp.full(6, 10.0), jnp.full(6, 7.0))
    tau = T @ np.random.default_rng(seed).uniform(-6.9, 9.9, 6)
    allocated = step_from_rest(PriorityAllocation.of(thirty_kg(thrusters=thrusters), start=0, stop=0), tau)
    np.testing.assert_allclose(allocated.made, tau, atol=2e-5)
    np.testing.assert_allclose(made(thrusters, allocated.command), allocated.made, atol=1e-9)


def test_heading_goes_before_surge():
    block = PriorityAllocation.of(thirty_kg())
    allocated = step_from_rest(block, [20.0, 3.0, 0, 0, 0, 2.8])
    np.testing.assert_allclose(allocated.made, [10.0, 3.0, 0, 0, 0, 2.8], atol=0.03)
    np.testing.assert_array_equal(allocated.limited, [True, False, False, False, False, False])
    # The starboard thruster would give the last 0.03 N, but rests: that is no limit's doing.
    np.testing.assert_allclose(allocated.residual, allocated.shortfall, atol=0.04)


def test_depth_goes_before_roll_before_surge():
    # Heave rolls, and so does surge; what balances roll is enough for heave alone.
    T = np.eye(6)[:, [2, 0, 3]] + 0.2 * np.eye(6)[:, [3, 3, 0]] * [1.0, 1.0, 0.0]
    block = PriorityAllocation.of(thirty_kg(thrusters=thrusters_from(jnp.asarray(T), jnp.array([10.0, 10.0, 1.0]))))
    allocated = step_from_rest(block, [5.0, 0, 5.0, 0, 0, 0])
    np.testing.assert_allclose(allocated.made[2], 5.0, atol=0.05)
    np.testing.assert_allclose(allocated.made[3], 0.0, atol=0.035)  # 5 N m at most, 2 / 300 of it
    np.testing.assert_allclose(allocated.made[0], 0.0, atol=0.15)


def test_what_one_thruster_less_cannot_hold_is_no_axis():
    """Heave and surge both roll, and nothing balances it: roll is left to the righting moment."""
    T = np.eye(6)[:, [2, 0]] + 0.2 * np.eye(6)[:, [3, 3]]
    block = PriorityAllocation.of(thirty_kg(thrusters=thrusters_from(jnp.asarray(T), jnp.array([10.0, 10.0]))))
    allocated = step_from_rest(block, [5.0, 0, 5.0, 0, 0, 0])
    np.testing.assert_allclose(allocated.made, [5.0, 0, 5.0, 2.0, 0, 0], atol=0.03)
    np.testing.assert_allclose(allocated.shortfall, 0.0, atol=0.03)


def test_one_of_two_bodies_lost_without_compiling_again():
    block = PriorityAllocation.of(thirty_kg())
    step_from_rest(block, np.zeros(6))
    compiled = step._cache_size()
    allocated = step_from_rest(block, [10.0, 3.0, 5.0, 0, 0, 0], [1, 1, 1, 0, 0, 0])
    assert step._cache_size() == compiled
    np.testing.assert_array_equal(allocated.command.u[3:], 0.0)
    assert not np.any(allocated.limited[3:])
    np.testing.assert_allclose(
        np.asarray(allocated.made)[[0, 1, 2, 5]], [0.0, 3.0, 5.0, 0.0], atol=0.05
    )  # surge would turn it


def test_weak_thruster_is_asked_for_more():
    block = PriorityAllocation.of(thirty_kg())
    allocated = step_from_rest(block, [6.0, 0, 0, 0, 0, 0], [0.5, 1, 1, 1, 1, 1])
    np.testing.assert_allclose(np.asarray(allocated.made)[[0, 5]], [6.0, 0.0], atol=1e-5)
    np.testing.assert_allclose(np.asarray(allocated.command.u)[[0, 3]], [0.6, 0.3], atol=1e-5)


def test_force_moves_no_faster_than_its_rate():
    block = PriorityAllocation.of(thirty_kg(), slew=50.0)
    memory = block.init(jax.random.key(0), None)
    sent = []
    for k in range(20):
        expected = [20.0 if k < 12 else -20.0, 0, 0, 0, 0, 0]
        memory, allocated = step(block, memory, AllocationInput(jnp.array(expected), SOUND))
        sent.append(float(memory.solved[0]))
    assert np.max(np.abs(np.diff([0.0, *sent]))) <= 50.0 * DT + 1e-12
    np.testing.assert_allclose(sent[9], 10.0, atol=1e-3)
    assert allocated.limited[0]


def test_near_standstill_a_thruster_rests_and_does_not_chatter():
    block = PriorityAllocation.of(thirty_kg(), start=0.02, stop=0.01)
    memory, forces = block.init(jax.random.key(0), None), []
    for surge in [0.3, 0.5, 0.3, 0.15, 0.3, -0.3]:  # of 10 N each: 0.15, 0.25, 0.15, 0.075, 0.15, -0.15
        memory, allocated = step(block, memory, AllocationInput(jnp.array([surge, 0, 0, 0, 0, 0]), SOUND))
        forces.append(float(memory.sent[0]))
    np.testing.assert_allclose(forces, [0, 0.25, 0.15, 0, 0, 0], atol=1e-5)
    np.testing.assert_allclose(allocated.shortfall, 0.0, atol=1e-5)
    np.testing.assert_allclose(allocated.residual[0], -0.3, atol=1e-5)


def test_slow_thruster_gets_away_from_standstill():
    block = PriorityAllocation.of(thirty_kg(), slew=1.0, start=0.05, stop=0.01)
    memory = block.init(jax.random.key(0), None)
    for _ in range(60):
        memory, allocated = step(block, memory, AllocationInput(jnp.array([2.0, 0, 0, 0, 0, 0]), SOUND))
    np.testing.assert_allclose(allocated.made[0], 2.0, atol=1e-5)


@pytest.mark.system
@settings(max_examples=10)
@given(seeds)
def test_gradient_is_that_of_the_minimum(seed):
    _, thrusters = any_thrusters(seed, 8)
    block = PriorityAllocation.of(thirty_kg(thrusters=thrusters), start=0, stop=0)
    rng = np.random.default_rng(seed)
    tau, way = rng.normal(0, 15, (2, 6))
    away = jnp.asarray(way)

    def along(s):
        return step_from_rest(block, jnp.asarray(tau) + s * away).made

    slope = jax.jacfwd(along)(0.0)
    h = 1e-6
    ends = along(h), along(0.0), along(-h)
    one_sided = [(ends[0] - ends[1]) / h, (ends[1] - ends[2]) / h]
    if np.allclose(*one_sided, atol=1e-3):  # not at a kink
        np.testing.assert_allclose(slope, one_sided[0], atol=2e-3)
    assert np.all(np.isfinite(jax.jacrev(lambda t: step_from_rest(block, t).made)(jnp.asarray(tau))))


@given(seeds)
def test_largest_factor_is_the_linear_programmes(seed):
    rng = np.random.default_rng(seed)
    T, thrusters = any_thrusters(seed, 8)
    low, high = (np.asarray(limit) for limit in force_limits(thrusters))
    health, held = rng.choice([0.0, 0.5, 1.0, 1.0], 8), rng.random(6) < 0.6
    direction = held * (T * health @ rng.normal(size=8) if seed % 2 else rng.normal(size=6))
    spent = held * (T * health @ rng.uniform(low, high)) * 0.5
    got = largest_factor(thrusters, *map(jnp.asarray, (direction, health, held, spent)))
    if not np.any(direction):
        assert got == 0.0
        return
    columns = np.c_[(T * health)[held], -direction[held]]
    found = linprog(
        np.r_[np.zeros(8), -1], A_eq=columns, b_eq=spent[held], bounds=[*zip(low, high, strict=True), (0, None)]
    )
    np.testing.assert_allclose(got, found.x[-1] if found.status == 0 else 0.0, atol=1e-4, rtol=1e-4)


@pytest.mark.slow
def test_what_is_left_of_two_bodies():
    thrusters = thirty_kg().thrusters
    what = jax.jit(remaining)
    sound, one = what(thrusters, SOUND), what(thrusters, jnp.array([1.0, 1, 1, 0, 0, 0]))
    np.testing.assert_allclose(sound.either, [20.0, 10.0, 22.0, 22 * ARM, 0.0, 20 * ARM], atol=1e-4)
    np.testing.assert_allclose(sound.horizontal, 10.0, atol=1e-4)
    np.testing.assert_allclose(one.either, [0.0, 5.0, 11.0, 0.0, 0.0, 0.0], atol=1e-4)
    np.testing.assert_allclose(one.horizontal, 0.0, atol=1e-4)
    np.testing.assert_array_equal(lost_axes(one, sound), [True, False, False, True, False, True])
    turning = remaining(thrusters, jnp.array([1.0, 1, 1, 0, 0, 0]), held=(True, True, True, False, False, False))
    np.testing.assert_allclose(turning.horizontal, 5.0, atol=1e-4)


def test_vectored_vehicle_that_lost_a_thruster_still_moves_every_way():
    thrusters = thrusters_from(jnp.asarray(VECTORED), jnp.full(6, 10.0))
    what = jax.jit(remaining)
    sound, now = what(thrusters, SOUND), what(thrusters, jnp.array([0.0, 1, 1, 1, 1, 1]))
    assert not np.any(lost_axes(now, sound, 0.3))
    assert 0.3 < now.horizontal / sound.horizontal < 0.8


@pytest.mark.system
@pytest.mark.parametrize("name", list_library())
def test_thrusters_above_co_still_push(name):
    """What surge makes in pitch is a by-product where nothing balances it: it took surge away, with 2 cm of lever."""
    model = raised(load_vehicle(name).model(), 0.05)
    allocation = PriorityAllocation.of(model, slew=np.inf)
    step = jax.jit(lambda tau: allocation.step(allocation.init(None, None), AllocationInput(tau, one), 0.02)[1])
    one, sound = jnp.ones(model.thrusters.count), pushed_axes(load_vehicle(name).model())
    np.testing.assert_array_equal(pushed_axes(model)[[0, 1, 2, 5]], sound[[0, 1, 2, 5]])
    for axis in np.flatnonzero(pushed_axes(model)):
        asked = 0.5 * float(jnp.minimum(allocation.greatest_wrench, -allocation.least_wrench)[axis])
        got = step(jnp.zeros(6).at[axis].set(asked))
        assert got.made[axis] == pytest.approx(asked, rel=0.02), AXES[axis]
        assert abs(float(got.shortfall[axis])) < 0.02 * asked
        assert not np.any(got.shortfall[~pushed_axes(model)]), "nobody asked for it, nothing winds up on it"


def test_where_the_origin_lies_changes_no_axis():
    """Moments about a far origin are levers of the drawing, not of the vehicle."""
    for name in list_library():
        model = load_vehicle(name).model()
        T, r = np.asarray(model.thrusters.configuration), np.array([1.5, 0.3, -0.4])
        T = np.vstack([T[:3], T[3:] + np.cross(r, T[:3], axisb=0, axisc=0)])
        moved = model.replace(
            center_of_gravity=model.center_of_gravity + r,
            thrusters=eqx.tree_at(lambda t: t.configuration, model.thrusters, jnp.asarray(T)),
        )
        np.testing.assert_array_equal(pushed_axes(moved), pushed_axes(model), err_msg=name)


def raised(model, share):
    """The same with all thrusters that much of its length nearer to the surface."""
    T = np.asarray(model.thrusters.configuration)
    up = np.array([0.0, 0.0, -share * VehicleScales.of(model).length])
    T = np.vstack([T[:3], T[3:] + np.cross(up, T[:3], axisb=0, axisc=0)])
    return model.replace(thrusters=eqx.tree_at(lambda t: t.configuration, model.thrusters, jnp.asarray(T)))


def test_bad_options_are_named():
    with pytest.raises(ValueError, match="stop is 0.2"):
        PriorityAllocation.of(thirty_kg(), stop=0.2)
