"""JAX, configured once: float64, synchronous dispatch, a compilation cache that persists between processes.

Import `jnp` and `Array` from here, never configure JAX elsewhere: XLA reads its flags when it starts.
"""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast


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

P = ParamSpec("P")
T = TypeVar("T")


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


def _listen(quiet: Quiet) -> None:
    jax.monitoring.register_event_listener(quiet.begins)
    jax.monitoring.register_event_duration_secs_listener(quiet.ends)


_listen(Quiet())


def traced_once(function: Callable[P, T]) -> Callable[P, T]:
    """`jax.jit` of a function that is called many times in one program: traced once for arguments of one form.

    XLA puts its operations where it is called, so that the program is the same and only quicker to make: a tick of the
    autopilot has 140 cross products.
    """
    return cast(Callable[P, T], jax.jit(function))


def module_for(*values: Any) -> Any:
    """NumPy; jax.numpy where a value is under a trace (a gradient, a batch).

    For what is computed once, from parameters: outside compiled code each JAX operation on each shape is a program of
    its own, which takes 20 ms to compile. The results go through `as_array`.
    """
    return jnp if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(values)) else np


def in_numpy(tree: T) -> T:
    """The same with NumPy's arrays for JAX's, as `module_for` counts on; as it is where one is under a trace."""
    return tree if module_for(tree) is jnp else jax.tree.map(np.asarray, tree)


def as_array(value: object, dtype: Any = float) -> Array:
    """Array, float64 by default, of a number or nested sequence; a Python float in a module would get no gradient."""
    if not isinstance(value, Array):
        value = module_for(value).asarray(value, dtype=dtype)
    return jnp.asarray(value, dtype=dtype)


OPTIMISATION = "xla_backend_optimization_level"


def unoptimised() -> dict[str, bool | int | float | str] | None:
    """`compiler_options` of `jax.jit` for a program that runs once, or for seconds: to optimise it takes longer.

    None on an accelerator, and where the user sets the level. Left out besides: which pointers cannot alias, of use to
    optimisation alone (a fifth of the time of such a compilation), and with jax 0.10 fusions by way of MLIR (a tenth),
    which make it no faster.
    """
    if jax.default_backend() != "cpu" or OPTIMISATION in os.environ.get("XLA_FLAGS", ""):
        return None
    options: dict[str, bool | int | float | str] = {
        OPTIMISATION: 0,
        "xla_llvm_enable_alias_scope_metadata": False,
        "xla_llvm_enable_noalias_metadata": False,
    }
    if jax.__version_info__ < (0, 11):
        options["xla_cpu_use_fusion_emitters"] = False
    return options


__all__ = [
    "Array",
    "Tracer",
    "as_array",
    "cache_folder",
    "in_numpy",
    "jax",
    "jnp",
    "module_for",
    "set_xla_metadata",
    "traced_once",
    "unoptimised",
]
