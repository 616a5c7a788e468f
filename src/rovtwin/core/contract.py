"""What a Block must keep to, looked at without running it: structure, shapes and types of what it takes and gives.

Nothing is computed: JAX traces `init` and `step` once. `rovtwin.testing.check_block` runs the block, too.
"""

from typing import Any

from rovtwin.core.arrays.flat import EXACT
from rovtwin.core.block import Block, Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import jax


def require_block(block: Any, input: Any, output: Any, dt: float, where: str) -> None:
    """Raise ConfigError unless a block takes and gives what it shall, and keeps the form of its memory.

    Args:
        block: What is offered as a Block.
        input: Of one tick, arrays or `jax.ShapeDtypeStruct`s.
        output: What one tick must give, in the same way; None: whatever it is.
        dt: Tick [s].
        where: Key or option that the block was given by, for messages.
    """
    if not isinstance(block, Block):
        raise ConfigError(f"{where}: found {_named(block)}, expected a rovtwin.Block with init and step")
    memory, after, given = form_of(block, input, dt, where)
    require_same_form(after, memory, f"{where}: memory after step", "what init gave")
    for path, leaf in jax.tree_util.tree_leaves_with_path(memory):
        if str(leaf.dtype) not in EXACT:
            raise ConfigError(
                f"{where}: memory{jax.tree_util.keystr(path)}: found {leaf.dtype}, expected one of {', '.join(EXACT)}; "
                "keep the numbers of a key by jax.random.key_data"
            )
    if output is not None:
        require_same_form(given, output, f"{where}: output of step")


def form_of(block: Block, input: Any, dt: float, where: str) -> tuple[Any, Any, Any]:
    """Forms of a block's memory from `init`, of that after a tick, and of its output, as `jax.ShapeDtypeStruct`s.

    Raises:
        ConfigError: `init` or `step` raise, or `step` does not give two things.
    """
    begin = Start.at()
    memory = _traced(lambda: block.init(jax.random.key(0), begin), f"{where}: init")
    result = _traced(lambda m, i: block.step(m, i, dt), f"{where}: step", memory, input)
    if not isinstance(result, tuple) or len(result) != 2:
        raise ConfigError(f"{where}: step: found {_named(result)}, expected (memory, output)")
    return memory, *result


def require_same_form(found: Any, expected: Any, where: str, what: str = "") -> None:
    """Raise ConfigError where two trees differ in structure, shapes or types; the message names the first leaf."""
    there, here = (dict(_leaves(tree)) for tree in (expected, found))
    if missing := [name for name in there if name not in here]:
        kind = f" ({_named(found)})" if type(found) is not type(expected) else ""
        name, form = missing[0], there[missing[0]]
        raise ConfigError(f"{where}: found no {name or 'array'}{kind}, expected {_named(expected)} with {name} {form}")
    if extra := [name for name in here if name not in there]:
        raise ConfigError(f"{where}: found {extra[0] or _named(found)}, expected only {what or _named(expected)}")
    for name, form in there.items():
        if here[name] != form:
            raise ConfigError(f"{where}: found {name} {here[name]}, expected {form}{f', {what}' if what else ''}")
    if jax.tree.structure(found) != jax.tree.structure(expected):
        raise ConfigError(f"{where}: found {_named(found)}, expected {what or _named(expected)}")


def _traced(call: Any, where: str, *arguments: Any) -> Any:
    try:
        return jax.eval_shape(call, *arguments)
    except ConfigError:
        raise
    except Exception as error:  # of somebody else's code: anything
        text = next((line.strip() for line in str(error).splitlines() if line.strip()), "")
        raise ConfigError(f"{where} failed: {type(error).__name__}: {text}") from error


def _leaves(tree: Any) -> list[tuple[str, str]]:
    """Place and form of each array of a tree: (".tau", "float64[6]")."""
    leaves = jax.tree_util.tree_leaves_with_path(tree)
    return [(jax.tree_util.keystr(path), f"{leaf.dtype}{list(leaf.shape)}") for path, leaf in leaves]


def _named(thing: Any) -> str:
    return f"the class {thing.__name__}" if isinstance(thing, type) else type(thing).__name__
