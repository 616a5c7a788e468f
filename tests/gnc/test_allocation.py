import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.gnc.flying import ARM, thirty_kg, two_bodies

from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.thesis.allocation import Allocation, coupled, weighted_pseudo_inverse
from rovtwin.vehicle.physics.actuation import rank, reachable_share, uncontrollable_directions, wrench_limits
from rovtwin.vehicle.physics.thrusters import force_limits, static_force, thrusters_from

# Four vectored horizontal thrusters, which surge, sway and yaw share, and two vertical ones: a common small ROV.
_C = np.sqrt(0.5)
VECTORED = np.array(
    [
        [_C, _C, -_C, -_C, 0, 0],
        [_C, -_C, _C, -_C, 0, 0],
        [0, 0, 0, 0, 1, 1],
        [0, 0, 0, 0, -0.11, 0.11],
        [0, 0, 0, 0, 0, 0],
        [0.19, -0.19, -0.19, 0.19, 0, 0],
    ]
)

seeds = st.integers(0, 2**32 - 1)


def any_thrusters(seed, n):
    """n thrusters anywhere with unequal, curved characteristics."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(3, n))
    direction /= np.linalg.norm(direction, axis=0)
    T = np.vstack([direction, np.cross(rng.uniform(-0.4, 0.4, (3, n)), direction, axis=0)])
    ahead, astern = rng.uniform(5.0, 20.0, (2, n))
    return T, thrusters_from(
        jnp.asarray(T),
        jnp.asarray(ahead),
        jnp.asarray(astern),
        exponent=jnp.asarray(rng.uniform(1.0, 2.0, n)),
        dead_band=jnp.asarray(rng.uniform(0.0, 0.1, n)),
    )


def allocation(thrusters, **options):
    return Allocation.of(thirty_kg(thrusters=thrusters), **options)


def made(thrusters, command):
    """The wrench that the plant's thrusters settle at."""
    return thrusters.configuration @ static_force(thrusters, command.u)


@pytest.mark.system
@given(seeds, st.sampled_from([1, 3, 8]), st.sampled_from(["scale", "clip"]))
def test_reachable_wrench_is_made(seed, n, saturation):
    T, thrusters = any_thrusters(seed, n)
    forces = np.random.default_rng(seed + 1).uniform(-1.0, 1.0, n)
    tau = T @ forces
    command, allocated = allocation(thrusters, saturation=saturation)(jnp.asarray(tau))
    np.testing.assert_allclose(allocated, tau, atol=1e-9)
    np.testing.assert_allclose(made(thrusters, command), tau, atol=1e-9)


@pytest.mark.system
@given(seeds, st.sampled_from([1, 3, 8]), st.sampled_from(["scale", "clip"]))
def test_what_it_tells_is_what_thrusters_make(seed, n, saturation):
    _, thrusters = any_thrusters(seed, n)
    tau = jnp.asarray(np.random.default_rng(seed + 1).normal(0, 40, 6))
    command, allocated = allocation(thrusters, saturation=saturation)(tau)
    assert np.all(np.abs(command.u) <= 1 + 1e-12)
    np.testing.assert_allclose(made(thrusters, command), allocated, atol=1e-9)


@given(seeds, st.just(8))
def test_least_weighted_effort(seed, n):
    T, thrusters = any_thrusters(seed, n)
    rng = np.random.default_rng(seed + 1)
    weights = rng.uniform(0.5, 4.0, n)
    tau = T @ rng.uniform(-0.5, 0.5, n)
    best = Allocation.of(thirty_kg(thrusters=thrusters), weights).pseudo_inverse @ tau
    np.testing.assert_allclose(T @ best, tau, atol=1e-9)
    null = np.linalg.svd(T)[2][6:]
    for direction in null:  # any other forces that make the same wrench cost more
        for step in (0.01, -0.01):
            assert weights @ (best + step * direction) ** 2 > weights @ best**2


def test_pitch_of_two_bodies_cannot_be_controlled():
    T = two_bodies()
    assert rank(T) == 5
    np.testing.assert_allclose(np.abs(uncontrollable_directions(T)), [[0, 0, 0, 0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(reachable_share(T), [1, 1, 1, 1, 0, 1], atol=1e-12)
    _, allocated = Allocation.of(thirty_kg())(jnp.array([3.0, 1.0, -2.0, 0.4, 1.0, 0.7]))
    np.testing.assert_allclose(allocated, [3.0, 1.0, -2.0, 0.4, 0.0, 0.7], atol=1e-12)


@given(seeds, st.sampled_from([2, 4, 5]))
def test_uncontrollable_directions_span_what_is_left(seed, n):
    T, _ = any_thrusters(seed, n)
    null = uncontrollable_directions(T)
    assert null.shape == (6 - n, 6) and np.linalg.matrix_rank(null) == 6 - n
    np.testing.assert_allclose(null @ T, 0.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(null, axis=1), 1.0)


def test_plain_axes_are_named_as_such():
    surge_and_heave = np.eye(6)[:, [0, 2]]
    np.testing.assert_array_equal(np.abs(uncontrollable_directions(surge_and_heave)).sum(axis=0), [0, 1, 0, 1, 1, 1])
    assert uncontrollable_directions(np.eye(6)).shape == (0, 6)
    np.testing.assert_allclose(np.abs(uncontrollable_directions(VECTORED)), [[0, 0, 0, 0, 1, 0]], atol=1e-12)


@given(seeds)
def test_noise_of_the_geometry_is_no_direction(seed):
    """A nanometre of misfit gives nobody pitch, and does not tilt the answer either."""
    noisy = VECTORED + np.random.default_rng(seed).normal(0, 1e-9, VECTORED.shape)
    assert rank(noisy) == 5
    np.testing.assert_allclose(uncontrollable_directions(noisy), [[0, 0, 0, 0, 1, 0]], atol=1e-7)


def test_no_thrusters_reach_nothing():
    nothing = np.zeros((6, 0))
    assert rank(nothing) == 0 and rank(np.zeros((6, 2))) == 0
    np.testing.assert_array_equal(uncontrollable_directions(nothing), np.eye(6))
    np.testing.assert_array_equal(uncontrollable_directions(np.zeros((6, 2))), np.eye(6))
    np.testing.assert_array_equal(reachable_share(nothing), np.zeros(6))
    assert weighted_pseudo_inverse(nothing).shape == (0, 6) and coupled(nothing).shape == (0, 0)
    thrusters = thrusters_from(jnp.zeros((6, 0)), jnp.zeros(0))
    for limit in wrench_limits(thrusters):
        np.testing.assert_array_equal(limit, np.zeros(6))
    for saturation in ("scale", "clip"):
        allocate = Allocation.of(thirty_kg().replace(thrusters=thrusters), saturation=saturation)
        command, allocated = allocate(jnp.ones(6))
        assert command.u.shape == (0,) and not np.any(allocated)


@given(seeds)
def test_scaling_keeps_the_direction(seed):
    thrusters = thrusters_from(jnp.asarray(VECTORED), jnp.full(6, 10.0), jnp.full(6, 7.0))
    tau = np.random.default_rng(seed).normal(0, 60, 6) * [1, 1, 0, 0, 0, 0.2]
    _, allocated = allocation(thrusters)(jnp.asarray(tau))
    allocated = np.asarray(allocated)
    share = allocated @ tau / (tau @ tau)
    assert 0 < share <= 1
    np.testing.assert_allclose(allocated, share * tau, atol=1e-9)
    if share < 1:  # and no larger wrench along it is possible
        low, high = (np.asarray(limit) for limit in force_limits(thrusters))
        forces = np.linalg.pinv(VECTORED) @ allocated
        assert np.any(np.isclose(forces, low, atol=1e-6) | np.isclose(forces, high, atol=1e-6))


def test_clipping_turns_the_wrench_and_gives_more():
    expected = jnp.array([20.0, 0.0, 0.0, 0.0, 0.0, 2.8])  # port 15 N, starboard 5 N; 10 N each at most
    _, scaled = Allocation.of(thirty_kg())(expected)
    _, clipped = Allocation.of(thirty_kg(), saturation="clip")(expected)
    np.testing.assert_allclose(scaled, np.asarray(expected) * 10 / 15, atol=1e-12)
    np.testing.assert_allclose(clipped, [15.0, 0, 0, 0, 0, ARM * 5.0], atol=1e-12)


def test_an_axis_of_its_own_keeps_its_force():
    _, allocated = Allocation.of(thirty_kg())(jnp.array([60.0, 0.0, 5.0, 1.0, 0.0, 1.4]))
    share = 10 / (30 + 2.5)
    np.testing.assert_allclose(allocated, [60 * share, 0, 5.0, 1.0, 0, 1.4 * share], atol=1e-12)


def test_thruster_that_cannot_push_astern_does_not_stop_the_others():
    T = np.eye(6)[:, [0, 0, 1]]
    thrusters = thrusters_from(jnp.asarray(T), jnp.array([10.0, 10.0, 5.0]), jnp.array([10.0, 0.0, 5.0]))
    _, allocated = allocation(thrusters)(jnp.array([-8.0, 3.0, 0, 0, 0, 0]))
    np.testing.assert_allclose(allocated, [-4.0, 3.0, 0, 0, 0, 0], atol=1e-12)


def test_known_fault_is_worked_round():
    T, thrusters = any_thrusters(5, 8)
    broken = thrusters_from(
        thrusters.configuration, thrusters.force_ahead, thrusters.force_astern, health=jnp.array([0.0, 0.5] + [1.0] * 6)
    )
    tau = jnp.asarray(T[:, 1:] @ np.full(7, 0.3))
    command, allocated = allocation(broken)(tau)
    np.testing.assert_allclose(allocated, tau, atol=1e-9)
    np.testing.assert_allclose(made(broken, command), tau, atol=1e-9)


def test_limits_of_each_axis():
    lower, upper = wrench_limits(thirty_kg().thrusters)
    np.testing.assert_allclose(upper, [20.0, 10.0, 22.0, 22 * ARM, 0.0, 20 * ARM])
    np.testing.assert_allclose(lower, -np.asarray(upper))


def test_no_wrench_no_command():
    command, allocated = Allocation.of(thirty_kg())(jnp.zeros(6))
    assert not np.any(command.u) and not np.any(allocated)


def test_gradient_is_finite_at_rest_and_beyond_the_limits():
    allocate = Allocation.of(thirty_kg())
    for tau in (jnp.zeros(6), jnp.full(6, 100.0), jnp.full(6, -3.0)):
        assert np.all(np.isfinite(jax.jacfwd(lambda t: allocate(t)[1])(tau)))


def test_bad_options_are_named():
    with pytest.raises(ValueError, match="'shrink'"):
        Allocation.of(thirty_kg(), saturation="shrink")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="6 positive numbers"):
        Allocation.of(thirty_kg(), [1, 1, 1, 1, 1, 0])
