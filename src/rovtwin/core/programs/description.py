"""A digest of all that a traced function can depend on: its code, its arguments' structure, the modules it reaches.

What is described is what is loaded, not what lies on the disk: a constant that was changed from outside, or a file that
was edited after it was imported, cannot hide. What has no description here makes the digest impossible
(`Undescribed`), never wrong.
"""

import collections
import dataclasses
import enum
import functools
import hashlib
import logging
import marshal
import operator
import pathlib
import re
import sys
import threading
import types
import typing
from collections.abc import Callable
from typing import Any

import numpy as np

from rovtwin.core.numerics import Array, Tracer, jax, jnp

OURS = "rovtwin"
# Of these a name and the version stand for the code; all others' code could change without either.
LIBRARIES = ("annotated_types", "equinox", "jax", "jaxlib", "jaxtyping", "ml_dtypes", "numpy", "opt_einsum")
LIBRARIES += ("PIL", "pydantic", "pydantic_core", "scipy", "typing_extensions", "wadler_lindig", "yaml")
TRUSTED = {OURS, "builtins", *sys.stdlib_module_names, *LIBRARIES} - {"__main__"}

# Of a class or module: where it came from and what it says of itself, which no computation reads.
_ASIDE = {"__annotations__", "__builtins__", "__cached__", "__dict__", "__doc__", "__file__", "__loader__", "__path__"}
_ASIDE |= {
    "__spec__",
    "__static_attributes__",
    "__firstlineno__",
    "__weakref__",
    "_abc_impl",
    "__annotations_cache__",
    "__slotnames__",
}
_ASIDE |= {"__dataclass_params__", "__match_args__", "__orig_bases__", "__parameters__"}
_ASIDE |= {"__annotate__", "__annotate_func__", "__conditional_annotations__"}
_PLAIN = (type(None), bool, int, float, complex, str, bytes, type(...), type(NotImplemented), range, slice)
_TYPING = (typing.TypeVar, typing.ParamSpec, types.GenericAlias, types.UnionType, typing.ForwardRef)
_SINGLE = (types.FunctionType, types.ModuleType, type)
_SLOTS = (types.MemberDescriptorType, types.GetSetDescriptorType, types.WrapperDescriptorType)
_BUILTIN = (types.BuiltinFunctionType, types.MethodDescriptorType, types.ClassMethodDescriptorType)
_BUILTIN += (types.MethodWrapperType, np.ufunc)
# Classes of others, written in Python, whose objects are what their attributes are.
_OPEN = {
    "equinox._module._module.Module",
    "typing.Generic",
    "abc.ABC",
    "collections.abc.Hashable",
    "enum.Enum",
    "enum.ReprEnum",
}
_OPEN |= {"pydantic_core._pydantic_core.PydanticUndefinedType", "equinox._module._flatten._Missing"}
_OPEN |= {f"dataclasses.{name}" for name in ("_MISSING_TYPE", "_HAS_DEFAULT_FACTORY_CLASS", "_DataclassParams")}
_Place = type(vars(typing.NamedTuple("_Place", [("first", int)]))["first"])  # of a field in a named tuple
_Jitted = type(jax.jit(lambda: None))


class Undescribed(Exception):
    """Something has no description that is sure to tell it from another."""


class Described:
    """Mixin of objects that say themselves what of them a computation depends on."""

    def described(self) -> Any:
        raise NotImplementedError


class Description:
    """A digest of what is put into it, and of all code and constants of this package that those refer to.

    A module counts as a whole as soon as one of its functions or classes does.
    """

    def __init__(self) -> None:
        self._hash = hashlib.blake2b(digest_size=20)
        self._words: list[str] = []  # not in the hash yet
        self._met: dict[int, int] = {}  # what was described before is a number
        self._alive: list[Any] = []  # ids are of living objects only
        self._inside: set[int] = set()
        self._waiting: list[types.ModuleType] = []

    def digest(self) -> str:
        """Of everything put in so far and the modules that it reaches.

        Raises:
            Undescribed: A module of this package holds something without a description.
        """
        while self._waiting:
            module = self._waiting.pop()
            self._say("module", module.__name__)
            self._named(vars(module), module.__name__)
        self._hash_words()
        return self._hash.hexdigest()

    def put(self, value: Any) -> None:
        """Put in a value.

        Raises:
            Undescribed: It, or something that it refers to, has no description.
        """
        if type(value) in _PLAIN:
            self._say(type(value).__name__, repr(value))
        elif isinstance(value, types.CodeType):
            self._code(value)
        elif isinstance(value, _SINGLE):
            if not self._before(value):
                self._compound(value)
        elif id(value) in self._inside:
            self._say("within itself")
        else:
            # In full each time: whether equal values are one object differs between what was made and what was read.
            self._inside.add(id(value))
            self._compound(value)
            self._inside.remove(id(value))

    def _say(self, *words: str | bytes) -> None:
        for word in words:
            if isinstance(word, bytes):
                self._hash_words()
                self._hash.update(b"%d:%b" % (len(word), word))
            else:
                self._words.append(f"{len(word)}:{word}")

    def _hash_words(self) -> None:
        """Those said so far, together: a hundred thousand of them one by one take a tenth of a flight's start."""
        self._hash.update("".join(self._words).encode("utf-8", "surrogatepass"))
        self._words.clear()

    def _before(self, value: Any) -> bool:
        number = self._met.get(id(value))
        if number is not None:
            self._say("again", str(number))
            return True
        self._met[id(value)] = len(self._met)
        self._alive.append(value)
        return False

    def _compound(self, value: Any) -> None:
        describe = _how(type(value))
        if describe is not None:
            describe(self, value)
            return
        origin = type(value).__module__
        if origin in ("typing", "jaxtyping", "typing_extensions"):  # an annotation
            self._say("annotation", _without_places(value))
        elif type(value).__name__ == "cython_function_or_method" or origin == "pydantic.fields":
            self._of_library(value)
        else:
            self._object(value)

    def _of_library(self, value: Any) -> None:
        """A function written in Cython, by its name; a field of pydantic's, by its default."""
        if type(value).__module__ == "pydantic.fields":
            self._say("field")
            self.put(value.default)
            self.put(value.default_factory)
        elif value.__module__.partition(".")[0] in LIBRARIES:
            self._say("function", value.__module__, value.__qualname__)
        else:
            raise Undescribed(f"function {value.__qualname__} of {value.__module__}")

    def _code(self, code: types.CodeType) -> None:
        # Without references between its parts, which depend on what else is alive; without the place of the file.
        self._say("code", marshal.dumps(_bare(code), 2))

    def _function(self, function: types.FunctionType) -> None:
        home = function.__globals__.get("__name__", "")
        ours = self._origin(home, function)
        self._say("function", home, function.__qualname__)
        if (
            not ours
            and _is_of_library(function.__module__)
            and (_found_by_name(function, home) or _found_by_name(function, function.__module__))
        ):
            return  # what wraps a function of this package has its name, and is described with what it holds
        self._code(function.__code__)
        kept = vars(function) if ours else {}  # what a library's decorator wraps is in its closure
        for part in (function.__defaults__, function.__kwdefaults__, kept):
            self.put(part)
        for cell in function.__closure__ or ():
            try:
                self.put(cell.cell_contents)
            except ValueError:
                self._say("empty")

    def _origin(self, name: str, value: Any) -> bool:
        """Whether a module is of this package, which is then described, too."""
        root = name.partition(".")[0]
        if root not in TRUSTED and not name.startswith("namedtuple_"):
            raise Undescribed(f"{getattr(value, '__qualname__', value)!s} of {name or 'nowhere'}")
        if root == OURS and (module := sys.modules.get(name)) is not None:
            self.put(module)
        return root not in TRUSTED or root == OURS

    def _module(self, module: types.ModuleType) -> None:
        self._say("module", module.__name__)
        root = module.__name__.partition(".")[0]
        if root not in TRUSTED:
            raise Undescribed(f"module {module.__name__}")
        if root == OURS:
            self._waiting.append(module)

    def _class(self, kind: type) -> None:
        self._say("class", kind.__module__, kind.__qualname__)
        if self._origin(kind.__module__, kind):
            for base in kind.__bases__:
                self.put(base)
            # What pydantic computes is computed from the rest.
            names = {name: value for name, value in vars(kind).items() if not _is_computed(kind, name)}
            self._named(names, kind.__qualname__)

    def _named(self, names: Any, where: str) -> None:
        for name in sorted(names):
            if name not in _ASIDE:
                self._say("name", name)
                try:
                    self.put(names[name])
                except Undescribed as error:
                    raise Undescribed(f"{where}.{name}: {error}") from None

    def _builtin(self, value: Any) -> None:
        self._say(type(value).__name__, f"{getattr(value, '__module__', '')} {getattr(value, '__qualname__', value)}")
        owner = getattr(value, "__self__", None)
        if not isinstance(owner, types.ModuleType | type | None):
            self.put(owner)

    def _beside(self, value: Any) -> None:
        """What an object of a subclass of dict, list or tuple holds besides."""
        if isinstance(value, collections.defaultdict):
            self.put(value.default_factory)
        if own := getattr(value, "__dict__", None):
            self._named(own, type(value).__qualname__)

    def _items(self, value: Any) -> None:
        self.put(type(value))
        self._beside(value)
        if type(value) is tuple and all(type(item) in _PLAIN for item in value):
            self._say(repr(value))
            return
        self._say(str(len(value)))
        for item in value:
            self.put(item)

    def _pairs(self, value: Any) -> None:
        self.put(type(value))
        self._beside(value)
        self._say(str(len(value)))
        for name, item in value.items():
            self.put(name)
            self.put(item)

    def _set(self, value: Any) -> None:
        self._say("set", type(value).__name__)
        if not all(isinstance(item, _PLAIN) for item in value):
            raise Undescribed(f"a set of {sorted({type(item).__name__ for item in value})}")
        for item in sorted(repr(item) for item in value):
            self._say(item)

    def _array(self, value: Any) -> None:
        if isinstance(value, Tracer) or (isinstance(value, Array) and jnp.issubdtype(value.dtype, jax.dtypes.extended)):
            raise Undescribed(f"an array of {type(value).__name__}")
        held = np.asarray(value)
        if held.dtype.hasobject:
            raise Undescribed("an array of Python objects")
        weak = str(getattr(value, "weak_type", False))
        self._say("array", type(value).__name__, held.dtype.str, str(held.shape), weak, held.tobytes())

    def _object(self, value: Any) -> None:
        """An object of a class written in Python: the class, and all attributes."""
        kind = type(value)
        if not all(map(_is_open, kind.__mro__[:-1])):  # an object() holds nothing
            raise Undescribed(f"an object of {kind.__module__}.{kind.__qualname__}")
        self.put(kind)
        slots = [slot for base in kind.__mro__ for slot in _slots_of(base) if hasattr(value, slot)]
        self._named(getattr(value, "__dict__", {}) | {slot: getattr(value, slot) for slot in slots}, kind.__qualname__)


def _bare(code: types.CodeType) -> types.CodeType:
    """The same code without file and lines."""
    consts = tuple(_bare(one) if isinstance(one, types.CodeType) else one for one in code.co_consts)
    return code.replace(co_filename="", co_firstlineno=1, co_linetable=b"", co_consts=consts)


def _without_places(annotation: Any) -> str:
    """What an annotation reads, without addresses of the functions in it."""
    return re.sub(r" at 0x[0-9a-f]+", "", repr(annotation))


def _is_of_library(module: str | None) -> bool:
    return (module or "").partition(".")[0] not in (OURS, "")


def _found_by_name(function: types.FunctionType, home: str) -> bool:
    found: Any = sys.modules.get(home)
    for part in function.__qualname__.split("."):
        found = getattr(found, part, None)
    return found is function


def _is_computed(kind: type, name: str) -> bool:
    return type(kind).__module__.startswith("pydantic.") and (
        name == "__signature__" or (name.startswith("__pydantic_") and name != "__pydantic_fields__")
    )


def _is_open(kind: type) -> bool:
    """Whether all that an object of a class holds is in attributes; classes written in C may hide something."""
    return kind.__module__.partition(".")[0] == OURS or f"{kind.__module__}.{kind.__qualname__}" in _OPEN


def _slots_of(kind: type) -> tuple[str, ...]:
    slots = vars(kind).get("__slots__", ())
    return tuple(s for s in ((slots,) if isinstance(slots, str) else slots) if s not in ("__dict__", "__weakref__"))


def _parts(*names: str) -> Callable[[Description, Any], None]:
    def describe(description: Description, value: Any) -> None:
        description._say(type(value).__name__)
        for name in names:
            description.put(getattr(value, name))

    return describe


def _structure(description: Description, structure: Any) -> None:
    """Nodes, static fields and places of leaves of a pytree's structure."""
    description.put(structure.node_data())
    children = structure.children()
    description.put(len(children))
    for child in children:
        _structure(description, child)


def _by(text: Callable[[Any], str]) -> Callable[[Description, Any], None]:
    return lambda description, value: description._say(type(value).__name__, text(value))


def _by_itself(description: Description, value: Described) -> None:
    description.put(type(value))
    description.put(value.described())


_HOW: list[tuple[Any, Callable[[Description, Any], None]]] = [
    (Described, _by_itself),
    (enum.Enum, _parts("__class__", "name")),
    (types.FunctionType, Description._function),
    (_Jitted, _parts("__wrapped__")),
    (jax.tree_util.PyTreeDef, _structure),
    (type, Description._class),
    (types.ModuleType, Description._module),
    ((np.ndarray, np.generic, Array), Description._array),
    ((np.dtype, pathlib.PurePath), _by(str)),
    (_TYPING, _by(_without_places)),
    (type(threading.Lock()), _by(lambda lock: "")),
    (logging.Logger, _by(lambda logger: logger.name)),
    (re.Pattern, _parts("pattern", "flags")),
    (types.MethodType, _parts("__func__", "__self__")),
    (_BUILTIN, Description._builtin),
    (_SLOTS, _by(lambda value: value.__name__)),
    ((staticmethod, classmethod), _parts("__func__")),
    (property, _parts("fget", "fset", "fdel")),
    (functools.partial, _parts("func", "args", "keywords")),
    (functools.cached_property, _parts("func")),
    (functools._lru_cache_wrapper, _parts("__wrapped__")),
    (operator.itemgetter, _by(lambda getter: repr(getter.__reduce__()[1]))),
    (_Place, _by(lambda place: str(place.__reduce__()[1][0]))),
    (dataclasses.Field, _parts("name", "metadata")),  # its default is in the class, or in `__init__`
    ((tuple, list), Description._items),
    ((dict, types.MappingProxyType), Description._pairs),
    ((set, frozenset), Description._set),
]


@functools.cache
def _how(kind: type) -> Callable[[Description, Any], None] | None:
    return next((describe for kinds, describe in _HOW if issubclass(kind, kinds)), None)
