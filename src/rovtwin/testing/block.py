"""The contract of `core.block.Block`: pure, of fixed form, the same compiled, looped and batched, with a gradient."""

import functools
from typing import Any

import equinox as eqx
import numpy as np

from rovtwin.core.block import Block, Start
from rovtwin.core.contract import of_arrays, require_block
from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.interfaces import output_of

BATCH = 3
START = Start.at((0.5, -0.3, 2.0), heading=0.4)


def check_block(
    block: Block,
    inputs: Any,
    *,
    dt: float = 0.02,
    start: Start = START,
    shared: Any = 0,
    differentiable: bool = True,
    output: Any = None,
) -> None:
    """Run a block and hold it to all clauses of the contract.

    Args:
        block: Its fields are its parameters.
        inputs: Input of each tick, leading axis ticks on every array; see `recorded_inputs`.
        dt: Tick [s].
        start: What `init` is given.
        shared: Which of the inputs' leaves a batch shares, as vmap's in_axes for one input; 0 is none.
        differentiable: Whether the outputs have a gradient by parameters and inputs.
        output: What one tick must give, for its structure, shapes and types; None: what the part of an autopilot that
            takes such inputs gives, and of other inputs anything.

    Raises:
        AssertionError: It breaks a clause.
    """
    contract = BlockContract(block, inputs, dt, start, shared)
    contract.fits_its_place(output)
    contract.keeps_its_form()
    contract.repeats()
    contract.loops_as_compiled()
    contract.batches()
    if differentiable:
        contract.has_a_gradient()


class BlockContract:
    """A block's `init` and `step`, compiled in each of the forms that the contract names, and its clauses."""

    def __init__(self, block: Block, inputs: Any, dt: float = 0.02, start: Start = START, shared: Any = 0):
        """See `check_block`."""
        assert isinstance(block, Block), f"found {type(block).__name__}, expected a rovtwin.Block"
        try:
            block = of_arrays(block, "parameters")  # as what flies: a number of Python's would get no gradient
        except ConfigError as error:
            raise AssertionError(str(error)) from error
        self.inputs, self.dt, self.start, self.shared = inputs, dt, start, shared
        self.arrays, self.rest = eqx.partition(block, eqx.is_array)
        self.step = jax.jit(self._step)
        self.run = jax.jit(self._run)

    # -- clauses

    def fits_its_place(self, output: Any = None) -> None:
        """Memory keeps its form, and a tick gives what is expected there, shape by shape; nothing is computed."""
        one = jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape[1:], leaf.dtype), self.inputs)
        block = self._block(self.arrays)
        try:
            require_block(block, one, output_of(one) if output is None else output, self.dt, type(block).__name__)
        except ConfigError as error:
            raise AssertionError(str(error)) from error

    def keeps_its_form(self) -> None:
        """Structure, shapes and types of memory stay from tick to tick; no NaN and no infinity in memory or output."""
        begin, memory, outputs = self.result
        assert _form(begin) == _form(memory), "memory has another form after step than after init"
        assert jax.tree.leaves(outputs), "a block has an output"
        for path, leaf in jax.tree_util.tree_leaves_with_path((begin, memory, outputs)):
            if jnp.issubdtype(leaf.dtype, jnp.floating):
                where = jax.tree_util.keystr(path)
                assert leaf.dtype == jnp.float64, f"{where}: found {leaf.dtype}, expected float64"
                assert np.isfinite(leaf).all(), f"{where}: found what is no finite number"

    def repeats(self) -> None:
        """The same arguments give the same result bit for bit, also traced afresh: all is remembered in memory."""
        again = self.run(self.arrays, 1, self.start, self.inputs)
        for a, b in zip(jax.tree.leaves(self.result), jax.tree.leaves(again), strict=True):
            np.testing.assert_array_equal(a, b)
        first = jax.tree.map(lambda leaf: leaf[0], self.inputs)
        arguments = self.arrays, self.result[0], first
        traces = [str(jax.make_jaxpr(lambda *a: self._step(*a))(*arguments)) for _ in range(2)]
        assert traces[0] == traces[1], "two traces of step differ"

    def loops_as_compiled(self) -> None:
        """Tick by tick from Python it gives what the compiled scan gives."""
        begin, *after = self.result
        memory, outputs = begin, []
        inputs = jax.tree.map(np.asarray, self.inputs)
        for k in range(self.ticks):
            memory, output = self.step(self.arrays, memory, jax.tree.map(lambda leaf, k=k: leaf[k], inputs))
            outputs.append(output)
        _close((memory, jax.tree.map(lambda *leaves: np.stack(leaves), *outputs)), tuple(after))

    def batches(self) -> None:
        """A batch of different runs under vmap is what they are one by one."""
        for i in range(BATCH):
            _close(jax.tree.map(lambda leaf, i=i: leaf[i], self.batch), self.run(self.arrays, *self._member(i)))

    def has_a_gradient(self) -> None:
        """The sum of all outputs has a finite gradient by every float parameter, the start and every float input."""
        arrays, others = eqx.partition(self.arrays, eqx.is_inexact_array)
        inputs, fixed = eqx.partition(self.inputs, eqx.is_inexact_array)

        @jax.jit
        @jax.grad
        def slopes(x):
            parameters, start, inputs = x
            *_, outputs = self._run(eqx.combine(parameters, others), 1, start, eqx.combine(inputs, fixed))
            floats = [leaf for leaf in jax.tree.leaves(outputs) if jnp.issubdtype(leaf.dtype, jnp.floating)]
            return sum(jnp.sum(leaf) for leaf in floats)

        gradient = jax.tree_util.tree_leaves_with_path(slopes((arrays, self.start, inputs)))
        bad = [jax.tree_util.keystr(path) for path, leaf in gradient if not np.isfinite(leaf).all()]
        assert not bad, f"the gradient is not finite by {bad}"
        assert any(np.any(leaf) for _, leaf in gradient), "a gradient of zero everywhere is none"

    # -- what they look at

    @property
    def ticks(self) -> int:
        """How many inputs there are."""
        return len(jax.tree.leaves(self.inputs)[0])

    @functools.cached_property
    def result(self) -> Any:
        """Memory before and after a run, and its outputs with a leading axis ticks."""
        return self.run(self.arrays, 1, self.start, self.inputs)

    @functools.cached_property
    def batch(self) -> Any:
        """Runs of BATCH seeds, starts and inputs that differ, under vmap."""
        return jax.jit(jax.vmap(self._run, in_axes=(None, 0, 0, self.shared)))(self.arrays, *self._batched)

    def _block(self, arrays: Any) -> Block:
        return eqx.combine(arrays, self.rest)

    def _step(self, arrays: Any, memory: Any, input: Any) -> Any:
        block = self._block(arrays)
        # Copies of the containers: whoever writes into a dict or list of the caller's is seen below.
        kept = jax.tree.map(lambda leaf: leaf, (block, memory, input))
        result = block.step(memory, input, self.dt)
        assert _same_arrays(kept, (block, memory, input)), "step changed its arguments"
        assert isinstance(result, tuple) and len(result) == 2, "step returns (memory, output)"
        return result

    def _run(self, arrays: Any, seed: Any, start: Start, inputs: Any) -> Any:
        begin = self._block(arrays).init(jax.random.key(seed), start)
        return begin, *jax.lax.scan(lambda memory, input: self._step(arrays, memory, input), begin, inputs)

    @functools.cached_property
    def _batched(self) -> tuple[Any, Start, Any]:
        def vary(leaf):
            # A little different in each member; a leaf that is shared is not touched.
            factor = 1 + 0.01 * jnp.arange(BATCH).reshape(-1, *[1] * leaf.ndim)
            floats = jnp.issubdtype(leaf.dtype, jnp.floating)
            return leaf * factor if floats else jnp.broadcast_to(leaf, (BATCH, *leaf.shape))

        axes = self._axes()
        inputs = jax.tree.map(lambda axis, x: x if axis is None else vary(x), axes, self.inputs, is_leaf=_is_axis)
        return jnp.arange(BATCH) + 1, jax.tree.map(vary, self.start), inputs

    def _member(self, i: int) -> tuple[Any, Any, Any]:
        """Seed, start and inputs of one run of the batch."""
        seeds, starts, inputs = self._batched
        seed, start = jax.tree.map(lambda leaf: leaf[i], (seeds, starts))
        chosen = jax.tree.map(lambda axis, x: x if axis is None else x[i], self._axes(), inputs, is_leaf=_is_axis)
        return seed, start, chosen

    def _axes(self) -> Any:
        """`shared` for each leaf of the inputs."""
        if self.shared == 0:
            return jax.tree.map(lambda _: 0, self.inputs)
        return jax.tree.map(
            lambda axis, part: jax.tree.map(lambda _: axis, part), self.shared, self.inputs, is_leaf=_is_axis
        )


def _is_axis(x: Any) -> bool:
    return x is None or isinstance(x, int)


def _same_arrays(a: Any, b: Any) -> bool:
    """The very same leaves in the very same structure."""
    x, y = jax.tree.flatten(a), jax.tree.flatten(b)
    return x[1] == y[1] and all(p is q for p, q in zip(x[0], y[0], strict=True))


def _form(tree: Any) -> Any:
    """Structure, shapes and types."""
    leaves, structure = jax.tree.flatten(tree)
    return structure, [(leaf.shape, leaf.dtype) for leaf in leaves]


def _close(a: Any, b: Any, atol: float = 1e-9) -> None:
    assert jax.tree.structure(a) == jax.tree.structure(b)
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        np.testing.assert_allclose(np.asarray(x, float), np.asarray(y, float), rtol=atol, atol=atol)
