"""The contract of `core.block.Block`, held by every Block in the package.

Blocks are found by importing the package, examples of them in `tests/block_examples.py`.
"""

import functools
import importlib
import inspect
import pkgutil

import equinox as eqx
import numpy as np
import pytest
from tests.block_examples import EXAMPLES, SLOW, SLOW_BATCH, SLOW_GRADIENT, START, TICKS, Example

import rovtwin
from rovtwin.core.block import Block
from rovtwin.core.numerics import jax, jnp

NOT_BLOCKS = ("rovtwin.cli", "rovtwin.__main__", "rovtwin.report", "rovtwin.console")
BATCH = 3
SEED = jnp.asarray(1)


def find_blocks() -> dict[str, type[Block]]:
    """Every concrete Block of the package by module and name."""
    for found in pkgutil.walk_packages(rovtwin.__path__, "rovtwin.", onerror=lambda name: None):
        if not found.name.startswith(NOT_BLOCKS):
            importlib.import_module(found.name)
    blocks, rest = {}, [Block]
    while rest:
        for cls in rest.pop().__subclasses__():
            rest.append(cls)
            if cls.__module__.startswith("rovtwin.") and not inspect.isabstract(cls):
                blocks[f"{cls.__module__}.{cls.__qualname__}".removeprefix("rovtwin.")] = cls
    return blocks


def test_every_block_has_an_example():
    blocks, shown = find_blocks(), {name.split(":")[0] for name in EXAMPLES}
    missing, gone = sorted(blocks.keys() - shown), sorted(shown - blocks.keys())
    assert not missing, f"add an example to EXAMPLES in tests/block_examples.py of: {', '.join(missing)}"
    assert not gone, f"no such Block any more, take it out of EXAMPLES in tests/block_examples.py: {', '.join(gone)}"
    for name, example in EXAMPLES.items():
        assert type(example().block) is blocks[name.split(":")[0]], name


# -- one compiled form of everything, made once per block and used by all tests


def same_arrays(a, b) -> bool:
    """The very same leaves in the very same structure."""
    x, y = jax.tree.flatten(a), jax.tree.flatten(b)
    return x[1] == y[1] and all(p is q for p, q in zip(x[0], y[0], strict=True))


class Compiled:
    """A block's `init` and `step`, compiled in each of the forms the contract names."""

    def __init__(self, example: Example):
        self.example = example
        self.arrays, self.rest = eqx.partition(example.block, eqx.is_array)
        self.step = jax.jit(self._step)
        self.run = jax.jit(self._run)

    def block(self, arrays) -> Block:
        return eqx.combine(arrays, self.rest)

    def _init(self, arrays, seed, start):
        return self.block(arrays).init(jax.random.key(seed), start)

    def _step(self, arrays, memory, input):
        block = self.block(arrays)
        # Copies of the containers: whoever writes into a dict or list of the caller's is seen below.
        kept = jax.tree.map(lambda leaf: leaf, (block, memory, input))
        result = block.step(memory, input, self.example.dt)
        assert same_arrays(kept, (block, memory, input)), "step changed its arguments"
        assert isinstance(result, tuple) and len(result) == 2, "step returns (memory, output)"
        return result

    def _run(self, arrays, seed, start, inputs):
        begin = self._init(arrays, seed, start)
        return begin, *jax.lax.scan(lambda memory, input: self._step(arrays, memory, input), begin, inputs)

    @functools.cached_property
    def result(self):
        """Memory before and after a run, and its outputs with a leading axis TICKS."""
        return self.run(self.arrays, SEED, START, self.example.inputs)

    @functools.cached_property
    def batch(self):
        """Runs of BATCH seeds, starts and inputs that differ, under vmap."""
        shared = self.example.shared
        return jax.jit(jax.vmap(self._run, in_axes=(None, 0, 0, shared)))(self.arrays, *self.batched)

    @functools.cached_property
    def batched(self):
        def vary(leaf):
            # A little different in each member; a leaf that is shared is not touched.
            factor = 1 + 0.01 * jnp.arange(BATCH).reshape(-1, *[1] * leaf.ndim)
            floats = jnp.issubdtype(leaf.dtype, jnp.floating)
            return leaf * factor if floats else jnp.broadcast_to(leaf, (BATCH, *leaf.shape))

        inputs, shared = self.example.inputs, self.example.shared
        if shared != 0:
            axes = jax.tree.map(lambda axis, part: jax.tree.map(lambda _: axis, part), shared, inputs, is_leaf=is_axis)
            inputs = jax.tree.map(lambda axis, x: x if axis is None else vary(x), axes, inputs, is_leaf=is_axis)
        else:
            inputs = jax.tree.map(vary, inputs)
        return jnp.arange(BATCH) + 1, jax.tree.map(vary, START), inputs

    def member(self, i: int):
        """Seed, start and inputs of one run of the batch."""
        seeds, starts, inputs = self.batched
        pick = jax.tree.map(lambda leaf: leaf[i], (seeds, starts))
        shared = self.example.shared
        if shared == 0:
            return *pick, jax.tree.map(lambda leaf: leaf[i], inputs)
        axes = jax.tree.map(lambda axis, part: jax.tree.map(lambda _: axis, part), shared, inputs, is_leaf=is_axis)
        return *pick, jax.tree.map(lambda axis, x: x if axis is None else x[i], axes, inputs, is_leaf=is_axis)


def is_axis(x) -> bool:
    return x is None or isinstance(x, int)


@functools.cache
def compiled(name: str) -> Compiled:
    return Compiled(EXAMPLES[name]())


def names(slow: set[str]) -> list:
    return [pytest.param(name, marks=pytest.mark.slow) if name in slow else name for name in sorted(EXAMPLES)]


every_block = pytest.mark.parametrize("name", names(SLOW))


def form(tree):
    """Structure, shapes and types."""
    leaves, structure = jax.tree.flatten(tree)
    return structure, [(leaf.shape, leaf.dtype) for leaf in leaves]


def close(a, b, atol=1e-9):
    assert jax.tree.structure(a) == jax.tree.structure(b)
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        np.testing.assert_allclose(np.asarray(x, float), np.asarray(y, float), rtol=atol, atol=atol)


@every_block
def test_memory_keeps_its_form_and_all_is_finite(name):
    """Structure, shapes and types stay from tick to tick; no NaN and no infinity in memory or output."""
    block = compiled(name)
    begin, memory, outputs = block.result
    assert form(begin) == form(memory)
    assert jax.tree.leaves(outputs), "a block has an output"
    for leaf in jax.tree.leaves((begin, memory, outputs)):
        if jnp.issubdtype(leaf.dtype, jnp.floating):
            assert leaf.dtype == jnp.float64
            assert np.isfinite(leaf).all()


@every_block
def test_same_arguments_give_the_same_result(name):
    """Bit for bit, also when traced afresh: nothing is remembered outside memory."""
    block = compiled(name)
    again = block.run(block.arrays, SEED, START, block.example.inputs)
    for a, b in zip(jax.tree.leaves(block.result), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(a, b)
    first = jax.tree.map(lambda leaf: leaf[0], block.example.inputs)
    arguments = block.arrays, block.result[0], first
    traces = [str(jax.make_jaxpr(lambda *a: block._step(*a))(*arguments)) for _ in range(2)]
    assert traces[0] == traces[1]


@every_block
def test_python_loop_equals_compiled_scan(name):
    block = compiled(name)
    begin, *after = block.result
    memory, outputs = begin, []
    inputs = jax.tree.map(np.asarray, block.example.inputs)
    for k in range(TICKS):
        memory, output = block.step(block.arrays, memory, jax.tree.map(lambda leaf, k=k: leaf[k], inputs))
        outputs.append(output)
    close((memory, jax.tree.map(lambda *leaves: np.stack(leaves), *outputs)), tuple(after))


@pytest.mark.parametrize("name", names(SLOW_BATCH))
def test_batch_equals_singles(name):
    block = compiled(name)
    for i in range(BATCH):
        close(jax.tree.map(lambda leaf, i=i: leaf[i], block.batch), block.run(block.arrays, *block.member(i)))


@pytest.mark.parametrize("name", names(SLOW_GRADIENT))
def test_gradient_is_finite(name):
    """Of the sum of all outputs, by every float parameter, the start and every float input."""
    block = compiled(name)
    if not block.example.differentiable:
        pytest.skip("has no float output to differentiate")
    arrays, others = eqx.partition(block.arrays, eqx.is_inexact_array)
    inputs, fixed = eqx.partition(block.example.inputs, eqx.is_inexact_array)

    @jax.jit
    @jax.grad
    def slopes(x):
        parameters, start, inputs = x
        *_, outputs = block._run(eqx.combine(parameters, others), SEED, start, eqx.combine(inputs, fixed))
        floats = [leaf for leaf in jax.tree.leaves(outputs) if jnp.issubdtype(leaf.dtype, jnp.floating)]
        return sum(jnp.sum(leaf) for leaf in floats)

    gradient = jax.tree_util.tree_leaves_with_path(slopes((arrays, START, inputs)))
    bad = [jax.tree_util.keystr(path) for path, leaf in gradient if not np.isfinite(leaf).all()]
    assert not bad, f"not finite by {bad}"
    assert any(np.any(leaf) for _, leaf in gradient), "a gradient of zero everywhere is none"
