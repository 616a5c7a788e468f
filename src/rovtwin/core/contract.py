"""What a Block must keep to, looked at without running it: structure, shapes and types of what it takes and gives.

Nothing is computed: JAX traces `init` and `step` once. `rovtwin.testing.check_block` runs the block, too.
"""

import importlib
import traceback
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.arrays.flat import EXACT
from rovtwin.core.block import Block, Start
from rovtwin.core.errors import ConfigError, LogError
from rovtwin.core.log.channel import Channel
from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.core.sensors import FRAMES, SENSORS, SensorKind

KEY = "keep the numbers of a key by jax.random.key_data"
AROUND = (
    "jax",
    "jaxlib",
    "equinox",
    "jaxtyping",
    "numpy",
    "rovtwin",
)  # packages whose lines are not the user's mistake
TRACED = "arrays have no values yet while a block is compiled"
HINTS = {
    jax.errors.TracerBoolConversionError: f"{TRACED}: use jnp.where or jax.lax.cond in place of if, and, or, while",
    jax.errors.TracerIntegerConversionError: f"{TRACED}: use jnp.take or jax.lax.dynamic_slice in place of an index",
    jax.errors.TracerArrayConversionError: f"{TRACED}: use jax.numpy in place of numpy",
    jax.errors.NonConcreteBooleanIndexError: f"{TRACED}: use jnp.where in place of a mask as an index",
    jax.errors.ConcretizationTypeError: f"{TRACED}: use jax.numpy in place of float(), int() and math",
}
"""What to write instead, by what JAX raises; the first that fits."""


def of_arrays(block: Any, where: str) -> Any:
    """A block whose numbers are arrays: the compiled loop takes nothing else; what is no Block as it is.

    Raises:
        ConfigError: A field is no number, or of a type that a log's float64 does not keep, or it is declared static and
            has no hash.
    """
    if not isinstance(block, Block):
        return block
    _require_hash(block, f"{where}: {type(block).__name__}")
    leaves, structure = jax.tree_util.tree_flatten_with_path(block)
    return structure.unflatten(
        [_as_array(leaf, f"{where}: {type(block).__name__}{jax.tree_util.keystr(path)}") for path, leaf in leaves]
    )


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
    _require_hash(memory, f"{where}: memory")
    require_same_form(after, memory, f"{where}: memory after step", "what init gave")
    for path, leaf in jax.tree_util.tree_leaves_with_path(memory):
        if str(leaf.dtype) not in EXACT:
            raise ConfigError(
                f"{where}: memory{jax.tree_util.keystr(path)}: found {leaf.dtype}, expected one of "
                f"{', '.join(EXACT)}; {KEY}"
            )
    if output is not None:
        require_same_form(given, output, f"{where}: output of step")


def require_kind(kind: Any, where: str) -> None:
    """Raise ConfigError unless the `kind` of a sensor of one's own says what its readings hold, as a log needs it."""
    if not isinstance(kind, SensorKind):
        raise ConfigError(f"{where}: kind: found {_named(kind)}, expected a rovtwin.core.sensors.SensorKind")
    for name in ("fields", "units"):
        found = getattr(kind, name)
        if not (isinstance(found, tuple) and found and all(isinstance(one, str) for one in found)):
            raise ConfigError(f"{where}: kind.{name}: found {found!r}, expected a tuple of texts, one for each value")
    try:
        Channel("sensor/own", (*kind.fields, "t_valid"), (*kind.units, "s"), "")
    except LogError as error:
        why = str(error).removeprefix("channel 'sensor/own': ")
        raise ConfigError(f"{where}: kind: {why}") from error
    for name, known in (("frame", FRAMES), ("world", {row.world for row in SENSORS.values()})):
        if (found := getattr(kind, name)) not in known:
            raise ConfigError(f"{where}: kind.{name}: found {found!r}, expected one of {sorted(known)}")
    for name, least in (("rate_hz", 0.0), ("std", 0.0), ("bias", -np.inf)):
        found = getattr(kind, name)
        if isinstance(found, bool) or not isinstance(found, int | float) or not least <= found < np.inf:
            raise ConfigError(f"{where}: kind.{name}: found {found!r}, expected a finite number, {least:g} or more")


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
            raise ConfigError(
                f"{where}: found {f'{name} {here[name]}'.strip()}, expected {form}{f', {what}' if what else ''}"
            )
    if jax.tree.structure(found) != jax.tree.structure(expected):
        raise ConfigError(f"{where}: found {_named(found)}, expected {what or _named(expected)}")


def _as_array(leaf: Any, where: str) -> Any:
    if not isinstance(leaf, bool | int | float | np.ndarray | np.generic | jax.Array):
        raise ConfigError(
            f"{where}: found {_named(leaf)}, expected a number or an array; declare what is none by "
            "equinox.field(static=True)"
        )
    kind = str(getattr(leaf, "dtype", type(leaf).__name__))
    if hasattr(leaf, "dtype") and kind not in EXACT:
        hint = f"; {KEY}" if kind.startswith("key<") else ""
        raise ConfigError(f"{where}: found {kind}, expected one of {', '.join(EXACT)}{hint}")
    try:
        return as_array(leaf) if isinstance(leaf, float) else jnp.asarray(leaf)
    except OverflowError as error:
        raise ConfigError(f"{where}: found {leaf}, expected a number that int64 holds") from error


def _require_hash(tree: Any, where: str) -> None:
    """Raise ConfigError where a static field has no hash: programs are found again by them."""
    if isinstance(tree, dict | list | tuple):
        parts = tree.items() if isinstance(tree, dict) else enumerate(tree)
        for name, part in parts:
            _require_hash(part, f"{where}[{name!r}]")
    for field in fields(tree) if is_dataclass(tree) else ():
        part, label = getattr(tree, field.name, None), f"{where}.{field.name}"
        if not field.metadata.get("static"):
            _require_hash(part, label)
            continue
        try:
            hash(part)
        except TypeError:
            raise ConfigError(
                f"{label}: found {_named(part)}, which has no hash, expected a number, text or tuple in a static field"
            ) from None


def _traced(call: Any, where: str, *arguments: Any) -> Any:
    try:
        return jax.eval_shape(call, *arguments)
    except ConfigError:
        raise
    except Exception as error:  # of somebody else's code: anything
        text = next((line.strip() for line in str(error).splitlines() if line.strip()), "").removesuffix(".")
        hint = next((f"; {hint}" for kind, hint in HINTS.items() if isinstance(error, kind)), "")
        raise ConfigError(f"{where} failed: {type(error).__name__}: {text}{_line_of(error)}{hint}") from error


def _line_of(error: Exception) -> str:
    """The last line of the block's own file that an error came through, in words; "" where there is none."""
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        file = Path(frame.filename)
        if file.is_file() and not any(file.is_relative_to(folder) for folder in _around()):
            return f" ({file.name}, line {frame.lineno}: {frame.line})"
    return ""


@cache
def _around() -> tuple[Path, ...]:
    files = (importlib.import_module(name).__file__ for name in AROUND)
    return tuple(Path(file).parent for file in files if file)


def _leaves(tree: Any) -> list[tuple[str, str]]:
    """Place and form of each array of a tree: (".tau", "float64[6]")."""
    leaves = jax.tree_util.tree_leaves_with_path(tree)
    return [(jax.tree_util.keystr(path), f"{leaf.dtype}{list(leaf.shape)}") for path, leaf in leaves]


def _named(thing: Any) -> str:
    return f"the class {thing.__name__}" if isinstance(thing, type) else type(thing).__name__
