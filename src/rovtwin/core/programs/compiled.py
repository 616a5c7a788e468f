"""Functions compiled once and for all: those called a few times in all, and those called often that do little.

Both are kept between processes by what they are made of, see `kept`, so that the next process traces nothing.
"""

import logging
from collections.abc import Callable, Hashable
from functools import partial, wraps
from typing import Any

from rovtwin.core.numerics import Tracer, jax, set_xla_metadata, unoptimised
from rovtwin.core.programs import kept
from rovtwin.core.programs.description import Described

logger = logging.getLogger(__name__)

# How XLA says that it cannot compile something into one piece.
_NOT_WHOLE = ("UNIMPLEMENTED", "Failed to materialize symbols")


def jit_once(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    """`jax.jit` of a function that is called a few times in all: compiled in a third of the time, four times slower.

    Args:
        function: What to compile.
        options: As `jax.jit` takes them. Static arguments are named, and given by name.
    """
    return Compiled(function, whole=False, quickly=True, options=options)


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
    return Compiled(function, whole=True, quickly=quickly, options=options)


def _unmarked() -> Any:
    """A context in which calls have no mark: that of `in_one_piece` is of its own call, not of those inside."""
    return set_xla_metadata(xla_cpu_small_call=None, inlineable=None)


def shapes_in_one_piece(function: Callable[..., Any], *arguments: Any, **static: Any) -> Any:
    """`jax.eval_shape` of what `in_one_piece` compiles later on: its trace serves for both, and what it gives is kept.

    JAX keeps a trace by the context in which it was made; one from outside would be made a second time.
    """
    name, key = f"{_name(function)}-shapes", kept.key_of(function, arguments, static)
    held = kept.read(name, key) if key else None
    if held is not None and not kept.is_checked():
        return held
    kept.forget_old_traces()
    with _unmarked():
        found = jax.eval_shape(partial(function, **static), *arguments)
    if held is not None and jax.tree.flatten(held) != jax.tree.flatten(found):
        raise kept.WrongProgram(f"{kept.path_of(name, key or '')}: found other shapes than those of its key")
    if key and held is None:
        kept.try_to_write(name, key, found)
    return found


def _name(function: Callable[..., Any]) -> str:
    """Of the files of what is kept of a function."""
    return getattr(function, "__name__", "program").strip("_<>")


def _marked(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function, marked as one that is to be compiled into one piece."""

    @wraps(function)
    def whole(*arguments: Any, **named: Any) -> Any:
        @jax.jit
        def inner(*given: Any) -> Any:
            with _unmarked():
                return function(*given, **named)

        with set_xla_metadata(xla_cpu_small_call="true", inlineable="false"):
            return inner(*arguments)

    return whole


def _forget_places(lowered: Any) -> None:
    """Take the names and lines of source files out of a program: a tenth of what it takes to read it again."""
    try:
        from jaxlib.mlir.passmanager import PassManager

        module = lowered.compiler_ir("stablehlo")
        with module.context:
            PassManager.parse("builtin.module(strip-debuginfo)").run(module.operation)
    except (ImportError, AttributeError, ValueError) as error:  # another JAX
        logger.debug("with names of source files: %s", error)


def _form(leaf: Any) -> Any:
    """As `kept.form`, for looking up in this process: a tick in real time has microseconds for it."""
    dtype = getattr(leaf, "dtype", None)
    return kept.form(leaf) if dtype is None else (leaf.shape, dtype, getattr(leaf, "weak_type", False))


class Compiled(Described):
    """A function with a compiled program for each form of its arguments."""

    def __init__(self, function: Callable[..., Any], whole: bool, quickly: bool, options: dict[str, Any]):
        self._function, self._whole, self._quickly, self._options = function, whole, quickly, options
        self._jitted: dict[bool, Callable[..., Any]] = {}
        self._programs: dict[Hashable, Callable[..., Any]] = {}

    def described(self) -> Any:
        return self._function, self._whole, self._quickly, self._options

    def __call__(self, *arguments: Any, **static: Any) -> Any:
        if kept.is_debugged():
            return self._jit(self._whole)(*arguments, **static)
        leaves, structure = jax.tree.flatten(arguments)
        form = (kept.context(), structure, *[_form(leaf) for leaf in leaves], *static.items())
        program = self._programs.get(form)
        if program is None:
            if any(isinstance(leaf, Tracer) for leaf in leaves):
                return self._jit(self._whole)(*arguments, **static)
            program = self._programs[form] = self._program(arguments, static)
        return program(*arguments)

    @property
    def _how(self) -> dict[str, Any]:
        return self._options | ({"compiler_options": unoptimised()} if self._quickly else {})

    def _program(self, arguments: tuple[Any, ...], static: dict[str, Any]) -> Callable[..., Any]:
        """For arguments of this form: the one kept, or compiled now and kept."""
        name = _name(self._function)
        key = kept.key_of(self, arguments, static, self._how)
        found = kept.load(name, key, arguments) if key else None
        if found and not kept.is_checked():
            return found.call
        kept.forget_old_traces()
        lowered, compiled, in_cache = self._compile(arguments, static)
        if found and found.source != kept.source_of(lowered):
            raise kept.WrongProgram(f"{kept.path_of(name, key or '')}: found another program than that of its key")
        if key and not found:
            kept.save(name, key, compiled, in_cache, kept.source_of(lowered))
        return compiled

    def _compile(self, arguments: tuple[Any, ...], static: dict[str, Any]) -> tuple[Any, Any, list[bytes]]:
        """The program lowered and compiled, and what JAX's cache has of it."""
        for whole in (True, False) if self._whole and jax.default_backend() == "cpu" else (False,):
            lowered = self._jit(whole).trace(*arguments, **static).lower()
            _forget_places(lowered)
            try:
                with kept.noting() as in_cache:
                    compiled = lowered.compile()
                # One in pieces is not kept, so that each process says it.
                return lowered, compiled, in_cache if whole == self._whole else []
            except jax.errors.JaxRuntimeError as error:
                if not whole or not any(sign in str(error) for sign in _NOT_WHOLE):  # of the function itself
                    raise
                logger.debug("not in one piece: %s", error)
        raise AssertionError("unreachable")

    def _jit(self, whole: bool) -> Any:
        if whole not in self._jitted:  # not before the first call, as the backend starts with it
            function = _marked(self._function) if whole else self._function
            self._jitted[whole] = jax.jit(function, **self._how)
        return self._jitted[whole]
