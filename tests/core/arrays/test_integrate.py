"""RK4: the classical method, its order, any pytree, one step at a time."""

import numpy as np
import pytest

from rovtwin.core.arrays.integrate import rk4_step
from rovtwin.core.numerics import jax, jnp


def test_one_step_by_hand():
    """x_dot = x: the Taylor series up to the fourth power."""
    h = 0.3
    assert float(rk4_step(lambda _, x: x, jnp.asarray(1.0), h)) == pytest.approx(
        1 + h + h**2 / 2 + h**3 / 6 + h**4 / 24, abs=1e-15
    )


def test_polynomials_in_time_are_exact():
    """Up to degree 3 the method is Simpson's rule; the time passed in is that since the start of the step."""
    for power in range(4):
        x = rk4_step(lambda s, _, power=power: jnp.asarray(s) ** power, jnp.asarray(0.0), 0.7)
        assert float(x) == pytest.approx(0.7 ** (power + 1) / (power + 1), abs=1e-15)


def test_order_four():
    """A pendulum and a falling stone in one tree."""

    def derivative(_, x):
        return {"angle": x["rate"], "rate": -9.81 * jnp.sin(x["angle"]), "fall": (x["fall"][1], -x["fall"][1])}

    def end(steps):
        x = {"angle": jnp.asarray(1.0), "rate": jnp.asarray(0.0), "fall": (jnp.zeros(2), jnp.ones(2))}
        step = jax.jit(lambda x: rk4_step(derivative, x, 2.0 / steps))
        for _ in range(steps):
            x = step(x)
        return np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(x)])

    best = end(800)
    errors = [np.abs(end(steps) - best).max() for steps in (25, 50, 100)]
    assert (np.abs(np.log2(errors[:-1] / np.array(errors[1:])) - 4) < 0.3).all()
    np.testing.assert_allclose(best[1:3], 1 - np.exp(-2.0), atol=1e-9)


def test_tree_comes_back_as_it_was():
    x = {"a": jnp.zeros((2, 3)), "b": (jnp.ones(1), jnp.zeros(()))}
    after = rk4_step(lambda _, x: x, x, 0.1)
    assert jax.tree.structure(after) == jax.tree.structure(x)
    assert all(
        a.shape == b.shape and a.dtype == b.dtype for a, b in zip(*map(jax.tree.leaves, (x, after)), strict=True)
    )
