"""The contract of `core.block.Block`, held by every Block in the package.

Blocks are found by importing the package, examples of them in `tests/block_examples.py`; the clauses are those of
`rovtwin.testing`, which blocks of other packages are held to as well.
"""

import functools
import importlib
import inspect
import pkgutil

import equinox as eqx
import pytest
from tests.block_examples import EXAMPLES, SLOW, SLOW_BATCH, SLOW_GRADIENT, START, Example

import rovtwin
from rovtwin.core.block import Block
from rovtwin.core.flow import Wrench
from rovtwin.core.numerics import jnp
from rovtwin.testing import BlockContract, check_block

NOT_BLOCKS = ("rovtwin.cli", "rovtwin.__main__", "rovtwin.report", "rovtwin.console")


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


@functools.cache
def example(name: str) -> Example:
    """Made once: its arrays are made outside compiled code, one operation after the other."""
    return EXAMPLES[name]()


def test_every_block_has_an_example():
    blocks, shown = find_blocks(), {name.split(":")[0] for name in EXAMPLES}
    missing, gone = sorted(blocks.keys() - shown), sorted(shown - blocks.keys())
    assert not missing, f"add an example to EXAMPLES in tests/block_examples.py of: {', '.join(missing)}"
    assert not gone, f"no such Block any more, take it out of EXAMPLES in tests/block_examples.py: {', '.join(gone)}"
    for name in EXAMPLES:
        assert type(example(name).block) is blocks[name.split(":")[0]], name


@functools.cache
def contract(name: str) -> BlockContract:
    shown = example(name)
    return BlockContract(shown.block, shown.inputs, shown.dt, START, shown.shared)


def names(slow: set[str]) -> list:
    return [pytest.param(name, marks=pytest.mark.slow) if name in slow else name for name in sorted(EXAMPLES)]


every_block = pytest.mark.parametrize("name", names(SLOW))


@every_block
def test_memory_keeps_its_form_and_all_is_finite(name):
    contract(name).keeps_its_form()


@every_block
def test_same_arguments_give_the_same_result(name):
    contract(name).repeats()


@every_block
def test_python_loop_equals_compiled_scan(name):
    contract(name).loops_as_compiled()


@pytest.mark.parametrize("name", names(SLOW_BATCH))
def test_batch_equals_singles(name):
    contract(name).batches()


@pytest.mark.system
@pytest.mark.parametrize("name", names(SLOW_GRADIENT))
def test_gradient_is_finite(name):
    if not example(name).differentiable:
        pytest.skip("has no float output to differentiate")
    contract(name).has_a_gradient()


class Edge(Block):
    """Its gradient by `gain` is none where it counts: a number of Python's, as one's own blocks have."""

    gain: float = 0.0

    def init(self, key, start):
        return None

    def step(self, memory, input, dt):
        return memory, input * jnp.sqrt(jnp.asarray(self.gain, float))


def test_numbers_of_python_are_parameters_too():
    with pytest.raises(AssertionError, match="gradient is not finite by .*gain"):
        check_block(Edge(), jnp.ones(4))
    with pytest.raises(AssertionError, match="Edge.gain: found str, expected a number"):
        check_block(Edge("much"), jnp.ones(4))


class Shaped(Block):
    """A controller whose memory, after a tick, and output are of shapes that can be chosen."""

    after: int = eqx.field(static=True, default=2)
    axes: int = eqx.field(static=True, default=6)
    flag: type = eqx.field(static=True, default=bool)

    def init(self, key, start):
        return jnp.zeros(2)

    def step(self, memory, input, dt):
        return jnp.zeros(self.after), Wrench(jnp.zeros(self.axes), jnp.zeros(6, self.flag))


@pytest.mark.parametrize(
    ("block", "why"),
    [
        (Shaped(axes=3), r"Shaped: output of step: found .tau float64\[3\], expected float64\[6\]"),
        (Shaped(flag=float), r"Shaped: output of step: found .saturated float64\[6\], expected bool\[6\]"),
        (Shaped(after=3), r"Shaped: memory after step: found .*float64\[3\], expected float64\[2\]"),
    ],
)
def test_check_block_looks_at_shapes_and_types(block, why):
    with pytest.raises(AssertionError, match=why):
        check_block(block, EXAMPLES["gnc.thesis.pid.Pid"]().inputs)
    with pytest.raises(AssertionError, match=r"Edge: output of step: found float64\[4\], expected .*\[3\]"):
        check_block(Edge(), jnp.ones((2, 4)), output=jnp.zeros(3))


@pytest.mark.parametrize("name", [name for name in sorted(EXAMPLES) if name.startswith("gnc.")])
def test_our_parts_fit_their_places(name):
    contract(name).fits_its_place()
