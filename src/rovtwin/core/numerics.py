"""JAX, configured once: float64, synchronous dispatch, a compilation cache that persists between processes.

Import `jnp` and `Array` from here, never configure JAX elsewhere: XLA reads its flags when it starts.
"""

import logging
import os
import sys
from collections.abc import Callable
from functools import partial, wraps
from pathlib import Path
from typing import Any


def _add_flag(prefix: str, option: str, value: str) -> None:
    """Unless the user has set the option."""
    flags = os.environ.get("XLA_FLAGS", "")
    if option not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} {prefix}{option}={value}".strip()


def _xla_flags() -> None:
    # jax 0.10 is the newest for Python 3.11. Its CPU thunk runtime dispatches every operation of a scan's body
    # one by one unless small loops are compiled as one function; 0.12 does that by itself.
    if sys.version_info < (3, 12):
        _add_flag("--xla_backend_extra_options=", "xla_cpu_small_while_loop_byte_threshold", "10000000000")
        # Vectors as wide as the processor has them; left alone, XLA stops at 256 bits.
        _add_flag("--", "xla_cpu_prefer_vector_width", "512")
    # One roll-out is sequential: a second thread only adds hand-overs.
    os.environ.setdefault("PJRT_NPROC", "1")
    # Errors of XLA are for users, warnings are not, such as one line for each function of `in_one_piece` that is none.
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "2")


_xla_flags()

import jax  # noqa: E402  (the flags above must be set before JAX starts)
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from jax.core import Tracer  # noqa: E402
from jax.experimental.xla_metadata import set_xla_metadata  # noqa: E402

from rovtwin.core.processes.quiet import Quiet  # noqa: E402

Array = jax.Array

logger = logging.getLogger(__name__)


def cache_folder() -> Path:
    """Where compiled programs are kept: `$ROVTWIN_CACHE`, else the user's cache folder."""
    given = os.environ.get("ROVTWIN_CACHE")
    if given:
        return Path(given)
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "rovtwin"


jax.config.update("jax_enable_x64", True)
jax.config.update("jax_cpu_enable_async_dispatch", False)
jax.config.update("jax_compilation_cache_dir", str(cache_folder() / "jax"))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)
_quiet = Quiet()
jax.monitoring.register_event_listener(_quiet.begins)
jax.monitoring.register_event_duration_secs_listener(_quiet.ends)


def module_for(*values: Any) -> Any:
    """NumPy; jax.numpy where a value is under a trace (a gradient, a batch).

    For what is computed once, from parameters: outside compiled code each JAX operation on each shape is a program of
    its own, which takes 20 ms to compile. The results go through `as_array`.
    """
    return jnp if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(values)) else np


def as_array(value: object, dtype: Any = float) -> Array:
    """Array, float64 by default, of a number or nested sequence; a Python float in a module would get no gradient."""
    if not isinstance(value, Array):
        value = module_for(value).asarray(value, dtype=dtype)
    return jnp.asarray(value, dtype=dtype)


OPTIMISATION = "xla_backend_optimization_level"


def unoptimised() -> dict[str, bool | int | float | str] | None:
    """`compiler_options` of `jax.jit` for a program that runs once, or for seconds: to optimise it takes longer.

    None on an accelerator, and where the user sets the level. Fusions by way of MLIR take a tenth of the time of such a
    compilation (a flight's first second: 25.4 and 22.6 s of processor time) and make it no faster: jax 0.10 can leave
    them out.
    """
    if jax.default_backend() != "cpu" or OPTIMISATION in os.environ.get("XLA_FLAGS", ""):
        return None
    options: dict[str, bool | int | float | str] = {OPTIMISATION: 0}
    if jax.__version_info__ < (0, 11):
        options["xla_cpu_use_fusion_emitters"] = False
    return options


def jit_once(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    """`jax.jit` of a function that is called a few times in all: compiled in a third of the time, four times slower.

    Args:
        function: What to compile.
        options: As `jax.jit` takes them.
    """
    chosen: list[Callable[..., Any]] = []

    def call(*arguments: Any, **named: Any) -> Any:
        if not chosen:  # not before the first call, as the backend starts with it
            chosen.append(jax.jit(function, compiler_options=unoptimised(), **options))
        return chosen[0](*arguments, **named)

    return call


def _unmarked() -> Any:
    """A context in which calls have no mark: that of `in_one_piece` is of its own call, not of those inside."""
    return set_xla_metadata(xla_cpu_small_call=None, inlineable=None)


def shapes_in_one_piece(function: Callable[..., Any], *arguments: Any, **static: Any) -> Any:
    """`jax.eval_shape` of what `in_one_piece` compiles later on: its trace is kept and serves for both.

    JAX keeps a trace by the context in which it was made; one from outside would be made a second time.
    """
    with _unmarked():
        return jax.eval_shape(partial(function, **static), *arguments)


# How XLA says that it cannot compile something into one piece.
_NOT_WHOLE = ("UNIMPLEMENTED", "Failed to materialize symbols")


def in_one_piece(function: Callable[..., Any], quickly: bool = False, **options: Any) -> Callable[..., Any]:
    """`jax.jit` of a function that is called often and does little at a time, as a tick in real time does.

    On a processor, XLA starts the hundreds of small operations of such a function one by one, and compiles each by
    itself. Told that it is small, it compiles them into one piece, as it does with the bodies of loops: the
    autopilot's tick takes half as long, and what brings parameters into a loop is compiled in a tenth of the time.

    XLA cannot do that with all operations: not with products of larger matrices, scatters by indices, sorting or
    LAPACK. A function that has one is compiled as it is, which is logged at level DEBUG; XLA then writes a line of its
    own to standard error, so that a function for users should have none of them.

    Args:
        function: What to compile.
        quickly: Without optimisation, see `unoptimised`.
        options: As `jax.jit` takes them. Static arguments are named, and given by name.
    """

    @wraps(function)
    def whole(*arguments: Any, **named: Any) -> Any:
        @jax.jit
        def inner(*given: Any) -> Any:
            with _unmarked():
                return function(*given, **named)

        with set_xla_metadata(xla_cpu_small_call="true", inlineable="false"):
            return inner(*arguments)

    compiled: dict[str, Callable[..., Any]] = {}
    not_whole: set[tuple[Any, ...]] = set()

    def call(*arguments: Any, **static: Any) -> Any:
        if not compiled:  # not before the first call, as the backend starts with it
            how: dict[str, Any] = options | ({"compiler_options": unoptimised()} if quickly else {})
            plain = jax.jit(function, **how)
            compiled.update(plain=plain, whole=jax.jit(whole, **how) if jax.default_backend() == "cpu" else plain)
        key = tuple(static.values())
        if key not in not_whole:
            try:
                return compiled["whole"](*arguments, **static)
            except jax.errors.JaxRuntimeError as error:
                if not any(sign in str(error) for sign in _NOT_WHOLE):  # of the function itself
                    raise
                logger.debug("not in one piece: %s", error)
                not_whole.add(key)
        return compiled["plain"](*arguments, **static)

    return call


__all__ = [
    "Array",
    "as_array",
    "cache_folder",
    "in_one_piece",
    "jax",
    "jit_once",
    "jnp",
    "module_for",
    "shapes_in_one_piece",
    "unoptimised",
]
