"""Vehicles in chunks are vehicles side by side."""

import numpy as np
import pytest

from rovtwin.core.arrays.batch import batched
from rovtwin.core.numerics import jax, jnp


def one(tree, x):
    return {"product": tree["a"] @ x, "sum": tree["b"] + x.sum()}


@pytest.mark.system
@pytest.mark.parametrize("count", [1, 4, 5, 8, 11])
def test_chunks_are_vmap(count):
    rng = np.random.default_rng(count)
    tree = {"a": jnp.asarray(rng.normal(size=(count, 3, 3))), "b": jnp.arange(count)}
    x = jnp.asarray(rng.normal(size=(count, 3)))
    found, expected = jax.jit(batched(one, size=4))(tree, x), jax.vmap(one)(tree, x)
    for key, value in expected.items():
        assert found[key].shape == value.shape and found[key].dtype == value.dtype
        np.testing.assert_allclose(found[key], value, rtol=1e-14)


def test_gradients_go_through():
    def cost(scale, size):
        return jnp.sum(batched(lambda x: jnp.sin(scale * x), size)(jnp.arange(7.0)))

    slope = [float(jax.grad(cost)(2.0, size)) for size in (3, 7)]
    assert slope[0] == pytest.approx(slope[1], rel=1e-14)
