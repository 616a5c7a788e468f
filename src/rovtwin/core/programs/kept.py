"""Compiled programs kept between processes under a key that needs no trace: a file each in `$ROVTWIN_CACHE/programs`.

JAX's own compilation cache finds a program by its StableHLO, which takes a trace to make: for a flight three times as
long as all the rest. Here the key is a digest of all that a trace could depend on (`Description`), of versions,
settings and the processor. Where anything has no description, such as a block of one's own, JAX's way is taken.

The files are pickles with machine code in them, like those of JAX's cache beside them: whoever may write to the folder
may run code as its owner. `ROVTWIN_CHECK_KEPT=1` traces all the same and compares.
"""

import hashlib
import importlib
import io
import logging
import os
import pickle
import platform
import sys
import threading
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

from jax.experimental import serialize_executable

from rovtwin.core.numerics import cache_folder, jax
from rovtwin.core.programs.description import LIBRARIES, OURS, Described, Description, Undescribed
from rovtwin.core.user_files.files import write_bytes


def _module(name: str) -> Any:
    """A module, None where there is none."""
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


# Of JAX what has no public name: where another version lacks any of it, nothing is kept.
compilation_cache: Any = _module("jax._src.compilation_cache")
config: Any = _module("jax._src.config")
_CAN_KEEP = all(
    hasattr(place, name)
    for place, name in (
        (config, "trace_context"),
        (compilation_cache, "extract_executable_and_time"),
        (compilation_cache, "combine_executable_and_time"),
        (serialize_executable, "_JaxPjrtPickler"),
    )
)

logger = logging.getLogger(__name__)

FORMAT = b"rovtwin program 1\n"
# Settings of JAX's that say where it writes and what it shows, and not what is computed.
_ASIDE = ("cache", "log", "dump", "traceback", "profil", "explain")
_DIGEST = 32  # bytes of SHA-256
_ONE = threading.Lock()  # one compilation at a time is looked at


class WrongProgram(RuntimeError):
    """`ROVTWIN_CHECK_KEPT` found a kept program that is not what would be compiled: a fault of this package."""


class Program(NamedTuple):
    """A compiled program and the digest of the StableHLO that it was made from."""

    call: Callable[..., Any]
    source: str


def is_checked() -> bool:
    """Whether each kept program is traced anew and compared."""
    return os.environ.get("ROVTWIN_CHECK_KEPT", "") not in ("", "0")


def key_of(function: Callable[..., Any], arguments: tuple[Any, ...], *details: Any) -> str | None:
    """A key of the program of a function for arguments of these shapes; None where no sound one can be given.

    Args:
        function: What is traced.
        arguments: Its arguments, of which structure, static fields, shapes and types count, and no values.
        details: Static arguments and all that changes the compilation.
    """
    leaves, structure = jax.tree.flatten(arguments)
    return _key(details, structure, tuple(form(leaf) for leaf in leaves), function)


def key_of_value(function: Callable[..., Any], arguments: tuple[Any, ...]) -> str | None:
    """The same of what a function gives for arguments of these values."""
    return _key(arguments, function)


def _key(*ingredients: Any) -> str | None:
    if not _CAN_KEEP or jax.default_backend() != "cpu" or not config.enable_compilation_cache.value:
        return None
    description = Description()
    try:
        for one in (_surroundings(), _settings(), *ingredients):
            description.put(one)
        return description.digest()
    except (Undescribed, ImportError, AttributeError) as error:  # of another JAX, what is asked of it may be missing
        logger.debug("not kept: %s", error)
        return None


def form(leaf: Any) -> tuple[Any, ...]:
    """What a trace sees of an array: shape, type, and whether the type is weak."""
    if hasattr(leaf, "dtype"):
        return (leaf.shape, str(leaf.dtype), getattr(leaf, "weak_type", False))
    return ((), type(leaf).__name__, True)


@cache
def _surroundings() -> tuple[Any, ...]:
    """Versions, flags and the processor: they stay as they are while a process runs."""
    versions = tuple(sorted((name, _version(name)) for name in LIBRARIES))
    flags = tuple(sorted((k, v) for k, v in os.environ.items() if k.startswith(("XLA_", "JAX_", "PJRT_"))))
    client = jax.devices()[0].client
    where = (client.platform, client.platform_version, tuple(device.device_kind for device in jax.devices()))
    return (FORMAT, sys.version, versions, _own_files(), flags, where, platform.machine(), _processor())


def _version(library: str) -> str:
    """Of what is installed, imported or not."""
    try:
        return metadata.version({"PIL": "pillow", "yaml": "PyYAML"}.get(library, library))
    except metadata.PackageNotFoundError:
        return ""


def _own_files() -> tuple[tuple[str, int, int], ...]:
    """Name, size and time of every file of this package: what is only imported within a function counts too."""
    root = Path(__file__).parents[2]
    stats = ((path.relative_to(root).as_posix(), path.stat()) for path in root.rglob("*.py"))
    return tuple(sorted((name, stat.st_size, stat.st_mtime_ns) for name, stat in stats))


def is_debugged() -> bool:
    """Whether JAX is to run step by step, or to look for what is no number: no program compiled ahead does either."""
    return _CAN_KEEP and (config.disable_jit.value or config.debug_nans.value or config.debug_infs.value)


def context() -> Any:
    """JAX's settings that a trace depends on, those of contexts too."""
    return config.trace_context() if _CAN_KEEP else None


def _processor() -> str:
    """What sets the instructions that may be used."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return " ".join((platform.processor(), platform.node()))
    return "\n".join(sorted({line for line in lines if line.startswith(("model name", "flags", "Features", "CPU "))}))


def _settings() -> tuple[Any, ...]:
    """JAX's settings as they are now, those of contexts too."""
    values = {name: value for name, value in jax.config.values.items() if not any(word in name for word in _ASIDE)}
    context = config.trace_context()
    axes = [item for item in context if type(item).__name__ == "AxisEnv"]
    meshes = [item for item in context if type(item).__name__ == "AbstractMesh"]
    if any(axis.axis_sizes or axis.spmd_axis_names for axis in axes) or not all(mesh.empty for mesh in meshes):
        raise Undescribed("a mapped axis, or a mesh of devices")
    return values, tuple(item for item in context if not any(item is one for one in (*axes, *meshes)))


class _Names(Described):
    """What the names in this package's modules stood for when something was traced last."""

    def __init__(self) -> None:
        self._held: dict[str, dict[str, Any]] = {}

    def described(self) -> Any:
        return None

    def changed(self) -> bool:
        """Whether one that was there stands for another object; from now on those of now count."""
        now = {name: dict(vars(module)) for name, module in list(sys.modules.items()) if name.partition(".")[0] == OURS}
        both = self._held.keys() & now.keys()
        found = any(held is not now[name].get(key, held) for name in both for key, held in self._held[name].items())
        self._held.update(now)
        return found


_names = _Names()


def forget_old_traces() -> None:
    """Before a program is traced that will be kept: it must not hold parts of what has changed since.

    JAX keeps the traces of functions inside (`traced_once`), whatever a constant has been set to meanwhile. So all are
    forgotten where a name in a module of this package stands for another object than when something was traced last.
    """
    if _names.changed():
        logger.debug("a name of this package was set anew: old traces are forgotten")
        jax.clear_caches()


def path_of(name: str, key: str) -> Path:
    """The file of what is kept under a key."""
    return cache_folder() / "programs" / f"{name}-{key}"


def load(name: str, key: str, arguments: tuple[Any, ...]) -> Program | None:
    """The program of a key, None if there is none that can be used."""
    return read(name, key, lambda held: _program(held, jax.tree.structure((arguments, {}))))


def _program(held: tuple[str, bytes, Any], takes: Any) -> Program:
    source, executable, gives = held
    return Program(serialize_executable.deserialize_and_load(executable, takes, gives), source)


def read(name: str, key: str, made: Callable[[Any], Any] = lambda held: held) -> Any:
    """What `made` makes of what is kept under a key, None if there is nothing that can be used."""
    path = path_of(name, key)
    try:
        raw = path.read_bytes()
    except OSError:
        return None
    try:
        return made(pickle.loads(_checked(raw, key)))
    except Exception as error:  # damaged, in a way that the digest does not show too
        logger.warning("%s: cannot be used (%s), made anew", path, " ".join(str(error).split())[:200])
        return None


def _checked(raw: bytes, key: str) -> bytes:
    """What is in a file, if it is whole and of this key."""
    head = FORMAT + key.encode()
    body = raw[len(head) + _DIGEST :]
    if not raw.startswith(head) or hashlib.sha256(body).digest() != raw[len(head) : len(head) + _DIGEST]:
        raise ValueError("found a damaged file")
    return zlib.decompress(body)


def write(name: str, key: str, held: Any) -> None:
    """Keep something under a key, whole or not at all, so that of two processes at once each leaves a whole file.

    Raises:
        OSError, PicklingError and others: It cannot be kept.
    """
    raw = _pickled(held)
    body = zlib.compress(raw, 1)
    path = path_of(name, key)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(path, FORMAT + key.encode() + hashlib.sha256(body).digest() + body)


def try_to_write(name: str, key: str, held: Any) -> None:
    """The same; what cannot be kept, or is not the same read back, is made anew next time."""
    try:
        if jax.tree.structure(pickle.loads(_pickled(held))) != jax.tree.structure(held):
            raise ValueError("what was written is not the same read back")
        write(name, key, held)
    except Exception as error:  # a full disk, or what cannot be pickled
        logger.debug("%s: not kept: %s", name, error)


@contextmanager
def noting() -> Iterator[list[bytes]]:
    """Gives a list of the executables that this thread meanwhile writes to JAX's cache or reads from it.

    From there and not from XLA: what it has read itself it does not write whole a second time, functions are lacking.
    The list is empty for a program that is in JAX's memory already.
    """
    found: list[bytes] = []
    if not _CAN_KEEP:
        yield found
        return
    thread = threading.get_ident()

    def noted(executable: bytes) -> None:
        if threading.get_ident() == thread:
            found.append(executable)

    with _ONE:
        read, written = compilation_cache.extract_executable_and_time, compilation_cache.combine_executable_and_time

        def reading(entry: bytes) -> Any:
            executable, seconds = read(entry)
            noted(executable)
            return executable, seconds

        def writing(executable: bytes, seconds: int) -> bytes:
            noted(executable)
            return written(executable, seconds)

        compilation_cache.extract_executable_and_time = reading
        compilation_cache.combine_executable_and_time = writing
        try:
            yield found
        finally:
            compilation_cache.extract_executable_and_time = read
            compilation_cache.combine_executable_and_time = written


def save(name: str, key: str, compiled: Any, in_cache: list[bytes], source: str) -> None:
    """Keep a compiled program; where that cannot be done it is compiled again next time.

    Written whole or not at all, so that of two processes at once each leaves a whole file.

    Args:
        name: Of the function.
        key: See `key_of`.
        compiled: A `jax.stages.Compiled`.
        in_cache: See `noting`.
        source: See `source_of`.
    """
    try:
        gives = compiled.out_tree
        if pickle.loads(_pickled(gives)) != gives:
            raise ValueError("what it gives is not the same read back")
        write(name, key, (source, _parts(compiled, in_cache), gives))
    except Exception as error:  # a full disk, or a program that JAX cannot write
        logger.debug("%s: not kept: %s", name, error)


def _parts(compiled: Any, in_cache: list[bytes]) -> bytes:
    """What `serialize_executable.serialize` gives, with the executable as JAX's cache has it."""
    if compiled._params.const_args or len(in_cache) != 1:
        raise ValueError("found constants that were handed over, or not just one program")
    with io.BytesIO() as file:
        _pickler(file, in_cache[0]).dump(
            (compiled._executable._unloaded_executable, jax.tree.leaves(compiled.args_info), compiled._no_kwargs)
        )
        return file.getvalue()


def _pickler(file: io.BytesIO, executable: bytes) -> pickle.Pickler:
    """JAX's own of programs, with the executable given."""
    theirs: Any = serialize_executable

    class WithExecutable(theirs._JaxPjrtPickler):
        def persistent_id(self, obj: Any) -> Any:
            if isinstance(obj, (theirs.xc.LoadedExecutable, theirs._jax.Executable)):
                return "exec", executable
            return super().persistent_id(obj)

    return WithExecutable(file)


class _Pickler(pickle.Pickler):
    def reducer_override(self, obj: Any) -> Any:
        # Equinox's mark of a field that is not set is compared by identity.
        return "MISSING" if type(obj).__name__ == "_Missing" else NotImplemented


def _pickled(value: Any) -> bytes:
    with io.BytesIO() as file:
        _Pickler(file, protocol=5).dump(value)
        return file.getvalue()


def source_of(lowered: Any) -> str:
    """A digest of the StableHLO of a program."""
    with io.BytesIO() as file:
        lowered.compiler_ir("stablehlo").operation.write_bytecode(file)
        return hashlib.sha256(file.getvalue()).hexdigest()
