"""A pytree as one vector and back, exactly; readings straight into it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rovtwin.core.arrays.flat import Layout, Packer
from rovtwin.core.flow import Measurement, Slot, pack
from rovtwin.core.numerics import jax, jnp

TREE = {
    "float": jnp.array([[1.5, -0.0], [np.inf, 1e-308]]),
    "bool": jnp.array([True, False, True]),
    "int32": jnp.array(-(2**31), dtype=jnp.int32),
    "int64": jnp.array([2**53, -(2**53), 7]),
    "key": jax.random.key_data(jax.random.key(2**32 - 1)),
    "nothing": (None, jnp.zeros((0, 3))),
}


def assert_same(one, other):
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        assert a.shape == b.shape and a.dtype == b.dtype
        np.testing.assert_array_equal(np.asarray(a), np.asarray(b))
        np.testing.assert_array_equal(np.signbit(np.asarray(a, float)), np.signbit(np.asarray(b, float)))


def test_there_and_back_compiled_and_on_the_host():
    layout = Layout(TREE)
    vector = jax.jit(layout.flatten)(TREE)
    assert vector.shape == (layout.size,) and vector.dtype == jnp.float64
    assert_same(jax.jit(layout.unflatten)(vector), TREE)
    assert_same(layout.unflatten(np.asarray(vector)), TREE)
    on_the_host = layout.flatten(TREE)
    assert isinstance(on_the_host, np.ndarray) and on_the_host.tobytes() == np.asarray(vector).tobytes()


def test_not_a_number_stays_one():
    layout = Layout(jnp.zeros(2))
    np.testing.assert_array_equal(layout.unflatten(layout.flatten(jnp.array([np.nan, 1.0]))), [np.nan, 1.0])


def test_leading_axes_go_to_every_leaf():
    layout = Layout(TREE)
    vector = np.asarray(layout.flatten(TREE))
    many = layout.unflatten(np.stack([vector, vector, vector]))
    assert many["float"].shape == (3, 2, 2) and many["int32"].shape == (3,)
    assert_same(jax.tree.map(lambda leaf: leaf[1], many), TREE)


def test_places_say_where_a_leaf_lies():
    layout = Layout(TREE)
    vector, places = np.asarray(layout.flatten(TREE)), layout.places()
    np.testing.assert_array_equal(vector[places["int64"]], TREE["int64"])
    np.testing.assert_array_equal(vector[places["float"]], np.ravel(TREE["float"]))


def test_an_empty_tree_is_an_empty_vector():
    layout = Layout((None, {}))
    assert layout.size == 0 and layout.flatten((None, {})).shape == (0,)


@pytest.mark.parametrize("leaf", [jnp.zeros(2, complex), np.zeros(2, np.uint64), jax.random.key(0)])
def test_what_float64_does_not_hold_is_refused(leaf):
    with pytest.raises(TypeError, match="found a leaf of type"):
        Layout({"odd": leaf})


SLOTS = {"gyro": Slot.empty(2, 3), "position": Slot.empty(1, 2), "pressure": Slot.empty(3, 1)}
SIZES = {"gyro": 3, "position": 2, "pressure": 1, "sonar": 4}


@given(st.lists(st.sampled_from(sorted(SIZES)), max_size=12))
def test_packing_in_one_go_is_pack_and_flatten(names):
    readings = [
        Measurement(name, np.linspace(k, k + 1, SIZES[name]), 0.01 * k) for k, name in enumerate(names, start=1)
    ]
    layout = Layout(SLOTS)
    packer = Packer(layout, SLOTS, layout.places())
    np.testing.assert_array_equal(packer(readings), layout.flatten(pack(readings, SLOTS)))


def test_a_reading_of_another_size_is_refused():
    layout = Layout(SLOTS)
    with pytest.raises(ValueError, match="'gyro': found 2 values, expected 3"):
        Packer(layout, SLOTS, layout.places())([Measurement("gyro", np.zeros(2), 0.0)])
