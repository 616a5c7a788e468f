"""What a pure function gives, computed once: remembered in the process, and kept between processes.

For what follows from a vehicle and takes longer than to read it again, or needs libraries that take long to import.
"""

import copy
import pickle
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Generic, ParamSpec, TypeVar

from rovtwin.core.numerics import Tracer, jax
from rovtwin.core.programs import kept
from rovtwin.core.programs.description import Described

P = ParamSpec("P")
T = TypeVar("T")

MOST = 64  # arguments whose results are remembered


class Once(Described, Generic[P, T]):
    """A function that is computed once for the same objects, which must never change, as no module of Equinox does."""

    def __init__(self, function: Callable[P, T], between_processes: bool):
        self._function, self._between = function, between_processes
        self._known: OrderedDict[tuple[int, ...], tuple[Any, T]] = OrderedDict()
        self.__doc__, self.__name__ = function.__doc__, getattr(function, "__name__", "value")

    def described(self) -> Any:
        return self._function

    def __call__(self, *arguments: P.args, **named: P.kwargs) -> T:
        if named or any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(arguments)):
            return self._function(*arguments, **named)
        which = tuple(map(id, arguments))
        if which not in self._known:
            if len(self._known) >= MOST:
                self._known.popitem(last=False)
            found = (self._kept if self._between else self._function)(*arguments, **named)
            self._known[which] = arguments, found  # an id is of a living object only
        else:
            found = self._known[which][1]
        return copy.deepcopy(found) if isinstance(found, dict | list) else found  # which a caller may change

    def _kept(self, *arguments: P.args, **named: P.kwargs) -> T:
        key = kept.key_of_value(self._function, arguments)
        held = kept.read(self.__name__, key) if key else None
        if held is not None and not kept.is_checked():
            return held[0]
        found = self._function(*arguments, **named)
        if held is not None and pickle.dumps(held[0]) != pickle.dumps(found):
            raise kept.WrongProgram(f"{self.__name__}: found another value than that of its key")
        if key and held is None:
            kept.try_to_write(self.__name__, key, (found,))
        return found


def once(function: Callable[P, T]) -> Once[P, T]:
    """Computed once in a process for the same arguments."""
    return Once(function, between_processes=False)


def once_and_for_all(function: Callable[P, T]) -> Once[P, T]:
    """Computed once for equal arguments, by what they and the function are made of; `ROVTWIN_CACHE` keeps the result.

    Only for pure functions, of which no warning is lost, and whose results are arrays, numbers and what holds them.
    """
    return Once(function, between_processes=True)
