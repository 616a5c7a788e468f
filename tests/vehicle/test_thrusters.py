"""Command -> force -> lag and back, for every kind of curve."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.vehicle.random_vehicles import build

from rovtwin.core.numerics import jax, jnp
from rovtwin.vehicle.physics.thrusters import (
    Thrusters,
    command_for_force,
    force_just_after,
    force_limits,
    half_steps,
    lag,
    static_force,
    thrusters_from,
)

N = 4
GRID = np.array([-1.0, -0.7, -0.3, -0.08, 0.0, 0.08, 0.35, 0.8, 1.0])
unit = st.floats(-1.0, 1.0)

settle = jax.jit(static_force)
invert = jax.jit(command_for_force)


def curves(seed: int, kind: str) -> Thrusters:
    """Four thrusters with a dead band, stronger ahead than astern."""
    rng = np.random.default_rng(seed)
    ahead = rng.uniform(5, 50, N)
    astern = ahead * rng.uniform(0.5, 1.0, N)
    others = {"dead_band": jnp.asarray(rng.uniform(0.0, 0.15, N))}
    if kind == "power":
        others["exponent"] = jnp.asarray(rng.uniform(1.0, 2.5, N))
    if kind == "table":
        rise = rng.uniform(0.5, 10, (N, len(GRID) - 1))
        rise[:, 3:5] = 0.0  # the dead zone of the table: no force from -0.08 to 0.08
        force = np.concatenate([np.zeros((N, 1)), np.cumsum(rise, axis=1)], axis=1)
        force -= force[:, 4:5]
        ahead, astern = force[:, -1], -force[:, 0]
        others |= {
            "table_command": jnp.asarray(GRID),
            "table_force": jnp.asarray(force),
            "tabulated": jnp.ones(N, dtype=bool),
        }
    return thrusters_from(jnp.ones((6, N)), jnp.asarray(ahead), jnp.asarray(astern), **others)


kinds = st.builds(curves, st.integers(0, 2**32 - 1), st.sampled_from(["linear", "power", "table"]))


@given(kinds, st.lists(unit, min_size=N, max_size=N))
def test_command_for_force_undoes_static_force(thrusters, u):
    u = np.array(u)
    force = np.asarray(settle(thrusters, u))
    back = np.asarray(invert(thrusters, force))
    moving = np.abs(force) > 1e-6
    np.testing.assert_allclose(back[moving], u[moving], atol=1e-6)
    np.testing.assert_allclose(settle(thrusters, back), force, atol=2e-9 * 60)
    assert (back[force == 0] == 0).all()


@given(kinds, st.lists(st.floats(-2.0, 2.0), min_size=N, max_size=N))
def test_command_for_a_desired_force(thrusters, share):
    """Within the limits the desired force comes out, beyond them the limit; the limits differ ahead and astern."""
    low, high = map(np.asarray, force_limits(thrusters))
    np.testing.assert_allclose(high, thrusters.force_ahead)
    np.testing.assert_allclose(low, -thrusters.force_astern)
    expected = np.where(np.array(share) >= 0, high, -low) * share
    u = np.asarray(invert(thrusters, expected))
    assert (np.abs(u) <= 1).all()
    np.testing.assert_allclose(settle(thrusters, u), np.clip(expected, low, high), atol=1e-6)


@given(kinds, st.lists(unit, min_size=N, max_size=N), st.floats(0.0, 0.5))
def test_force_never_falls_with_command(thrusters, u, more):
    u = np.array(u)
    assert (np.asarray(settle(thrusters, u + more)) >= np.asarray(settle(thrusters, u)) - 1e-12).all()


def test_dead_band_by_hand():
    """Dead up to 0.1; at u = 0.55 half of the travel is left, so with the exponent 2 a quarter of the force."""
    thrusters = thrusters_from(
        jnp.ones((6, 1)), jnp.array([40.0]), jnp.array([32.0]), exponent=jnp.array([2.0]), dead_band=jnp.array([0.1])
    )
    for u, force in ((0.0, 0), (0.1, 0), (-0.1, 0), (0.55, 10), (-0.55, -8), (1, 40), (-1, -32), (3, 40), (-3, -32)):
        np.testing.assert_allclose(static_force(thrusters, jnp.array([u])), [force], atol=1e-12)


@given(st.integers(0, 2**32 - 1), st.lists(st.floats(-1.3, 1.3), min_size=N, max_size=N))
def test_table_is_numpys_interpolation(seed, u):
    thrusters = curves(seed, "table")
    expected = [np.interp(x, GRID, row) for x, row in zip(u, thrusters.table_force, strict=True)]
    np.testing.assert_allclose(settle(thrusters, np.array(u)), expected, atol=1e-12)


@pytest.mark.system
def test_tables_and_power_laws_side_by_side():
    """Only the tabulated thrusters use the table."""
    table = curves(1, "table")
    mixed = dataclasses.replace(table, tabulated=jnp.array([True, False, True, False]))
    u = np.array([0.5, 0.5, -0.6, -0.6])
    by_table, by_law = static_force(table, u), static_force(dataclasses.replace(table, tabulated=jnp.zeros(N, bool)), u)
    np.testing.assert_allclose(static_force(mixed, u), np.where(mixed.tabulated, by_table, by_law))
    np.testing.assert_allclose(command_for_force(mixed, static_force(mixed, u)), u, atol=1e-9)


def test_quantisation():
    """A servo of 1 % steps: commands are rounded before the curve."""
    thrusters = dataclasses.replace(curves(2, "power"), quantisation=jnp.array([0.01, 0.25, 0.0, 0.01]))
    u = np.array([0.334, 0.334, 0.334, -0.996])
    exact = dataclasses.replace(thrusters, quantisation=jnp.zeros(N))
    np.testing.assert_allclose(static_force(thrusters, u), static_force(exact, np.array([0.33, 0.25, 0.334, -1.0])))


@given(kinds, st.lists(unit, min_size=N, max_size=N), st.lists(st.floats(0.0, 1.0), min_size=N, max_size=N))
def test_health_scales_the_force(thrusters, u, health):
    sick = dataclasses.replace(thrusters, health=jnp.asarray(health))
    np.testing.assert_allclose(settle(sick, np.array(u)), np.array(health) * settle(thrusters, np.array(u)))


# -- lag

CONSTANTS = np.array([0.0, 0.05, 0.2, 1.0])


def lagging(rate_limit: float = np.inf) -> Thrusters:
    force = jnp.full(N, 20.0)
    limit = jnp.full(N, rate_limit)
    return thrusters_from(jnp.ones((6, N)), force, time_constant=jnp.asarray(CONSTANTS), rate_limit=limit)


@given(
    st.lists(st.floats(-20, 20), min_size=N, max_size=N),
    st.lists(st.floats(-20, 20), min_size=N, max_size=N),
    st.lists(st.floats(1e-4, 0.5), min_size=1, max_size=6),
)
def test_lag_is_the_exponential_however_time_is_cut(start, target, steps):
    start, target = np.array(start), np.array(target)
    force = start
    for dt in steps:
        force = lag(lagging(), force, target, dt)
    decay = np.where(CONSTANTS > 0, np.exp(-sum(steps) / np.where(CONSTANTS > 0, CONSTANTS, 1)), 0.0)
    np.testing.assert_allclose(force, target + (start - target) * decay, atol=1e-12)


def test_rate_limit():
    """20 N asked, 10 N/s allowed: 1 N after 0.1 s however fast the lag; near the target the lag is the slower one."""
    thrusters, target = lagging(10.0), jnp.full(N, 20.0)
    np.testing.assert_allclose(lag(thrusters, jnp.zeros(N), target, 0.1), np.ones(N))
    np.testing.assert_allclose(lag(thrusters, jnp.zeros(N), -target, 0.1), -np.ones(N))
    near = lag(thrusters, target - 0.01, target, 0.1)
    np.testing.assert_allclose(near, lag(lagging(), target - 0.01, target, 0.1))
    force = jnp.zeros(N)
    for _ in range(1000):
        before, force = force, lag(thrusters, force, target, 0.01)
        assert (np.abs(force - before) <= 0.1 + 1e-12).all()
    np.testing.assert_allclose(force, target, atol=2e-3)


def test_only_a_free_thruster_jumps():
    """Right after a new command a thruster without lag is there; one with a lag or a rate limit has not moved."""
    start, target = jnp.zeros(N), jnp.full(N, 5.0)
    np.testing.assert_allclose(force_just_after(lagging(), start, target), [5, 0, 0, 0])
    np.testing.assert_allclose(force_just_after(lagging(10.0), start, target), np.zeros(N))


# -- gradients


@pytest.mark.parametrize("kind", ["linear", "power", "table"])
def test_gradients_are_finite_everywhere(kind):
    """Also at zero command, at the edge of the dead band and at the limits, where a power law is awkward."""
    thrusters = curves(3, kind)
    edge = float(thrusters.dead_band[0])

    @jax.jit
    def slopes(u):
        return jax.grad(lambda t, u: static_force(t, u).sum(), argnums=(0, 1), allow_int=True)(thrusters, u)

    for u in (0.0, edge, -edge, 1.0, -1.0, 0.08):
        for slope in jax.tree.leaves(slopes(jnp.full(N, u))):
            assert slope.dtype != float or np.isfinite(slope).all()


@pytest.mark.system
@pytest.mark.parametrize("kind", ["linear", "power", "table"])
def test_slope_is_that_of_differences(kind):
    thrusters = curves(4, kind)
    for u in (0.5, -0.4, 0.9):
        at, h = jnp.full(N, u), 1e-6
        slope = jax.grad(lambda u: static_force(thrusters, u).sum())(at)
        difference = (static_force(thrusters, at + h) - static_force(thrusters, at - h)) / (2 * h)
        np.testing.assert_allclose(slope, difference, rtol=1e-6)


def test_inverse_has_a_finite_gradient_at_no_force():
    slope = jax.grad(lambda f: command_for_force(curves(5, "power"), f).sum())(jnp.zeros(N))
    assert np.isfinite(slope).all()


def test_half_steps_are_those_of_two_steps_of_half_the_length():
    thrusters = build(3, count=4).thrusters
    force, target = jnp.linspace(-3.0, 2.0, thrusters.count), static_force(thrusters, jnp.full(thrusters.count, 0.6))
    begin, middle, end = half_steps(thrusters, force, target, 0.2)
    np.testing.assert_array_equal(begin, force_just_after(thrusters, force, target))
    np.testing.assert_allclose(middle, lag(thrusters, begin, target, 0.1), rtol=1e-14)
    np.testing.assert_allclose(end, lag(thrusters, begin, target, 0.2), rtol=1e-12, atol=1e-12)
